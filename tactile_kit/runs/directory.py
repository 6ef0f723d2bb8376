"""Run directories: the lock, and what surrounds a run (versions, hardware, git revision)."""

from __future__ import annotations

import contextlib
import fcntl
import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, BinaryIO

from tactile_kit.errors import LockedError

PACKAGES = ("torch", "numpy", "stable-baselines3", "gymnasium", "pybullet", "safetensors")
_held: set[Path] = set()


@contextmanager
def locked(directory: Path) -> Iterator[str]:
    """Hold the directory for this process; raises LockedError when another one (or this one) already does.

    Yields who held it last and was killed, empty where that one left by itself.

    The lock is the kernel's, so it goes with the process, however that ends; forked workers do not inherit it.
    """
    path = directory / ".lock"
    key = path.resolve()
    if key in _held:
        raise LockedError(f"{directory}: this process already works here")
    with path.open("a+b", buffering=0) as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise LockedError(
                f"{directory}: {_holder(file) or 'another process'} already works here"
            ) from None
        _held.add(key)
        try:
            killed = _holder(file)
            file.truncate(0)
            with contextlib.suppress(
                OSError
            ):  # on a full disk the lock holds, though nobody can read whose it is
                file.write(f"process {os.getpid()} on {platform.node()}".encode())
            yield killed
        finally:
            _held.discard(key)
            file.truncate(0)


def _holder(file: BinaryIO) -> str:
    file.seek(0)
    return file.read().decode(errors="replace").strip()


@cache
def versions() -> dict[str, str]:
    """Versions that a result may depend on."""
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


@cache
def revision() -> str | None:
    """Git revision of the code when first asked, with ``-dirty`` when it was changed; None outside a checkout."""
    here = Path(__file__).resolve().parent
    try:
        head = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, timeout=10
        )
        if head.returncode:
            return None
        changed = subprocess.run(
            ["git", "status", "--porcelain", "--untracked-files=no", "--", "*.py"],
            cwd=here, capture_output=True, text=True, timeout=30,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return None
    return head.stdout.strip() + ("-dirty" if changed.stdout.strip() else "")


def hardware() -> dict[str, Any]:
    """Processor and its number of cores."""
    model = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        model = next(
            (line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), model
        )
    except OSError:
        pass
    return {"processor": model, "cores": os.cpu_count(), "system": platform.system()}
