"""Writes the tables of docs/{speed,physics,compiled,cluster}.md from results/benchmarks/*.json, between markers.

    python benchmarks/render.py [--check]

A block begins with ``<!-- bench NAME: ... -->`` and ends with ``<!-- /bench -->``; all else in a page stays.
``--check`` writes nothing and fails where a page differs.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable
from typing import Any

import tables_cluster
import tables_compiled
import tables_physics
import tables_speed
from record import RESULTS, ROOT

PAGES = ("docs/speed.md", "docs/physics.md", "docs/compiled.md", "docs/cluster.md")
BLOCK = re.compile(r"(<!-- bench (\w+):[^\n]*-->\n).*?(<!-- /bench -->)", re.DOTALL)
# name of the block: its file in results/benchmarks and what renders it
BLOCKS: dict[str, tuple[str, Callable[[dict[str, Any]], list[str]]]] = {
    "simulation": ("simulation", tables_speed.simulation),
    "objects": ("simulation", tables_speed.objects),
    "vector": ("vector", tables_speed.vector),
    "peer": ("peer", tables_speed.peer),
    "bps": ("bps", tables_speed.bps),
    "bps_goals": ("bps", tables_speed.bps_goals),
    "bps_exactness": ("bps", tables_speed.bps_exactness),
    "grasps": ("grasps", tables_speed.grasps),
    "recipe": ("recipe", tables_speed.recipe),
    "coupled": ("coupled", tables_speed.coupled),
    "steps": ("physics", tables_physics.steps),
    "iterations": ("physics", tables_physics.iterations),
    "lanes": ("lanes", tables_compiled.lanes),
    "compiled_speed": ("compiled", tables_compiled.speed),
    "compiled_motion": ("compiled", tables_compiled.motion),
    "compiled_ends": ("compiled", tables_compiled.ends),
    "paper_jobs": ("cluster", tables_cluster.paper_jobs),
    "ray": ("cluster", tables_cluster.ray),
    "ray_scaling": ("cluster", tables_cluster.ray_scaling),
    "steps_of_agent": ("steps_of_agent", tables_physics.agent),
}


def block(name: str) -> str:
    """The markdown of one block."""
    if name not in BLOCKS:
        raise SystemExit(f"block {name!r}: allowed are {', '.join(BLOCKS)}")
    stem, table = BLOCKS[name]
    path = RESULTS / f"{stem}.json"
    if not path.exists():
        return "\nNot measured yet.\n\n"
    record = json.loads(path.read_text(encoding="utf-8"))
    return "\n".join(["", *table(record), "", footnote(record["machine"]), "", ""])


def footnote(machine: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {v}" for name, v in machine["versions"].items() if v != "absent")
    revision = (machine["revision"] or "unknown")[:10]
    return (
        f"*{machine['processor']}, {machine['cores']} cores, load {machine['load']} at the end; "
        f"{machine['date'][:16].replace('T', ' ')} UTC, revision {revision}; {versions}.*"
    )


def rendered(text: str) -> str:
    """A page with all its blocks written anew."""
    return BLOCK.sub(lambda found: found[1] + block(found[2]) + found[3], text)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing, fail where a page differs")
    check = parser.parse_args().check
    stale = []
    for page in PAGES:
        path = ROOT / page
        text = path.read_text(encoding="utf-8")
        new = rendered(text)
        if new != text:
            stale.append(page)
            if not check:
                path.write_text(new, encoding="utf-8")
    if stale and check:
        sys.exit(f"{', '.join(stale)}: not what results/benchmarks says; run benchmarks/render.py")


if __name__ == "__main__":
    main()
