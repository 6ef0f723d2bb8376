"""URDF: one link with inertia, a mesh to look at, and one collision shape a convex part (PyBullet, Isaac, ROS)."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from object_sets.exporters import about, number
from object_sets.exporters.obj import mesh_text, part_files
from object_sets.objects import Object


def files(item: Object, mass: float) -> dict[str, str]:
    """``NAME.urdf`` and the OBJ files that it names, all in one folder.

    PyBullet recomputes inertias from shapes unless it is loaded with ``URDF_USE_INERTIA_FROM_FILE``.
    """
    parts = part_files(item)
    (ixx, ixy, ixz), (_, iyy, iyz), (_, _, izz) = (mass * item.inertia).tolist()
    inertia = {"ixx": ixx, "ixy": ixy, "ixz": ixz, "iyy": iyy, "iyz": iyz, "izz": izz}
    lines = [
        '<?xml version="1.0"?>',
        f"<!-- {about(item)} -->",
        f"<robot name={quoteattr(item.name)}>",
        f"  <link name={quoteattr(item.name)}>",
        "    <inertial>",
        f'      <origin xyz="{number(*item.center_of_mass)}" rpy="0 0 0"/>',
        f'      <mass value="{number(mass)}"/>',
        "      <inertia " + " ".join(f'{key}="{number(value)}"' for key, value in inertia.items()) + "/>",
        "    </inertial>",
        *_shape("visual", f"{item.name}.obj"),
        *(line for file in parts for line in _shape("collision", file)),
        "  </link>",
        "</robot>",
    ]
    return {f"{item.name}.urdf": "\n".join(lines) + "\n", f"{item.name}.obj": mesh_text(item), **parts}


def _shape(tag: str, file: str) -> list[str]:
    return [
        f"    <{tag}>",
        '      <origin xyz="0 0 0" rpy="0 0 0"/>',
        f"      <geometry><mesh filename={quoteattr(file)}/></geometry>",
        f"    </{tag}>",
    ]
