"""Bounds of memory and time for work on meshes of unknown origin, done in processes of their own."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from object_sets.errors import ObjectSetError

GIB = 2**30
_running: set[subprocess.Popen[bytes]] = set()
BODIES = 500  # of one file; what consists of more is no single object
EXHAUSTED = ("MemoryError", "bad_alloc", "Cannot allocate", "Unable to allocate")  # how libraries say it


@dataclass(frozen=True)
class Limits:
    """What one mesh may cost.

    Attributes:
        memory: GiB of address space of a worker process, the libraries' own included; at least 0.5.
        timeout: seconds.
    """

    memory: float = 4.0
    timeout: float = 300.0

    def __post_init__(self) -> None:
        if not 0.5 <= self.memory < float("inf"):
            raise ObjectSetError(f"memory = {self.memory!r}: at least 0.5 GiB are needed")
        if not 0 < self.timeout < float("inf"):
            raise ObjectSetError(f"timeout = {self.timeout!r}: seconds > 0 are needed")


def start_worker(module: str, arguments: Sequence[str] = (), **pipes: Any) -> subprocess.Popen[bytes]:
    """Start ``python -m object_sets.MODULE PID ARGUMENTS`` in a process group of its own; end it by ``stop_worker``."""
    # -P: the folder one stands in may be a stranger's, and hold a numpy.py.
    command = [sys.executable, "-P", "-m", f"object_sets.{module}", str(os.getpid()), *arguments]
    worker = subprocess.Popen(command, env=_environment(), process_group=0, **pipes)
    _running.add(worker)
    return worker


def stop_worker(worker: subprocess.Popen[bytes]) -> None:
    """Kill a worker and what it started, unless it has ended; close its pipes."""
    if worker.poll() is None:
        os.killpg(worker.pid, signal.SIGKILL)
    worker.wait()
    for pipe in (worker.stdin, worker.stdout, worker.stderr):
        if pipe is not None:
            pipe.close()
    _running.discard(worker)


def stop_all_workers() -> None:
    """On an interrupt: whoever waits for a worker sees it end at once."""
    for worker in list(_running):
        if worker.poll() is None:
            os.killpg(worker.pid, signal.SIGKILL)


def die_with_parent(parent: int) -> None:
    """In a worker: be killed when the thread that started it, of process ``parent``, ends, however that comes about."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG of Linux
    if os.getppid() != parent:  # it ended before it could be told
        os._exit(1)


def _environment() -> dict[str, str]:
    """Finds this package wherever it lies, and starts no threads.

    With one thread CoACD's tree search depends on its seed alone, and no memory is reserved for idle threads.
    """
    home, before = str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH")
    return {
        **os.environ,
        "PYTHONPATH": home if not before else os.pathsep.join([home, before]),
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def limit_this_process(memory: int, seconds: float, parent: int) -> None:
    """In a worker of process ``parent``: bound address space (bytes) and processor time (s); leave no core file."""
    import resource

    die_with_parent(parent)
    for kind, bound in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_CPU, int(seconds) + 2),  # should nobody be left who could stop it
        (resource.RLIMIT_CORE, 0),
    ):
        _, hard = resource.getrlimit(kind)
        allowed = bound if hard == resource.RLIM_INFINITY else min(bound, hard)
        resource.setrlimit(kind, (allowed, allowed))


def out_of_memory(words: str) -> bool:
    """Whether a worker's last words say that its memory was too small."""
    return any(word in words for word in EXHAUSTED)
