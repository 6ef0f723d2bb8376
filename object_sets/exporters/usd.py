"""USD, as text (.usda): a rigid body with UsdPhysics mass, a mesh to look at, one collision mesh a part (Isaac Sim)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from object_sets.exporters import about, number
from object_sets.exporters.obj import hull_faces
from object_sets.objects import Object
from object_sets.posing import principal_axes


def files(item: Object, mass: float) -> dict[str, str]:
    """``NAME.usda``, complete in itself. The text is written here, so nothing of USD needs to be installed."""
    prim = "".join(c if c.isascii() and (c.isalnum() or c == "_") else "_" for c in item.name)
    prim = prim if not prim[0].isdigit() else f"_{prim}"
    to_principal = principal_axes(item.vertices, item.faces)
    moments = mass * np.diag(to_principal @ item.inertia @ to_principal.T)
    lines = [
        "#usda 1.0",
        "(",
        f'    defaultPrim = "{prim}"',
        f'    doc = "{about(item)}"',
        "    kilogramsPerUnit = 1",
        "    metersPerUnit = 1",
        '    upAxis = "Z"',
        ")",
        "",
        f'def Xform "{prim}" (',
        '    prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]',
        '    kind = "component"',
        ")",
        "{",
        f"    point3f physics:centerOfMass = {_tuple(item.center_of_mass)}",
        f"    float3 physics:diagonalInertia = {_tuple(moments)}",
        f"    float physics:mass = {number(mass)}",
        f"    quatf physics:principalAxes = {_tuple(_quaternion(to_principal.T))}",
        "",
        *_mesh("visual", item.vertices, item.faces, ()),
    ]
    for index, corners in enumerate(item.parts):
        collision = (
            '        uniform token physics:approximation = "convexHull"',
            '        uniform token purpose = "guide"',
        )
        lines += ["", *_mesh(f"collision_{index:03d}", corners, hull_faces(corners), collision)]
    return {f"{item.name}.usda": "\n".join([*lines, "}"]) + "\n"}


def _mesh(name: str, vertices: np.ndarray, faces: np.ndarray, collision: Iterable[str]) -> list[str]:
    points = ", ".join(_tuple(point) for point in vertices)
    box = ", ".join((_tuple(vertices.min(axis=0)), _tuple(vertices.max(axis=0))))
    head = [f'    def Mesh "{name}"']
    if collision:
        schemas = '        prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]'
        head = [f'    def Mesh "{name}" (', schemas, "    )"]
    return [
        *head,
        "    {",
        f"        float3[] extent = [{box}]",
        f"        int[] faceVertexCounts = [{', '.join(['3'] * len(faces))}]",
        f"        int[] faceVertexIndices = [{', '.join(str(i) for i in np.asarray(faces).ravel().tolist())}]",
        f"        point3f[] points = [{points}]",
        *collision,
        '        uniform token subdivisionScheme = "none"',
        "    }",
    ]


def _tuple(values: Iterable[float]) -> str:
    return f"({', '.join(number(value) for value in values)})"


def _quaternion(rotation: np.ndarray) -> list[float]:
    """(w, x, y, z) of a rotation (3, 3)."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True).tolist()
    return [w, x, y, z]
