"""The tangent of force laws on coordinates; of users' functions by central differences."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.native import call_law, call_state
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import coordinate_law
from flexmbd.multibody.kernels.physics.energies import add_energy_block
from flexmbd.multibody.kernels.physics.joints import retract

_STEP = 6e-6  # share of a variable's size: the cube root of round-off


@kernel
def _stride(per_x, per_v, size_x, size_v):
    """How far along (per_x, per_v) the larger of the changes is `_STEP` of its size; 0 where there is no direction."""
    share = 0.0
    if per_x != 0.0:
        share = abs(per_x) / size_x
    if per_v != 0.0:
        share = max(share, abs(per_v) / size_v)
    return _STEP / share if share > 0.0 else 0.0


@kernel
def _user_slope(plan, work, tw, row, beta, rate, per_x, per_v):
    """Derivative of a user's law along (per_x, per_v)."""
    k = row[at.EL_V]
    step = _stride(per_x, per_v, max(tw.size_x[k], abs(beta)), max(tw.size_v[k], abs(rate)))
    if step == 0.0:
        return 0.0
    t = work.time[plan.times.shape[0], 0]
    address = row[at.EL_ADDRESS]
    up = call_law(address, t, beta + per_x * step, rate + per_v * step)
    down = call_law(address, t, beta - per_x * step, rate - per_v * step)
    return (up - down) / (2.0 * step)


@kernel
def _add_state_columns(plan, work, tw, address, x, v, per_x, per_v, matrix):
    """Derivative of a user's function of the whole state, column by column."""
    nv = v.shape[0]
    t = work.time[plan.times.shape[0], 0]
    for k in range(nv):
        step = _stride(per_x, per_v, tw.size_x[k], max(tw.size_v[k], abs(v[k])))
        if step == 0.0:
            return
        for sign in (-1.0, 1.0):
            for j in range(nv):
                tw.moved_v[j] = v[j]
                tw.move[j] = 0.0
            tw.moved_v[k] += sign * per_v * step
            tw.move[k] = sign * per_x * step
            retract(plan, x, tw.move, tw.moved_x)
            call_state(address, t, tw.moved_x, tw.moved_v, work.generalized)
            for j in range(nv):
                matrix[j, k] -= sign * work.generalized[j] / (2.0 * step)


@deferred_kernel()
def add_laws(plan, work, tw, x, v, per_x, per_v, matrix):
    """Subtract from the tangent the derivatives of all forces on coordinates."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        kind = row[at.EL_KIND]
        k = row[at.EL_V]
        if kind in kinds.COORDINATE_LAWS:
            _, slope_x, slope_v = coordinate_law(plan, row, x[row[at.EL_X]], v[k])
            matrix[k, k] -= per_x * slope_x + per_v * slope_v
        elif kind == kinds.ON_ENERGY:
            add_energy_block(plan, row, x, per_x, matrix)
        elif plan.flag[0] != 0:
            continue
        elif kind == kinds.ON_FUNCTION:
            matrix[k, k] -= _user_slope(plan, work, tw, row, x[row[at.EL_X]], v[k], per_x, per_v)
        elif kind == kinds.ON_STATE:
            _add_state_columns(plan, work, tw, row[at.EL_ADDRESS], x, v, per_x, per_v, matrix)
