"""The stages of a Radau IIA step on the manifold: their places and the residuals of their equations.

Stage i lies at x = retract(x_n, u_i), u' = J(u)^-1 (v + D^T mu), v' = a, with J the differential of the exponential map
for rotations, the identity for all else; M a + b + C^T nu = f.  Loops are closed at the level of positions and of
velocities: mu shifts the positions along D (stabilised index 2; Gear, Leimkuhler & Gupta 1985).  The unknowns of a
stage are a, nu and the rate kappa of mu.
"""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.radau.coefficients import NODES, STAGES, TO_POWERS, WEIGHTS
from flexmbd.integrate.radau.workspace import CONSTRAINTS, RESIDUAL
from flexmbd.multibody.kernels.algebra.so3 import left_jacobian_inverse, load3, scale3, store3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.separate import call_separate
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times


@kernel
def evaluate_stage_times(plan, work, state, scratch, h):
    """Functions of time at the instants of the stages; False where a callable failed, its time in ``work``."""
    for i in range(STAGES):
        t = state.numbers[st.TIME] + NODES[i] * h
        if i == STAGES - 1:
            t = state.numbers[st.STEP_END]
        evaluate_times(plan, st.function_time(state.numbers, t), work.time)
        for k in range(work.time.shape[0]):
            for j in range(3):
                scratch.time[i, k, j] = work.time[k, j]
        if plan.flag[0] != 0:
            return False
    return True


@kernel
def predict_stages(plan, state, scratch, h, extrapolate):
    """Predictor: stages' accelerations and multipliers on the last step's polynomial, or those of the step's start."""
    step = h / scratch.memory.step_polynomial[0] if extrapolate else 0.0
    memory = scratch.memory
    scratch.pushed[:, :] = 0.0
    for i in range(STAGES):
        # values of the polynomial through the last stages, as weights of these
        t = 1.0 + NODES[i] * step
        w0 = TO_POWERS[0, 0] + t * (TO_POWERS[1, 0] + t * TO_POWERS[2, 0])
        w1 = TO_POWERS[0, 1] + t * (TO_POWERS[1, 1] + t * TO_POWERS[2, 1])
        w2 = TO_POWERS[0, 2] + t * (TO_POWERS[1, 2] + t * TO_POWERS[2, 2])
        for k in range(state.a.shape[0]):
            scratch.a[i, k] = state.a[k]
            if extrapolate:
                scratch.a[i, k] = w0 * memory.stage_a[0, k] + w1 * memory.stage_a[1, k] + w2 * memory.stage_a[2, k]
        for r in range(plan.rows.shape[0]):
            scratch.shift[i, r] = 0.0
            scratch.multipliers[i, r] = state.multipliers[r]
            if extrapolate:
                before = memory.stage_reactions
                scratch.multipliers[i, r] = w0 * before[0, r] + w1 * before[1, r] + w2 * before[2, r]


@kernel
def place_stages(plan, state, scratch, h):
    """Velocities and local coordinates of the stages; returns the largest change over its scale.

    Rates of rotation vectors depend on these themselves: each call is one sweep of a fixed-point iteration that
    contracts by about a twelfth of the squared turn, besides Newton's own.
    """
    largest = 0.0
    rows = plan.rows.shape[0] > 0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        for i in range(STAGES):
            a = scratch.a
            gain = WEIGHTS[i, 0] * a[0, k] + WEIGHTS[i, 1] * a[1, k] + WEIGHTS[i, 2] * a[2, k]
            v = state.v[k] + h * gain
            part = abs(v - scratch.v[i, k]) / scratch.scale_v[k]
            if not part <= largest:
                largest = part
                state.counts[st.WORST] = k
            scratch.v[i, k] = v
            if rows:
                p = scratch.pushed
                v += h * (WEIGHTS[i, 0] * p[0, j] + WEIGHTS[i, 1] * p[1, j] + WEIGHTS[i, 2] * p[2, j])
            scratch.local_rate[i, k] = v
    for q in range(scratch.quaternions.shape[0]):
        o = scratch.quaternions[q]
        for i in range(STAGES):
            back = scale3(-1.0, load3(scratch.local[i], o))  # body axes: the right Jacobian
            store3(scratch.local_rate[i], o, left_jacobian_inverse(back, load3(scratch.local_rate[i], o)))
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        for i in range(STAGES):
            p = scratch.local_rate
            u = h * (WEIGHTS[i, 0] * p[0, k] + WEIGHTS[i, 1] * p[1, k] + WEIGHTS[i, 2] * p[2, k])
            part = abs(u - scratch.local[i, k]) / scratch.scale_x[k]
            if not part <= largest:
                largest = part
                state.counts[st.WORST] = k
            scratch.local[i, k] = u
    return largest


@kernel
def put_stage(plan, work, state, scratch, i):
    """Write the configuration of stage i, where its local coordinates have brought it, at its time."""
    for f in range(work.time.shape[0]):
        for c in range(3):
            work.time[f, c] = scratch.time[i, f, c]
    retract(plan, state.x, scratch.local[i], scratch.x[i])
    drive(plan, work, scratch.x[i], scratch.v[i], scratch.a[i])


@kernel
def evaluate_stage(plan, work, state, scratch, i):
    """Residual, and residuals of the rows at all levels, of stage i where it is placed."""
    put_stage(plan, work, state, scratch, i)
    call_separate(
        scratch.kernels[RESIDUAL],
        (plan, work, scratch.x[i], scratch.v[i], scratch.a[i], scratch.multipliers[i], scratch.residual),
    )
    state.counts[st.EVALUATIONS] += 1
    if plan.rows.shape[0] > 0:
        call_separate(scratch.kernels[CONSTRAINTS], (plan, work, scratch.phi, scratch.phi_rate, scratch.phi_rate2))
    nu = plan.free.shape[0]
    m = plan.rows.shape[0]
    for j in range(nu):
        scratch.equation[i, j] = scratch.residual[plan.free[j]]
    for r in range(m):
        scratch.equation[i, nu + r] = scratch.phi[r]
        scratch.equation[i, nu + m + r] = scratch.phi_rate[r]
