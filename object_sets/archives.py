"""3MF files are zip archives of XML: what to refuse before a parser unpacks them."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

from object_sets.errors import MeshError
from object_sets.limits import BODIES

XML = (".model", ".rels", ".xml")
UNPACKED = 512 * 2**20  # bytes a file may unpack to


def check_archive(path: Path, data: bytes) -> int | None:
    """Look a 3MF file over before it is parsed; returns the number of bodies it describes, where that can be told.

    Raises:
        MeshError: it is no archive, unpacks to too much, brings XML definitions, or multiplies bodies by reference.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            # What is read of a member ends at its declared size, so the declared sizes are a bound.
            unpacked = sum(member.file_size for member in archive.infolist())
            if unpacked > UNPACKED:
                raise MeshError(
                    path, f"unpacks to {unpacked / 2**20:.0f} MiB; allowed are {UNPACKED // 2**20}",
                    "simplify the mesh, or save it as STL",
                )  # fmt: skip
            for member in archive.infolist():
                text = archive.read(member) if member.filename.lower().endswith(XML) else b""
                if b"<!DOCTYPE" in text.replace(b"\0", b""):  # in UTF-16 too
                    raise MeshError(
                        path, "holds XML with a DOCTYPE", "export it again, as the 3MF standard says"
                    )
            models = [name for name in archive.namelist() if name.lower().endswith("3d/3dmodel.model")]
            bodies = _bodies(archive.read(models[0])) if models else None
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # zipfile raises a dozen kinds on broken input
        raise MeshError(path, f"is no readable 3MF file ({error})", "export it again") from error
    if bodies is not None and bodies > BODIES:
        raise MeshError(
            path, f"consists of {bodies} bodies; allowed are {BODIES}",
            "unite them in a modelling program, or save single bodies",
        )  # fmt: skip
    return bodies


def _bodies(model: bytes) -> int | None:
    """How many bodies the build of a model makes of its objects, components of components included.

    None where components lie in further files. A component that holds itself counts as endless.
    """
    from lxml import etree

    meshes: dict[str, int] = {}
    components: dict[str, list[str]] = {}
    items: list[str] = []
    for _, element in etree.iterparse(
        io.BytesIO(model), tag=("{*}object", "{*}item"), resolve_entities=False, no_network=True
    ):
        if element.tag.endswith("item"):
            items.append(element.get("objectid", ""))
            continue
        inner = list(element.iter("{*}component"))
        if any(key.endswith("path") for component in inner for key in component.attrib):
            return None
        identity = element.get("id", "")
        meshes[identity] = 1 if next(element.iter("{*}mesh"), None) is not None else 0
        components[identity] = [component.get("objectid", "") for component in inner]
        element.clear()
    counts: dict[str, int] = {}

    def count(identity: str, above: tuple[str, ...] = ()) -> int:
        if identity in above or len(above) > 100:
            return BODIES + 1
        if identity not in counts:
            inside = (count(other, (*above, identity)) for other in components.get(identity, ()))
            counts[identity] = meshes.get(identity, 0) + sum(inside)
        return counts[identity]

    return sum(count(identity) for identity in items)
