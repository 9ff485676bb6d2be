"""Eight numbers at a time, as vector registers hold them, in kernels whose loops a compiler leaves as they are.

``Lanes`` are values inside of one kernel: none takes or returns any.  A row that is read or written by them has
`padded` numbers; no index is looked at.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.on_demand import intrinsic, ir, types

LANES = 8


def padded_size(n: int) -> int:
    """The least multiple of LANES that is not less than n."""
    return -(-n // LANES) * LANES


@kernel
def padded(n):
    """As ``padded_size``, for kernels."""
    return (n + LANES - 1) // LANES * LANES


@cache
def _kind() -> Any:
    """Numba's type of them."""
    from numba.core.types import Type
    from numba.extending import models, register_model

    class Lanes(Type):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(name="Lanes")

    @register_model(Lanes)
    class _Model(models.PrimitiveModel):  # type: ignore[misc]
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, ir.VectorType(ir.DoubleType(), LANES))

    return Lanes()


def _place(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Pointer to eight numbers of an array (n,)."""
    from numba.np.arrayobj import make_array

    own = make_array(signature.args[0])(context, builder, arguments[0])
    pointer = ir.VectorType(ir.DoubleType(), LANES).as_pointer()
    return builder.bitcast(builder.gep(own.data, [arguments[1]]), pointer)


@intrinsic
def lanes(typingctx, values, i):
    """``values[i : i + 8]`` of a contiguous array (n,)."""

    def codegen(context, builder, signature, arguments):
        return builder.load(_place(context, builder, signature, arguments), align=8)

    return _kind()(values, types.intp), codegen


@intrinsic
def put_lanes(typingctx, values, i, given):
    """Write ``values[i : i + 8]``."""

    def codegen(context, builder, signature, arguments):
        builder.store(arguments[2], _place(context, builder, signature, arguments), align=8)
        return context.get_dummy_value()

    return types.void(values, types.intp, _kind()), codegen


def _spread(builder: Any, value: Any) -> Any:
    empty = ir.Constant(ir.VectorType(ir.DoubleType(), LANES), ir.Undefined)
    one = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, empty, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


@intrinsic
def spread(typingctx, value):
    """A number in all lanes."""

    def codegen(context, builder, signature, arguments):
        return _spread(builder, arguments[0])

    return _kind()(types.float64), codegen


@intrinsic
def spread_at(typingctx, values, i):
    """``values[i]`` of an array (n,) in all lanes."""

    def codegen(context, builder, signature, arguments):
        from numba.np.arrayobj import make_array

        own = make_array(signature.args[0])(context, builder, arguments[0])
        return _spread(builder, builder.load(builder.gep(own.data, [arguments[1]])))

    return _kind()(values, types.intp), codegen


@intrinsic
def plus_product(typingctx, a, b, c):
    """a + b c, rounded once where there is an instruction for it."""

    def codegen(context, builder, signature, arguments):
        product = builder.fmul(arguments[1], arguments[2], flags=("contract",))
        return builder.fadd(arguments[0], product, flags=("contract",))

    return _kind()(a, b, c), codegen


@intrinsic
def less_product(typingctx, a, b, c):
    """a - b c, likewise."""

    def codegen(context, builder, signature, arguments):
        product = builder.fmul(arguments[1], arguments[2], flags=("contract",))
        return builder.fsub(arguments[0], product, flags=("contract",))

    return _kind()(a, b, c), codegen


@intrinsic
def sum_of(typingctx, given):
    """The sum of all lanes."""

    def codegen(context, builder, signature, arguments):
        left, size = arguments[0], LANES
        while size > 1:
            size //= 2
            kind = ir.VectorType(ir.IntType(32), size)
            halves = [
                builder.shuffle_vector(left, left, ir.Constant(kind, list(range(k, k + size)))) for k in (0, size)
            ]
            left = builder.fadd(*halves)
        return builder.extract_element(left, ir.Constant(ir.IntType(32), 0))

    return types.float64(given), codegen
