"""Models that nobody here made, through ``object-sets``: writes docs/collections.md.

pip install --no-deps gymnasium-robotics dm-control     # further collections; pybullet_data comes with PyBullet
python benchmarks/mesh_collections.py --folder "trimesh's models=CHECKOUT/models"
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from object_sets.errors import MeshError
from object_sets.importing import ImportConfig, mesh_files
from object_sets.limits import Limits
from object_sets.reading import Readers

PAGE = Path(__file__).resolve().parents[1] / "docs" / "collections.md"
PACKAGES = ("pybullet_data", "dm_control", "gymnasium_robotics")
DISTRIBUTIONS = {
    "pybullet_data": "pybullet",
    "dm_control": "dm-control",
    "gymnasium_robotics": "gymnasium-robotics",
}
EXTENT = (0.045, 0.09)  # m
LIMITS = Limits(memory=4.0, timeout=60.0)
SCALED = "scaled by"  # what was asked for is no repair

HEAD = """# Real collections

*Written by `benchmarks/mesh_collections.py` over what is installable: models made for other purposes, each scaled into
a hand's range (`--extent 0.045:0.09`), 60 s a file. Usable means as it is; repaired, that the summary says what was
changed. What a refusal means and what helps: [objects.md](objects.md).*
"""


class Outcome(NamedTuple):
    """Of one file."""

    kind: str  # usable, repaired, refused, and with remeshing: remeshed
    reasons: tuple[str, ...]


class Collection(NamedTuple):
    """Files of one origin."""

    name: str
    files: tuple[Path, ...]
    note: str


def collections(folders: Sequence[str], every: int) -> list[Collection]:
    """What is installed, and the folders given as NAME=FOLDER."""
    found = []
    for package in PACKAGES:
        spec = find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            continue
        files = mesh_files(Path(spec.submodule_search_locations[0]), recursive=True)
        label = f"{package} ({DISTRIBUTIONS.get(package, package)} {version(DISTRIBUTIONS.get(package, package))})"
        many = [file for file in files if "random_urdfs" in file.parts]
        found.append(Collection(label, tuple(file for file in files if file not in set(many)), ""))
        if many:
            found.append(
                Collection("its random_urdfs", tuple(many[::every]), f"every {every}th" if every > 1 else "")
            )
    for text in folders:
        name, _, folder = text.partition("=")
        found.append(Collection(name, tuple(mesh_files(Path(folder), recursive=True)), ""))
    return found


def outcome(file: Path, readers: Readers) -> Outcome:
    """Read one file; where it is refused, once more with remeshing."""
    try:
        repairs = readers.read(file, ImportConfig(EXTENT), LIMITS).repairs
    except MeshError as error:
        try:
            readers.read(file, ImportConfig(EXTENT, remesh=True), LIMITS)
        except MeshError:
            return Outcome("refused", (kind(error.defect),))
        return Outcome("remeshed", (kind(error.defect),))
    changed = tuple(dict.fromkeys(kind(repair) for repair in repairs if not repair.startswith(SCALED)))
    return Outcome("repaired" if changed else "usable", changed)


def kind(text: str) -> str:
    """A reason without what differs from file to file."""
    text = re.sub(r"\(.*?\)|'.*?'|: .*|, (?:gaps|which|and|the surface) .*", "", text)
    return re.sub(r"\s+", " ", re.sub(r"[-+]?\d[\d.e+-]*", "N", text)).strip()


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(map(str, row)) + " |" for row in rows)])


def page(results: dict[Collection, list[Outcome]]) -> str:
    """The whole document."""
    rows = []
    for collection, outcomes in results.items():
        counts = Counter(outcome.kind for outcome in outcomes)
        note = f", {collection.note}" if collection.note else ""
        refused = counts["refused"] + counts["remeshed"]
        rows.append((
            collection.name + note, len(outcomes), counts["usable"], counts["repaired"], refused, counts["remeshed"]
        ))  # fmt: skip
    head = ("collection", "files", "usable", "repaired", "refused", "of these usable with `--remesh`")
    parts = [HEAD, table(head, rows)]
    for title, kinds in (("Refused because it", ("refused", "remeshed")), ("Repaired", ("repaired",))):
        counts_of = {
            collection: Counter(r for o in outcomes if o.kind in kinds for r in o.reasons)
            for collection, outcomes in results.items()
        }
        total = sum(counts_of.values(), Counter())
        rows = [
            (reason, *(counts[reason] for counts in counts_of.values())) for reason, _ in total.most_common()
        ]
        parts.append(f"## {title}\n\n" + table(("", *(c.name.split(" (")[0] for c in results)), rows))
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Read everything and write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--folder", action="append", default=[], metavar="NAME=FOLDER", help="a further collection"
    )
    parser.add_argument("--every", type=int, default=1, help="of random_urdfs only each so manieth file")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=PAGE)
    given = parser.parse_args()
    results = {}
    with Readers() as readers, ThreadPoolExecutor(given.jobs) as pool:
        for collection in collections(given.folder, given.every):
            results[collection] = list(pool.map(partial(outcome, readers=readers), collection.files))
            print(collection.name, Counter(item.kind for item in results[collection]), flush=True)
            given.out.write_text(page(results))


if __name__ == "__main__":
    main()
