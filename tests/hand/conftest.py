"""The hand alone in Bullet, straight from its URDF: what kinematics and controller are held against."""

from __future__ import annotations

from collections.abc import Iterator

import pybullet
import pytest

from tactile_kit.hand import kinematics
from tactile_kit.hand.urdf import hand_urdf
from tactile_kit.rotations import to_quaternion
from tactile_kit.simulation.client import Client


@pytest.fixture(scope="package")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Client, int]]:
    """Client and body id."""
    path = tmp_path_factory.mktemp("hand") / "hand.urdf"
    path.write_text(hand_urdf(), encoding="utf-8")
    client = Client()
    body = client.loadURDF(
        str(path),
        kinematics.HAND_POSITION.tolist(),
        to_quaternion(kinematics.HAND_ROTATION).tolist(),
        useFixedBase=True,
        flags=pybullet.URDF_USE_INERTIA_FROM_FILE,
    )
    yield client, body
    client.disconnect()
