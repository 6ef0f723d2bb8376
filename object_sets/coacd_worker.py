"""Runs CoACD on one mesh in a process of its own: ``python coacd_worker.py IN.npz OUT.npz``.

CoACD and torch each bring an OpenMP runtime, and one process with both can crash. This file is run by path, so it
imports nothing of the package. IN holds vertices (V, 3) float64, faces (F, 3) int32 and the scalar settings; OUT gets
``count`` and ``part0``, ``part1``, ... as (n, 3) float64.
"""

from __future__ import annotations

import sys

import numpy as np


def main(source: str, target: str) -> None:
    """Read, decompose, write."""
    import coacd

    coacd.set_log_level("error")
    with np.load(source, allow_pickle=False) as data:
        mesh = coacd.Mesh(data["vertices"], data["faces"])
        settings = {key: data[key].item() for key in data.files if key not in ("vertices", "faces")}
    parts = coacd.run_coacd(mesh, **settings)
    arrays = {f"part{i}": np.asarray(vertices, dtype=np.float64) for i, (vertices, _) in enumerate(parts)}
    np.savez(target, allow_pickle=False, count=np.array(len(parts)), **arrays)


if __name__ == "__main__":
    main(*sys.argv[1:])
