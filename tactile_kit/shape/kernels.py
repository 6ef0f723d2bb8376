"""Compiled closest-point search, all in this one file: numba's cache misses changes in imported ones.

Each triangle is read once per 64 points: the points are vector lanes, so the search needs neither reductions nor
gathers nor branches. Everything a lane loop touches lies in ONE flat scratch array with constant row offsets: separate
arrays would cost run-time alias checks (20 to 25 %). Constants take the arrays' dtype, because a bare literal turns
float32 arithmetic into float64.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

K = 64  # basis points, compile-time so that lane loops have a fixed length
M = 16  # points that move with the fingers, likewise; they use the first lanes of every row
QX, QY, QZ, BEST, WINNER = 0, K, 2 * K, 3 * K, 4 * K  # rows of the scratch
EDGE = 5 * K  # then 4 x (offset in plane, direction in plane) of the winner's three edges and its face
LANES = 16  # triangles of a block and boxes of a group: one AVX-512 register of float32
TRIAL = EDGE + 16  # squared distances of one block's triangles
BOXES = (
    TRIAL + LANES
)  # then the squared distances to all boxes of the mesh, then the least of each group of boxes

#: Positions beyond this (m) and rotations further than this from orthonormal are refused.
MAX_POSITION = 100.0
MAX_SKEW = 1e-3

OK, BAD_POSITION, BAD_ROTATION, BAD_MESH = 0, 1, 2, 3

OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}
FAST = {**OPTIONS, "fastmath": True}
# What forward calls. As functions of their own they would be optimised twice, and fast-math rounds differently each
# time: the process that compiles would call the first version, and processes that read the cache the second.
INSIDE = {**FAST, "forceinline": True}


def _load_lanes(context, builder, kind, array, offset):
    pointer = builder.gep(context.make_array(kind)(context, builder, array).data, [offset])
    vector = ir.VectorType(pointer.type.pointee, LANES)
    return builder.load(builder.bitcast(pointer, vector.as_pointer()), align=kind.dtype.bitwidth // 8), vector


@intrinsic
def _least(typing_context, s, offset):
    """Minimum of the LANES values at s[offset]; numba itself does not vectorise a minimum."""

    def generate(context, builder, signature, args):
        lanes, vector = _load_lanes(context, builder, signature.args[0], *args)
        bits = signature.args[0].dtype.bitwidth
        kind = ir.FunctionType(vector.element, [vector])
        name = f"llvm.vector.reduce.fmin.v{LANES}f{bits}"
        reduce = cgutils.get_or_insert_function(builder.module, kind, name)
        return builder.call(reduce, [lanes], fastmath=("nnan", "nsz"))

    return s.dtype(s, types.intp), generate


@intrinsic
def _at_most(typing_context, s, offset, limit):
    """Bit mask of the LANES values at s[offset] that are no greater than limit."""

    def generate(context, builder, signature, args):
        lanes, vector = _load_lanes(context, builder, signature.args[0], *args[:2])
        splat = ir.Constant(vector, ir.Undefined)
        for lane in range(LANES):
            splat = builder.insert_element(splat, args[2], ir.Constant(ir.IntType(32), lane))
        mask = builder.fcmp_ordered("<=", lanes, splat)
        return builder.zext(builder.bitcast(mask, ir.IntType(LANES)), ir.IntType(64))

    return types.int64(s, types.intp, s.dtype), generate


@intrinsic
def _first_lane(typing_context, mask):
    """Lowest set bit of a mask that is not zero."""

    def generate(context, builder, signature, args):
        return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate


@njit(**OPTIONS)
def _check(position, rotation, mesh, meshes):
    """Status of one pose. Not fast-math: comparisons must be false for NaN."""
    if mesh < 0 or mesh >= meshes:
        return BAD_MESH
    for i in range(3):
        if not abs(position[i]) <= MAX_POSITION:
            return BAD_POSITION
        for j in range(i, 3):
            product = (
                rotation[0, i] * rotation[0, j]
                + rotation[1, i] * rotation[1, j]
                + rotation[2, i] * rotation[2, j]
            )
            if not abs(product - (1 if i == j else 0)) <= MAX_SKEW:
                return BAD_ROTATION
    cross = rotation[1, 0] * rotation[2, 1] - rotation[2, 0] * rotation[1, 1]
    determinant = (
        rotation[0, 2] * cross
        + rotation[1, 2] * (rotation[2, 0] * rotation[0, 1] - rotation[0, 0] * rotation[2, 1])
        + rotation[2, 2] * (rotation[0, 0] * rotation[1, 1] - rotation[1, 0] * rotation[0, 1])
    )
    return OK if determinant > 0 else BAD_ROTATION


@njit(**INSIDE)
def _search(rows, start, stop, s, count):
    """Nearest triangle of rows[start:stop] for ``count`` points: squared distance and index (kept as a float)."""
    real = s.dtype.type
    zero = real(0)
    for k in range(count):
        s[BEST + k] = real(1e30)
        s[WINNER + k] = zero
    for f in range(start, stop):
        ux, uy, uz, u0 = rows[f, 0], rows[f, 1], rows[f, 2], rows[f, 3]
        wx, wy, wz, w0 = rows[f, 4], rows[f, 5], rows[f, 6], rows[f, 7]
        nx, ny, nz, n0 = rows[f, 8], rows[f, 9], rows[f, 10], rows[f, 11]
        ab = rows[f, 12]
        bx, by, bc = rows[f, 13], rows[f, 14], rows[f, 15]
        cx, cy, ac = rows[f, 16], rows[f, 17], rows[f, 18]
        index = real(f - start)
        for k in range(count):
            x, y, z = s[QX + k], s[QY + k], s[QZ + k]
            p = ux * x + uy * y + uz * z + u0
            t = wx * x + wy * y + wz * z + w0
            h = nx * x + ny * y + nz * z + n0
            # offset beyond the ends along each edge, and across it (positive outside)
            da = p - min(max(p, zero), ab)
            pb = p - ab
            along_b = pb * bx + t * by
            across_b = pb * by - t * bx
            db = along_b - min(max(along_b, zero), bc)
            along_c = p * cx + t * cy
            across_c = t * cx - p * cy
            dc = along_c - min(max(along_c, zero), ac)
            outside = max(max(-t, across_b), across_c)
            edge = min(min(da * da + t * t, db * db + across_b * across_b), dc * dc + across_c * across_c)
            d2 = h * h + (edge if outside > zero else zero)
            best = s[BEST + k]
            s[WINNER + k] = index if d2 < best else s[WINNER + k]
            s[BEST + k] = d2 if d2 < best else best


@njit(**INSIDE)
def _search_block(blocks, block, x, y, z, s):
    """Squared distances from one point to a block's 16 triangles, as lanes in the scratch; returns the least."""
    zero = s.dtype.type(0)
    for i in range(LANES):
        p = blocks[block, 0, i] * x + blocks[block, 1, i] * y + blocks[block, 2, i] * z + blocks[block, 3, i]
        t = blocks[block, 4, i] * x + blocks[block, 5, i] * y + blocks[block, 6, i] * z + blocks[block, 7, i]
        h = (
            blocks[block, 8, i] * x
            + blocks[block, 9, i] * y
            + blocks[block, 10, i] * z
            + blocks[block, 11, i]
        )
        ab = blocks[block, 12, i]
        bx, by, bc = blocks[block, 13, i], blocks[block, 14, i], blocks[block, 15, i]
        cx, cy, ac = blocks[block, 16, i], blocks[block, 17, i], blocks[block, 18, i]
        da = p - min(max(p, zero), ab)
        pb = p - ab
        along_b = pb * bx + t * by
        across_b = pb * by - t * bx
        db = along_b - min(max(along_b, zero), bc)
        along_c = p * cx + t * cy
        across_c = t * cx - p * cy
        dc = along_c - min(max(along_c, zero), ac)
        outside = max(max(-t, across_b), across_c)
        edge = min(min(da * da + t * t, db * db + across_b * across_b), dc * dc + across_c * across_c)
        s[TRIAL + i] = h * h + (edge if outside > zero else zero)
    return _least(s, TRIAL)


@njit(**INSIDE)
def _search_boxes(blocks, bounds, first, last, triangles, s, count):
    """As _search for a big mesh: per point, only blocks whose box is nearer than the best triangle so far."""
    real = s.dtype.type
    zero = real(0)
    boxes, groups = (last - first) * LANES, last - first
    least_of = BOXES + boxes
    # Contiguous rows, so that lanes count from 0: an index that might be negative is wrapped around lane by lane, and
    # a slice over two axes loses its unit stride.
    here = slice(first * LANES, last * LANES)
    low_x, low_y, low_z = bounds[0, here], bounds[1, here], bounds[2, here]
    high_x, high_y, high_z = bounds[3, here], bounds[4, here], bounds[5, here]
    blocks = blocks[here]
    for k in range(count):
        x, y, z = s[QX + k], s[QY + k], s[QZ + k]
        for i in range(boxes):
            dx = max(max(low_x[i] - x, x - high_x[i]), zero)
            dy = max(max(low_y[i] - y, y - high_y[i]), zero)
            dz = max(max(low_z[i] - z, z - high_z[i]), zero)
            s[BOXES + i] = dx * dx + dy * dy + dz * dz
        least, group = real(1e30), 0
        for g in range(groups):
            value = _least(s, BOXES + g * LANES)
            s[least_of + g] = value
            if value < least:
                least, group = value, g
        near = group * LANES + _first_lane(_at_most(s, BOXES + group * LANES, least))
        best = _search_block(blocks, near, x, y, z, s)
        winner = near * LANES + _first_lane(_at_most(s, TRIAL, best))
        s[BOXES + near] = real(1e30)  # done
        for g in range(groups):
            if s[least_of + g] < best:
                lanes = _at_most(s, BOXES + g * LANES, best)
                while lanes != 0:
                    lane = _first_lane(lanes)
                    lanes &= lanes - 1
                    block = g * LANES + lane
                    if s[BOXES + block] < best:
                        d2 = _search_block(blocks, block, x, y, z, s)
                        if d2 < best:
                            best = d2
                            winner = block * LANES + _first_lane(_at_most(s, TRIAL, best))
        # lanes past the end of the last block repeat the last triangle
        s[WINNER + k] = real(min(winner, triangles - 1))


@njit(**INSIDE)
def _finish(rows, normals, start, rotation, s, vectors, unit, save, count):
    """Closest-point vectors of the winners (hand frame), zero inside; and what the backward pass needs if save."""
    real = s.dtype.type
    zero, one = real(0), real(1)
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    # Table driven: four candidates (edges ab bc ac, face) as offset and direction, one picked by index. If/else here
    # costs a mispredicted branch per point, and selects are turned into branches by LLVM.
    s[EDGE + 6], s[EDGE + 7] = zero, zero
    s[EDGE + 8], s[EDGE + 9] = one, zero
    s[EDGE + 14], s[EDGE + 15] = zero, zero
    for k in range(count):
        f = start + int(s[WINNER + k])
        x, y, z = s[QX + k], s[QY + k], s[QZ + k]
        p = rows[f, 0] * x + rows[f, 1] * y + rows[f, 2] * z + rows[f, 3]
        t = rows[f, 4] * x + rows[f, 5] * y + rows[f, 6] * z + rows[f, 7]
        h = rows[f, 8] * x + rows[f, 9] * y + rows[f, 10] * z + rows[f, 11]
        ab, bx, by, bc = rows[f, 12], rows[f, 13], rows[f, 14], rows[f, 15]
        cx, cy, ac = rows[f, 16], rows[f, 17], rows[f, 18]
        da = min(max(p, zero), ab) - p
        pb = p - ab
        along_b = pb * bx + t * by
        across_b = pb * by - t * bx
        db = min(max(along_b, zero), bc) - along_b
        along_c = p * cx + t * cy
        across_c = t * cx - p * cy
        dc = min(max(along_c, zero), ac) - along_c
        s[EDGE + 0], s[EDGE + 1] = da, -t
        s[EDGE + 2] = db * bx - across_b * by
        s[EDGE + 3] = db * by + across_b * bx
        s[EDGE + 4] = dc * cx + across_c * cy
        s[EDGE + 5] = dc * cy - across_c * cx
        s[EDGE + 10], s[EDGE + 11] = bx, by
        s[EDGE + 12], s[EDGE + 13] = cx, cy
        ea, eb, ec = da * da + t * t, db * db + across_b * across_b, dc * dc + across_c * across_c
        nearest = int(eb < ea)
        nearest += (2 - nearest) * int(ec < min(ea, eb))
        on_face = int(max(max(-t, across_b), across_c) <= zero)
        # end of the nearest edge: 0 in between, 1 at its first vertex, 2 at its second; packed feature numbers
        # 0 face, 1-3 edges ab bc ca, 4-6 vertices a b c, for (edge, end) in base 8 digits.
        at_a = int(da > zero) + 2 * int(da < zero)
        at_b = int(db > zero) + 2 * int(db < zero)
        at_c = int(dc > zero) + 2 * int(dc < zero)
        end = (at_a | (at_b << 2) | (at_c << 4)) >> (2 * nearest) & 3
        feature = (0o643652541 >> (3 * (3 * nearest + end)) & 7) * (1 - on_face)
        pick = nearest + (3 - nearest) * on_face
        ox, oy, oz = s[EDGE + 2 * pick], s[EDGE + 2 * pick + 1], -h
        side = (
            ox * normals[f, 3 * feature] + oy * normals[f, 3 * feature + 1] + oz * normals[f, 3 * feature + 2]
        )
        free = one - real(int(side > zero))
        vx = (ox * rows[f, 0] + oy * rows[f, 4] + oz * rows[f, 8]) * free
        vy = (ox * rows[f, 1] + oy * rows[f, 5] + oz * rows[f, 9]) * free
        vz = (ox * rows[f, 2] + oy * rows[f, 6] + oz * rows[f, 10]) * free
        vectors[k, 0] = r00 * vx + r01 * vy + r02 * vz
        vectors[k, 1] = r10 * vx + r11 * vy + r12 * vz
        vectors[k, 2] = r20 * vx + r21 * vy + r22 * vz
        if save:
            # unit vector that keeps its direction: the normal on a face, the edge's own on an edge, none at a vertex
            on_vertex = int(feature > 3)
            scale = free * real(1 - on_vertex)
            tx = s[EDGE + 8 + 2 * pick] * scale
            ty = s[EDGE + 9 + 2 * pick] * scale
            tz = real(on_face) * scale
            ex = tx * rows[f, 0] + ty * rows[f, 4] + tz * rows[f, 8]
            ey = tx * rows[f, 1] + ty * rows[f, 5] + tz * rows[f, 9]
            ez = tx * rows[f, 2] + ty * rows[f, 6] + tz * rows[f, 10]
            unit[k, 0] = r00 * ex + r01 * ey + r02 * ez
            unit[k, 1] = r10 * ex + r11 * ey + r12 * ez
            unit[k, 2] = r20 * ex + r21 * ey + r22 * ez
            unit[k, 3] = free * real(1 - on_face)


@njit(**INSIDE)
def _localise(points, position, rotation, s, count):
    """Points (3, count) in the object's frame, q = R^T (p - x), as three rows of lanes."""
    x, y, z = position[0], position[1], position[2]
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    for k in range(count):
        s[QX + k], s[QY + k], s[QZ + k] = points[0, k], points[1, k], points[2, k]
    for k in range(count):
        dx, dy, dz = s[QX + k] - x, s[QY + k] - y, s[QZ + k] - z
        s[QX + k] = r00 * dx + r10 * dy + r20 * dz
        s[QY + k] = r01 * dx + r11 * dy + r21 * dz
        s[QZ + k] = r02 * dx + r12 * dy + r22 * dz


@njit(forceinline=True, **OPTIONS)
def _encode(points, x, R, mesh, offsets, rows, normals, groups, bounds, blocks, vectors, unit, save, count):
    """What forward does; points (1, 3, count) shared by all poses, or (B, 3, count)."""
    size, meshes = x.shape[0], offsets.shape[0] - 1
    own = points.shape[0] > 1
    widest = 0
    for b in range(size):
        status = _check(x[b], R[b], mesh[b], meshes)
        if status != OK:
            return status, b
        widest = max(widest, groups[mesh[b] + 1] - groups[mesh[b]])
    s = np.empty(BOXES + widest * (LANES + 1), dtype=vectors.dtype)
    order = _by_mesh(mesh, meshes)
    for i in range(size):
        b = order[i]
        start, stop = offsets[mesh[b]], offsets[mesh[b] + 1]
        first, last = groups[mesh[b]], groups[mesh[b] + 1]
        _localise(points[b if own else 0], x[b], R[b], s, count)
        if last > first:
            _search_boxes(blocks, bounds, first, last, stop - start, s, count)
        else:
            _search(rows, start, stop, s, count)
        _finish(rows, normals, start, R[b], s, vectors[b], unit[b if save else 0], save, count)
    return OK, 0


@njit(**OPTIONS)
def forward(points, x, R, mesh, offsets, rows, normals, groups, bounds, blocks, vectors, unit, save):
    """Vectors (B, K, 3) from the basis points (3, K) to the posed meshes; returns a status and the row it is about.

    unit receives e and alpha for the backward pass: (B, K, 4) if save, else any (1, K, 4), which is left alone.
    """
    shared = points.reshape(1, 3, K)
    return _encode(shared, x, R, mesh, offsets, rows, normals, groups, bounds, blocks, vectors, unit, save, K)


@njit(**OPTIONS)
def forward_moving(points, x, R, mesh, offsets, rows, normals, groups, bounds, blocks, vectors, unit, save):
    """As forward, from points (B, 3, M) of every pose's own: vectors (B, M, 3), unit (B, M, 4)."""
    return _encode(points, x, R, mesh, offsets, rows, normals, groups, bounds, blocks, vectors, unit, save, M)


@njit(**OPTIONS)
def _by_mesh(mesh, meshes):
    """Rows in the order of their meshes, so that a table is read once; as they come where sorting costs more."""
    size = mesh.shape[0]
    order = np.arange(size)
    if size > 2 and 4 * size >= meshes:
        places = np.zeros(meshes + 1, dtype=np.int64)
        for b in range(size):
            places[mesh[b] + 1] += 1
        for m in range(meshes):
            places[m + 1] += places[m]
        for b in range(size):
            order[places[mesh[b]]] = b
            places[mesh[b]] += 1
    return order
