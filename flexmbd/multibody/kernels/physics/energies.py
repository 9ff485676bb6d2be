"""Strain energies of homogeneous deformations behind addresses: what they add to the stiffness of the modes.

The data of such an element: V (m^3); the stiffnesses K_k of the six modes, whose energy the record has already; and the
modes H_k (6, 9).  With F = 1 + sum_k q_k H_k its energy is V W(F) - sum_k K_k q_k^2 / 2.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel

_N_VALUES = 91  # W, dW/dF (9), its derivative (81)
_F = _N_VALUES  # where F stands in the room
_NOTHING = _F + 9  # where the coordinates of a cell stand, which a function may read and no energy depends on
_STACK_SIZE = _NOTHING + 12
_STIFFNESS, _MODES = 1, 7  # in the data


@intrinsic
def _stack_space(typingctx):
    """A pointer to numbers on the stack of the function that this stands in."""

    def codegen(context, builder, signature, args):
        numbers = cgutils.alloca_once(builder, ir.ArrayType(ir.DoubleType(), _STACK_SIZE))
        return builder.bitcast(numbers, ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(), codegen


@intrinsic
def _get(typingctx, room, k):
    """The number k of the room."""

    def codegen(context, builder, signature, args):
        return builder.load(builder.gep(args[0], [args[1]]))

    return types.float64(types.CPointer(types.float64), types.int64), codegen


@intrinsic
def _put(typingctx, room, k, value):
    """Write the number k of the room."""

    def codegen(context, builder, signature, args):
        builder.store(args[2], builder.gep(args[0], [args[1]]))
        return context.get_dummy_value()

    return types.void(types.CPointer(types.float64), types.int64, types.float64), codegen


@intrinsic
def _call(typingctx, address, room):
    """Call the function at an address (see ``flexmbd.CompiledEnergy``) with the parts of the room."""

    def codegen(context, builder, signature, args):
        pointer = ir.DoubleType().as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 7)
        function = builder.inttoptr(args[0], kind.as_pointer())
        F, nothing = (builder.gep(args[1], [ir.Constant(ir.IntType(64), k)]) for k in (_F, _NOTHING))
        none = ir.Constant(pointer, None)
        builder.call(function, [args[1], none, F, nothing, none, none, none])
        return context.get_dummy_value()

    return types.void(types.int64, types.CPointer(types.float64)), codegen


@kernel
def _evaluate(plan, row, x, room):
    """Let the function of an element write W and its derivatives at x into the room."""
    for k in range(_STACK_SIZE):
        _put(room, k, 0.0)
    o = row[at.EL_DATA] + _MODES
    first = row[at.EL_X]
    for c in range(9):
        part = 1.0 if c % 4 == 0 else 0.0
        for j in range(row[at.EL_COUNT]):
            part += x[first + j] * plan.data[o + 9 * j + c]
        _put(room, _F + c, part)
    _call(row[at.EL_ADDRESS], room)


@kernel
def add_energy_gradient(plan, row, x, out):
    """Add to ``out`` (nv,) the derivatives of an element's energy by its modes."""
    room = _stack_space()
    _evaluate(plan, row, x, room)
    o = row[at.EL_DATA]
    for j in range(row[at.EL_COUNT]):
        work = 0.0
        for c in range(9):
            work += _get(room, 1 + c) * plan.data[o + _MODES + 9 * j + c]
        linear = plan.data[o + _STIFFNESS + j] * x[row[at.EL_X] + j]
        out[row[at.EL_V] + j] += plan.data[o] * work - linear


@kernel
def energy_of(plan, row, x):
    """An element's energy (J)."""
    room = _stack_space()
    _evaluate(plan, row, x, room)
    o = row[at.EL_DATA]
    energy = plan.data[o] * _get(room, 0)
    for j in range(row[at.EL_COUNT]):
        q = x[row[at.EL_X] + j]
        energy -= 0.5 * plan.data[o + _STIFFNESS + j] * q * q
    return energy


@kernel
def add_energy_block(plan, row, x, per_x, matrix):
    """Add ``per_x`` times the second derivatives of an element's energy by its modes to ``matrix`` (nv, nv)."""
    room = _stack_space()
    _evaluate(plan, row, x, room)
    o = row[at.EL_DATA]
    modes = o + _MODES
    first = row[at.EL_V]
    for i in range(row[at.EL_COUNT]):
        for j in range(row[at.EL_COUNT]):
            second = 0.0
            for c in range(9):
                for d in range(9):
                    second += plan.data[modes + 9 * i + c] * _get(room, 10 + 9 * c + d) * plan.data[modes + 9 * j + d]
            matrix[first + i, first + j] += per_x * plan.data[o] * second
        matrix[first + i, first + i] -= per_x * plan.data[o + _STIFFNESS + i]
