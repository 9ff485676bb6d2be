"""A function of time and the whole state behind an address, which gives generalised forces (nv,).

Its numbers, count pairs: a velocity, and over how much of it (m/s or rad/s) the forces change as they do at rest, as
friction does within its regularisation.
"""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_state
from flexmbd.multibody.kernels.elements.differences import difference_step, put_moved_state
from flexmbd.multibody.kernels.elements.element import Behaviour, GeneralisedForce, Stiffness
from flexmbd.multibody.kernels.elements.user_law import address_at_side


@kernel
def _finite(values):
    total = 0.0  # a sum is finite but where a value is not, or where they are beyond all use
    for k in range(values.shape[0]):
        total += abs(values[k])
    return np.isfinite(total)


@kernel
def _subtract(plan, work, row, x, v, out):
    """Subtract the forces; NaN and ``plan.flag`` where they are not finite, not called where the state is not."""
    force = work.generalized[: v.shape[0]]
    for k in range(force.shape[0]):
        force[k] = np.nan
    if plan.flag[0] == 0 and _finite(x) and _finite(v):
        call_state(address_at_side(row, x), work.time[plan.times.shape[0], 0], x, v, force)
        if plan.flag[0] == 0 and not _finite(force):
            plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    for k in range(force.shape[0]):
        out[k] -= force[k]


@kernel
def _subtract_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    """Derivative by central differences, column by column."""
    nv = v.shape[0]
    o = row[at.EL_DATA]
    t = work.time[plan.times.shape[0], 0]
    if plan.flag[0] != 0:
        return
    for k in range(nv):
        size_v = tw.size_v[k]
        for i in range(row[at.EL_COUNT]):
            if plan.data[o + 2 * i] == k:
                size_v = min(size_v, plan.data[o + 2 * i + 1])
        step = difference_step(per_x, per_v, tw.size_x[k], max(size_v, abs(v[k])))
        if step == 0.0:
            return
        for sign in (-1.0, 1.0):
            put_moved_state(plan, tw, x, v, k, sign * per_x * step, sign * per_v * step)
            force = work.generalized[:nv]
            call_state(address_at_side(row, x), t, tw.moved_x, tw.moved_v, force)
            for j in range(nv):
                matrix[j, k] -= sign * force[j] / (2.0 * step)


_NAME = "forces of the state, which may be stiff"
STATE_FORCE = GeneralisedForce(
    Behaviour(_NAME, Stiffness.UNSEEN, calls_user=True, drives=True), _subtract, _subtract_tangent
)
#: What is solved for the whole machine at once, as friction that follows reactions: it drives no joint.
SOLVED_TOGETHER = GeneralisedForce(
    Behaviour(_NAME, Stiffness.UNSEEN, calls_user=True), _subtract, _subtract_tangent
)
