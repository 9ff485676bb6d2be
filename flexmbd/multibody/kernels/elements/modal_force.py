"""Given forces on the modes of a body, scaled by a function of time.

Its numbers: one a mode; where there is a place in x, ``EL_X``, also the rows of a symmetric matrix, by which the forces
grow with the modal coordinates: those of what does its work on strains of second order, as a voltage does.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, GeneralisedForce


@kernel
def modal_force(plan, data, place, count, x, j):
    """Force on mode j per unit of the function of time; ``place``: of the first mode in x, -1 without a matrix."""
    force = plan.data[data + j]
    if place >= 0:
        for k in range(count):
            force += plan.data[data + count * (1 + j) + k] * x[place + k]
    return force


@kernel
def _subtract(plan, work, row, x, v, out):
    factor = work.time[row[at.EL_TIME], 0]
    for j in range(row[at.EL_COUNT]):
        out[row[at.EL_V] + j] -= factor * modal_force(plan, row[at.EL_DATA], row[at.EL_X], row[at.EL_COUNT], x, j)


@kernel
def _subtract_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    if row[at.EL_X] < 0:
        return
    factor, count, first = per_x * work.time[row[at.EL_TIME], 0], row[at.EL_COUNT], row[at.EL_V]
    for j in range(count):
        for k in range(count):
            matrix[first + j, first + k] -= factor * plan.data[row[at.EL_DATA] + count * (1 + j) + k]


MODAL_FORCE = GeneralisedForce(
    Behaviour("given forces", given=True), _subtract, _subtract_tangent, couples=False
)
