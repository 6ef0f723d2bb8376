"""The hand and an object in MuJoCo: a second judge of agents, with contacts and a solver of its own.

The package ``mujoco`` is in the extra ``transfer``; everything here says so where it is missing.
"""
