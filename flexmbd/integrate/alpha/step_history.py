"""An implicit step by a ``relation``: its preparation, its stages, and the history that it keeps."""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.integrate.alpha.augmented import solve_passes
from flexmbd.integrate.alpha.relation import (
    POINT,
    A,
    begin_stage,
    keep_stage,
    remember_step,
    remembers_acceleration,
    take_weights,
)
from flexmbd.multibody.kernels.base.compiling import kernel

_NEWTON_SHARE = 0.02  # Newton's error as a share of the step's tolerance
_FAR = 4.0  # times the step before, after one cut short by its end: beyond that its slopes say nothing


@kernel
def prepare_step(state, groups, scratch, h):
    """Take the weights of a step of h and set its scales; returns the tolerance of Newton's iteration."""
    rate = state.numbers[st.RATE]
    if h > _FAR * state.numbers[st.STEP_BEFORE]:
        scratch.memory.known_steps[0] = 0
    known = scratch.memory.known_steps[0] > 0
    take_weights(scratch.relation, h, state.numbers[st.STEP_BEFORE] if known else 0.0)
    limit = max(state.numbers[st.TOLERANCE] * min(1.0, h * rate), st.ROUND_OFF)
    st.set_scales(state, groups, scratch, rate, limit)
    return max(_NEWTON_SHARE * limit, 5e-15)


@kernel
def solve_stages(plan, work, state, scratch, h, tolerance):
    """Solve one stage of the step after the other; whether all converged.

    If so ``scratch`` holds the step's end.
    """
    last = scratch.relation.nodes.shape[0] - 1
    for i in range(last + 1):
        begin_stage(plan, work, state, scratch, h, i)
        if not solve_passes(plan, work, state, scratch, h, tolerance):
            return False
        if i < last:
            keep_stage(scratch, i)
    return True


@kernel
def accept(state, scratch, h):
    """Make the trial state the current one."""
    memory = scratch.memory
    a0 = a1 = carried = 0.0
    alone = remembers_acceleration(scratch.relation)
    if alone:  # in the loop below, for small machines' sake
        weights = scratch.relation.remember[0]
        a0, a1, carried = weights[A], weights[POINT + A], weights[POINT + POINT]
    else:
        remember_step(state, scratch)
    for k in range(state.v.shape[0]):
        if alone:
            memory.remembered[0, k] = a0 * state.a[k] + a1 * scratch.a[k] + carried * memory.remembered[0, k]
        memory.earliest[k] = memory.earlier[k]
        memory.earlier[k] = memory.before[k]
        memory.before[k] = state.a[k]
        state.v[k] = scratch.v[k]
        state.a[k] = scratch.a[k]
        memory.own_rate[k] = st.own_rate(scratch.own_rate[k], memory.own_rate[k], state.numbers[st.RATE], h)
    for k in range(state.x.shape[0]):
        state.x[k] = scratch.x[k]
    for i in range(state.multipliers.shape[0]):
        memory.reactions_earliest[i] = memory.reactions_earlier[i]
        memory.reactions_earlier[i] = memory.reactions_before[i]
        memory.reactions_before[i] = state.multipliers[i]
        state.multipliers[i] = scratch.multipliers[i]
    scratch.memory.step_earlier[0] = state.numbers[st.STEP_BEFORE]
    scratch.memory.known_steps[0] = min(3, scratch.memory.known_steps[0] + 1)
