"""Stages: one file each. ``run_stage`` is what ``reproduce stage`` and the workflow call."""

from __future__ import annotations

import importlib
import traceback
from pathlib import Path

from reproduce import owner
from reproduce.errors import ReproduceError
from reproduce.files import read_json
from reproduce.heartbeat import Heartbeat
from reproduce.plan import ARTEFACTS
from tactile_kit.errors import nearest

WORK = ("objects", "grasps", "train", "evaluate")  # one file each here; the rest are artefacts
STAGES = (*WORK, *ARTEFACTS)


def items_of(pipeline: Path, stage: str) -> list[str]:
    """The items a stage has in this pipeline: ``[""]`` for a stage without."""
    _known(stage)
    if stage not in ("grasps", "train", "evaluate"):
        return [""]
    return sorted(read_json(pipeline / "plan.json")[stage])


def run_stage(pipeline: Path, stage: str, item: str = "", *, echo: bool = False) -> None:
    """Runs one job from its file below ``<pipeline>/jobs`` and leaves its outputs and marker.

    Raises ``ReproduceError`` for a stage or item that doesn't exist.
    """
    _known(stage)
    valid = items_of(pipeline, stage)
    if item not in valid:
        raise ReproduceError(f"stage {stage}: item {item!r} unknown{nearest(item, valid)}")
    owner.end_with_owner()
    beat = Heartbeat(pipeline, f"{stage}/{item}" if item else stage, echo)
    try:
        if stage in WORK:
            importlib.import_module(f"reproduce.stages.{stage}").run(pipeline, item, beat)
        else:
            _artefact(pipeline, stage)
    except BaseException as error:
        beat.end("failed", f"{type(error).__name__}: {error}")
        if not isinstance(error, ValueError):
            traceback.print_exc()
        raise
    beat.end("done")


def _artefact(pipeline: Path, name: str) -> None:
    from reproduce.artefacts import make
    from reproduce.results import Results

    outputs = [Path(file) for file in read_json(pipeline / "plan.json")["artefacts"][name]]
    make(
        name, Results.load(pipeline / "jobs" / "artefacts" / f"{name}.yaml", pipeline / "evaluated"), outputs
    )


def _known(stage: str) -> None:
    if stage not in STAGES:
        raise ReproduceError(f"stage {stage!r} unknown{nearest(stage, STAGES)}")
