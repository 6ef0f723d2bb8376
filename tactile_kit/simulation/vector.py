"""Many simulators over worker processes, states in shared memory.

The parent writes actions and the episodes that come next; a worker steps its simulators, writes their states, and
starts the next episode where one has ended. Workers hold no random state, so results don't depend on their number.
"""

from __future__ import annotations

import itertools
import multiprocessing
import os
import shutil
import signal
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from tactile_kit.processes import light_main
from tactile_kit.simulation.dump import Dump, write
from tactile_kit.simulation.simulator import Simulator
from tactile_kit.simulation.worker import FIELDS, Blueprint, Group, views_of, work

TIMEOUT = 300.0  # s without an answer after which a worker counts as hung
MAX_DUMPS = 100  # faults kept in a folder


class WorkerError(RuntimeError):
    """A worker process raised, died or hung; the message holds its traceback where there is one."""


class VectorSimulation:
    """``environments`` simulators over ``workers`` processes (0: in this process).

    Attributes:
        views: the shared arrays of ``FIELDS``, first axis environments.
        faults: folder that the first ``MAX_DUMPS`` episodes ending in a fault are written to; None: nowhere.
    """

    faults: Path | None = None
    _told = False  # that a fault could not be written

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
        self.views = views_of(memory, environments)
        self._pipes: list[Any] = []
        self._processes: list[Any] = []
        self._group: Group | None = None
        if workers == 0:
            self._group = Group(blueprint, self.views, range(environments))
            return
        self._stacks = Path(tempfile.mkdtemp(prefix="tactile-kit-"))
        bounds = np.linspace(0, environments, workers + 1).astype(int)
        try:
            for first, last in itertools.pairwise(bounds.tolist()):
                ours, theirs = context.Pipe()
                stack = str(self._stacks / str(len(self._pipes)))
                arguments = (theirs, blueprint, memory, environments, range(first, last), stack)
                process = context.Process(target=work, args=arguments, daemon=True)
                with light_main():
                    process.start()
                theirs.close()
                self._pipes.append(ours)
                self._processes.append(process)
            for worker in range(workers):
                self._answer(worker)
        except BaseException:  # an interrupt too
            self.close()
            raise

    def _answer(self, worker: int) -> Any:
        pipe, process = self._pipes[worker], self._processes[worker]
        try:
            if not pipe.poll(TIMEOUT):
                where = self._stack(worker)
                self.close(patience=0.1)
                raise WorkerError(f"worker {worker} did not answer for {TIMEOUT:.0f} s; {where}")
            kind, value = pipe.recv()
        except (EOFError, OSError) as error:
            process.join(1.0)
            self.close()
            raise WorkerError(f"worker {worker} died with exit code {process.exitcode}") from error
        if kind == "error":
            self.close()
            raise WorkerError(f"worker {worker} failed:\n{value}")
        return value

    def _stack(self, worker: int) -> str:
        """Where a worker that does not answer stands, in words."""
        written = self._stacks / str(worker)
        if written.exists():  # it knows the signal already
            os.kill(self._processes[worker].pid, signal.SIGUSR1)
        for _ in range(20):
            time.sleep(0.05)
            if written.exists() and written.stat().st_size:
                return f"it hangs at:\n{written.read_text(encoding='utf-8', errors='replace')}"
        return "it does not even tell where it hangs (stopped, or waiting for a device)"

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
        self._tell(b"reset")
        for worker in range(len(self._pipes)):
            self._answer(worker)

    def step_async(self) -> None:
        """Begin a step with the actions in ``views``."""
        self._require_open()
        self._tell(b"step")

    def _tell(self, command: bytes) -> None:
        for worker, pipe in enumerate(self._pipes):
            try:
                pipe.send_bytes(command)
            except OSError:
                self._answer(worker)  # raises: it died

    def step_wait(self) -> dict[int, dict[str, Any]]:
        """Finish the step; returns ``fault``, ``steps`` and ``physics`` of episodes that ended, by environment."""
        ended = self._finish()
        for index in sorted(ended):
            if "dump" in ended[index]:
                self._keep(ended[index].pop("dump"))
        return ended

    def _finish(self) -> dict[int, dict[str, Any]]:
        if self._group is not None:
            return self._group.step()
        ended: dict[int, dict[str, Any]] = {}
        for worker in range(len(self._pipes)):
            ended.update(self._answer(worker))
        return ended

    def _keep(self, dump: Dump) -> None:
        if self.faults is None:
            return
        try:
            number = len(list(self.faults.glob("fault-*.npz")))
            if number < MAX_DUMPS:
                write(self.faults / f"fault-{number:03d}.npz", dump)
        except OSError as problem:  # the episodes are worth more than a record of their faults
            if not self._told:
                warnings.warn(f"{self.faults}: no dump of a fault could be written: {problem}", stacklevel=2)
            self._told = True

    def _require_open(self) -> None:
        if self._group is None and not self._pipes:
            raise WorkerError("the simulation is closed: a worker failed before, or close() was called")

    def close(self, patience: float = 2.0) -> None:
        """End all workers; those that have not ended after ``patience`` seconds are killed."""
        if self._group is not None:
            self._group.close()
            self._group = None
        if not self._processes:
            return
        for pipe in self._pipes:
            try:
                pipe.send_bytes(b"close")
            except OSError:
                pass
        end = time.monotonic() + patience
        for pipe, process in zip(self._pipes, self._processes, strict=False):
            process.join(max(end - time.monotonic(), 0.0))
            if process.is_alive():
                process.kill()
                process.join()
            pipe.close()
        self._pipes, self._processes = [], []
        shutil.rmtree(self._stacks, ignore_errors=True)
