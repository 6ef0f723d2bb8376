"""The hand: kinematic table, URDF, impedance controller, command filter."""
