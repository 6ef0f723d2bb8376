"""Draws the scene with viser: in a live page, or into a recording."""

from __future__ import annotations

import contextlib
import io
import socket
from typing import Any

import numpy as np
import viser

from tactile_kit.errors import ViewError
from tactile_kit.rotations import to_quaternion
from tactile_kit.view.look import BASIS
from tactile_kit.view.scene import EYE, TARGET, Lines, Pose, Scene, Shown

LOOPBACK = "127.0.0.1"


def serve(host: str = LOOPBACK, port: int = 8080) -> viser.ViserServer:
    """A page at ``host:port``; port 0 takes any that is free.

    Raises:
        ViewError: the address can't be had.
    """
    if not 0 <= port <= 65535:
        raise ViewError(f"port = {port}; allowed are 0 to 65535")
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))  # viser itself would take the next free port, unasked
        except OSError as problem:
            reason = problem.strerror or str(problem)
            raise ViewError(f"{host}:{port}: {reason}; another port, or 0 for any that is free") from None
    with contextlib.redirect_stdout(io.StringIO()):  # a banner, whatever verbose says
        server = viser.ViserServer(host=host, port=port, verbose=False)
    server.scene.set_up_direction("+z")
    server.initial_camera.position = tuple(EYE)
    server.initial_camera.look_at = tuple(TARGET)
    server.initial_camera.fov = 0.75
    server.scene.configure_default_lights(enabled=True, cast_shadow=False)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    server.gui.main_panel.dock_right()
    return server


def end(server: viser.ViserServer) -> None:
    """Take the page down."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


class Drawing:
    """One scene in a server's page; :meth:`show` moves it, :meth:`remove` takes it away."""

    def __init__(self, server: viser.ViserServer, scene: Scene) -> None:
        self._server, self._scene = server, scene
        self._root = server.scene.add_frame("/view", show_axes=False)
        self._groups: dict[str, Any] = {}
        self._moved: dict[str, Pose] = {}
        for group in scene.groups:
            self._groups[group.name] = server.scene.add_frame(
                f"/view/{group.name}", show_axes=False, visible=False
            )
            for part in group.parts:
                self._add(f"/view/{group.name}/{part.name}", part)
        self._vectors: Any = None

    def _add(self, name: str, part: Any) -> None:
        if isinstance(part, Lines):
            self._server.scene.add_line_segments(
                name,
                part.segments.astype(np.float32),
                colors=part.colour,
                thickness=part.width,
                thickness_units="screen",
            )
            return
        vertices, faces = part.mesh
        opacity = None if part.opacity >= 1 else part.opacity
        self._server.scene.add_mesh_simple(
            name,
            vertices,
            faces,
            color=part.colour,
            opacity=opacity,
            flat_shading=len(faces) < 100,
            side="double" if opacity else "front",
        )

    def show(self, shown: Shown) -> None:
        """Draw what ``Scene.show`` says; what has not moved is not sent again."""
        with self._server.atomic():
            for name, handle in self._groups.items():
                pose = shown.poses.get(name)
                if pose is None:
                    if self._moved.pop(name, None) is not None:
                        handle.visible = False
                    continue
                before = self._moved.get(name)
                if before is None:
                    handle.visible = True
                if before is None or not np.array_equal(before.position, pose.position):
                    handle.position = pose.position
                if before is None or not np.array_equal(before.rotation, pose.rotation):
                    handle.wxyz = np.roll(to_quaternion(pose.rotation), 1)
                self._moved[name] = pose
            self._show_vectors(shown)

    def _show_vectors(self, shown: Shown) -> None:
        points = shown.vectors.astype(np.float32)
        if not len(points):
            if self._vectors is not None:
                self._vectors.visible = False
        elif self._vectors is None:
            self._vectors = self._server.scene.add_line_segments(
                "/view/vectors", points, colors=BASIS, thickness=1.5, thickness_units="screen"
            )
        else:
            self._vectors.points, self._vectors.visible = points, True

    def remove(self) -> None:
        """Take everything away."""
        self._root.remove()
