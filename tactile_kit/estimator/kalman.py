"""Kalman baseline: what fingertip geometry alone tells of the object's pose, without learning.

An error-state extended Kalman filter (filterpy) on position and orientation. Prediction: the touching
fingertips carry the object along as a rigid body. Correction: where a finger is loaded, the distance from
its tip capsule's axis to the object's surface is the capsule's radius; a tip that would stand inside the
object counts as touching too. A finger touches when the control error of its flexion joints is large: the
hand has no other sense.

It has the cell's interface, so that it can stand in for it wherever a belief is needed.
"""

from __future__ import annotations

import numpy as np
import torch
import trimesh
from filterpy.kalman import ExtendedKalmanFilter
from numpy.typing import NDArray
from pydantic import Field
from torch import Tensor

from tactile_kit.estimator.errors import EstimatorError
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.hand import kinematics
from tactile_kit.shape import Encoding
from tactile_kit.task import rotations
from tactile_kit.task.config import Settings

Array = NDArray[np.float64]

SAMPLES = 6
AXIS_POINTS = 3  # along the tip capsule's axis: 9 mm apart, against a radius of 14 mm


class KalmanConfig(Settings):
    """Noise of the filter. All standard deviations; chosen by the sizes of the effects, not fitted."""

    start_position: float = Field(
        default=0.015, gt=0, description="m, of the object about the nominal centre."
    )
    start_rotation: float = Field(default=0.02, gt=0, description="rad; the start orientation is known.")
    position_noise: float = Field(default=0.002, gt=0, description="m a step.")
    rotation_noise: float = Field(
        default=0.06, gt=0, description="rad a step; an object turns some 0.1 rad a step."
    )
    contact_noise: float = Field(
        default=0.003, gt=0, description="m, distance of a touching tip to the surface."
    )
    contact_error: float = Field(
        default=0.04, gt=0, description="rad, flexion control error of a touching finger."
    )
    gate: float = Field(
        default=4.0, gt=0, description="Contacts further off than this many deviations are left out."
    )
    carry: bool = Field(
        default=True, description="Touching tips carry the object; else it is predicted to rest."
    )
    distance_unit: float = Field(
        default=0.01, gt=0, description="m, unit of sigma_v, as the learned estimator's."
    )


class KalmanFilter:
    """Pose filter over a batch of environments; ``latent`` of its state is the covariance, ``(B, 36)``."""

    def __init__(self, config: KalmanConfig | None = None) -> None:
        self.config = config or KalmanConfig()

    def initial(self, R0: Tensor) -> EstimatorState:
        """State at an episode's start: orientation ``(B, 3, 3)`` given, position at the origin."""
        config, count = self.config, len(R0)
        spread = torch.tensor([config.start_position**2] * 3 + [config.start_rotation**2] * 3, dtype=R0.dtype)
        covariance = torch.diag(spread).flatten().repeat(count, 1)
        return EstimatorState(torch.zeros(count, 3, dtype=R0.dtype), R0.clone(), covariance)

    def __call__(self, state: EstimatorState, z: Tensor, encoding: Encoding, mesh: Tensor) -> EstimatorState:
        """One prediction and correction; arguments and result as for ``EstimatorCell``. Of ``encoding`` the meshes."""
        if z.shape[-1] != SAMPLES * 2 * kinematics.JOINTS:
            raise EstimatorError(
                f"measurements have {z.shape[-1]} entries, allowed: {SAMPLES * 2 * kinematics.JOINTS}"
            )
        windows = z.detach().double().numpy().reshape(len(z), SAMPLES, 2, kinematics.JOINTS)
        rows = []
        for n, window in enumerate(windows):
            pose = state.x[n].double().numpy(), state.R[n].double().numpy()
            covariance = state.latent[n].double().numpy().reshape(6, 6)
            rows.append(self._update(*pose, covariance, window, encoding.meshes.triangles(int(mesh[n]))))
        x, R, covariance = (np.array(part) for part in zip(*rows, strict=True))
        parts = (x, R, covariance.reshape(len(z), 36))
        return EstimatorState(*(torch.from_numpy(part).to(state.x.dtype) for part in parts))

    def sigmas(self, state: EstimatorState) -> Tensor:
        """σ_v (in ``distance_unit``) and σ_R (rad) from the covariance: ``(B, 2)``."""
        variance = state.latent.reshape(-1, 6, 6).diagonal(dim1=1, dim2=2)
        position = (variance[:, :3].mean(dim=1)).sqrt() / self.config.distance_unit
        return torch.stack([position, variance[:, 3:].sum(dim=1).sqrt()], dim=1)

    def _update(self, x: Array, R: Array, covariance: Array, window: Array, triangles: Array):
        config = self.config
        before = kinematics.link_frames(window[0, 0])[:, 3]
        after = kinematics.link_frames(window[-1, 0])[:, 3]
        error = np.abs(window[-1, 1].reshape(kinematics.FINGERS, kinematics.DRIVEN)[:, 1:]).max(axis=1)
        touching = error > config.contact_error
        if config.carry:
            x, R = self._carried(x, R, before, after, touching, triangles)
        ekf = ExtendedKalmanFilter(dim_x=6, dim_z=1)
        ekf.x = np.zeros(6)
        ekf.P = covariance.copy()
        ekf.Q = np.diag([config.position_noise**2] * 3 + [config.rotation_noise**2] * 3)
        ekf.predict()
        for finger in range(kinematics.FINGERS):
            distance, surface, normal = _contact(after[finger], x, R, triangles)
            gap = distance - kinematics.DISTAL.capsule.radius
            if not (touching[finger] or gap < 0):
                continue
            # the surface point moves with the object: its distance to the fixed tip shrinks by n . (dx + dr
            # x (c - x))
            slope = -np.concatenate([normal, np.cross(surface - x, normal)])[None]
            if gap**2 > config.gate**2 * ((slope @ ekf.P @ slope.T).item() + config.contact_noise**2):
                continue
            ekf.update(
                np.zeros(1),
                lambda _, slope=slope: slope,
                lambda _, gap=gap: np.array([gap]),
                R=config.contact_noise**2,
            )
            # the error is moved into the pose at once, so that the next finger sees the corrected one
            x, R = x + ekf.x[:3], rotations.exp(ekf.x[3:]) @ R
            ekf.x = np.zeros(6)
        return x, R, 0.5 * (ekf.P + ekf.P.T)

    def _carried(self, x: Array, R: Array, before: Array, after: Array, touching: Array, triangles: Array):
        """Pose moved by the rigid motion that fits the touching tips' skin best, damped where they say little."""
        equations, moves = [], []
        for finger in np.flatnonzero(touching):
            _, surface, _ = _contact(before[finger], x, R, triangles)
            local = before[finger, :3, :3].T @ (surface - before[finger, :3, 3])
            # the window spans 5 of the step's 6 sampling intervals
            move = (after[finger, :3, :3] @ local + after[finger, :3, 3] - surface) * SAMPLES / (SAMPLES - 1)
            lever = surface - x
            cross = np.array([[0, lever[2], -lever[1]], [-lever[2], 0, lever[0]], [lever[1], -lever[0], 0]])
            equations.append(np.hstack([np.eye(3), cross]) / self.config.contact_noise)
            moves.append(move / self.config.contact_noise)
        if not equations:
            return x, R
        # rest is the prior, with a step's noise widened threefold: one or two tips don't fix a rotation
        prior = np.diag(
            [1 / (3 * self.config.position_noise)] * 3 + [1 / (3 * self.config.rotation_noise)] * 3
        )
        system, right = np.vstack([*equations, prior]), np.concatenate([*moves, np.zeros(6)])
        twist = np.linalg.lstsq(system, right, rcond=None)[0]
        return x + twist[:3], rotations.exp(twist[3:]) @ R


def _contact(frame: Array, x: Array, R: Array, triangles: Array) -> tuple[float, Array, Array]:
    """Signed distance from a tip capsule's axis to the posed mesh, the surface point, and the normal there (world)."""
    capsule = kinematics.DISTAL.capsule
    along = np.linspace(capsule.start, capsule.end, AXIS_POINTS)
    points = (frame[:3, 3] + along[:, None] * frame[:3, kinematics.DISTAL.axis] - x) @ R
    count = len(triangles)
    tiled = np.broadcast_to(triangles, (len(points), count, 3, 3)).reshape(-1, 3, 3)
    nearest = trimesh.triangles.closest_point(tiled, np.repeat(points, count, axis=0)).reshape(
        len(points), count, 3
    )
    offsets = points[:, None] - nearest
    squared = (offsets**2).sum(-1)
    point, triangle = np.unravel_index(squared.argmin(), squared.shape)
    a, b, c = triangles[triangle]
    face = np.cross(b - a, c - a)
    face /= np.linalg.norm(face)
    offset, distance = offsets[point, triangle], float(np.sqrt(squared[point, triangle]))
    # on the surface itself the offset has no direction, inside it points inwards
    side = 1.0 if offset @ face >= 0 else -1.0
    normal = side * offset / distance if distance > 1e-9 else face
    return side * distance, R @ nearest[point, triangle] + x, R @ normal
