"""The noise of accelerations that rounding of places makes by stiff elements, which no shorter step makes smaller.

An element of stiffness K between bodies of mass m knows their places to eps times the largest, and so their
accelerations to eps K / m times that.  It is measured: the accelerations of the state at hand against those of states
whose coordinates differ from it by a thousand times what places are known to, over a thousand.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.explicit.loop_dynamics import accelerate
from flexmbd.multibody.kernels.algebra.rotation_update import from_local_coordinates
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.reading.evaluated_motion import farthest_place
from flexmbd.multibody.kernels.reading.force_tables import has_stiff_elements

_EPS = sys.float_info.epsilon
_FIRST = 8  # samples of the first estimate
_RENEWAL = 20  # attempts from one sample to the next: less than a hundredth of the evaluations
_KEPT = 0.95  # of an estimate at the next sample
_MAGNIFIED = 2.0**10  # roundings that a sample moves by, and is divided by, so that its own rounding does not count
_SPREAD = 4.0  # a sum of a few roundings over the largest of some samples of it


@dataclass(frozen=True, eq=False)
class ForceNoise(ArrayStruct):
    """What is remembered of the noise.

    acceleration: (nv,) rad/s^2 or m/s^2; without entries where no element is stiff.  count: (2,) attempts since the
    last sample, and samples.
    """

    acceleration: NDArray[np.float64]
    count: NDArray[np.int64]


def new_force_noise(plan: Plan, nv: int) -> ForceNoise:
    """Allocate for nv velocities."""
    return ForceNoise(np.zeros(nv if has_stiff_elements(plan) else 0), np.zeros(2, np.int64))


def no_force_noise() -> ForceNoise:
    """Of fixed steps, which have no error to measure."""
    return ForceNoise(np.zeros(0), np.zeros(2, np.int64))


@kernel
def noise_is_due(noise):
    """Whether the noise is to be sampled before this attempt at a step, which is counted."""
    if noise.acceleration.shape[0] == 0:
        return False
    noise.count[0] += 1
    return noise.count[1] == 0 or noise.count[0] >= _RENEWAL


@deferred_kernel()
def sample_noise(plan, work, aw, loops, plain, quaternions, way, state, groups, scratch, noise):
    """Renew the noise; ``scratch`` has x, v, a, u and multipliers to overwrite."""
    evaluate_times(plan, st.function_time(state.numbers, state.numbers[st.TIME]), work.time)
    if plan.flag[0] != 0:
        return
    # where bodies are now: ``work`` may have none yet, or those of a stage far away
    forward_kinematics(plan, work, state.x, state.v, state.a)
    place = farthest_place(plan, work)
    for _ in range(_FIRST if noise.count[1] == 0 else 1):
        _sample(plan, work, aw, loops, plain, quaternions, way, state, groups, scratch, noise, place)
    noise.count[0] = 0


@kernel
def _sample(plan, work, aw, loops, plain, quaternions, way, state, groups, scratch, noise, place):
    for k in range(scratch.u.shape[0]):
        scratch.u[k] = 0.0
        scratch.v[k] = state.v[k]
    sample = noise.count[1]
    for j in range(plan.free.shape[0]):
        k = plan.free[j]
        g = groups.of[k]
        if groups.kind[g] == kinds.GROUP_LENGTH:
            scratch.u[k] = _MAGNIFIED * _EPS * max(place, groups.full[g]) * _sign(k, sample)
        elif groups.kind[g] == kinds.GROUP_ANGLE:
            scratch.u[k] = _MAGNIFIED * _EPS * _sign(k, sample)
    from_local_coordinates(plain, quaternions, way, state.x, scratch.u, scratch.x)
    drive(plan, work, scratch.x, scratch.v, scratch.a)
    accelerate(plan, work, aw, loops, scratch.x, scratch.v, scratch.a, scratch.multipliers)
    state.counts[st.EVALUATIONS] += 1
    for k in range(noise.acceleration.shape[0]):
        change = abs(scratch.a[k] - state.a[k]) / _MAGNIFIED
        noise.acceleration[k] = max(_KEPT * noise.acceleration[k], change)
    noise.count[1] += 1


@kernel
def _sign(k, sample):
    """One of two signs, without a pattern over unknowns and samples."""
    mixed = (k + 1) * 40503 + (sample + 1) * 69069 * (2 * k + 1)
    return 1.0 if (mixed >> 7) & 1 == 0 else -1.0


@kernel
def put_noise(noise, weights, h, out):
    """Write what noise makes of an error (nv,) of velocities: h times the stages' accelerations by ``weights``."""
    square = 0.0
    for j in range(weights.shape[0]):
        square += weights[j] ** 2
    for k in range(noise.acceleration.shape[0]):
        out[k] = _SPREAD * h * np.sqrt(square) * noise.acceleration[k]
