"""The step limit of central differences: two over the fastest vibration's angular frequency, followed as it changes.

What a small displacement y makes of the accelerations is J y; the power iteration y <- J y turns y towards the fastest
vibration, and the length of J y over that of y towards the square of its frequency.  The nonlinear form, by differences
of forward dynamics: Sommeijer, Shampine & Verwer 1998 (doi:10.1016/S0377-0427(97)00219-7), section 3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.loop_dynamics import accelerate
from flexmbd.multibody.kernels.algebra.rotation_update import EXPONENTIAL, from_local_coordinates
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times

FloatArray = NDArray[np.float64]

_FIRST = 16  # products of the first estimate
_RENEWAL = 20  # steps from one product to the next while the limit may rule
_REST = 200  # and where it is more than _FAR steps away
_FAR = 4.0
_SHARE = 0.9  # of the estimate, which comes from below
_SMALL = 1e-6  # displacement over the machine's size: its square and round-off of forces over it are both small


@dataclass(frozen=True, eq=False)
class VibrationMemory(ArrayStruct):
    """What is remembered of the fastest vibration.

    shape: (nv,) displacement, zero before the first estimate.  limit: (1,) stable step (s), 0 before.
    steps: (1,) tried since the last product.
    """

    shape: FloatArray
    limit: FloatArray
    steps: NDArray[np.int64]


def new_vibration_memory(nv: int) -> VibrationMemory:
    """Allocate for nv velocities."""
    return VibrationMemory(np.zeros(nv), np.zeros(1), np.zeros(1, np.int64))


@kernel
def bound_step(plan, work, aw, loops, plain, quaternions, state, groups, scratch, h):
    """Renew STABLE_STEP where that is due; False, the step being rejected untried, where h is no stable one."""
    memory = scratch.memory.vibration
    memory.steps[0] += 1
    rules = h * _FAR > memory.limit[0]
    if memory.limit[0] > 0.0 and memory.steps[0] < (_RENEWAL if rules else _REST):
        return True
    if plan.free.shape[0] == 0:
        return True
    evaluate_times(plan, st.function_time(state.numbers, state.numbers[st.TIME]), work.time)
    if plan.flag[0] != 0:
        state.counts[st.OUTCOME] = st.CALLBACK_FAILED
        return False
    products = 1
    if memory.limit[0] == 0.0:
        products = _FIRST
        for j in range(plan.free.shape[0]):
            k = plan.free[j]
            memory.shape[k] = groups.full[groups.of[k]] * (1.0 if j % 3 == 0 else -0.7 + 0.1 * (j % 7))
    for _ in range(products):
        _turn(plan, work, aw, loops, plain, quaternions, state, groups, scratch)
    limit = _SHARE * memory.limit[0]
    state.numbers[st.STABLE_STEP] = limit
    memory.steps[0] = 0
    if h > memory.limit[0]:
        state.numbers[st.ERROR_RATIO] = (h / limit) ** 3
        return False
    return True


@kernel
def _turn(plan, work, aw, loops, plain, quaternions, state, groups, scratch):
    """One product: turn the shape towards the fastest vibration and renew the limit.

    A step at its limit h lets displacements y alternate, with predicted velocities 4 y / h, so that dampers count too.
    """
    memory = scratch.memory.vibration
    size = _length(plan, groups, memory.shape)
    limit = memory.limit[0]
    for k in range(scratch.u.shape[0]):
        scratch.u[k] = 0.0
        scratch.v[k] = state.v[k]
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.u[k] = _SMALL / size * memory.shape[k]
        if limit > 0.0:
            scratch.v[k] += 4.0 / limit * scratch.u[k]
    from_local_coordinates(plain, quaternions, EXPONENTIAL, state.x, scratch.u, scratch.x)
    accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.a, scratch.multipliers)
    state.counts[st.EVALUATIONS] += 1
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        scratch.u[k] = scratch.a[k] - state.a[k]
    square = _length(plan, groups, scratch.u) / _SMALL
    if not (square > 0.0 and np.isfinite(square)):
        memory.limit[0] = np.inf
        return
    memory.limit[0] = 2.0 / np.sqrt(square)
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        memory.shape[k] = scratch.u[k]


@kernel
def _length(plan, groups, vector):
    """Length of the free part of a vector (nv,) whose coordinates are measured by the machine's sizes."""
    total = 0.0
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        total += (vector[k] / groups.full[groups.of[k]]) ** 2
    return np.sqrt(total)
