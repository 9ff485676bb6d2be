"""The passes of an augmented Lagrangian within a step (Hestenes 1969; Powell 1969).

A row that one enforces has the reaction nu = nu* + k phi + c d phi/dt.  Each pass solves the step
with nu* known; the next adds k phi to it, until phi is small enough.  Aitken's factor, of the
changes over all rows, shortens what a stiffness low against mass / h^2 would make long.
Integrators that know of no passes solve for the reaction itself, which leaves phi = 0.
"""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.step import solve_step
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, NUMBER, deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.reading.plan_entries import (
    augmented_gap,
    augmented_stiffness,
    augmented_tolerance,
    holds_position,
    is_augmented,
)

_PASSES = 100
_LEAST, _MOST = 0.1, 20.0  # bounds of Aitken's factor


@deferred_kernel(FLAG)
def _is_open(plan, work, scratch):
    """Whether the gap of a row exceeds its tolerance at the step's end in ``scratch``."""
    forward_kinematics(plan, work, scratch.x, scratch.v, scratch.a)
    constraints(plan, work, scratch.phi, scratch.phi_rate, scratch.phi_rate2)
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        if is_augmented(row):
            gap = scratch.phi[i] if holds_position(row) else scratch.phi_rate[i]
            if not abs(gap) <= augmented_gap(plan.data, row):
                return True
    return False


@deferred_kernel(NUMBER)
def _next_pass(plan, scratch, factor, first):
    """Add the reaction to the last pass's gap to the known reactions; return Aitken's factor.

    Of a row that holds positions the gap alone counts: damping may act on a closed row, for the
    step does not fulfil the velocity as well.
    """
    along = 0.0
    size = 0.0
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        if is_augmented(row):
            k, c = augmented_stiffness(plan.data, row)
            lacks = k * scratch.phi[i] if holds_position(row) else c * scratch.phi_rate[i]
            change = lacks - scratch.row_force[i]
            along += scratch.row_force[i] * change
            size += change * change
            scratch.row_force[i] = lacks
    if not first and size > 0.0:
        factor = min(max(-factor * along / size, _LEAST), _MOST)
    for i in range(plan.rows.shape[0]):
        if is_augmented(plan.rows[i]):
            scratch.known_reaction[i] += factor * scratch.row_force[i]
    return factor


@kernel
def solve_passes(plan, work, state, scratch, h, tolerance):
    """``solve_step``, repeated where an augmented Lagrangian enforces rows until they are closed.

    Returns whether it converged; if so ``scratch`` holds the step's end.
    """
    augmented = False
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        if is_augmented(row):
            augmented = True
            scratch.known_reaction[i] = state.multipliers[i]
            tolerance = min(tolerance, 0.1 * augmented_tolerance(plan.data, row))
    factor = 1.0
    for k in range(_PASSES):
        if not solve_step(plan, work, state, scratch, h, tolerance):
            return False
        if not augmented or not _is_open(plan, work, scratch):
            return True
        factor = _next_pass(plan, scratch, factor, k == 0)
    state.counts[st.OUTCOME] = st.NOT_ENFORCED
    return False
