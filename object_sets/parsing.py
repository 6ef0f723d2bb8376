"""From a mesh file to triangles. Nothing outside the file's folder is read, and no material at all.

OBJ and OFF are read by ``polygons``, PLY by ``ply`` (which say why), the other formats by trimesh.
"""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote

import numpy as np

from object_sets.archives import check_archive
from object_sets.errors import MeshError
from object_sets.nature import check_nature, without_trailer
from object_sets.ply import read_ply
from object_sets.polygons import read_obj, read_off
from object_sets.storage import sha256

FORMATS = (".stl", ".obj", ".ply", ".glb", ".gltf", ".off", ".3mf")
SINGLE_UNITS = {
    "micron": 1e-6,
    "millimeter": 1e-3,
    "centimeter": 1e-2,
    "inch": 0.0254,
    "foot": 0.3048,
    "meter": 1.0,
}
UNITS = {**SINGLE_UNITS, **{f"{name}s": value for name, value in SINGLE_UNITS.items()}}  # of 3MF files


class Triangles(NamedTuple):
    """What a file says, unchecked but for finite numbers and valid indices."""

    vertices: np.ndarray  # (V, 3) float64, m (3MF) or the file's unit
    faces: np.ndarray  # (F, 3) int64, indices as in the file: what it keeps apart stays apart
    groups: np.ndarray  # (F,) int64, which body, node or solid of the file a face is listed under
    sha256: str  # of the file


def parse(path: Path) -> Triangles:
    """Every triangle of a mesh file, all its bodies together.

    Raises:
        MeshError: the file can't be read, is damaged, holds no triangle, or names files outside its folder.
        MemoryError: it needs more memory than there is.
    """
    if path.suffix.lower() not in FORMATS:
        raise MeshError(path, f"unknown ending {path.suffix!r}", f"convert it to one of {', '.join(FORMATS)}")
    if path.is_symlink() and not path.exists():
        raise MeshError(
            path, f"is a link to {str(path.readlink())!r}, which is missing", "restore what it points to"
        )
    try:
        if path.exists() and not path.is_file():  # a pipe or a device would never end
            raise MeshError(path, "is no regular file", "give a mesh file")
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(
            path, f"can't be read ({error.strerror})", "check the path and its permissions"
        ) from error
    kind = path.suffix.lower()[1:]
    check_nature(path, data, kind)
    bodies = check_archive(path, data) if kind == "3mf" else None
    vertices, faces, groups = _loaded(path, data, kind, bodies)
    if len(faces) == 0 or faces.ndim != 2:
        raise MeshError(
            path, "has no triangles", "export the surface, not a point cloud, curves or an empty scene"
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise MeshError(path, "has faces that name vertices it lacks", "export it again")
    used = vertices[np.unique(faces)]
    if not np.isfinite(used).all():
        raise MeshError(path, "has vertices that are not finite numbers", "export it again")
    if np.abs(used).max() > 1e30:
        raise MeshError(path, f"has coordinates as large as {np.abs(used).max():.3g}", "export it again")
    return Triangles(vertices, faces, groups, sha256(data))


def _loaded(
    path: Path, data: bytes, kind: str, bodies: int | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    quiet = logging.getLogger("trimesh")
    level = quiet.level
    quiet.setLevel(logging.CRITICAL)  # what it would say is raised below, with the file's name
    try:
        own = {"obj": read_obj, "off": read_off, "ply": read_ply}.get(kind)
        return own(data) if own else _by_trimesh(path, data, kind, bodies)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # parsers raise anything on broken input
        first = (str(error).strip() or type(error).__name__).splitlines()[0][:200]
        raise MeshError(path, f"is no readable {kind.upper()} file ({first})", "export it again") from error
    finally:
        quiet.setLevel(level)


def _by_trimesh(
    path: Path, data: bytes, kind: str, bodies: int | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    import trimesh

    options: dict[str, Any] = {"process": False}
    if kind in ("glb", "gltf"):
        options["skip_materials"] = True
    data = without_trailer(data) if kind == "stl" else data
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=_beside(path), **options)
    factor = UNITS.get(str(scene.units), 1.0) if kind == "3mf" else 1.0
    found = len(scene.graph.nodes_geometry)
    if bodies is not None and found != bodies:
        raise MeshError(
            path,
            f"holds {bodies} bodies, of which {found} could be read",
            "save them as one mesh without components",
        )
    meshes = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = [np.zeros((0, 3)), *(np.asarray(mesh.vertices, np.float64) for mesh in meshes)]
    faces = [np.zeros((0, 3), np.int64), *(mesh.faces + start for mesh, start in zip(meshes, starts))]
    groups = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    return np.concatenate(vertices) * factor, np.concatenate(faces).astype(np.int64), groups


def _beside(path: Path) -> Any:
    """Finds the files that ``path`` names, in its own folder only."""
    from trimesh.resolvers import Resolver

    folder = path.resolve().parent

    class Beside(Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            for name in dict.fromkeys((str(key), unquote(str(key)))):
                file = (folder / name).resolve()
                if not file.is_relative_to(folder):
                    raise MeshError(
                        path,
                        f"names a file outside its folder ({name[:200]!r})",
                        "copy it beside and name it so",
                    )
                if file.is_file():
                    return file.read_bytes()
            raise MeshError(
                path, f"names {str(key)[:200]!r}, which is missing", "copy it into the same folder"
            )

        def keys(self) -> list[str]:
            return []

        def write(self, name: str, data: Any) -> None:
            raise MeshError(path, f"tries to write {name[:200]!r}", "export it again")

        def namespaced(self, namespace: str) -> Any:
            return self

    return Beside()
