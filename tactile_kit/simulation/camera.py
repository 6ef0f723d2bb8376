"""Pictures of a scene, drawn by Bullet's software renderer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactile_kit.simulation.client import Client
from tactile_kit.simulation.quiet_bullet import pybullet


def picture(
    bullet: Client,
    size: int = 480,
    distance: float = 0.42,
    yaw: float = 35.0,
    pitch: float = -15.0,
    height: float = 0.04,
) -> NDArray[np.uint8]:
    """RGB image ``(size, size, 3)`` of a client's scene, seen from ``distance`` m around a point ``height`` m up."""
    view = pybullet.computeViewMatrixFromYawPitchRoll((-0.01, 0.0, height), distance, yaw, pitch, 0, 2)
    projection = pybullet.computeProjectionMatrixFOV(45, 1.0, 0.02, 2.0)
    _, _, pixels, _, _ = bullet.getCameraImage(
        size,
        size,
        view,
        projection,
        lightDirection=(0.4, -0.6, 1.0),
        shadow=1,
        renderer=pybullet.ER_TINY_RENDERER,
    )
    return np.asarray(pixels, dtype=np.uint8).reshape(size, size, 4)[:, :, :3]
