"""Exports are loaded by what they are for, and mass, inertia and shapes are read back."""

import subprocess
import sys

import numpy as np
import pybullet
import pytest
import trimesh
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import object_sets
from object_sets import ObjectSetError, export
from object_sets.cli import main
from object_sets.exporters import FORMATS

# Convex, non-convex with its centre of mass off the origin, one with a mass of its own, one lying askew in its frame.
THINGS = object_sets.select("cube,l_shape,apple,elephant")


def askew():
    """The elephant turned out of its principal axes."""
    thing = THINGS["elephant"]
    turn = Rotation.from_euler("xyz", (0.4, 0.7, 0.2)).as_matrix()
    return object_sets.Object(
        0, "askew", thing.vertices @ turn.T, thing.faces, tuple(part @ turn.T for part in thing.parts),
        False, "turned -- \"so\" & <so>\n", "CC0-1.0",
    )  # fmt: skip


ALL = [*THINGS, askew()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("export")
    for form in FORMATS:
        export(ALL, place, form)
    return place


def mass(thing):
    return thing.mass if thing.mass is not None else 0.05


def rays():
    """(200, 3) starts and ends of rays through the middle, along the axes from all sides."""
    generator = np.random.default_rng(0)
    aims = generator.uniform(-0.03, 0.03, (200, 3))
    directions = np.eye(3)[generator.integers(3, size=200)] * generator.choice([-0.2, 0.2], (200, 1))
    return aims - directions, aims + directions


def outside(points, parts):
    """(N,) m: how far points (N, 3) lie beyond the faces of the nearest part; negative inside."""
    hulls = [ConvexHull(part).equations for part in parts]
    return np.min([(points @ planes[:, :3].T + planes[:, 3]).max(axis=1) for planes in hulls], axis=0)


@pytest.mark.parametrize("thing", ALL, ids=lambda thing: thing.name)
def test_urdf_in_bullet(thing, folder):
    client = pybullet.connect(pybullet.DIRECT)
    try:
        body = pybullet.loadURDF(
            str(folder / thing.name / f"{thing.name}.urdf"),
            flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
        dynamics = pybullet.getDynamicsInfo(body, -1, physicsClientId=client)
        shapes = pybullet.getCollisionShapeData(body, -1, physicsClientId=client)
        looks = pybullet.getVisualShapeData(body, physicsClientId=client)
        starts, ends = rays()
        hits = pybullet.rayTestBatch(starts.tolist(), ends.tolist(), physicsClientId=client)
    finally:
        pybullet.disconnect(client)
    assert dynamics[0] == pytest.approx(mass(thing), rel=1e-6)
    assert np.allclose(dynamics[3], thing.center_of_mass, atol=1e-7)
    axes = Rotation.from_quat(dynamics[4]).as_matrix()
    inertia = axes @ np.diag(dynamics[2]) @ axes.T
    assert np.allclose(inertia, mass(thing) * thing.inertia, rtol=1e-3, atol=1e-9)
    assert len(shapes) == len(thing.parts) and len(looks) == 1
    assert all(shape[2] == pybullet.GEOM_MESH for shape in shapes)
    # Where rays meet the body are the surfaces of the parts, up to the millimetre of margin that Bullet adds.
    met = np.array([hit[0] == body for hit in hits])
    distance = outside(np.array([hit[3] for hit in hits])[met], thing.parts)
    assert distance.min() > 0.0005 and distance.max() < 0.0022
    along = starts + np.linspace(0, 1, 401)[:, None, None] * (ends - starts)
    crossing = (outside(along.reshape(-1, 3), thing.parts).reshape(401, -1) < 0).any(axis=0)
    assert crossing.any() and met[crossing].all()


@pytest.mark.parametrize("thing", ALL, ids=lambda thing: thing.name)
def test_mjcf_in_mujoco(thing, folder):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(folder / thing.name / f"{thing.name}.xml"))
    assert model.body_mass[1] == pytest.approx(mass(thing), rel=1e-6)
    assert np.allclose(model.body_ipos[1], thing.center_of_mass, atol=1e-7)
    axes = Rotation.from_quat(model.body_iquat[1], scalar_first=True).as_matrix()
    inertia = axes @ np.diag(model.body_inertia[1]) @ axes.T
    assert np.allclose(inertia, mass(thing) * thing.inertia, rtol=1e-5, atol=1e-10)
    colliding = np.flatnonzero(model.geom_contype)
    assert len(colliding) == len(thing.parts) and model.ngeom == len(thing.parts) + 1
    # Where MuJoCo puts the corners of each part, in the frame of the body.
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for geom, part in zip(colliding, thing.parts, strict=True):
        mesh = model.geom_dataid[geom]
        start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
        corners = model.mesh_vert[start : start + count] @ data.geom_xmat[geom].reshape(3, 3).T
        corners = corners + data.geom_xpos[geom]
        assert np.allclose(np.sort(corners, axis=0), np.sort(part, axis=0), atol=1e-6)


def test_mujoco_drops_it_on_a_floor(folder):
    """The exported body is not only read: it falls and comes to rest on its parts."""
    mujoco = pytest.importorskip("mujoco")
    spec = mujoco.MjSpec.from_file(str(folder / "l_shape" / "l_shape.xml"))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[1, 1, 0.1], pos=[0, 0, -0.1])
    model = spec.compile()
    data = mujoco.MjData(model)
    for _ in range(1500):
        mujoco.mj_step(model, data)
    assert data.qpos[2] == pytest.approx(-0.1 + THINGS["l_shape"].extents[2] / 2, abs=0.002)
    assert np.abs(data.qvel).max() < 0.05


@pytest.mark.parametrize("thing", ALL, ids=lambda thing: thing.name)
def test_usd_in_pxr(thing, folder):
    usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom, UsdPhysics

    stage = usd.Stage.Open(str(folder / thing.name / f"{thing.name}.usda"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1 and UsdGeom.GetStageUpAxis(stage) == "Z"
    root = stage.GetDefaultPrim()
    assert root.HasAPI(UsdPhysics.RigidBodyAPI)
    physics = UsdPhysics.MassAPI(root)
    assert physics.GetMassAttr().Get() == pytest.approx(mass(thing), rel=1e-6)
    assert np.allclose(physics.GetCenterOfMassAttr().Get(), thing.center_of_mass, atol=1e-7)
    quaternion = physics.GetPrincipalAxesAttr().Get()
    axes = Rotation.from_quat([*quaternion.GetImaginary(), quaternion.GetReal()]).as_matrix()
    inertia = axes @ np.diag(physics.GetDiagonalInertiaAttr().Get()) @ axes.T
    assert np.allclose(inertia, mass(thing) * thing.inertia, rtol=1e-3, atol=1e-10)
    meshes = [prim for prim in root.GetChildren() if prim.IsA(UsdGeom.Mesh)]
    assert len(meshes) == 1 + len(thing.parts)
    points = np.array(UsdGeom.Mesh(meshes[0]).GetPointsAttr().Get())
    assert np.allclose(points, thing.vertices, atol=1e-7)
    for prim, part in zip(meshes[1:], thing.parts, strict=True):
        assert prim.HasAPI(UsdPhysics.CollisionAPI)
        assert UsdPhysics.MeshCollisionAPI(prim).GetApproximationAttr().Get() == "convexHull"
        assert np.allclose(np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get()), part, atol=1e-7)


@pytest.mark.parametrize("thing", ALL, ids=lambda thing: thing.name)
def test_obj_in_trimesh(thing, folder):
    place = folder / thing.name
    mesh = trimesh.load_mesh(place / f"{thing.name}.obj", process=False)
    assert mesh.is_watertight and mesh.volume == pytest.approx(thing.volume, rel=1e-6)
    assert np.allclose(mesh.vertices, thing.vertices, atol=1e-9)
    scene = trimesh.load_scene(place / f"{thing.name}_parts.obj", split_objects=True, process=False)
    assert len(scene.geometry) == len(thing.parts)
    for index, part in enumerate(thing.parts):
        alone = trimesh.load_mesh(place / f"{thing.name}_part_{index:03d}.obj", process=False)
        assert alone.is_watertight and alone.volume == pytest.approx(ConvexHull(part).volume, rel=1e-6)


def test_same_objects_same_bytes(folder, tmp_path):
    for form in FORMATS:
        export(ALL, tmp_path, form)
    first = {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.*")}
    assert first == {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*.*")}
    assert len(first) > 4 * len(ALL)


def test_mass_and_density(tmp_path):
    (path,) = export([THINGS["cube"]], tmp_path, "urdf", density=500.0)
    assert f'<mass value="{500.0 * THINGS["cube"].volume:.9g}"/>' in path.read_text()
    (path,) = export([THINGS["apple"]], tmp_path, "urdf", mass=0.2)
    assert '<mass value="0.2"/>' in path.read_text()


@pytest.mark.parametrize(
    ("objects", "form", "settings", "message"),
    [
        (ALL, "udrf", {}, "nearest valid name: 'urdf'"),
        ([], "urdf", {}, "none"),
        ([ALL[0], ALL[0]], "urdf", {}, "names repeat: cube"),
        (ALL, "urdf", {"mass": 1.0, "density": 1.0}, "at most one"),
        (ALL, "urdf", {"mass": -1.0}, "mass = -1"),
    ],
)
def test_bad_arguments(tmp_path, objects, form, settings, message):
    with pytest.raises(ObjectSetError, match=message):
        export(objects, tmp_path / "out", form, **settings)
    assert not (tmp_path / "out").exists()


def test_command(tmp_path, capsys):
    assert main(["export", "cube,apple", "--format", "usd", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "cube.usda" in text and "1 of 2 objects have no known mass: 0.05 kg written" in text
    assert main(["export", "cubee", "--format", "usd", "--out", str(tmp_path)]) == 1


def test_writing_needs_none_of_the_simulators(tmp_path):
    code = (
        "import sys, object_sets; object_sets.export(object_sets.load('all'), sys.argv[1], 'usd');"
        "bad = {'pxr', 'mujoco', 'pybullet', 'trimesh'} & set(sys.modules); sys.exit(f'imported {bad}' if bad else 0)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert len(list(tmp_path.iterdir())) == 16
