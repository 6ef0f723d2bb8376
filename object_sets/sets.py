"""Find objects: the paper's sets, single objects by name or id, and directories made by ``object-sets build``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from object_sets.errors import DataError, MeshError, ScaleError, UnknownObjectError, nearest
from object_sets.objects import Object, ObjectSet
from object_sets.storage import read_npz, sha256

if TYPE_CHECKING:
    from object_sets.manifest import Manifest

DATA = Path(__file__).with_name("data")

SETS: dict[str, tuple[int, ...]] = {
    "geometric8": tuple(range(8)),
    "ood": tuple(range(8, 13)),
    "complex": (13, 14, 15),
    "paper": tuple(range(13)),
    "all": tuple(range(16)),
}


def load(name: str | Path) -> ObjectSet:
    """A set with meshes and convex parts, its digests verified.

    Args:
        name: "geometric8" (ids 0-7), "ood" (8-12), "complex" (13-15), "paper" (0-12), "all" (0-15), or a directory
            made by ``object-sets build``. In a directory with prepared sizes each object comes once a size, named
            ``NAME_000``, ``NAME_001``, ..., and ids count on.

    Raises:
        UnknownObjectError: neither a set nor a directory with a manifest.
        DataError: the data was altered or has another schema.
    """
    if isinstance(name, str) and name in SETS:
        everything = _shipped().objects
        return ObjectSet(name, tuple(everything[i] for i in SETS[name]))
    directory = Path(name)
    if directory.name == "manifest.json":
        directory = directory.parent
    if (directory / "manifest.json").is_file():
        return _read(directory.resolve())
    hint = _building(directory) or nearest(name, SETS)
    raise UnknownObjectError(
        f"object set {str(name)!r}: neither a set nor a directory with manifest.json{hint}"
    )


def _building(place: Path) -> str:
    """For meshes that no set was made of yet: the command that makes it, to end an error message with."""
    from object_sets.parsing import FORMATS

    folder = place.parent if place.suffix.lower() in FORMATS and place.is_file() else place
    if not folder.is_dir() or not any(file.suffix.lower() in FORMATS for file in folder.rglob("*")):
        return ""
    deep = "" if any(file.suffix.lower() in FORMATS for file in folder.iterdir()) else " --recursive"
    return (
        f"; it holds meshes, make a set of them: object-sets build --meshes {folder}{deep} --out "
        f"{folder.resolve().name}_set --extent 0.045:0.09"
    )


def listed(objects: str | Path | Sequence[str | Path]) -> str:
    """Objects as the comma list that ``select`` takes: a name, a path, or several of them."""
    return (
        ",".join(map(str, objects))
        if isinstance(objects, Sequence) and not isinstance(objects, str)
        else str(objects)
    )


def select(objects: str | Path | Sequence[str | Path]) -> ObjectSet:
    """Objects from a comma list of set names, object names and ids, for example ``"geometric8,cube,12"``.

    Order is kept, duplicates are dropped. A directory made by ``object-sets build`` may stand alone or in the list, and
    so may one object of a set, by name: ``"my_set/mug"``. Paths and lists of all these are taken too.

    Raises:
        UnknownObjectError: an item is none of these; the message names the nearest that is.
    """
    text = listed(objects)
    everything = load("all")
    chosen: dict[tuple[int, str, str], Object] = {}
    items = [item.strip() for item in text.split(",")]
    for item in items:
        if item in SETS:
            found: tuple[Object, ...] = load(item).objects
        elif item.isdecimal() and int(item) < len(everything):
            found = (everything[int(item)],)
        elif item in everything.names:
            found = (everything[item],)
        elif item and _is_set(Path(item)):
            found = load(Path(item)).objects
        elif "/" in item and (item.rpartition("/")[0] in SETS or _is_set(Path(item).parent)):
            found = (_one(*item.rpartition("/")[::2]),)
        else:
            hint = (_building(Path(item)) if item else "") or nearest(item, [*SETS, *everything.names])
            raise UnknownObjectError(
                f"object {item!r} in {text!r}: ids 0-{len(everything) - 1}, names and sets{hint}"
            )
        for candidate in found:
            chosen.setdefault((candidate.id, candidate.name, candidate.digest), candidate)
    return ObjectSet(text if len(items) > 1 else items[0], tuple(chosen.values()))


def _is_set(place: Path) -> bool:
    return (place.parent if place.name == "manifest.json" else place).joinpath("manifest.json").is_file()


def _one(place: str, name: str) -> Object:
    """One object of a set, by its name."""
    whole = load(place)
    if name not in whole.names:
        raise UnknownObjectError(f"object {name!r} of {place!r}{nearest(name, whole.names)}")
    return whole[name]


def addresses(objects: str | Path | Sequence[str | Path]) -> dict[str, Object]:
    """What ``select`` finds, each object under a text by which ``select`` finds it alone."""
    found: dict[str, Object] = {}
    for item in (part.strip() for part in listed(objects).split(",")):
        chosen = select(item)
        alone = len(chosen) == 1 and not _is_set(Path(item))
        for thing in chosen:
            address = item if alone else thing.name if item in SETS else f"{item}/{thing.name}"
            if thing not in found.values():
                found[address] = thing
    return found


@lru_cache(maxsize=1)
def _shipped() -> ObjectSet:
    return _read(DATA, own=True)


def _read(directory: Path, own: bool = False) -> ObjectSet:
    from object_sets.manifest import MANIFEST_NAME, Manifest

    manifest = Manifest.from_bytes((directory / MANIFEST_NAME).read_bytes(), directory / MANIFEST_NAME)
    objects: list[Object] = []
    try:
        for entry, nominal in zip(manifest.objects, nominal_objects(manifest, directory, own), strict=True):
            objects.extend(_sizes(nominal, entry.scales, len(objects)))
    except (MeshError, ScaleError) as error:  # content that no builder has written
        raise DataError(f"{directory / MANIFEST_NAME}: {error}") from error
    return ObjectSet(manifest.name, tuple(objects))


def nominal_objects(manifest: Manifest, directory: Path, own: bool = False) -> Iterator[Object]:
    """The objects of a manifest in ``directory`` at their nominal sizes, digests verified.

    With ``own`` files may be links that leave the folder: installers link the package's own data so.

    Raises:
        DataError: a file is missing, altered, or not what the manifest says.
    """
    for entry in manifest.objects:
        file = directory / entry.file
        if not file.is_file():
            raise DataError(f"{file}: missing, the manifest lists it; build the set again")
        if not own and file.resolve().parent != directory.resolve():
            raise DataError(f"{file}: a link that leaves the set's folder; copy the file itself")
        data = file.read_bytes()
        if sha256(data) != entry.sha256:
            raise DataError(
                f"{file}: sha256 does not fit the manifest; the file was altered, build the set again"
            )
        arrays = read_npz(data, file)
        wanted = {"vertices", "faces", *(f"part{i}" for i in range(len(entry.parts)))}
        if arrays.keys() != wanted:
            raise DataError(f"{file}: arrays {sorted(arrays)}; the manifest says {sorted(wanted)}")
        nominal = Object(
            id=entry.id,
            name=entry.name,
            vertices=arrays["vertices"],
            faces=arrays["faces"],
            parts=tuple(arrays[f"part{i}"] for i in range(len(entry.parts))),
            convex=entry.convexity == "convex",
            source=entry.source,
            licence=entry.licence,
            mass=entry.mass,
        )
        if nominal.digest != entry.digest:
            raise DataError(f"{file}: content digest does not fit the manifest; build the set again")
        yield nominal


def _sizes(nominal: Object, scales: tuple, start: int) -> list[Object]:
    if not scales:
        return [nominal]
    return [
        replace(nominal.scaled(factors), id=start + k, name=f"{nominal.name}_{k:03d}")
        for k, factors in enumerate(scales)
    ]
