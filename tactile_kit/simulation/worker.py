"""What a worker process does: steps its part of the simulators, and says what went wrong."""

from __future__ import annotations

import faulthandler
import os
import signal
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.simulation.config import SAMPLES
from tactile_kit.simulation.episode import Status
from tactile_kit.simulation.simulator import Simulator

# name: (shape of one environment's entry, dtype)
FIELDS: dict[str, tuple[tuple[int, ...], type]] = {
    "action": ((JOINTS,), np.float32),
    "next_variant": ((), np.int64),
    "next_seed": ((), np.int64),
    "next_gravity": ((), np.float64),
    "status": ((), np.int64),
    # after the step, before any new episode
    "z": ((SAMPLES * 2 * JOINTS,), np.float32),
    "x": ((3,), np.float64),
    "R": ((3, 3), np.float64),
    "q": ((JOINTS,), np.float64),
    # where an episode ended: first state of the next one
    "z0": ((SAMPLES * 2 * JOINTS,), np.float32),
    "x0": ((3,), np.float64),
    "R0": ((3, 3), np.float64),
    "q0": ((JOINTS,), np.float64),
}


@dataclass(frozen=True)
class Blueprint:
    """What a worker needs to build its simulators (arguments of :class:`Simulator`)."""

    config: Any
    bodies: Sequence[Any]
    bank: Any
    preset: Any
    horizon: int

    def build(self, visible: bool = False) -> Simulator:
        """A new simulator."""
        return Simulator(self.config, self.bodies, self.bank, self.preset, self.horizon, visible)


def views_of(memory: dict[str, Any], environments: int) -> dict[str, np.ndarray]:
    views: dict[str, np.ndarray] = {}
    for name, (shape, dtype) in FIELDS.items():
        views[name] = np.frombuffer(memory[name], dtype=dtype).reshape(environments, *shape)
    return views


class Group:
    """The simulators of one worker and their part of the shared arrays."""

    def __init__(self, blueprint: Blueprint, views: dict[str, np.ndarray], members: range) -> None:
        self.views, self.members = views, members
        self.simulators = [blueprint.build() for _ in members]

    def reset(self) -> None:
        for simulator, index in zip(self.simulators, self.members, strict=True):
            self._start(simulator, index)

    def step(self) -> dict[int, dict[str, Any]]:
        """Step all; returns what is known of ended episodes."""
        ended = {}
        views = self.views
        for simulator, index in zip(self.simulators, self.members, strict=True):
            status = simulator.step(views["action"][index].astype(np.float64))
            views["status"][index] = status
            simulator.read(*(views[name][index] for name in ("z", "x", "R", "q")))
            if status != Status.RUNNING:
                end: dict[str, Any] = {
                    "fault": simulator.fault,
                    "steps": simulator.elapsed,
                    "physics": simulator.physics,
                }
                if status == Status.FAULT:
                    end["dump"] = simulator.dump()
                ended[index] = end
                self._start(simulator, index)
        return ended

    def _start(self, simulator: Simulator, index: int) -> None:
        views = self.views
        simulator.reset(
            int(views["next_variant"][index]),
            int(views["next_seed"][index]),
            float(views["next_gravity"][index]),
        )
        simulator.read(*(views[name][index] for name in ("z0", "x0", "R0", "q0")))

    def close(self) -> None:
        for simulator in self.simulators:
            simulator.close()


def work(
    pipe: Any, blueprint: Blueprint, memory: dict[str, Any], environments: int, members: range, stack: str
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    # Schedulers send SIGTERM to every process of a job, and the parent may still need steps to reach its checkpoint.
    told: list[int] = []
    signal.signal(signal.SIGTERM, lambda number, frame: told.append(number))
    where = open(stack, "wb", buffering=0)  # noqa: SIM115  # must stay open for the signal's handler
    faulthandler.register(signal.SIGUSR1, file=where)  # asked for when this worker hangs
    parent = os.getppid()
    try:
        group = Group(blueprint, views_of(memory, environments), members)
        pipe.send(("ready", None))
        while True:
            while not pipe.poll(5.0):
                if told or os.getppid() != parent:  # nobody asks any more: leave no process behind
                    return
            command = pipe.recv_bytes()
            if command == b"close":
                group.close()
                return
            if command == b"step":
                pipe.send(("done", group.step()))
            else:
                group.reset()
                pipe.send(("done", None))
    except (EOFError, BrokenPipeError):
        return
    except BaseException:
        pipe.send(("error", traceback.format_exc()))
