"""Small real problems for the tests: boxes, and joint measurements that tell of their motion."""

from __future__ import annotations

import numpy as np
import torch
import trimesh

from tactile_kit import rotations
from tactile_kit.estimator import EstimatorConfig, Sequences, cell_of
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.shape import MeshTable, encoding

TINY = EstimatorConfig(
    encoder_hidden=(24,), transition_hidden=(32, 32), sigma_hidden=(16,), features=8, latent=6, minibatch=16
)


def boxes(*extents: tuple[float, float, float]) -> MeshTable:
    meshes = [trimesh.creation.box(extents=size) for size in extents]
    return MeshTable.from_meshes([(mesh.vertices, mesh.faces) for mesh in meshes])


CUBE = (0.0675, 0.0675, 0.0675)
CUBOID = (0.05, 0.07, 0.085)


def make(config: EstimatorConfig = TINY, table: MeshTable | None = None, seed: int = 0, dtype=torch.float32):
    """Cell, its encoding and the loss's distances, over a cube and a cuboid."""
    table = table or boxes(CUBE, CUBOID)
    shape = encoding(config.encoding or "vec_bps", table)
    torch.manual_seed(seed)
    return cell_of(config, shape).to(dtype), shape, encoding("bps", table)


def motion(
    rng: np.random.Generator, steps: int, count: int, latent: int, restarts: float = 0.0, noise: float = 0.01
):
    """Objects that turn and wander, and measurements in which their motion of this step hides.

    The twist of each step (rotation vector and translation) goes through a fixed mixing matrix into the 144
    measurements, with noise. Episodes restart at random steps at a random orientation.
    """
    # mixing belongs to the problem, not to the data: the same for training and test
    mixing = np.random.default_rng(99).standard_normal((6, 144)) * 0.3
    started = rng.random((steps, count)) < restarts
    x, R = 0.005 * rng.standard_normal((count, 3)), rotations.random_rotations(rng, count)
    rows: dict[str, list[np.ndarray]] = {name: [] for name in ("z", "x_before", "R_before", "x", "R")}
    twist = np.zeros((count, 6))
    for t in range(steps):
        new = started[t] if t else np.ones(count, bool)
        x = np.where(new[:, None], 0.005 * rng.standard_normal((count, 3)), x)
        R = np.where(new[:, None, None], rotations.random_rotations(rng, count), R)
        twist = 0.7 * twist + 0.7 * rng.standard_normal((count, 6))
        rows["x_before"].append(x)
        rows["R_before"].append(R)
        R = rotations.exp(0.08 * twist[:, :3]) @ R
        x = 0.95 * x + 0.002 * twist[:, 3:]
        rows["z"].append(0.1 * twist @ mixing + noise * rng.standard_normal((count, 144)))
        rows["x"].append(x)
        rows["R"].append(R)
    started[0] = True
    arrays = {name: torch.from_numpy(np.array(values)).float() for name, values in rows.items()}
    arrays["valid"] = torch.ones(steps, count, dtype=torch.bool)
    state = EstimatorState(torch.zeros(count, 3), arrays["R_before"][0].clone(), torch.zeros(count, latent))
    mesh = torch.from_numpy(rng.integers(0, 2, (1, count))).repeat(steps, 1)
    return Sequences(mesh=mesh, started=torch.from_numpy(started), state=state, **arrays)
