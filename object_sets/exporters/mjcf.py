"""MJCF: a free body with inertia, a mesh to look at, and one collision geom a convex part (MuJoCo)."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from object_sets.exporters import about, number
from object_sets.exporters.obj import mesh_text, part_files
from object_sets.objects import Object


def files(item: Object, mass: float) -> dict[str, str]:
    """``NAME.xml`` and the OBJ files that it names, all in one folder."""
    name, parts = quoteattr(item.name), part_files(item)
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = (mass * item.inertia).tolist()
    meshes = {item.name: f"{item.name}.obj", **{file.removesuffix(".obj"): file for file in parts}}
    lines = [
        f"<!-- {about(item)} -->",
        f"<mujoco model={name}>",
        '  <compiler angle="radian"/>',
        "  <default>",
        '    <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default>',
        '    <default class="collision"><geom type="mesh" group="3"/></default>',
        "  </default>",
        "  <asset>",
        *(f"    <mesh name={quoteattr(key)} file={quoteattr(file)}/>" for key, file in meshes.items()),
        "  </asset>",
        "  <worldbody>",
        f"    <body name={name}>",
        "      <freejoint/>",
        f'      <inertial pos="{number(*item.center_of_mass)}" mass="{number(mass)}"',
        f'                fullinertia="{number(ixx, iyy, izz, ixy, ixz, iyz)}"/>',
        f'      <geom class="visual" mesh={name}/>',
        *(f'      <geom class="collision" mesh={quoteattr(f.removesuffix(".obj"))}/>' for f in parts),
        "    </body>",
        "  </worldbody>",
        "</mujoco>",
    ]
    return {f"{item.name}.xml": "\n".join(lines) + "\n", f"{item.name}.obj": mesh_text(item), **parts}
