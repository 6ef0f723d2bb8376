"""Kalman baseline: what contact geometry alone tells of the object's pose, without learning.

An error-state unscented Kalman filter on position and orientation: the state of the filter is the error of the
estimate, ``(dx, dr)`` with x = x̂ + dx and R = exp(dr) R̂, so that six numbers without constraints describe it.
Prediction: the pads that press carry the object along as a rigid body, at every sigma point as it would be held there.
Correction: a finger that presses stands on the surface; one that does not press may be anywhere outside it; and a
held object is near the centre of the hand.

It has the cell's interface, so that it can stand in for it wherever a belief is needed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from pydantic import Field
from torch import Tensor

from tactile_kit.errors import EstimatorError
from tactile_kit.estimator.cell import MEASUREMENTS
from tactile_kit.estimator.fingers import FINGERS, MEMORY, RADII, SPHERES, Fingers, fingers
from tactile_kit.estimator.fits import fits
from tactile_kit.estimator.so3 import log
from tactile_kit.estimator.state import EstimatorState
from tactile_kit.estimator.step import FARTHEST
from tactile_kit.estimator.turn import turned
from tactile_kit.estimator.unscented import Unscented
from tactile_kit.settings import Settings
from tactile_kit.shape.moving import surface_vectors

N = 6  # dx, dr
COVARIANCE = N * N


class KalmanConfig(Settings):
    """Noise of the filter, standard deviations: what the models miss where an oracle acts (docs/kalman.md)."""

    start_position: float = Field(
        default=0.005, gt=0, description="m, of the object about the nominal centre."
    )
    start_rotation: float = Field(default=0.02, gt=0, description="rad; the start orientation is known.")
    position_noise: float = Field(default=0.003, gt=0, description="m a step, of what the pads carry.")
    rotation_noise: float = Field(default=0.08, gt=0, description="rad a step, likewise.")
    contact_noise: float = Field(default=0.006, gt=0, description="m, of a finger's distance to the surface.")
    home: float = Field(default=0.015, gt=0, description="m, of a held object about the nominal centre.")
    pressed: float = Field(
        default=0.5, gt=0, lt=1, description="From this share on (estimator/fits.py) a finger presses."
    )
    alpha: float = Field(default=1.0, gt=0, le=1, description="How far out the sigma points are: times √6 σ.")
    largest_position: float = Field(
        default=0.03, gt=0, description="m, beyond which no deviation grows: a hand is no larger."
    )
    largest_rotation: float = Field(default=0.8, gt=0, description="rad, likewise, of each axis.")
    distance_unit: float = Field(
        default=0.01, gt=0, description="m, unit of sigma_v, as the learned estimator's."
    )


class KalmanFilter:
    """Pose filter over a batch of environments; of its state ``latent (B, 36 + MEMORY)`` are covariance and fingers."""

    def __init__(self, config: KalmanConfig | None = None) -> None:
        self.config = config = config or KalmanConfig()
        self.unscented = Unscented(N, alpha=config.alpha, beta=2.0, kappa=0.0)
        self.process_noise = _diagonal(config.position_noise, config.rotation_noise)
        deviations = [config.contact_noise] * FINGERS + [config.home] * 3
        self.contact_noise = torch.diag(torch.tensor(deviations, dtype=torch.float64) ** 2)

    def initial(self, R0: Tensor) -> EstimatorState:
        """State at an episode's start: orientation ``(B, 3, 3)`` given, position at the origin."""
        config, count = self.config, len(R0)
        spread = _diagonal(config.start_position, config.start_rotation).to(R0.dtype)
        latent = torch.cat([spread.flatten().repeat(count, 1), R0.new_zeros(count, MEMORY)], dim=1)
        return EstimatorState(R0.new_zeros(count, 3), R0.clone(), latent)

    @torch.no_grad()
    def __call__(self, state: EstimatorState, z: Tensor, encoding: Any, mesh: Tensor) -> EstimatorState:
        """One prediction and correction; arguments and result as for ``EstimatorCell``. Of ``encoding`` the meshes."""
        if z.shape[-1] != MEASUREMENTS:
            raise EstimatorError(f"measurements have {z.shape[-1]} entries, allowed: {MEASUREMENTS}")
        nowhere = torch.zeros(1, len(z), dtype=torch.bool)
        (seen,) = fingers(z[None], nowhere, state.latent[:, COVARIANCE:]).steps()
        hand = Held(seen, encoding.meshes, mesh)
        at, P = Pose(state.x.float(), state.R.float()), _covariance(state)
        carried = hand.carried(at)
        error, P = self.unscented.predict(
            P.new_zeros(len(z), N), P, lambda points: process(hand, at, carried, points), self.process_noise
        )
        pressing = hand.shares(carried.moved(error)) > self.config.pressed
        error, P = self.unscented.update(
            error, P, lambda points: contacts(hand, carried, pressing, points), self.contact_noise
        )
        after, P = carried.moved(error), self._bounded(P)
        latent = torch.cat([P.flatten(1).to(state.latent.dtype), seen.memory.to(state.latent.dtype)], dim=1)
        return EstimatorState(after.x.to(state.x.dtype), after.R.to(state.R.dtype), latent)

    def sigmas(self, state: EstimatorState) -> Tensor:
        """σ_v (in ``distance_unit``) and σ_R (rad) from the covariance: ``(B, 2)``."""
        variance = _covariance(state).diagonal(dim1=1, dim2=2)
        position = variance[:, :3].mean(dim=1).sqrt() / self.config.distance_unit
        sigmas = torch.stack([position, variance[:, 3:].sum(dim=1).sqrt()], dim=1)
        return sigmas.to(state.latent.dtype)

    def _bounded(self, P: Tensor) -> Tensor:
        """P, scaled where a deviation is beyond the largest: without contact it would grow without end."""
        config = self.config
        largest = torch.tensor(
            [config.largest_position] * 3 + [config.largest_rotation] * 3, dtype=torch.float64
        )
        shrink = (largest / P.diagonal(dim1=1, dim2=2).sqrt()).clamp(max=1.0)
        return shrink[:, :, None] * P * shrink[:, None, :]


class Pose(NamedTuple):
    """x ``(B, 3)`` m, R ``(B, 3, 3)``; float32."""

    x: Tensor
    R: Tensor

    def moved(self, error: Tensor) -> Pose:
        """The pose that is off by ``error (B, 6)``: m, rad."""
        dx, dr = error.float().split(3, dim=1)
        return Pose((self.x + dx).clamp(-FARTHEST, FARTHEST), turned(self.R, dr))

    def repeated(self, times: int) -> Pose:
        return Pose(self.x.repeat(times, 1), self.R.repeat(times, 1, 1))


class Held:
    """One step's fingers of B environments about their meshes, asked at poses ``(k B, ...)``: k rounds of all B."""

    def __init__(self, seen: Fingers, meshes: Any, mesh: Tensor) -> None:
        self.seen, self.meshes, self.mesh = seen, meshes, mesh

    def carried(self, at: Pose) -> Pose:
        """The poses after the motion that the pads that press there must have given the object."""
        return at.moved(self._fits(at)[:, :N])

    def shares(self, at: Pose) -> Tensor:
        """How surely each finger presses: ``(k B, 4)`` in [0, 1]."""
        return self._fits(at)[:, 2 * N :]

    def gaps(self, at: Pose) -> Tensor:
        """Clearance of each finger, that of its nearest sphere: ``(k B, 4)`` m, below zero where it is inside."""
        clearance = self._vectors(at).norm(dim=-1) - RADII
        return clearance.unflatten(1, (FINGERS, SPHERES)).amin(dim=-1)

    def _vectors(self, at: Pose) -> Tensor:
        times = len(at.x) // len(self.mesh)
        return surface_vectors(
            self.meshes, at.x, at.R, self.seen.points.repeat(times, 1, 1), self.mesh.repeat(times)
        )

    def _fits(self, at: Pose) -> Tensor:
        times = len(at.x) // len(self.mesh)
        push, move = self.seen.push.repeat(times, 1, 1), self.seen.move.repeat(times, 1, 1)
        return fits(self.seen.points.repeat(times, 1, 1), self._vectors(at), at.x, push, move)


def process(hand: Held, at: Pose, carried: Pose, points: Tensor) -> Tensor:
    """Errors ``(k, B, 6)`` about ``at`` to errors about ``carried``, where the estimate itself is carried to."""
    times = len(points)
    after = hand.carried(at.repeated(times).moved(points.flatten(0, 1)))
    x, R = carried.repeated(times)
    turn = log(after.R.double() @ R.double().transpose(1, 2))
    return torch.cat([(after.x - x).double(), turn], dim=1).view_as(points)


def contacts(hand: Held, at: Pose, pressing: Tensor, points: Tensor) -> Tensor:
    """What should be zero at errors ``(k, B, 6)`` about ``at``: ``(k, B, 7)`` m.

    The clearance of a finger that presses (``pressing (B, 4)``); of any other, how far it would be inside; and the
    position, for an object that is not near the centre is not held.
    """
    there = at.repeated(len(points)).moved(points.flatten(0, 1))
    gaps = hand.gaps(there).double().view(len(points), -1, FINGERS)
    gaps = torch.where(pressing, gaps, gaps.clamp(max=0.0))
    return torch.cat([gaps, there.x.double().view(len(points), -1, 3)], dim=2)


def _diagonal(position: float, rotation: float) -> Tensor:
    return torch.diag(torch.tensor([position**2] * 3 + [rotation**2] * 3, dtype=torch.float64))


def _covariance(state: EstimatorState) -> Tensor:
    return state.latent[:, :COVARIANCE].double().reshape(-1, N, N)
