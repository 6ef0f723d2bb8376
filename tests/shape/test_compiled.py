"""The process that compiles the kernels computes the very bytes of those that find them compiled on disk."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CODE = """
import hashlib
import numpy as np
import torch
import object_sets
from tactile_kit.shape import MeshTable, kernels
from tactile_kit.shape.function import bps_vectors
from tactile_kit.rotations import random_rotations
things = object_sets.select("geometric8,elephant")  # the last one is searched through boxes
table = MeshTable.from_meshes([(thing.vertices, thing.faces) for thing in things])
rng = np.random.default_rng(0)
x = torch.as_tensor(rng.normal(0, 0.01, (200, 3)), dtype=torch.float32).requires_grad_()
R = torch.as_tensor(random_rotations(rng, 200), dtype=torch.float32).requires_grad_()
vectors = bps_vectors(table, x, R, torch.as_tensor(rng.integers(len(things), size=200)))
vectors.square().sum().backward()
digest = hashlib.sha256()
for tensor in (vectors.detach(), x.grad, R.grad):
    digest.update(tensor.numpy().tobytes())
print(sum(kernels.forward.stats.cache_hits.values()), digest.hexdigest())
"""


def test_a_fresh_compilation_rounds_as_the_one_on_disk(tmp_path: Path) -> None:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    said = [
        subprocess.run(
            [sys.executable, "-c", CODE],
            capture_output=True,
            text=True,
            timeout=240,
            check=True,
            env=environment,
        ).stdout.split()
        for _ in range(2)
    ]
    assert [hits for hits, _ in said] == ["0", "1"]
    assert said[0][1] == said[1][1]
