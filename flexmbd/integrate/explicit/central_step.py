"""A step of explicit central differences and its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Rule, next_step
from flexmbd.integrate.data_loads import MISSED, DataLoads, find_defects, shift_times
from flexmbd.integrate.explicit.loop_dynamics import (
    LoopMemory,
    Loops,
    accelerate,
    is_nearly_singular,
    project,
    update_row_scales,
)
from flexmbd.multibody.kernels.algebra.rotation_update import EXPONENTIAL, from_local_coordinates
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import ArticulatedWork
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: How its steps follow from their errors: each may be of another length, for nothing is factored.
RULE = Rule(exponent=1.0 / 3.0, failed=0.2, worth=1.0, tight=1.0, shrunk=1.0, hold=0)
_UNSEEN_ERROR = 3.0  # the error over its estimate: forces also depend on the predicted velocity at the step's end


@dataclass(frozen=True, eq=False)
class CentralDifferenceMemory(ArrayStruct):
    """What is remembered of the loops, and the accelerations (nv,) at the step before."""

    loops: LoopMemory
    before: FloatArray


@dataclass(frozen=True, eq=False)
class CentralDifferenceWorkspace(ArrayStruct):
    """The step's end, its displacement u, the local errors, and what is missed of data, with the reactions to it."""

    x: FloatArray
    v: FloatArray
    a: FloatArray
    u: FloatArray
    multipliers: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    reactions: FloatArray
    data: DataLoads
    memory: CentralDifferenceMemory


@dataclass(frozen=True, eq=False)
class CentralDifferenceMethod(ArrayStruct):
    """Arguments of an attempt."""

    plan: Plan
    work: Work
    aw: ArticulatedWork
    loops: Loops
    plain: IntArray
    quaternions: IntArray
    scratch: CentralDifferenceWorkspace


@kernel
def predict(plan, work, plain, quaternions, state, scratch, h):
    """Write the positions of the step's end and the predicted velocities there into ``scratch``."""
    for k in range(scratch.v.shape[0]):
        scratch.u[k] = h * (state.v[k] + 0.5 * h * state.a[k])
        scratch.v[k] = state.v[k] + h * state.a[k]
    from_local_coordinates(plain, quaternions, EXPONENTIAL, state.x, scratch.u, scratch.x)
    evaluate_times(plan, st.function_time(state.numbers, state.numbers[st.STEP_END]), work.time)
    if plan.flag[0] == 0:
        drive(plan, work, scratch.x, scratch.v, scratch.a)


@kernel
def _step(plan, work, aw, loops, plain, quaternions, state, groups, scratch, h, rate):
    """Take the step h; False if loops do not close or the end is not finite."""
    predict(plan, work, plain, quaternions, state, scratch, h)
    if plan.flag[0] != 0:
        return False
    looped = plan.rows.shape[0] > 0
    for off in range(2):
        if off == 1 and not project(
            plan, work, aw, plain, quaternions, state, groups, loops, rate, scratch.x, scratch.v
        ):
            state.counts[st.OUTCOME] = st.LOOPS_OPEN
            return False
        accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.a, scratch.multipliers)
        state.counts[st.EVALUATIONS] += 1
        if not looped or not is_nearly_singular(loops):
            break
    total = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.v[k] = state.v[k] + 0.5 * h * (state.a[k] + scratch.a[k])
        total += scratch.v[k]
    if looped and not project(plan, work, aw, plain, quaternions, state, groups, loops, rate, scratch.x, scratch.v):
        state.counts[st.OUTCOME] = st.LOOPS_OPEN
        return False
    return np.isfinite(total)


@kernel
def _error(plan, state, groups, scratch, h, rate):
    """The step's error over what is tolerated: what the accelerations' slope and curvature add."""
    before = state.numbers[st.STEP_BEFORE]
    known = before > 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        change = scratch.a[k] - state.a[k]
        scratch.error_x[k] = h * h / 6.0 * change
        scratch.error_v[k] = 0.0
        if known:
            bend = change / h - (state.a[k] - scratch.memory.before[k]) / before
            scratch.error_v[k] = h**3 / 6.0 * bend / (h + before)
    return _UNSEEN_ERROR * st.error_ratio(plan.free, state, groups, scratch.error_x, scratch.error_v, h, rate)


@kernel
def _missed(plan, work, aw, loops, state, groups, scratch, h, rate):
    """What a step misses of data between its ends, over what is tolerated; it is none of the accelerations' slopes."""
    if find_defects(plan, state, h, state.numbers[st.STEP_BEFORE], scratch.data) != MISSED:
        return 0.0
    shift_times(work.time, scratch.data.defect, 1.0)
    accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.data.a, scratch.reactions)
    shift_times(work.time, scratch.data.defect, -1.0)
    state.counts[st.EVALUATIONS] += 1
    for k in range(scratch.a.shape[0]):
        scratch.error_v[k] = h * (scratch.data.a[k] - scratch.a[k])
        scratch.error_x[k] = 0.5 * h * scratch.error_v[k]
    return st.error_ratio(plan.free, state, groups, scratch.error_x, scratch.error_v, h, rate)


@kernel
def _accept(state, scratch):
    """Make the step's end the current state."""
    for k in range(state.v.shape[0]):
        scratch.memory.before[k] = state.a[k]
        state.v[k] = scratch.v[k]
        state.a[k] = scratch.a[k]
    for k in range(state.x.shape[0]):
        state.x[k] = scratch.x[k]
    for i in range(state.multipliers.shape[0]):
        state.multipliers[i] = scratch.multipliers[i]


@kernel
def attempt(method, state, groups, h):
    """An attempt at a step, see ``controller``."""
    plan = method.plan
    work = method.work
    aw = method.aw
    loops = method.loops
    plain = method.plain
    quaternions = method.quaternions
    scratch = method.scratch
    rate = state.numbers[st.RATE]
    found = _step(plan, work, aw, loops, plain, quaternions, state, groups, scratch, h, rate)
    ratio = np.inf
    if plan.flag[0] != 0:
        state.counts[st.OUTCOME] = st.CALLBACK_FAILED
    elif found:
        ratio = 0.0 if state.counts[st.FIXED_STEP] == 1 else _error(plan, state, groups, scratch, h, rate)
        if 0.0 < ratio <= 1.0 and scratch.data.known[0] == 1:
            ratio = max(ratio, _missed(plan, work, aw, loops, state, groups, scratch, h, rate))
        if ratio <= 1.0:
            _accept(state, scratch)
            if plan.rows.shape[0] > 0:
                update_row_scales(loops, state)
    state.numbers[st.ERROR_RATIO] = ratio


@entry_kernel
def advance(method, rule, knots, state, groups, record):
    """Step until the end, a full record, or a failure; see ``controller``."""
    h = 0.0
    while True:
        h = next_step(method.plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        attempt(method, state, groups, h)
