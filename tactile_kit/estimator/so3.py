"""SO(3) in torch: exponential, logarithm, geodesic angle. Every gradient is finite, also at 0 and at pi.

A ``torch.where`` alone doesn't protect a gradient (0 * inf = NaN in the branch not taken), so the dangerous
argument is replaced before the square root or division: the "double where".
"""

from __future__ import annotations

import torch
from torch import Tensor


def safe_norm(vector: Tensor) -> Tensor:
    """Euclidean norm over the last axis, ``(..., n)`` to ``(...)``; its gradient at the zero vector is zero."""
    square = (vector * vector).sum(-1)
    positive = square > torch.finfo(vector.dtype).tiny
    return torch.where(positive, torch.where(positive, square, 1.0).sqrt(), 0.0)


def vee(rotation: Tensor) -> Tensor:
    """Axis times sine of the angle, from the skew part: ``(..., 3, 3)`` to ``(..., 3)``."""
    return 0.5 * torch.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        dim=-1,
    )


def hat(vector: Tensor) -> Tensor:
    """Cross-product matrix of ``(..., 3)``: ``(..., 3, 3)``."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(*vector.shape[:-1], 3, 3)


def exp(vector: Tensor) -> Tensor:
    """Rotation by ``|v|`` rad about ``v`` (Rodrigues): ``(..., 3)`` rad to ``(..., 3, 3)``, same dtype."""
    square = (vector * vector).sum(-1)[..., None, None]
    # Below this squared angle three Taylor terms are exact to float64 rounding.
    small = square < 1e-4
    safe = torch.where(small, 1.0, square)
    angle = safe.sqrt()
    half = (0.5 * angle).sin()
    sine = torch.where(small, 1 - square / 6 + square * square / 120, angle.sin() / angle)
    # (1 - cos a) / a^2 written with the half angle, which doesn't cancel
    cosine = torch.where(small, 0.5 - square / 24 + square * square / 720, 2 * half * half / safe)
    skew = hat(vector)
    eye = torch.eye(3, dtype=vector.dtype, device=vector.device)
    return eye + sine * skew + cosine * (skew @ skew)


def geodesic(a: Tensor, b: Tensor) -> Tensor:
    """Angle between rotations, rad in [0, pi]: ``(..., 3, 3)`` twice (broadcast) to ``(...)``.

    The paper's d(R̂, R). atan2 of sine and cosine keeps the digits at both ends, where the arc cosine of the
    trace loses them. The gradient is the unit rotation axis; at exactly 0 and pi, where there is none, it is
    zero.
    """
    difference = a @ b.transpose(-1, -2)
    cosine = 0.5 * (difference.diagonal(dim1=-2, dim2=-1).sum(-1) - 1.0)
    return torch.atan2(safe_norm(vee(difference)), cosine)


def log(rotation: Tensor) -> Tensor:
    """Rotation vector, rad, |v| <= pi: ``(..., 3, 3)`` to ``(..., 3)``. At pi one of the two axes is returned."""
    # 4 q q^T is linear in R; its row with the largest diagonal never vanishes, and is q up to scale.
    r = rotation
    trace = r.diagonal(dim1=-2, dim2=-1).sum(-1)
    axis = 2.0 * vee(r)
    outer = r + r.transpose(-1, -2)
    diagonal = 1.0 + 2.0 * r.diagonal(dim1=-2, dim2=-1) - trace[..., None]
    outer = outer - torch.diag_embed(outer.diagonal(dim1=-2, dim2=-1)) + torch.diag_embed(diagonal)
    real = torch.cat([(1.0 + trace)[..., None], axis], dim=-1)
    rows = torch.cat([real[..., None, :], torch.cat([axis[..., :, None], outer], dim=-1)], dim=-2)
    best = torch.cat([(1.0 + trace)[..., None], diagonal], dim=-1).argmax(-1)
    row = torch.gather(rows, -2, best[..., None, None].expand(*best.shape, 1, 4)).squeeze(-2)
    quaternion = row / row.norm(dim=-1, keepdim=True)
    quaternion = torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    w, v = quaternion[..., 0], quaternion[..., 1:]
    sine = safe_norm(v)
    tiny = sine < 1e-6
    factor = torch.where(
        tiny, 2.0 / w.clamp(min=0.5), 2.0 * torch.atan2(sine, w) / torch.where(tiny, 1.0, sine)
    )
    return factor[..., None] * v


def to_6d(rotation: Tensor) -> Tensor:
    """First two columns, one after the other: ``(..., 3, 3)`` to ``(..., 6)``."""
    return rotation[..., :, :2].transpose(-1, -2).flatten(-2)
