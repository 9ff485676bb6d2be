"""Given forces on the modes of a body, scaled by a function of time.  Its numbers: one a mode."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, GeneralisedForce


@kernel
def _subtract(plan, work, row, x, v, out):
    factor = work.time[row[at.EL_TIME], 0]
    for j in range(row[at.EL_COUNT]):
        out[row[at.EL_V] + j] -= factor * plan.data[row[at.EL_DATA] + j]


MODAL_FORCE = GeneralisedForce(Behaviour("given forces", given=True), _subtract)
