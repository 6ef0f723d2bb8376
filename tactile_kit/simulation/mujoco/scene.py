"""One MuJoCo model of the hand and an object, from the hand's kinematic table and what ``object-sets export`` writes.

MuJoCo's own ways are kept where it has them: its Newton solver, implicit damping of joints, elliptic friction cones.
"""

from __future__ import annotations

import functools
from typing import Any

from object_sets import Object
from object_sets.exporters import mjcf
from tactile_kit.errors import EngineError
from tactile_kit.hand.mjcf import hand_mjcf
from tactile_kit.simulation.engines import engine_of

# Time (s) in which a contact takes an overlap back. MuJoCo's default of 0.02 lets tips sink in by millimetres under the
# controller's forces; it has to be two physics steps at least.
CONTACT_TIME = 0.005
# Of the friction's stiffness to the normal's. At MuJoCo's default of 1 what is held creeps out of the hand (its
# documentation, "Slip"); it recommends larger ratios with elliptic cones for grasping.
FRICTION_RATIO = 10.0
OBJECT = "object_"  # before the names of the object's parts in the model


def load_mujoco() -> Any:
    """The package ``mujoco``. Raises EngineError where it is not installed."""
    engine_of("mujoco").require()
    import mujoco

    return mujoco


@functools.lru_cache(maxsize=256)
def scene(thing: Object, mass: float, filter_time_constant: float, steps_per_second: int) -> Any:
    """The ``MjModel`` of the hand with ``thing`` of ``mass`` kg as its last body; never changed, copied by who uses it.

    Raises:
        EngineError: mujoco is not installed, the object has no convex parts, or MuJoCo refuses what it is given.
    """
    mujoco = load_mujoco()
    if not thing.parts:
        raise EngineError(
            f"{thing.name}: no convex parts to touch it by; allowed are objects with one or more"
        )
    files = mjcf.files(thing, mass)
    assets = {name: text.encode() for name, text in files.items() if name.endswith(".obj")}
    try:
        spec = mujoco.MjSpec.from_string(hand_mjcf(filter_time_constant))
        held = mujoco.MjSpec.from_string(files[f"{thing.name}.xml"], assets=assets)
        spec.attach(held, frame=spec.worldbody.add_frame(), prefix=OBJECT)
        spec.compiler.discardvisual = True
        option = spec.option
        option.timestep = 1.0 / steps_per_second
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = FRICTION_RATIO
        for geom in spec.geoms:
            geom.solref = [CONTACT_TIME, 1.0]
        return spec.compile()
    except ValueError as problem:
        raise EngineError(f"{thing.name}: MuJoCo refuses it: {' '.join(str(problem).split())}") from None
