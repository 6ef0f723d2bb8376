"""Where each quantity of an environment stands: the rows of the table that the kernel reads and writes.

The table is ``(ROWS, P) float32``, a column an environment, so that one row of ``LANES`` columns is one vector. This is
the one place where a quantity gets its rows; ``Batch`` shows them by name.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

FINGERS, DRIVEN, SAMPLES = 4, 3, 6
BALLS = 5  # spheres a finger: three along the distal capsule, two along the middle one
TIP_BALLS = 3
_JOINTS = (FINGERS, DRIVEN)


class Quantities(NamedTuple):
    """One value a quantity; the defaults are the shapes of one environment's entries, in SI units."""

    # what holds for an episode
    mass: Any = ()
    moments: Any = (3,)  # of inertia, kg m^2, in the object's frame of principal axes
    gravity: Any = ()
    tip_friction: Any = ()
    link_friction: Any = ()
    spin_friction: Any = ()  # m
    stiffness: Any = ()  # Nm/rad that the controller and the drive's elasticity leave
    limit: Any = ()  # rad of control error at which the drive's torque ends
    give: Any = ()  # share of the control error that the motor stands ahead of the joint
    damping: Any = (FINGERS, DRIVEN, DRIVEN)  # Nms/rad
    feedforward: Any = _JOINTS  # Nm
    stick: Any = _JOINTS  # Nm of dry friction
    offset: Any = _JOINTS  # rad of the measurement
    calm: Any = ()  # share of the object's speed that drag leaves in a physics step
    origin: Any = (3,)  # m, first node of the grid of distances, object's frame
    cells: Any = (3,)  # 1/m, nodes of that grid a metre
    # what holds for a control step
    force: Any = (3,)  # N at the centre of mass, world frame
    torque: Any = (3,)  # Nm, world frame
    target: Any = _JOINTS  # rad, before the command filter
    noise: Any = (SAMPLES, *_JOINTS)  # rad of the measured angles
    # the state; from here on the kernel writes
    filtered: Any = _JOINTS  # rad, the command
    q: Any = _JOINTS
    dq: Any = _JOINTS
    place: Any = (3,)  # m, of the centre of mass, world frame
    quaternion: Any = (4,)  # of the principal axes, x y z w
    velocity: Any = (6,)  # m/s and rad/s, world frame
    # impulses of the last physics step: Ns in the world frame, Nms about the normal
    memory: Any = (FINGERS, BALLS, 4)
    # what is measured
    z: Any = (SAMPLES, 2, *_JOINTS)  # motor-side angles and control errors, rad
    deepest: Any = ()  # m: least distance of a finger from the object within the control step, 0 at most


SHAPES: dict[str, tuple[int, ...]] = Quantities._field_defaults
SIZES = {name: math.prod(shape) for name, shape in SHAPES.items()}
at = Quantities(*(sum(list(SIZES.values())[:number]) for number in range(len(SIZES))))  # first rows
ROWS = sum(SIZES.values())
FIRST_WRITTEN = at.filtered
