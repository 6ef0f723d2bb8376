"""Runs CoACD on one mesh in a process of its own, with arguments PARENT IN.npz OUT.npz MEMORY SECONDS.

CoACD and torch each bring an OpenMP runtime, and one process with both can crash. IN holds vertices (V, 3) float64,
faces (F, 3) int32 and the scalar settings; OUT gets ``count`` and ``part0``, ``part1``, ... as (n, 3) float64.
MEMORY (bytes) and SECONDS (of the processor) are bounds; without its parent process the worker ends.
"""

from __future__ import annotations

import sys

from object_sets.limits import limit_this_process


def main(parent: str, source: str, target: str, memory: str, seconds: str) -> None:
    """Read, decompose, write."""
    limit_this_process(int(memory), float(seconds), int(parent))
    import coacd
    import numpy as np

    coacd.set_log_level("error")
    with np.load(source, allow_pickle=False) as data:
        mesh = coacd.Mesh(data["vertices"], data["faces"])
        settings = {key: data[key].item() for key in data.files if key not in ("vertices", "faces")}
    parts = coacd.run_coacd(mesh, **settings)
    arrays = {f"part{i}": np.asarray(vertices, dtype=np.float64) for i, (vertices, _) in enumerate(parts)}
    np.savez(target, allow_pickle=False, count=np.array(len(parts)), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
