"""Membrane forces of what expands and is held, on the modes of a body, scaled by a function of time.

The strain energy of a body's membrane strains e = strain q and their second-order parts s = q^T P q / 2 is that of
e + s less the strains f e_th of free expansion by a factor f: beside the given forces of the expansion that leaves
- f sum of e_th s.  Its numbers: A = sum of e_th P, (n, n), symmetric; the forces are f A q.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, GeneralisedForce


@kernel
def _subtract(plan, work, row, x, v, out):
    factor, n, o = work.time[row[at.EL_TIME], 0], row[at.EL_COUNT], row[at.EL_DATA]
    for i in range(n):
        force = 0.0
        for j in range(n):
            force += plan.data[o + n * i + j] * x[row[at.EL_X] + j]
        out[row[at.EL_V] + i] -= factor * force


@kernel
def _subtract_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    scale, n, o = per_x * work.time[row[at.EL_TIME], 0], row[at.EL_COUNT], row[at.EL_DATA]
    for i in range(n):
        for j in range(n):
            matrix[row[at.EL_V] + i, row[at.EL_V] + j] -= scale * plan.data[o + n * i + j]


HELD_EXPANSION = GeneralisedForce(
    Behaviour("membrane forces of held expansions"), _subtract, _subtract_tangent, couples=False
)
