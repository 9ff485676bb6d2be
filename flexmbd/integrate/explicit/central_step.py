"""A step of explicit central differences and its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.controller import Rule, next_step
from flexmbd.integrate.data_loads import DataLoads, find_defects, shift_times
from flexmbd.integrate.explicit.fastest_vibration import VibrationMemory, bound_step
from flexmbd.integrate.explicit.loop_dynamics import (
    LoopMemory,
    Loops,
    accelerate,
    is_nearly_singular,
    project,
    project_onto_tangent,
    project_velocities,
    update_row_scales,
)
from flexmbd.integrate.filtered_error import filtered_ratio, misses_no_load, ratio_with_loads, vibration_rate
from flexmbd.integrate.jumps import take_jump
from flexmbd.integrate.lasting import forget_passing, judge_lasting
from flexmbd.multibody.kernels.algebra.rotation_update import EXPONENTIAL, from_local_coordinates
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import ArticulatedWork
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: How its steps follow from their errors: equal ones while these serve, for where lengths change from step to step fast
#: vibrations grow.
RULE = Rule(exponent=1.0 / 3.0, failed=0.2, worth=1.25, tight=0.9, shrunk=0.85, hold=7)
_UNSEEN_ERROR = 1.0  # the error over its estimate: forces also depend on the predicted velocity at the step's end


@dataclass(frozen=True, eq=False)
class CentralDifferenceMemory(ArrayStruct):
    """What is remembered of the loops and of the fastest vibration.

    before, own_rate: (nv,) the accelerations at the step before; each coordinate's own rate (1/s), see ``state``.
    """

    loops: LoopMemory
    vibration: VibrationMemory
    before: FloatArray
    own_rate: FloatArray


@dataclass(frozen=True, eq=False)
class CentralDifferenceWorkspace(ArrayStruct):
    """The step's end, its displacement u, the local errors, and what is missed of data, with the reactions to it.

    curve, own_rate: (nv,) half the second derivatives of the accelerations, and the rates (1/s) that these show.
    load: (1, free) accelerations by what is missed of data.  elastic: (1,) 1 where bodies are elastic, else 0.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    u: FloatArray
    multipliers: FloatArray
    error_x: FloatArray
    error_v: FloatArray
    curve: FloatArray
    own_rate: FloatArray
    load: FloatArray
    elastic: FloatArray
    reactions: FloatArray
    data: DataLoads
    memory: CentralDifferenceMemory


@dataclass(frozen=True, eq=False)
class CentralDifferenceMethod(ArrayStruct):
    """Arguments of an attempt.

    corrected: whether forces at the step's end are evaluated again, with the velocity that was found there.
    """

    plan: Plan
    work: Work
    aw: ArticulatedWork
    loops: Loops
    plain: IntArray
    quaternions: IntArray
    corrected: bool
    scratch: CentralDifferenceWorkspace


@kernel
def predict(plan, work, plain, quaternions, corrected, state, scratch, h):
    """Write the positions of the step's end and the predicted velocities there into ``scratch``.

    Velocities that are to be corrected follow the accelerations' slope over the step before.
    """
    before = state.numbers[st.STEP_BEFORE]
    slope = 0.5 * h * h / before if corrected and before > 0.0 else 0.0
    for k in range(scratch.v.shape[0]):
        scratch.u[k] = h * (state.v[k] + 0.5 * h * state.a[k])
        scratch.v[k] = state.v[k] + h * state.a[k]
        if slope > 0.0:
            scratch.v[k] += slope * (state.a[k] - scratch.memory.before[k])
    from_local_coordinates(plain, quaternions, EXPONENTIAL, state.x, scratch.u, scratch.x)
    evaluate_times(plan, st.function_time(state.numbers, state.numbers[st.STEP_END]), work.time)
    if plan.flag[0] == 0:
        drive(plan, work, scratch.x, scratch.v, scratch.a)


@kernel
def _step(plan, work, aw, loops, plain, quaternions, corrected, state, groups, scratch, h, rate):
    """Take the step h; False if loops do not close or the end is not finite."""
    predict(plan, work, plain, quaternions, corrected, state, scratch, h)
    if plan.flag[0] != 0:
        return False
    looped = plan.rows.shape[0] > 0
    closing = (plan, work, aw, plain, quaternions, state, groups, loops, rate, scratch.x, scratch.v)
    for off in range(2):
        if off == 1 and not project(*closing):
            state.counts[st.OUTCOME] = st.LOOPS_OPEN
            return False
        accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.a, scratch.multipliers)
        state.counts[st.EVALUATIONS] += 1
        if not looped or not is_nearly_singular(loops):
            break
    total = _end_velocities(plan, state, scratch, h)
    closed = not looped or project(*closing)
    if closed and corrected:
        accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.a, scratch.multipliers)
        state.counts[st.EVALUATIONS] += 1
        total = _end_velocities(plan, state, scratch, h)
        closed = not looped or project_velocities(
            plan, work, aw, state, groups, loops, rate, scratch.x, scratch.v
        )
    if not closed:
        state.counts[st.OUTCOME] = st.LOOPS_OPEN
        return False
    return np.isfinite(total)


@kernel
def _end_velocities(plan, state, scratch, h):
    """Write the velocities at the step's end by the mean acceleration; their sum."""
    total = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.v[k] = state.v[k] + 0.5 * h * (state.a[k] + scratch.a[k])
        total += scratch.v[k]
    return total


@kernel
def _error(plan, work, aw, loops, state, groups, scratch, h, rate):
    """The step's error over what is tolerated, against the parabola through the last three accelerations.

    With elastic bodies a vibration counts as in the implicit methods (``filtered_error``): its error swings and is no
    drift.  Errors across the loops do not count: projection removes them.
    """
    judge_lasting(plan, work, state, groups, scratch.x, scratch.v)
    before = state.numbers[st.STEP_BEFORE]
    for k in range(scratch.curve.shape[0]):
        change = scratch.a[k] - state.a[k]
        curve = 0.0
        if before > 0.0:
            curve = (change / h - (state.a[k] - scratch.memory.before[k]) / before) / (h + before)
        scratch.curve[k] = curve
        scratch.error_v[k] = h**3 / 6.0 * curve
        scratch.error_x[k] = h**4 / 12.0 * curve - h * h / 6.0 * change
    if plan.rows.shape[0] > 0:
        project_onto_tangent(plan, work, aw, loops, scratch.error_x)
        project_onto_tangent(plan, work, aw, loops, scratch.error_v)
        project_onto_tangent(plan, work, aw, loops, scratch.curve)
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.own_rate[k] = vibration_rate(groups, k, scratch.curve[k])
        scratch.error_x[j] = scratch.error_x[k]
        scratch.error_v[j] = scratch.error_v[k]
    ratio = _ratio(plan, state, groups, scratch, h, rate, _lasting(state, scratch))
    if 0.0 < ratio <= 1.0 and scratch.data.known[0] == 1:
        ratio = _ratio_with_loads(plan, work, aw, loops, state, groups, scratch, h, rate, ratio)
    forget_passing(plan, state, groups, scratch.own_rate)
    return ratio


@kernel
def _lasting(state, scratch):
    """Shares of own rates that are a vibration's, of modes and of joints: none without elastic bodies."""
    return scratch.elastic[0], scratch.elastic[0] * state.numbers[st.STEP_LASTING]


@kernel
def _ratio(plan, state, groups, scratch, h, rate, lasting):
    own, before = scratch.own_rate, scratch.memory.own_rate
    errors = scratch.error_x, scratch.error_v
    return filtered_ratio(plan, state, groups, *errors, own, before, h, rate, st.ROUND_OFF, lasting)


@kernel
def _ratio_with_loads(plan, work, aw, loops, state, groups, scratch, h, rate, ratio):
    """The error's ratio where data act in the step, see ``data_loads``: what is missed is no vibration."""
    found = find_defects(plan, state, h, state.numbers[st.STEP_BEFORE], scratch.data)
    errors = scratch.error_x, scratch.error_v, scratch.own_rate, scratch.memory.own_rate
    if misses_no_load(plan, state, groups, *errors, h, rate, st.ROUND_OFF, found):
        return ratio
    shift_times(work.time, scratch.data.defect, 1.0)
    accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.data.a, scratch.reactions)
    shift_times(work.time, scratch.data.defect, -1.0)
    state.counts[st.EVALUATIONS] += 1
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.load[0, j] = scratch.data.a[k] - scratch.a[k]
    lasting = _lasting(state, scratch)
    return ratio_with_loads(plan, state, groups, *errors, h, rate, st.ROUND_OFF, lasting, scratch.load)


@kernel
def _accept(state, scratch, h):
    """Make the step's end the current state."""
    for k in range(state.v.shape[0]):
        scratch.memory.before[k] = state.a[k]
        own, before = scratch.own_rate[k], scratch.memory.own_rate[k]
        scratch.memory.own_rate[k] = st.own_rate(own, before, state.numbers[st.RATE], h)
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
    corrected = method.corrected
    scratch = method.scratch
    rate = state.numbers[st.RATE]
    fixed = state.counts[st.FIXED_STEP] == 1
    if not fixed and not bound_step(plan, work, aw, loops, plain, quaternions, state, groups, scratch, h):
        return
    found = _step(plan, work, aw, loops, plain, quaternions, corrected, state, groups, scratch, h, rate)
    ratio = np.inf
    if plan.flag[0] != 0:
        state.counts[st.OUTCOME] = st.CALLBACK_FAILED
    elif found:
        ratio = 0.0 if fixed else _error(plan, work, aw, loops, state, groups, scratch, h, rate)
        if not ratio <= 1.0 and take_jump(plan.free, state, groups, state.a, scratch.a, 1.0, h):
            ratio = 1.0
        if ratio <= 1.0:
            _accept(state, scratch, h)
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
