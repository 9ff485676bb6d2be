"""Accelerations and multipliers at the end of a Radau IIA step, of its order: the last stage's are of order 3.

M a + C^T nu = f and C a = -gamma at the stage's positions and velocities, solved by corrections of a and nu with
factors of M and of C M^-1 C^T that may be those of an earlier step.
"""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.integrate.loop_dynamics import NO_REACTION
from flexmbd.integrate.radau_coefficients import STAGES
from flexmbd.integrate.radau_matrix import derive
from flexmbd.integrate.radau_stages import END, evaluate_stage
from flexmbd.multibody.kernels.compiling import kernel
from flexmbd.multibody.kernels.native import factor, solve
from flexmbd.multibody.kernels.rank_revealing import factor_semidefinite, solve_semidefinite

_LAST = STAGES - 1
_MAX_ITERATIONS = 10
_RENEW = 0.05  # a slower contraction than this renews the factors
_ROUND_OFF = 1e-13


@kernel
def _factor_end(plan, work, s):
    """Factor M and C M^-1 C^T at the last stage, which was evaluated last; whether M is regular."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    derive(plan, work, s, _LAST, 0.0, 0.0, 1.0)
    for i in range(nu):
        for j in range(nu):
            s.final[i, j] = s.full[plan.free[i], plan.free[j]]
    if factor(plan.lapack, s.final, s.pivot_final, s.sizes) != 0:
        return False
    for r in range(m):
        for j in range(nu):
            s.reach_end[r, j] = s.tangent.jacobian[r, plan.free[j]]
            s.response[r, j] = s.reach_end[r, j]
    solve(plan.lapack, s.final, s.pivot_final, s.sizes, s.response)
    for r in range(m):
        for q in range(r + 1):
            total = 0.0
            for j in range(nu):
                total += s.reach_end[r, j] * s.response[q, j]
            s.hold[r, q] = total
        s.hold_norm[r] = np.sqrt(s.hold[r, r]) if s.hold[r, r] > 0.0 else 1.0
        if not np.isfinite(s.hold[r, r]):
            return False
    rank = factor_semidefinite(s.hold, s.hold_order, s.hold_norm)
    # what is about to come free keeps the stage's own: round-off would tell it what to do
    while rank > 1 and s.hold[rank - 1, rank - 1] ** 2 < NO_REACTION:
        rank -= 1
    s.hold_rank[0] = rank
    return True


@kernel
def close_end(plan, work, state, s, h, tolerance):
    """Solve for a and nu of the last stage; whether the forces balance to the tolerance."""
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    before = 0.0
    for _ in range(_MAX_ITERATIONS):
        evaluate_stage(plan, work, state, s, _LAST)
        if state.counts[END] == 0:
            before = 0.0
            if not _factor_end(plan, work, s):
                state.counts[st.OUTCOME] = st.RANK_LOST
                return False
            state.counts[END] = 1
        for j in range(nu):
            s.rhs_final[0, j] = -s.equation[_LAST, j]
        solve(plan.lapack, s.final, s.pivot_final, s.sizes, s.rhs_final)
        for r in range(m):
            s.lacking[r] = s.phi_rate2[r]
            for j in range(nu):
                s.lacking[r] += s.reach_end[r, j] * s.rhs_final[0, j]
        solve_semidefinite(
            s.hold, s.hold_rank[0], s.hold_order, s.hold_norm, s.lacking, s.hold_scratch, s.reaction
        )
        size = 0.0
        noise = 0.0
        for j in range(nu):
            k = plan.free[j]
            change = s.rhs_final[0, j]  # of free bodies
            weight = 0.0
            for r in range(m):
                change -= s.response[r, j] * s.reaction[r]
                weight += abs(s.response[r, j] * s.multipliers[_LAST, r])
            s.a[_LAST, k] += change
            part = max(abs(change), abs(s.rhs_final[0, j])) * h / s.scale_v[k]
            if not part <= size:
                size = part
                state.counts[st.WORST] = k
            noise = max(noise, weight * h / s.scale_v[k])
        for r in range(m):
            s.multipliers[_LAST, r] += s.reaction[r]
        if not np.isfinite(size):
            return False
        # where rows are about to lose their hold, or have just got it back, old factors may not contract at all
        contraction = size / before if before > 0.0 else np.inf
        if size * contraction <= tolerance or size <= _ROUND_OFF * max(1.0, noise):
            return contraction < 1.0 or size <= _ROUND_OFF * max(1.0, noise)
        if contraction > _RENEW:
            state.counts[END] = 0
        before = size
    return False
