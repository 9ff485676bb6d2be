"""A user's law on a coordinate behind an address: f(t, x, rate) -> N or N m."""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_law
from flexmbd.multibody.kernels.elements.differences import difference_step
from flexmbd.multibody.kernels.elements.element import Behaviour, GeneralisedForce, Stiffness


@kernel
def address_at_side(row, x):
    """Address of a user's function on the side of its switch that x (nx,) tells."""
    if row[at.EL_SIDE] >= 0 and x[row[at.EL_SIDE]] < 0.0:
        return row[at.EL_ADDRESS + 1]
    return row[at.EL_ADDRESS]


@kernel
def _force(plan, work, row, address, x, rate):
    """The force; NaN and ``plan.flag`` where it is not finite.

    Where the trial state itself is not finite the law is not called.
    """
    if plan.flag[0] != 0 or not np.isfinite(x + rate):
        return np.nan
    force = call_law(address, work.time[plan.times.shape[0], 0], x, rate)
    if plan.flag[0] == 0 and not np.isfinite(force):
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    return force


@kernel
def _subtract(plan, work, row, x, v, out):
    k = row[at.EL_V]
    out[k] -= _force(plan, work, row, address_at_side(row, x), x[row[at.EL_X]], v[k])


@kernel
def _subtract_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    k = row[at.EL_V]
    beta, rate = x[row[at.EL_X]], v[k]
    step = difference_step(per_x, per_v, max(tw.size_x[k], abs(beta)), max(tw.size_v[k], abs(rate)))
    if step == 0.0 or plan.flag[0] != 0:
        return
    t = work.time[plan.times.shape[0], 0]
    address = address_at_side(row, x)
    up = call_law(address, t, beta + per_x * step, rate + per_v * step)
    down = call_law(address, t, beta - per_x * step, rate - per_v * step)
    matrix[k, k] -= (up - down) / (2.0 * step)


@kernel
def _slope(plan, work, row, x, v, size):
    if plan.flag[0] != 0:
        return 0.0
    beta, rate = x[row[at.EL_X]], v[row[at.EL_V]]
    step = difference_step(1.0, 0.0, max(size, abs(beta)), 1.0)
    t = work.time[plan.times.shape[0], 0]
    address = address_at_side(row, x)
    return (call_law(address, t, beta + step, rate) - call_law(address, t, beta - step, rate)) / (2.0 * step)


USER_LAW = GeneralisedForce(
    Behaviour("forces of the state, which may be stiff", Stiffness.UNSEEN, changing=True, calls_user=True, drives=True),
    _subtract,
    _subtract_tangent,
    slope=_slope,
    couples=False,
)
