"""Faults on disk: an episode from its start to the step in which the physics failed, to be played again.

Episodes repeat to the bit, so their start and the actions say it all; the last good state is there to check that.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from object_sets.storage import NUMBERS, read_npz, write_atomic
from tactile_kit.hand.kinematics import ALL_JOINTS, JOINTS

SCHEMA = 1
STATE = {"joints": (ALL_JOINTS,), "position": (3,), "rotation": (3, 3)}
_START = {"variant": int, "seed": int, "gravity": float, "body": str, "horizon": int}


class DumpError(ValueError):
    """A file is no dump, or one of another simulation."""


@dataclass(frozen=True)
class Dump:
    """One failed episode.

    Attributes:
        fault: what went wrong.
        start: ``variant``, ``seed``, ``gravity`` (m/s^2), ``body`` (its name), ``horizon`` and
            ``config``, the physics' settings.
        actions: ``(n, 12) float64`` as given, the last one led to the fault.
        physics: what the episode had drawn, by name.
        state: the last that means something: ``joints (16,)`` rad, ``position (3,)`` m, ``rotation (3, 3)``.
    """

    fault: str
    start: dict[str, Any]
    actions: NDArray[np.float64]
    physics: dict[str, NDArray]
    state: dict[str, NDArray]


def write(path: Path, dump: Dump) -> None:
    """Write ``dump`` as npz, whole or not at all. Raises OSError."""
    head = json.dumps({"schema": SCHEMA, "fault": dump.fault, "start": dump.start})
    arrays = {f"physics.{name}": value for name, value in dump.physics.items()}
    arrays |= {f"state.{name}": value for name, value in dump.state.items()}
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, head=np.array(head), actions=dump.actions, **arrays)
    write_atomic(path, buffer.getvalue())


def read(path: str | Path) -> Dump:
    """The dump in ``path``; nothing is unpickled. Raises DumpError naming file and defect."""
    path = Path(path)
    try:
        arrays = read_npz(path.read_bytes(), path, f"{NUMBERS}U")
        head = json.loads(str(arrays.pop("head")))
        actions = arrays.pop("actions")
    except OSError as problem:
        raise DumpError(f"{path}: {problem.strerror or problem}") from None
    except (ValueError, KeyError, RecursionError) as problem:
        raise DumpError(f"{path}: no dump of a fault ({problem})") from None
    if not isinstance(head, dict) or head.get("schema") != SCHEMA:
        found = head.get("schema") if isinstance(head, dict) else head
        raise DumpError(f"{path}: schema {found!r}, this version reads {SCHEMA}")
    start = head.get("start")
    if not isinstance(start, dict) or any(type(start.get(name)) is not kind for name, kind in _START.items()):
        raise DumpError(f"{path}: start is {start!r}, expected {', '.join(_START)}")
    state = {name: arrays.pop(f"state.{name}", np.zeros(0)) for name in STATE}
    expected = {"actions": (len(actions) if actions.ndim else 0, JOINTS), **STATE}
    for name, array in {"actions": actions, **state}.items():
        if array.dtype != np.float64 or array.shape != expected[name]:
            raise DumpError(
                f"{path}: {name} is {array.shape} {array.dtype}, expected {expected[name]} float64"
            )
    physics = {name.removeprefix("physics."): array for name, array in arrays.items()}
    return Dump(str(head.get("fault")), start, actions, physics, state)
