"""Calls of functions that FFCx compiled, through addresses, and numbers on the stack for them to read and write.

FFCx's functions are ``void f(double *tensor, double *coefficients, double *constants, double *coordinates, int *entity,
uint8_t *permutation, void *custom)``; users' compiled energies (``flexmbd.CompiledEnergy``) are of the same kind.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base.on_demand import cgutils, intrinsic, ir, types


def _numbers():
    return types.CPointer(types.float64)


@intrinsic
def call_tabulate(typingctx, address, pointers):
    """Call the function at an address with tensor, coefficients, constants and coordinates; the rest is null."""

    def codegen(context, builder, signature, args):
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 7).as_pointer()
        given = [builder.inttoptr(builder.extract_value(args[1], k), pointer) for k in range(4)]
        builder.call(builder.inttoptr(args[0], kind), [*given, *[ir.Constant(pointer, None)] * 3])
        return context.get_dummy_value()

    return types.void(types.int64, types.UniTuple(types.int64, 4)), codegen


@intrinsic(prefer_literal=True)
def stack_numbers(typingctx, count):
    """A pointer to numbers on the stack of the function that this stands in; ``count``: a module's constant."""
    size = count.literal_value

    def codegen(context, builder, signature, args):
        numbers = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), size))
        return builder.bitcast(numbers, ir.DoubleType().as_pointer())

    return _numbers()(count), codegen


@intrinsic
def address_of(typingctx, numbers):
    """The address of numbers on the stack."""

    def codegen(context, builder, signature, args):
        return builder.ptrtoint(args[0], ir.IntType(64))

    return types.int64(_numbers()), codegen


@intrinsic
def number_at(typingctx, numbers, k):
    """The number k of those on the stack."""

    def codegen(context, builder, signature, args):
        return builder.load(builder.gep(args[0], [args[1]]))

    return types.float64(_numbers(), types.int64), codegen


@intrinsic
def put_number(typingctx, numbers, k, value):
    """Write the number k of those on the stack."""

    def codegen(context, builder, signature, args):
        builder.store(args[2], builder.gep(args[0], [args[1]]))
        return context.get_dummy_value()

    return types.void(_numbers(), types.int64, types.float64), codegen
