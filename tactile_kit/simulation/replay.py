"""A dumped episode played again."""

from __future__ import annotations

import numpy as np

from tactile_kit.simulation.dump import Dump, DumpError
from tactile_kit.simulation.episode import Status
from tactile_kit.simulation.simulator import Simulator


def replay(dump: Dump, simulator: Simulator) -> Status:
    """Play the episode again in ``simulator``; returns how it ended (``simulator.fault`` says with what fault).

    Raises:
        DumpError: the simulator is of another task or physics, or its last good state differs from the dump's.
    """
    start = dump.start
    bodies = [body.name for body in simulator.bodies]
    found = {
        "body": bodies[start["variant"]] if 0 <= start["variant"] < len(bodies) else None,
        "horizon": simulator.horizon,
        "config": simulator.world.config.model_dump(),
    }
    other = [
        f"{name}: {start.get(name)!r} -> {value!r}"
        for name, value in found.items()
        if start.get(name) != value
    ]
    if not other:
        simulator.reset(start["variant"], start["seed"], start["gravity"])
        drawn = {name: np.asarray(value, dtype=np.float64) for name, value in simulator.physics.items()}
        names = sorted(drawn.keys() | dump.physics.keys())
        other = [name for name in names if not np.array_equal(drawn.get(name), dump.physics.get(name))]  # type: ignore[arg-type]
    if other:
        raise DumpError("the dump is of another simulation: " + "; ".join(other))
    for action in dump.actions:
        status = simulator.step(action)
        if status:
            break
    differing = [
        name
        for name, value in dump.state.items()
        if not np.array_equal(getattr(simulator.world, name), value)
    ]
    if differing:
        raise DumpError(f"the replay's last good state differs from the dump's in {', '.join(differing)}")
    return status
