"""Bounds of memory and time for work on meshes of unknown origin, done in processes of their own."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from object_sets.errors import ObjectSetError

GIB = 2**30
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


def worker_command(module: str) -> list[str]:
    """The command that runs ``object_sets.MODULE``; with ``worker_environment``."""
    # -P: the folder one stands in may be a stranger's, and hold a numpy.py.
    return [sys.executable, "-P", "-m", f"object_sets.{module}"]


def worker_environment() -> dict[str, str]:
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


def limit_this_process(memory: int, seconds: float) -> None:
    """In a worker: bound address space (bytes) and processor time (s); leave no core file."""
    import resource

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
