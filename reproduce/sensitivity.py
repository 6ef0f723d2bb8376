"""What limits feeling: an agent under the default randomisation with one term at a time from none to twice as wide.

All conditions play the same episodes: objects, goals, grasps and, through the terms' own streams, the same draws.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from reproduce.errors import ReproduceError
from tactile_kit.errors import nearest

# name in figures and files -> terms of the randomisation
GROUPS: dict[str, tuple[str, ...]] = {
    "joint offset": ("joint_offset",),
    "joint noise": ("joint_noise",),
    "friction": ("tip_friction", "link_friction"),
    "series stiffness": ("series_stiffness",),
    "mass": ("object_mass_offset",),
    "disturbance": ("force", "torque"),
    "sticky actions": ("sticky_action",),
}
EVERYTHING = "all of these"  # at once
FACTORS = (0.0, 2.0)
DEFAULT = "default"
SEPARATOR = " x "


def conditions() -> dict[str, tuple[tuple[str, ...], float]]:
    """Name of each condition -> the terms it scales, and by how much; the first is the default itself."""
    together = tuple(name for names in GROUPS.values() for name in names)
    found: dict[str, tuple[tuple[str, ...], float]] = {DEFAULT: ((), 1.0)}
    for group, names in {**GROUPS, EVERYTHING: together}.items():
        for factor in FACTORS:
            found[f"{group}{SEPARATOR}{factor:g}"] = (names, factor)
    return found


def measure_to(
    agent: Path,
    out: Path,
    *,
    only: Sequence[str] = (),
    objects: str = "paper",
    goals_per_case: int = 8,
    seed: int = 0,
    num_workers: int = 1,
    progress: Callable[[str, int, int], None] | None = None,
) -> int:
    """Plays the conditions that ``out`` does not hold yet and writes it after each; returns its episodes.

    Args:
        agent: the agent's directory.
        out: file of courses (CSV), one line an episode.
        only: names of ``conditions()``; all by default.
        progress: called with a condition and (episodes done, episodes in all).

    Raises:
        ReproduceError: an unknown condition, no agent, or ``out`` holds other episodes than those asked for.
    """
    if not (agent / "agent.json").is_file():
        raise ReproduceError(f"{agent}: no agent there (agent.json is missing)")
    known = conditions()
    for name in only:
        if name not in known:
            raise ReproduceError(f"condition {name!r} unknown{nearest(name, known)}")
    import torch

    import randomization
    from tactile_kit.agents.agent import load_agent
    from tactile_kit.evaluation.courses import read_courses, write_courses
    from tactile_kit.evaluation.playing import play

    torch.set_num_threads(1)
    lines = read_courses(out) if out.is_file() else []
    there = {line.condition for line in lines}
    loaded = load_agent(agent)
    for name in only or known:
        if name in there:
            continue
        terms, factor = known[name]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "scaled.yaml"
            wider = randomization.scaled(randomization.preset(DEFAULT), terms, factor)
            randomization.write_randomization(wider, file)
            tell: Any = (
                None if progress is None else lambda done, total, name=name: progress(name, done, total)
            )
            lines += play(
                loaded, name, (), tell, objects=objects, goals_per_case=goals_per_case, seed=seed,
                randomization=str(file), num_workers=num_workers, quiet=True,
            )  # fmt: skip
        order = list(known)
        lines.sort(key=lambda line: order.index(line.condition))  # stable
        episodes = [[line.seed for line in lines if line.condition == other] for other in dict.fromkeys(
            line.condition for line in lines
        )]  # fmt: skip
        if any(seeds != episodes[0] for seeds in episodes):
            raise ReproduceError(f"{out}: holds other episodes than {name}; name another file or delete it")
        write_courses(out, lines)
    return sum(bool(line.end) for line in lines)
