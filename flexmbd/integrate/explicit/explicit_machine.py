"""A machine as an explicit method of one's own moves it: places along a tangent vector, accelerations, closed loops.

The kernels here are what an attempt is written of (``controller``); docs/extending.md has a whole method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.explicit import loop_dynamics
from flexmbd.integrate.explicit.loop_dynamics import LoopMemory, Loops, new_loops
from flexmbd.multibody.kernels.algebra.rotation_update import EXPONENTIAL, coordinate_slots, from_local_coordinates
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import ArticulatedWork, new_articulated_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.plan.compiled_scene import CompiledScene

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ExplicitMachine(ArrayStruct):
    """What the kernels of this file take.

    plan, work: the compiled scene.  aw, loops: work arrays of its forward dynamics.  plain, quaternions: see
    ``rotation_update.coordinate_slots``.
    """

    plan: Plan
    work: Work
    aw: ArticulatedWork
    loops: Loops
    plain: IntArray
    quaternions: IntArray


def new_explicit_machine(scene: CompiledScene, memory: LoopMemory, work: Work) -> ExplicitMachine:
    """Allocate for a scene; ``memory`` is to be among what the method remembers."""
    plan = scene.plan
    loops = new_loops(plan, memory, scene.nv)
    return ExplicitMachine(plan, work, new_articulated_work(plan), loops, *coordinate_slots(plan))


@kernel
def move(machine, x, u, out):
    """Write the configuration x (nx,) moved by the tangent vector u (nv,) into ``out``; rotations turn by exp(u)."""
    from_local_coordinates(machine.plain, machine.quaternions, EXPONENTIAL, x, u, out)


@kernel
def accelerate(machine, state, t, x, v, a, multipliers):
    """Write accelerations (nv,) and multipliers (m,) at time t (s), place x and velocity v; False where that failed.

    Prescribed coordinates take their places in x and v.  A user's function that failed is why OUTCOME is set.
    """
    plan, work = machine.plan, machine.work
    evaluate_times(plan, st.function_time(state.numbers, t), work.time)
    if plan.flag[0] == 0:
        drive(plan, work, x, v, a)
        loop_dynamics.accelerate(plan, work, machine.aw, machine.loops, x, v, a, multipliers)
        state.counts[st.EVALUATIONS] += 1
    if plan.flag[0] != 0:
        state.counts[st.OUTCOME] = st.CALLBACK_FAILED
        return False
    return True


@kernel
def close_loops(machine, state, groups, x, v):
    """Move x, then v, onto the constraints of closed loops, by the factors of `accelerate`; False where that failed."""
    plan = machine.plan
    if plan.rows.shape[0] == 0:
        return True
    closed = loop_dynamics.project(
        plan, machine.work, machine.aw, machine.plain, machine.quaternions, state, groups, machine.loops,
        state.numbers[st.RATE], x, v,
    )  # fmt: skip
    if not closed:
        state.counts[st.OUTCOME] = st.LOOPS_OPEN
    return closed


@kernel
def judge(machine, state, groups, error_x, error_v, h):
    """Write RATIO, the local errors (nv,) over what is tolerated, 0 with a fixed step; whether the step is accepted."""
    ratio = 0.0
    if state.counts[st.FIXED_STEP] == 0:
        rate, noise = state.numbers[st.RATE], error_v[:0]
        ratio = st.error_ratio(machine.plan.free, state, groups, error_x, error_v, noise, h, rate)
    state.numbers[st.ERROR_RATIO] = ratio
    return ratio <= 1.0


@kernel
def accept(machine, state, x, v, a, multipliers):
    """Make the step's end the state; accelerations that are not finite are an error beyond all tolerance instead."""
    total = 0.0
    for k in range(v.shape[0]):
        total += abs(v[k]) + abs(a[k])
    if not np.isfinite(total):
        state.numbers[st.ERROR_RATIO] = np.inf
        return
    for k in range(v.shape[0]):
        state.v[k] = v[k]
        state.a[k] = a[k]
    for k in range(x.shape[0]):
        state.x[k] = x[k]
    for i in range(multipliers.shape[0]):
        state.multipliers[i] = multipliers[i]
    if multipliers.shape[0] > 0:
        loop_dynamics.update_row_scales(machine.loops, state)
