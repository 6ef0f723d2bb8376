"""Many simulators over worker processes, states in shared memory.

The parent writes actions and the episodes that come next; a worker steps its simulators, writes their states, and
starts the next episode where one has ended. Workers hold no random state, so results don't depend on their number.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tactile_kit.hand.kinematics import JOINTS
from tactile_kit.simulation.config import SAMPLES
from tactile_kit.simulation.simulator import Simulator, Status

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
TIMEOUT = 300.0  # s without an answer after which a worker counts as hung


class WorkerError(RuntimeError):
    """A worker process raised, died or hung; the message holds its traceback where there is one."""


@dataclass(frozen=True)
class Blueprint:
    """What a worker needs to build its simulators (arguments of :class:`Simulator`)."""

    config: Any
    bodies: Sequence[Any]
    bank: Any
    preset: Any
    horizon: int
    relative: bool

    def build(self, visible: bool = False) -> Simulator:
        """A new simulator."""
        return Simulator(
            self.config, self.bodies, self.bank, self.preset, self.horizon, self.relative, visible
        )


def _views(memory: dict[str, Any], environments: int) -> dict[str, np.ndarray]:
    views: dict[str, np.ndarray] = {}
    for name, (shape, dtype) in FIELDS.items():
        views[name] = np.frombuffer(memory[name], dtype=dtype).reshape(environments, *shape)
    return views


class _Group:
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
                ended[index] = {
                    "fault": simulator.fault,
                    "steps": simulator.elapsed,
                    "physics": simulator.physics,
                }
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


def _work(pipe: Any, blueprint: Blueprint, memory: dict[str, Any], environments: int, members: range) -> None:
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when to stop
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    parent = os.getppid()
    try:
        group = _Group(blueprint, _views(memory, environments), members)
        pipe.send(("ready", None))
        while True:
            while not pipe.poll(5.0):
                if os.getppid() != parent:  # the parent is gone: leave no process behind
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


class VectorSimulation:
    """``environments`` simulators over ``workers`` processes (0: in this process).

    Attributes:
        views: the shared arrays of ``FIELDS``, first axis environments.
    """

    def __init__(self, blueprint: Blueprint, environments: int, workers: int) -> None:
        if environments < 1:
            raise ValueError(f"num_envs = {environments}: allowed are 1 and more")
        if not 0 <= workers <= environments:
            raise ValueError(f"num_workers = {workers}: allowed are 0 to the {environments} environments")
        context = multiprocessing.get_context("spawn")
        memory = {
            name: context.RawArray(
                "b", environments * int(np.prod(shape, dtype=int)) * np.dtype(dtype).itemsize
            )
            for name, (shape, dtype) in FIELDS.items()
        }
        self.views = _views(memory, environments)
        self._pipes: list[Any] = []
        self._processes: list[Any] = []
        self._group: _Group | None = None
        if workers == 0:
            self._group = _Group(blueprint, self.views, range(environments))
            return
        bounds = np.linspace(0, environments, workers + 1).astype(int)
        for first, last in itertools.pairwise(bounds.tolist()):
            ours, theirs = context.Pipe()
            process = context.Process(
                target=_work, args=(theirs, blueprint, memory, environments, range(first, last)), daemon=True
            )
            with _light_main():
                process.start()
            theirs.close()
            self._pipes.append(ours)
            self._processes.append(process)
        for worker in range(workers):
            self._answer(worker)

    def _answer(self, worker: int) -> Any:
        pipe, process = self._pipes[worker], self._processes[worker]
        try:
            if not pipe.poll(TIMEOUT):
                self.close()
                raise WorkerError(f"worker {worker} did not answer for {TIMEOUT:.0f} s")
            kind, value = pipe.recv()
        except (EOFError, OSError) as error:
            process.join(1.0)
            self.close()
            raise WorkerError(f"worker {worker} died with exit code {process.exitcode}") from error
        if kind == "error":
            self.close()
            raise WorkerError(f"worker {worker} failed:\n{value}")
        return value

    @property
    def simulators(self) -> list[Simulator]:
        """The simulators of this process; empty where workers hold them."""
        return [] if self._group is None else self._group.simulators

    def reset(self) -> None:
        """Start the next episode everywhere; states in ``z0, x0, R0, q0``."""
        self._require_open()
        if self._group is not None:
            self._group.reset()
            return
        for pipe in self._pipes:
            pipe.send_bytes(b"reset")
        for worker in range(len(self._pipes)):
            self._answer(worker)

    def step_async(self) -> None:
        """Begin a step with the actions in ``views``."""
        self._require_open()
        for worker, pipe in enumerate(self._pipes):
            try:
                pipe.send_bytes(b"step")
            except OSError:
                self._answer(worker)

    def step_wait(self) -> dict[int, dict[str, Any]]:
        """Finish the step; returns ``fault``, ``steps`` and ``physics`` of episodes that ended, by environment."""
        if self._group is not None:
            return self._group.step()
        ended: dict[int, dict[str, Any]] = {}
        for worker in range(len(self._pipes)):
            ended.update(self._answer(worker))
        return ended

    def _require_open(self) -> None:
        if self._group is None and not self._pipes:
            raise WorkerError("the simulation is closed: a worker failed before, or close() was called")

    def close(self) -> None:
        """End all workers."""
        if self._group is not None:
            self._group.close()
            self._group = None
        for pipe, process in zip(self._pipes, self._processes, strict=True):
            try:
                pipe.send_bytes(b"close")
            except OSError:
                pass
            process.join(2.0)
            if process.is_alive():
                process.kill()
            pipe.close()
        self._pipes, self._processes = [], []


class _light_main:
    """Keeps spawned workers from importing the parent's main module, which may import torch."""

    def __enter__(self) -> None:
        self._main = sys.modules["__main__"]
        self._kept = {
            name: self._main.__dict__.pop(name) for name in ("__file__",) if hasattr(self._main, name)
        }
        self._spec = getattr(self._main, "__spec__", None)
        self._main.__spec__ = None

    def __exit__(self, *_: object) -> None:
        self._main.__spec__ = self._spec
        self._main.__dict__.update(self._kept)
