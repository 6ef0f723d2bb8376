"""Read mesh files of any origin in processes of their own, bounded in memory and time."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
from dataclasses import asdict
from pathlib import Path
from queue import Empty, SimpleQueue
from select import select
from typing import Any

from object_sets.errors import MeshError
from object_sets.importing import ImportConfig, ImportedMesh
from object_sets.limits import GIB, Limits, out_of_memory, start_worker, stop_worker
from object_sets.storage import read_npz

START = 60.0  # s that a worker may take to import its libraries, on top of a file's own time


class Readers:
    """Worker processes for many files; as many as there are threads that call ``read`` at once.

    A context manager: at its end all of them are gone.
    """

    def __init__(self) -> None:
        self._idle: SimpleQueue[subprocess.Popen[bytes]] = SimpleQueue()
        self._all: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Readers:
        return self

    def __exit__(self, *_: object) -> None:
        for worker in self._all:
            stop_worker(worker)

    def read(self, file: str | Path, config: ImportConfig, limits: Limits) -> ImportedMesh:
        """One file; arguments and errors as of ``read_mesh``."""
        path = Path(file)
        with tempfile.TemporaryDirectory(prefix="mesh-") as folder:
            code = self._run(path, config, limits, folder)
            words = Path(folder, "stderr").read_text(errors="replace") if code else ""
            if out_of_memory(words):
                raise MeshError(
                    path, f"needs more than {limits.memory:g} GiB to read and repair",
                    "simplify it, or allow more memory",
                )  # fmt: skip
            if code:
                said = words.strip()[-300:] or f"signal {-code}" if code < 0 else words.strip()[-300:]
                raise MeshError(
                    path, f"stopped the process that read it ({said})", "export it again in another format"
                )
            answer = json.loads(Path(folder, "answer.json").read_bytes())
            if "defect" in answer:
                raise MeshError(path, answer["defect"], answer["remedy"])
            arrays = read_npz(Path(folder, "mesh.npz").read_bytes(), path)
        return ImportedMesh(arrays["vertices"], arrays["faces"], answer["sha256"], tuple(answer["repairs"]))

    def _run(self, path: Path, config: ImportConfig, limits: Limits, folder: str) -> int:
        """Have a worker read the file; returns the exit code of its fork."""
        request: dict[str, Any] = {
            "file": str(path.absolute()),
            "config": asdict(config),
            "folder": folder,
            "memory": int(limits.memory * GIB),
            "seconds": limits.timeout,
        }
        worker = self._worker()
        try:
            assert worker.stdin is not None
            worker.stdin.write(json.dumps(request).encode() + b"\n")
            fork = _line(worker, START)
            if fork is None:
                raise MeshError(path, f"no process to read it started within {START:g} s", "try again later")
            code = _line(worker, limits.timeout)
            if code is None:
                os.kill(fork, signal.SIGKILL)
                _line(worker, START)
        except OSError as error:  # the pipe broke
            raise MeshError(path, f"the process that reads it ended ({error})", "try again") from error
        self._idle.put(worker)
        if code is None:
            raise MeshError(
                path, f"takes longer than {limits.timeout:g} s to read and repair",
                "simplify it, or allow more time",
            )  # fmt: skip
        return code

    def _worker(self) -> subprocess.Popen[bytes]:
        """One that is idle and alive, else a new one."""
        while True:
            try:
                worker = self._idle.get_nowait()
            except Empty:
                break
            if worker.poll() is None:
                return worker
        worker = start_worker("mesh_worker", stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0)
        self._all.append(worker)
        return worker


def _line(worker: subprocess.Popen[bytes], seconds: float) -> int | None:
    """The number on the worker's next line, or None when the time is over. Raises ``OSError`` when it has ended."""
    assert worker.stdout is not None
    if not select([worker.stdout], [], [], seconds)[0]:
        return None
    line = worker.stdout.readline()
    if not line:
        raise BrokenPipeError(f"code {worker.wait()}")
    return int(line)


def read_mesh(
    file: str | Path, config: ImportConfig | None = None, limits: Limits | None = None
) -> ImportedMesh:
    """Read one mesh file in a process of its own and make a sound solid of it.

    Args:
        file: STL, OBJ, PLY, GLB/GLTF, OFF or 3MF. Files that it names are read from its own folder only.
        config: scale, simplification, centre and alignment.
        limits: memory and time of the process.

    Raises:
        MeshError: the file can't be read, is no solid that could be repaired safely, or needs more memory or time
            than ``limits``; it names file, defect, remedy.
    """
    with Readers() as readers:
        return readers.read(file, config or ImportConfig(), limits or Limits())
