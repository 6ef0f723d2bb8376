"""The house's arrows: every import of every file, lazy ones and those for types included."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("object_sets", "randomization", "tactile_kit", "reproduce")
GROUND = ("errors", "files", "lazy", "processes", "progress", "rotations", "settings")
# From below to above; rooms of one floor don't know of each other.
FLOORS = (
    {"object_sets", "randomization"},
    {f"tactile_kit.{name}" for name in GROUND},
    {"tactile_kit.hand", "tactile_kit.shape"},
    {"tactile_kit.simulation"},
    {"tactile_kit.task"},
    {"tactile_kit.estimator", "tactile_kit.planning"},
    {"tactile_kit.ecrl"},
    {"tactile_kit.agents"},
    {"tactile_kit.evaluation"},
    {"tactile_kit.runs", "tactile_kit.view"},
    {"tactile_kit"},  # the ways in
    {"reproduce"},
)


def imported(source: str, name: str, folder: bool) -> Iterator[tuple[str, str]]:
    """(module, what of it) for every import in ``source``, the text of module ``name``; ``folder``: an __init__."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            near = name.split(".")[: len(name.split(".")) - node.level + folder] if node.level else []
            module = ".".join([*near, *filter(None, [node.module])])
            yield from ((module, alias.name) for alias in node.names)


def house(root: Path) -> dict[str, set[str]]:
    """Module -> modules of the house that it imports."""
    files = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    arrows: dict[str, set[str]] = {}
    for name, path in files.items():
        found = imported(path.read_text(encoding="utf-8"), name, path.name == "__init__.py")
        targets = {f"{module}.{what}" if f"{module}.{what}" in files else module for module, what in found}
        arrows[name] = {target for target in targets if target in files} - {name}
    return arrows


def room(module: str) -> str:
    parts = module.split(".")
    return ".".join(parts[:2]) if parts[0] == "tactile_kit" else parts[0]


def upward(arrows: dict[str, set[str]]) -> list[str]:
    """Imports that go up, or across a floor."""
    floor = {name: number for number, rooms in enumerate(FLOORS) for name in rooms}
    found = []
    for module, targets in arrows.items():
        here = room(module)
        for there in map(room, targets):
            ground = here in FLOORS[1] and there in FLOORS[1]  # whose files may build on each other
            if here != there and not ground and floor[there] >= floor[here]:
                found.append(f"{module} -> {there}")
    return sorted(set(found))


@pytest.fixture(scope="module")
def arrows() -> dict[str, set[str]]:
    return house(ROOT)


def test_every_room_has_its_floor(arrows: dict[str, set[str]]) -> None:
    assert {room(module) for module in arrows} == set.union(*FLOORS)


def test_the_page_shows_the_floors() -> None:
    rows = [
        line.split("|")[2]
        for line in (ROOT / "docs/architecture.md").read_text().splitlines()
        if "| `" in line
    ]
    shown = [
        {name if name[0] != "." else f"tactile_kit{name}" for name in row.split("`")[1::2]} for row in rows
    ]
    assert shown == [rooms for rooms in reversed(FLOORS) if rooms != {"tactile_kit"}]


def test_arrows_go_down_only(arrows: dict[str, set[str]]) -> None:
    assert not upward(arrows)


def test_there_is_no_circle_of_files(arrows: dict[str, set[str]]) -> None:
    # a folder's __init__ lists what its files offer
    files = {
        name: {t for t in targets if t not in PACKAGES}
        for name, targets in arrows.items()
        if name not in PACKAGES
    }
    tuple(TopologicalSorter(files).static_order())


def test_a_circle_and_an_upward_arrow_are_found(tmp_path: Path) -> None:
    for name, text in {
        "tactile_kit/hand/a.py": "def f():\n    from tactile_kit.task import b\n",
        "tactile_kit/hand/__init__.py": "",
        "tactile_kit/task/b.py": "from ..hand.a import f\n",
        "tactile_kit/task/__init__.py": "",
        "tactile_kit/shape/__init__.py": "import tactile_kit.hand.a\n",
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    arrows = house(tmp_path)
    assert upward(arrows) == [
        "tactile_kit.hand.a -> tactile_kit.task",
        "tactile_kit.shape -> tactile_kit.hand",
    ]
    with pytest.raises(CycleError):
        tuple(TopologicalSorter(arrows).static_order())
