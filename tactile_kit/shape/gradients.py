"""The compiled backward pass of the closest-point vectors: closed form, no search.

K and M are kernels.py's; numba's cache, which looks at this file alone, has to go when they change.
"""

from __future__ import annotations

from numba import njit

from tactile_kit.shape.kernels import FAST, INSIDE, K, M


@njit(**INSIDE)
def _return(points, x, R, vectors, unit, gradient, x_gradient, R_gradient, count):
    """With g the incoming gradient (B, count, 3) of each vector v, and e, alpha of the forward pass:
    h = alpha g + (1 - 2 alpha) (e.g) e,  dL/dx = sum h,  dL/dR = [sum g v^T - (p - x) h^T] R.
    """
    real = vectors.dtype.type
    zero, one, two = real(0), real(1), real(2)
    own = points.shape[0] > 1
    for b in range(x.shape[0]):
        at = points[b if own else 0]
        x0, x1, x2 = x[b, 0], x[b, 1], x[b, 2]
        h0, h1, h2 = zero, zero, zero
        m00, m01, m02, m10, m11, m12, m20, m21, m22 = zero, zero, zero, zero, zero, zero, zero, zero, zero
        for k in range(count):
            g0, g1, g2 = gradient[b, k, 0], gradient[b, k, 1], gradient[b, k, 2]
            v0, v1, v2 = vectors[b, k, 0], vectors[b, k, 1], vectors[b, k, 2]
            e0, e1, e2, alpha = unit[b, k, 0], unit[b, k, 1], unit[b, k, 2], unit[b, k, 3]
            along = (one - two * alpha) * (e0 * g0 + e1 * g1 + e2 * g2)
            a0, a1, a2 = alpha * g0 + along * e0, alpha * g1 + along * e1, alpha * g2 + along * e2
            p0, p1, p2 = at[0, k] - x0, at[1, k] - x1, at[2, k] - x2
            h0 += a0
            h1 += a1
            h2 += a2
            m00 += g0 * v0 - p0 * a0
            m01 += g0 * v1 - p0 * a1
            m02 += g0 * v2 - p0 * a2
            m10 += g1 * v0 - p1 * a0
            m11 += g1 * v1 - p1 * a1
            m12 += g1 * v2 - p1 * a2
            m20 += g2 * v0 - p2 * a0
            m21 += g2 * v1 - p2 * a1
            m22 += g2 * v2 - p2 * a2
        x_gradient[b, 0], x_gradient[b, 1], x_gradient[b, 2] = h0, h1, h2
        for j in range(3):
            c0, c1, c2 = R[b, 0, j], R[b, 1, j], R[b, 2, j]
            R_gradient[b, 0, j] = m00 * c0 + m01 * c1 + m02 * c2
            R_gradient[b, 1, j] = m10 * c0 + m11 * c1 + m12 * c2
            R_gradient[b, 2, j] = m20 * c0 + m21 * c1 + m22 * c2


@njit(**FAST)
def backward(points, x, R, vectors, unit, gradient, x_gradient, R_gradient):
    """Gradients (B, 3) and (B, 3, 3) of position and orientation from that of kernels.forward's vectors (B, K, 3)."""
    _return(points.reshape(1, 3, K), x, R, vectors, unit, gradient, x_gradient, R_gradient, K)


@njit(**FAST)
def backward_moving(points, x, R, vectors, unit, gradient, x_gradient, R_gradient):
    """The same for kernels.forward_moving."""
    _return(points, x, R, vectors, unit, gradient, x_gradient, R_gradient, M)
