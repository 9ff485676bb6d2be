"""What integrators share: where an integration stands, the scales of its error, its record."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# What ``advance`` returns.
DONE, OUTPUT, NEED_INPUT, STEP_FLOOR, NEWTON_FAILED = range(5)

# Entries of ``State.numbers``.
TIME, TIME_END, STEP, STEP_BEFORE, STEP_FLOOR_SIZE, STEP_CEILING = 0, 1, 2, 3, 4, 5
TOLERANCE, ALPHA_M, ALPHA_F, BETA, GAMMA, INPUT_TIME, STEP_FACTORED = range(6, 13)
# The step that the auxiliary acceleration belongs to; the step before the last; how much a
# Newton iteration with the factors at hand leaves of the error.
STEP_AUXILIARY, STEP_EARLIER, CONTRACTION = 13, 14, 15
SLOWEST, N_NUMBER = 16, 17  # the machine's rate (1/s) is taken as at least this

# Entries of ``State.counts``.
STEPS, REJECTED, ITERATIONS, FACTORISATIONS, EVALUATIONS, KNOWN_BEFORE = 0, 1, 2, 3, 4, 5
FIXED_STEP, WORST, STORED, ASKS_INPUT, FILTERS, HOLD, N_COUNT = range(6, 13)

#: No relative error is asked for below this.
ROUND_OFF = 1e-12


class State(NamedTuple):
    """Where the integration stands; every array is written in place.

    x, v, a: configuration, velocity, true acceleration at TIME.
    auxiliary: the method's acceleration.
    before, earlier: the true acceleration one and two steps ago; KNOWN_BEFORE counts them.
    multipliers: one a constraint row.  numbers, counts: scalars by the entries named above.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    auxiliary: FloatArray
    before: FloatArray
    earlier: FloatArray
    multipliers: FloatArray
    numbers: FloatArray
    counts: IntArray


class Groups(NamedTuple):
    """Scales of the error norm: a group of coordinates shares one scale.

    of: (nv,) group of each velocity.  kind: (ng,) layout.GROUP_*.
    full: (ng,) the machine's size in the group's unit (1 rad; its extent L; L sqrt(mass)).
    floor: (ng,) smallest position scale: ``full``, or a share of it for modes.
    position, velocity, acceleration: (ng,) the largest magnitudes met so far.
    """

    of: IntArray
    kind: IntArray
    full: FloatArray
    floor: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Record(NamedTuple):
    """Output buffer: STORED rows are filled when ``advance`` returns."""

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray


@kernel
def machine_rate(state, groups):
    """The machine's rate (1/s): the fastest group of joint coordinates, or of modes alone.

    At least one over the simulated time, for a machine that starts at rest has none yet.
    Takes note of the largest velocities and accelerations on the way.
    """
    for k in range(state.v.shape[0]):
        g = groups.of[k]
        groups.velocity[g] = max(groups.velocity[g], abs(state.v[k]))
        groups.acceleration[g] = max(groups.acceleration[g], abs(state.a[k]))
    joints = 0.0
    modes = 0.0
    for g in range(groups.floor.shape[0]):
        groups.position[g] = max(groups.position[g], groups.floor[g])
        size = groups.position[g]
        rate = max(groups.velocity[g] / size, np.sqrt(groups.acceleration[g] / size))
        if groups.kind[g] == at.GROUP_MODAL:
            modes = max(modes, rate)
        else:
            joints = max(joints, rate)
    return max(joints if joints > 0.0 else modes, state.numbers[SLOWEST])


@kernel
def group_speed(groups, g, rate):
    """Velocity scale of group g: the largest met, or what its acceleration gives over its size.

    At least a small share of what the machine's ``rate`` (1/s) makes of its size.
    """
    size = groups.position[g]
    speed = max(groups.velocity[g], np.sqrt(size * groups.acceleration[g]))
    return max(speed, 1e-3 * size * rate)


@kernel
def set_scales(state, groups, s, rate, limit):
    """Scales of Newton's corrections: sizes met so far, velocities over the machine's own time.

    No scale asks for less than round-off of the machine's whole motion, for modes that hardly
    move get theirs from differences of it.
    """
    for k in range(state.v.shape[0]):
        g = groups.of[k]
        least = groups.full[g] * ROUND_OFF / limit
        s.scale_x[k] = max(groups.position[g], least)
        s.scale_v[k] = max(group_speed(groups, g, rate), least * rate) + 1e-300
