"""The slow, obvious twin of the kernel, in float64 torch: what tests trust. Shares no code with it.

Closest point: every triangle is tried, by projection onto its plane and onto its three edges. Inside: the winding
number, a sum of solid angles, not pseudonormals. Gradients come from autograd.
"""

from __future__ import annotations

import math

import torch


def bps_vectors(
    points: torch.Tensor, triangles: torch.Tensor, x: torch.Tensor, R: torch.Tensor
) -> torch.Tensor:
    """Vectors from each point to one posed mesh, zero inside (paper eq. 4).

    points (K, 3), triangles (F, 3, 3), x (3,), R (3, 3), all float64, metres. Returns (K, 3), differentiable.
    """
    posed = triangles @ R.T + x
    vectors = closest_points(points, posed) - points
    return torch.where(inside(points, posed.detach())[:, None], torch.zeros_like(vectors), vectors)


def closest_points(points: torch.Tensor, triangles: torch.Tensor) -> torch.Tensor:
    """Closest surface point (K, 3) to each of points (K, 3) on triangles (F, 3, 3)."""
    a, b, c = triangles.unbind(dim=1)
    candidates = torch.stack(
        [
            on_plane(points, a, b, c),
            on_segment(points, a, b),
            on_segment(points, b, c),
            on_segment(points, c, a),
        ]
    )  # (4, K, F, 3)
    distances = torch.linalg.vector_norm(candidates.detach() - points[:, None], dim=-1)
    within = in_triangle(points, a, b, c)
    distances[0] = torch.where(within, distances[0], torch.inf)
    kind, triangle = torch.unravel_index(
        distances.transpose(0, 1).flatten(1).argmin(dim=1), (4, len(triangles))
    )
    return candidates[kind, torch.arange(len(points)), triangle]


def on_segment(points: torch.Tensor, start: torch.Tensor, end: torch.Tensor) -> torch.Tensor:
    """Closest points (K, F, 3) on segments start-end, (F, 3) each."""
    along = end - start
    share = ((points[:, None] - start) * along).sum(-1) / (along * along).sum(-1)
    return start + share.clamp(0, 1)[..., None] * along


def on_plane(points: torch.Tensor, a: torch.Tensor, b: torch.Tensor, c: torch.Tensor) -> torch.Tensor:
    """Feet of perpendiculars (K, F, 3) on the triangles' planes."""
    normal = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=-1, eps=0.0)
    return points[:, None] - ((points[:, None] - a) * normal).sum(-1, keepdim=True) * normal


def in_triangle(points: torch.Tensor, a: torch.Tensor, b: torch.Tensor, c: torch.Tensor) -> torch.Tensor:
    """Whether those feet lie within the triangles: (K, F) bool."""
    normal = torch.linalg.cross(b - a, c - a)
    sides = [
        (torch.linalg.cross((end - start).expand(len(points), -1, -1), points[:, None] - start) * normal).sum(
            -1
        )
        >= 0
        for start, end in ((a, b), (b, c), (c, a))
    ]
    return sides[0] & sides[1] & sides[2]


def inside(points: torch.Tensor, triangles: torch.Tensor) -> torch.Tensor:
    """Whether points (K, 3) lie inside the closed surface triangles (F, 3, 3): (K,) bool (van Oosterom 1983)."""
    return winding_number(points, triangles) > 0.5


def winding_number(points: torch.Tensor, triangles: torch.Tensor) -> torch.Tensor:
    """How often the surface goes round each point: (K,), 1 inside and 0 outside a simple closed surface."""
    a, b, c = (triangles - points[:, None, None]).unbind(dim=2)
    la, lb, lc = (torch.linalg.vector_norm(v, dim=-1) for v in (a, b, c))
    numerator = (a * torch.linalg.cross(b, c)).sum(-1)
    denominator = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return torch.atan2(numerator, denominator).sum(-1) / (2 * math.pi)
