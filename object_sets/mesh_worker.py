"""Reads mesh files away from the main process: argument PARENT (a process id), one request a line on stdin.

Parsers of seven formats meet files of unknown origin here. Each file is read in a fork of its own, bounded in memory
and processor time; forks are cheap because everything is imported once, before the first. ``reading.py`` talks to it.

A request is JSON: ``file``, ``config``, ``folder`` (for the answer), ``memory`` (bytes), ``seconds``. Two lines come
back: the fork's process id, and its exit code when it has ended. ``folder`` then holds ``answer.json`` with ``sha256``
and ``repairs`` beside ``mesh.npz`` with vertices (V, 3) float64 and faces (F, 3) int32; or ``defect`` and ``remedy``.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from object_sets.limits import die_with_parent, limit_this_process


def main() -> None:
    """Serve requests until stdin ends."""
    die_with_parent(int(sys.argv[1]))
    import manifold3d  # noqa: F401
    import scipy.spatial  # noqa: F401
    import trimesh  # noqa: F401

    from object_sets import importing, posing, quality, repair  # noqa: F401

    for line in sys.stdin:
        request = json.loads(line)
        parent = os.getpid()
        fork = os.fork()
        if fork == 0:
            os._exit(_child(request, parent))
        print(fork, flush=True)
        print(os.waitstatus_to_exitcode(os.waitpid(fork, 0)[1]), flush=True)


def _child(request: dict[str, Any], parent: int) -> int:
    folder = Path(request["folder"])
    words = os.open(folder / "stderr", os.O_WRONLY | os.O_CREAT, 0o600)
    os.dup2(words, 2)
    try:
        limit_this_process(request["memory"], request["seconds"], parent)
        answer = _read(request, folder)
        (folder / "answer.json").write_text(json.dumps(answer))
        return 0
    except BaseException as error:
        os.write(2, f"{type(error).__name__}: {error}".encode(errors="replace"))
        return 1


def _read(request: dict[str, Any], folder: Path) -> dict[str, Any]:
    from object_sets.errors import MeshError
    from object_sets.importing import ImportConfig, import_mesh
    from object_sets.storage import npz_bytes

    try:
        mesh = import_mesh(request["file"], ImportConfig(**request["config"]))
    except MeshError as error:
        return {"defect": error.defect, "remedy": error.remedy}
    (folder / "mesh.npz").write_bytes(npz_bytes({"vertices": mesh.vertices, "faces": mesh.faces}))
    return {"sha256": mesh.sha256, "repairs": mesh.repairs}


if __name__ == "__main__":
    main()
