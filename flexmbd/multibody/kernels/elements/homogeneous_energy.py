"""Strain energies of homogeneous deformations behind addresses: what they add to the stiffness of the modes.

The data of such an element: V (m^3); the stiffnesses K_k of the six modes, whose energy the record has already; and the
modes H_k (6, 9).  With F = 1 + sum_k q_k H_k its energy is V W(F) - sum_k K_k q_k^2 / 2.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.tabulate import address_of, call_tabulate, number_at, put_number, stack_numbers
from flexmbd.multibody.kernels.elements.element import Behaviour, GeneralisedForce

_N_VALUES = 91  # W, dW/dF (9), its derivative (81)
_F = _N_VALUES  # where F stands in the room
_NOTHING = _F + 9  # where the coordinates of a cell stand, which a function may read and no energy depends on
_STACK_SIZE = _NOTHING + 12
_BYTES = 8  # of a number
_STIFFNESS, _MODES = 1, 7  # in the data


@kernel
def _evaluate(plan, row, x, room):
    """Let the function of an element write W and its derivatives at x into the room."""
    for k in range(_STACK_SIZE):
        put_number(room, k, 0.0)
    o = row[at.EL_DATA] + _MODES
    coordinate = row[at.EL_X]
    for c in range(9):
        part = 1.0 if c % 4 == 0 else 0.0
        for j in range(row[at.EL_COUNT]):
            part += x[coordinate + j] * plan.data[o + 9 * j + c]
        put_number(room, _F + c, part)
    first = address_of(room)
    call_tabulate(row[at.EL_ADDRESS], (first, 0, first + _BYTES * _F, first + _BYTES * _NOTHING))


@kernel
def _subtract(plan, work, row, x, v, out):
    """The forces are the derivatives of the energy by the modes, with a minus."""
    room = stack_numbers(_STACK_SIZE)
    _evaluate(plan, row, x, room)
    o = row[at.EL_DATA]
    for j in range(row[at.EL_COUNT]):
        work = 0.0
        for c in range(9):
            work += number_at(room, 1 + c) * plan.data[o + _MODES + 9 * j + c]
        linear = plan.data[o + _STIFFNESS + j] * x[row[at.EL_X] + j]
        out[row[at.EL_V] + j] += plan.data[o] * work - linear


@kernel
def _energy(plan, work, row, x):
    room = stack_numbers(_STACK_SIZE)
    _evaluate(plan, row, x, room)
    o = row[at.EL_DATA]
    energy = plan.data[o] * number_at(room, 0)
    for j in range(row[at.EL_COUNT]):
        q = x[row[at.EL_X] + j]
        energy -= 0.5 * plan.data[o + _STIFFNESS + j] * q * q
    return energy


@kernel
def _subtract_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    room = stack_numbers(_STACK_SIZE)
    _evaluate(plan, row, x, room)
    o = row[at.EL_DATA]
    modes = o + _MODES
    first = row[at.EL_V]
    for i in range(row[at.EL_COUNT]):
        for j in range(row[at.EL_COUNT]):
            second = 0.0
            for c in range(9):
                for d in range(9):
                    curvature = number_at(room, 10 + 9 * c + d)
                    second += plan.data[modes + 9 * i + c] * curvature * plan.data[modes + 9 * j + d]
            matrix[first + i, first + j] += per_x * plan.data[o] * second
        matrix[first + i, first + i] -= per_x * plan.data[o + _STIFFNESS + i]


HOMOGENEOUS_ENERGY = GeneralisedForce(
    Behaviour("energies of homogeneous deformations"), _subtract, _subtract_tangent, _energy, couples=False
)
