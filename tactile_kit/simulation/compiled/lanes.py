"""Vectors of ``LANES`` float32 numbers as values of numba: one lane an environment, whatever registers there are.

Kernels written with them are vectorised by construction, not by the compiler's grace; LLVM splits the vectors where a
processor's registers are narrower. No operation mixes lanes, so what one of them holds (NaN too) cannot reach another,
save through :func:`any_of`, which kernels use for nothing but to leave out work that no lane needs.
"""

from __future__ import annotations

import operator

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import (
    intrinsic,
    lower_builtin,
    models,
    register_model,
    type_callable,
)

LANES = 16
_F32, _I1 = ir.FloatType(), ir.IntType(1)
_VECTOR, _BITS = ir.VectorType(_F32, LANES), ir.VectorType(_I1, LANES)


class Vector(types.Type):
    """``LANES`` float32 numbers."""

    def __init__(self) -> None:
        super().__init__(f"Vector({LANES})")


class Mask(types.Type):
    """``LANES`` truth values."""

    def __init__(self) -> None:
        super().__init__(f"Mask({LANES})")


vector, mask = Vector(), Mask()


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, _VECTOR)


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, kind) -> None:
        super().__init__(manager, kind, _BITS)


def _splat(builder, value):
    """All lanes the scalar ``value``."""
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.IntType(32)(0))
    return builder.shuffle_vector(
        one,
        ir.Constant(_VECTOR, ir.Undefined),
        ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES),
    )


def _lanes_of(context, builder, value, kind):
    return value if kind == vector else _splat(builder, context.cast(builder, value, kind, types.float32))


def _binary(operation, result, emit) -> None:
    """``operation`` of two vectors, or of a vector and a number."""

    def typer(context):
        def generic(left, right):
            kinds = (left, right)
            if vector in kinds and all(k == vector or isinstance(k, types.Number) for k in kinds):
                return result
            return None

        return generic

    type_callable(operation)(typer)

    def lower(context, builder, signature, args):
        left, right = (_lanes_of(context, builder, a, k) for a, k in zip(args, signature.args, strict=True))
        return emit(builder, left, right)

    for kinds in ((vector, vector), (vector, types.Number), (types.Number, vector)):
        lower_builtin(operation, *kinds)(lower)


_binary(operator.add, vector, lambda builder, a, b: builder.fadd(a, b))
_binary(operator.sub, vector, lambda builder, a, b: builder.fsub(a, b))
_binary(operator.mul, vector, lambda builder, a, b: builder.fmul(a, b))
_binary(operator.truediv, vector, lambda builder, a, b: builder.fdiv(a, b))
for _operation, _sign in (
    (operator.lt, "<"),
    (operator.le, "<="),
    (operator.gt, ">"),
    (operator.ge, ">="),
    (operator.eq, "=="),
):
    _binary(_operation, mask, lambda builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b))


def _of_masks(operation, emit) -> None:
    def typer(context):
        return lambda *kinds: mask if all(kind == mask for kind in kinds) else None

    def one(context):
        return lambda kind: mask if kind == mask else None

    def two(context):
        return lambda left, right: mask if left == mask and right == mask else None

    count = 1 if operation is operator.invert else 2
    type_callable(operation)(one if count == 1 else two)
    lower_builtin(operation, *[mask] * count)(lambda context, builder, signature, args: emit(builder, *args))


_of_masks(operator.and_, lambda builder, a, b: builder.and_(a, b))
_of_masks(operator.or_, lambda builder, a, b: builder.or_(a, b))
_of_masks(operator.invert, lambda builder, a: builder.not_(a))


@type_callable(operator.neg)
def _type_neg(context):
    return lambda kind: vector if kind == vector else None


@lower_builtin(operator.neg, vector)
def _neg(context, builder, signature, args):
    return builder.fneg(args[0])


def _unary(name):
    def generate(context, builder, signature, args):
        function = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_VECTOR, [_VECTOR]), f"llvm.{name}.v{LANES}f32"
        )
        return builder.call(function, args)

    return generate


@intrinsic
def root(typing_context, a):
    """Square root."""
    return vector(vector), _unary("sqrt")


@intrinsic
def size(typing_context, a):
    """Absolute value."""
    return vector(vector), _unary("fabs")


@intrinsic
def whole(typing_context, a):
    """Towards zero to a whole number."""
    return vector(vector), _unary("trunc")


@intrinsic
def where(typing_context, condition, a, b):
    """``a`` where ``condition`` holds, ``b`` elsewhere; both vectors or numbers."""

    def generate(context, builder, signature, args):
        _, left, right = signature.args
        return builder.select(
            args[0], _lanes_of(context, builder, args[1], left), _lanes_of(context, builder, args[2], right)
        )

    return vector(mask, a, b), generate


@intrinsic
def splat(typing_context, a):
    """All lanes the number ``a``."""

    def generate(context, builder, signature, args):
        return _lanes_of(context, builder, args[0], signature.args[0])

    return vector(a), generate


@intrinsic
def any_of(typing_context, a):
    """Whether ``a`` holds in some lane."""

    def generate(context, builder, signature, args):
        bits = builder.bitcast(args[0], ir.IntType(LANES))
        return builder.icmp_unsigned("!=", bits, ir.Constant(bits.type, 0))

    return types.boolean(mask), generate


def _pointer(context, builder, kind, array, offset, vector_type):
    data = builder.gep(context.make_array(kind)(context, builder, array).data, [offset])
    return builder.bitcast(data, vector_type.as_pointer())


@intrinsic
def load(typing_context, array, row):
    """Row ``row`` of a flat float32 ``array`` of rows of ``LANES`` numbers."""

    def generate(context, builder, signature, args):
        offset = builder.mul(args[1], ir.Constant(args[1].type, LANES))
        return builder.load(_pointer(context, builder, signature.args[0], args[0], offset, _VECTOR), align=4)

    return vector(array, types.intp), generate


@intrinsic
def store(typing_context, array, row, value):
    """Write ``value`` to row ``row`` of a flat float32 ``array``."""

    def generate(context, builder, signature, args):
        offset = builder.mul(args[1], ir.Constant(args[1].type, LANES))
        pointer = _pointer(context, builder, signature.args[0], args[0], offset, _VECTOR)
        builder.store(_lanes_of(context, builder, args[2], signature.args[2]), pointer, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, value), generate


_NODE = ir.VectorType(_F32, 4)


@intrinsic
def blend(typing_context, grid, first, stride_i, stride_j, fi, fj, fk, out, at):
    """Trilinear mean of eight nodes of four numbers each.

    ``grid`` is flat, ``first`` the offset of the lowest node, ``stride_i`` and ``stride_j`` lead to the next node along
    the first and second axis (the third's is 4); the four numbers go to ``out[at : at + 4]``.
    """

    def generate(context, builder, signature, args):
        grid_kind, out_kind = signature.args[0], signature.args[7]
        first, stride_i, stride_j = args[1:4]

        def node(offset):
            return builder.load(_pointer(context, builder, grid_kind, args[0], offset, _NODE), align=4)

        def between(low, high, share):
            one = builder.insert_element(ir.Constant(_NODE, ir.Undefined), share, ir.IntType(32)(0))
            shares = builder.shuffle_vector(
                one, ir.Constant(_NODE, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), 4), [0] * 4)
            )
            return builder.fadd(low, builder.fmul(shares, builder.fsub(high, low)))

        four = ir.Constant(first.type, 4)
        edges = []
        for offset in (first, builder.add(first, stride_j)):
            faces = []
            for along in (offset, builder.add(offset, stride_i)):
                faces.append(between(node(along), node(builder.add(along, four)), args[6]))
            edges.append(faces)
        near = between(edges[0][0], edges[1][0], args[5])
        far = between(edges[0][1], edges[1][1], args[5])
        builder.store(
            between(near, far, args[4]),
            _pointer(context, builder, out_kind, args[7], args[8], _NODE),
            align=4,
        )
        return context.get_dummy_value()

    whole_numbers = (types.intp,) * 3
    shares = (types.float32,) * 3
    return types.void(grid, *whole_numbers, *shares, out, types.intp), generate


@intrinsic
def column(typing_context, array, row, number):
    """Number ``number`` (a constant) of each of ``LANES`` groups of four that begin at row ``row`` of ``array``."""
    if not isinstance(number, types.IntegerLiteral):
        return None
    which = number.literal_value

    def generate(context, builder, signature, args):
        offset = builder.mul(args[1], ir.Constant(args[1].type, LANES))
        wide = ir.VectorType(_F32, 4 * LANES)
        groups = builder.load(_pointer(context, builder, signature.args[0], args[0], offset, wide), align=4)
        take = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [4 * lane + which for lane in range(LANES)])
        return builder.shuffle_vector(groups, ir.Constant(wide, ir.Undefined), take)

    return vector(array, types.intp, number), generate
