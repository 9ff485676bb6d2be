"""What a step makes of loads and motions that are data, against their exact integrals.

An estimate of the error sees accelerations at a few instants.  A pulse between them it does not see, and one at them it
cannot tell from a vibration that the step need not resolve.  Of data both can be said: the impulse that the method's
quadrature misses of them is an error of velocities that stays, whatever vibrates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.separate import address_of, call_separate
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.time_functions import integrals, piecewise
from flexmbd.multibody.kernels.reading.force_tables import data_functions
from flexmbd.multibody.kernels.reading.plan_entries import data_place, driven_place, driven_time
from flexmbd.round_off import ROUND_OFF

FloatArray = NDArray[np.float64]

# Data in a step: straight, or none; bent as their samples tell; with more in it than the samples tell.
STRAIGHT, SAMPLED, MISSED = range(3)

_ROUND_OFF = ROUND_OFF  # of a function's values, and of its integral up to there
_TOLD = 2.0  # the mean's error over what samples make of it: 1 where the step resolves the data


@dataclass(frozen=True, eq=False)
class DataLoads(ArrayStruct):
    """Work arrays of what a step misses of data.

    defect: (times, 3) in units of each function's value, rate and acceleration.
    push: (nv,) generalised forces that the defects make.  other, a: (nv,).
    known: (1,) whether any function of time that counts is data; kernel: (1,) then the address of `push_of_defects`.
    counts: (times,) which functions count.
    """

    defect: FloatArray
    push: FloatArray
    other: FloatArray
    a: FloatArray
    known: NDArray[np.int64]
    counts: NDArray[np.int64]
    kernel: NDArray[np.int64]


def new_data_loads(plan: Plan, nv: int, *, motions: bool = True) -> DataLoads:
    """Allocate the work arrays for ``plan``, for methods that do not `push`.

    ``motions``: whether a step can miss anything of prescribed motions.
    """
    counts = data_functions(plan, motions=motions)
    known = np.array([counts.any()], np.int64)
    defect, (push, other, a) = np.zeros((len(plan.times), 3)), np.zeros((3, nv))
    return DataLoads(defect, push, other, a, known, counts, np.zeros(1, np.int64))


def with_push(data: DataLoads, plan: Plan, work: Work, nx: int) -> DataLoads:
    """The same with the kernel of `push`, which is compiled where there are data alone."""
    if data.known[0] == 1:
        state = (np.zeros(nx), *np.zeros((2, len(data.a))), np.zeros(len(plan.rows)))
        data.kernel[0] = address_of(push_of_defects, (plan, work, *state, data))
    return data


@kernel
def mean_and_noise(plan, i, begin, end):
    """Means of data, of their rate and acceleration over a step, jumps left out; what may be round-off of each.

    All zero where function i is no piecewise polynomial, or a single one.
    """
    o, pieces = data_place(plan.times[i])
    if pieces == 0:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    first = piecewise(plan.time_data, o, pieces, begin)
    last = piecewise(plan.time_data, o, pieces, end)
    known = integrals(plan.time_data, o, pieces, begin)
    reached = integrals(plan.time_data, o, pieces, end)
    h = end - begin
    late = 1.0 + abs(end) / h  # of instants
    mean = ((reached[0] - known[0]) / h, (reached[1] - known[1]) / h, (reached[2] - known[2]) / h)
    noise = (
        _ROUND_OFF * ((abs(reached[0]) + abs(known[0])) / h + late * (abs(first[0]) + abs(last[0]))),
        _ROUND_OFF * ((abs(reached[1]) + abs(known[1])) / h + late * (abs(first[1]) + abs(last[1]))),
        _ROUND_OFF * ((abs(reached[2]) + abs(known[2])) / h + late * (abs(first[2]) + abs(last[2]))),
    )
    return mean, noise


@kernel
def find_defects(plan, state, h, h_before, data):
    """Fill ``data.defect`` (times, 3): by how much the trapezoidal rule misses each function's mean over the step.

    Or what the curvature of its values at both ends and at the step's before, h_before (s) earlier (0: none), makes of
    that, if it is more: by so much the estimate of the error takes it for bent.  Returns STRAIGHT where all are zero,
    but for round-off, MISSED where the samples tell less than there is.
    """
    found = STRAIGHT
    defect = data.defect
    begin = state.numbers[st.TIME]
    end = st.function_time(state.numbers, state.numbers[st.STEP_END])
    for i in range(plan.times.shape[0]):
        for c in range(3):
            defect[i, c] = 0.0
        if data.counts[i] == 0:
            continue
        o, pieces = data_place(plan.times[i])
        mean, noise = mean_and_noise(plan, i, begin, end)
        first = piecewise(plan.time_data, o, pieces, begin)
        last = piecewise(plan.time_data, o, pieces, end)
        before = piecewise(plan.time_data, o, pieces, begin - h_before)
        for c in range(3):
            lack = 0.5 * (first[c] + last[c]) - mean[c]
            bend = 0.0
            if h_before > 0.0:
                slope = (last[c] - first[c]) / h - (first[c] - before[c]) / h_before
                bend = slope / (h + h_before) * h * h / 6.0
            least = noise[c] + _ROUND_OFF * abs(before[c])
            if max(abs(lack), abs(bend)) > least:
                defect[i, c] = lack if abs(lack) > abs(bend) else bend
                found = max(found, MISSED if abs(lack) > _TOLD * abs(bend) + least else SAMPLED)
    return found


@kernel
def shift_times(time, defect, share):
    """Add ``share`` of the defects to the functions of time."""
    for i in range(defect.shape[0]):
        for c in range(3):
            time[i, c] += share * defect[i, c]


@entry_kernel
def push_of_defects(plan, work, x, v, a, multipliers, data):
    """Fill ``data.push`` with what its defects push at (x, v, a), ``work.time`` being up to date.

    The residual is linear in loads and in prescribed accelerations: its difference leaves out all else.
    """
    for k in range(a.shape[0]):
        data.a[k] = a[k]
    for sign in (1.0, -1.0):
        shift_times(work.time, data.defect, sign)
        for i in range(plan.driven.shape[0]):
            data.a[driven_place(plan.driven[i])[1]] = work.time[driven_time(plan.driven[i]), 2]
        residual(plan, work, x, v, data.a, multipliers, data.other)
        shift_times(work.time, data.defect, -sign)
        for k in range(a.shape[0]):
            data.push[k] = -data.other[k] if sign > 0.0 else 0.5 * (data.push[k] + data.other[k])


@kernel
def put_pushes(plan, data, right):
    """Put the forces that defects make on the free coordinates into a right-hand side (1, n) of which no row asks."""
    for i in range(right.shape[1]):
        right[0, i] = 0.0
    for j in range(plan.free.shape[0]):
        right[0, j] = data.push[plan.free[j]]


@kernel
def push(plan, work, state, x, v, a, multipliers, data):
    """`push_of_defects` by its address, so that scenes without data do not compile it."""
    call_separate(data.kernel[0], (plan, work, x, v, a, multipliers, data))
    state.counts[st.EVALUATIONS] += 2
