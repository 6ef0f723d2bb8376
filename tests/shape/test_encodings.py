"""Contracts that every encoding of the registry keeps, and what each one means."""

from __future__ import annotations

import subprocess
import sys

import bps_twin as twin
import numpy as np
import pytest
import torch
from bps_cases import hard_shapes, random_poses, table_of

from tactile_kit.shape import BPS, ENCODINGS, PoseError, VecBPS, basis_points, bps_vectors, encoding
from tactile_kit.shape.pointnet import POINTS, PointNet

SHAPES = hard_shapes()
TABLE = table_of(SHAPES["box"], SHAPES["l"], SHAPES["saddle"])
SIZES = {"vec_bps": (192, 192), "bps": (64, 64), "pointnet": (64, 768), "pos_rot": (9, 9), "mesh": (201, 201)}
SIZES |= {"pos": (3, 3), "none": (0, 0)}
NAMES = pytest.mark.parametrize("name", list(ENCODINGS))


def batch(
    number: int = 6, dtype: torch.dtype = torch.float32
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    x, R = random_poses(np.random.default_rng(14), number)
    return x.to(dtype), R.to(dtype), torch.arange(number) % 3


def test_names_and_sizes() -> None:
    assert {name: (kind.size, kind.observation_size) for name, kind in ENCODINGS.items()} == SIZES
    assert all(kind.name == name for name, kind in ENCODINGS.items())


@NAMES
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_shape_dtype_and_repeatability(name: str, dtype: torch.dtype) -> None:
    x, R, mesh = batch(dtype=dtype)
    encode = encoding(name, TABLE)
    found = encode(x, R, mesh)
    assert found.shape == (6, encode.observation_size) and found.dtype == dtype
    assert torch.equal(found, encoding(name, TABLE)(x, R, mesh))
    assert encode(x[:0], R[:0], mesh[:0]).shape == (0, encode.observation_size)
    assert torch.allclose(found[2:3], encode(x[2:3], R[2:3], mesh[2:3]), atol=1e-7)


@NAMES
def test_gradient_reaches_the_pose(name: str) -> None:
    x, R, mesh = batch(dtype=torch.float64)
    x.requires_grad_(), R.requires_grad_()
    encode = encoding(name, TABLE)
    if not encode.observation_size:
        return
    encode(x, R, mesh).square().sum().backward()
    assert torch.isfinite(x.grad).all() and (x.grad != 0).any()
    if name != "pos":
        assert torch.isfinite(R.grad).all() and (R.grad != 0).any()


@NAMES
def test_empty_batch_has_a_gradient(name: str) -> None:
    x, R, mesh = batch(0)
    encoding(name, TABLE)(x.requires_grad_(), R.requires_grad_(), mesh).sum().backward()


@NAMES
def test_feature_layer(name: str) -> None:
    encode = encoding(name, TABLE)
    layer = encode.features()
    if layer is None:
        assert encode.size == encode.observation_size
        return
    features = layer(encode(*batch()))
    assert features.shape == (6, encode.size)
    features.sum().backward()
    assert all((parameter.grad != 0).any() for parameter in layer.parameters())


@NAMES
@pytest.mark.parametrize(
    "change,match",
    [
        (lambda x, R, m: (x[:, :2], R, m), r"x is \(6, 2\)"),
        (lambda x, R, m: (x, R[:, :2], m), r"R \(6, 2, 3\)"),
        (lambda x, R, m: (x, R[:5], m), r"R \(5, 3, 3\)"),
        (lambda x, R, m: (x, R, m[:4]), r"mesh \(4,\)"),
        (lambda x, R, m: (x.double(), R, m), "expected both"),
        (lambda x, R, m: (x.half(), R.half(), m), "expected both"),
        (lambda x, R, m: (x, R, m.int()), "mesh is torch.int32"),
        (lambda x, R, m: (x, R, m + 1), "allowed 0..2"),
        (lambda x, R, m: (x, R, m - 1), "allowed 0..2"),
    ],
)
def test_refuses_wrong_calls(name: str, change: object, match: str) -> None:
    with pytest.raises(PoseError, match=match):
        encoding(name, TABLE)(*change(*batch()))


@pytest.mark.parametrize("grad", [False, True])
@pytest.mark.parametrize(
    "value,match", [(float("nan"), r"x\[3\]"), (float("inf"), r"x\[3\]"), (1000.0, "within")]
)
def test_refuses_bad_positions(value: float, match: str, grad: bool) -> None:
    x, R, mesh = batch()
    x[3, 2] = value
    with pytest.raises(PoseError, match=match):
        bps_vectors(TABLE, x.requires_grad_(grad), R, mesh)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_refuses_what_is_no_rotation(dtype: torch.dtype) -> None:
    for change in (lambda R: R * 1.01, lambda R: R * -1, lambda R: R * float("nan"), lambda R: R * 0):
        x, R, mesh = batch(dtype=dtype)
        R[4] = change(R[4])
        with pytest.raises(PoseError, match=r"R\[4\] .*no rotation"):
            bps_vectors(TABLE, x, R, mesh)


def test_unknown_name() -> None:
    with pytest.raises(ValueError, match="'vec_bp'; nearest valid name: 'vec_bps'"):
        encoding("vec_bp", TABLE)


def test_basis_points_are_the_papers_grid() -> None:
    points = basis_points()
    assert points.shape == (64, 3)
    assert np.allclose(np.unique(points), [-0.07, -0.07 / 3, 0.07 / 3, 0.07])
    assert len(np.unique(points, axis=0)) == 64


def test_bps_is_the_length_of_vec_bps() -> None:
    x, R, mesh = batch()
    vectors = VecBPS(TABLE)(x, R, mesh).reshape(-1, 64, 3)
    assert torch.allclose(BPS(TABLE)(x, R, mesh), vectors.norm(dim=-1))


def test_pose_parts() -> None:
    x, R, mesh = batch(dtype=torch.float64)
    pose = encoding("pos_rot", TABLE)(x, R, mesh)
    assert torch.equal(pose, torch.cat([x, R[:, :, 0], R[:, :, 1]], dim=1))
    assert torch.equal(encoding("pos", TABLE)(x, R, mesh), x)
    whole = encoding("mesh", TABLE)(x, R, mesh)
    still = VecBPS(TABLE)(torch.zeros_like(x), torch.eye(3).to(x).repeat(6, 1, 1), mesh)
    assert torch.equal(whole[:, :9], pose) and torch.equal(whole[:, 9:], still)
    assert torch.equal(encoding("mesh", TABLE)(x.float(), R.float(), mesh)[:, 9:], still.float())


def test_pointnet_points_lie_on_the_posed_surface_and_cover_it() -> None:
    x, R, mesh = batch(dtype=torch.float64)
    clouds = PointNet(TABLE)(x, R, mesh).reshape(6, POINTS, 3)
    for cloud, position, rotation, index in zip(clouds, x, R, mesh, strict=True):
        posed = torch.from_numpy(TABLE.triangles(int(index))) @ rotation.T + position
        assert torch.allclose(twin.closest_points(cloud, posed), cloud, atol=1e-12)
    # uniform by area: on the box, each side holds its share
    box = PointNet(TABLE)(torch.zeros(1, 3), torch.eye(3)[None], torch.zeros(1, dtype=torch.int64)).reshape(
        POINTS, 3
    )
    sides = TABLE.extents[0] / 2
    share = ((box.abs() - torch.from_numpy(sides)).abs() < 1e-6).double().mean(dim=0).numpy()
    areas = np.array([sides[1] * sides[2], sides[0] * sides[2], sides[0] * sides[1]])
    assert np.allclose(share, areas / areas.sum(), atol=0.1)


def test_pointnet_does_not_depend_on_the_table() -> None:
    x, R, _ = batch(3)
    alone = PointNet(table_of(SHAPES["l"]))(x, R, torch.zeros(3, dtype=torch.int64))
    assert torch.equal(alone, PointNet(TABLE)(x, R, torch.ones(3, dtype=torch.int64)))
    assert not torch.equal(alone, PointNet(TABLE, seed=1)(x, R, torch.ones(3, dtype=torch.int64)))


def test_pointnet_is_blind_to_the_order_of_points() -> None:
    layer = PointNet(TABLE).features()
    cloud = torch.randn(2, POINTS, 3, generator=torch.Generator().manual_seed(0))
    shuffled = cloud[:, torch.randperm(POINTS, generator=torch.Generator().manual_seed(1))]
    assert torch.equal(layer(cloud.flatten(1)), layer(shuffled.flatten(1)))


def test_room_does_not_load_the_simulator() -> None:
    code = "import sys, tactile_kit.shape; assert not {'pybullet', 'coacd', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
