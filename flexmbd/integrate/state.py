"""Data that all integrators share: the state of an integration, the scales of its error, the record of its steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.base.compiling import brief_entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember_step
from flexmbd.multibody.kernels.reading.plan_entries import modes_of
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Codes that a stepper returns.  DONE: the end is reached.  OUTPUT: the record is full.  The others are the failure of a
# step that cannot be made shorter: a user's function; an interior; Newton's iteration; constraint rows that are
# dependent, or a singular matrix; loops that do not close; a result that is not finite; an error above tolerance; rows
# that an augmented Lagrangian does not close; jumps that follow each other endlessly; a sliding hard contact that is
# pressed the more the more it is pushed apart (WORST: its element's number, ERROR_RATIO: the angle of
# ``moreau.step``); points of contact without room, which the method's stepper makes; a hard contact at which nothing
# gives way to an impulse (WORST: its element's number).
DONE, OUTPUT, CALLBACK_FAILED, INTERIOR_FAILED, NOT_CONVERGED, RANK_LOST, LOOPS_OPEN, NOT_FINITE, INACCURATE = range(9)
NOT_ENFORCED, ENDLESS_JUMPS, PAINLEVE, NO_ROOM, BLOCKED = 9, 10, 11, 12, 13

# Entries of ``State.numbers``.
TIME, TIME_END, STEP, STEP_BEFORE, STEP_FLOOR_SIZE, STEP_CEILING, TOLERANCE = range(7)
LEAST_RATE = 7  # lower bound of the machine's rate (1/s)
# LATEST: functions of time are evaluated no later than this, so that a step that ends at a break sees values before it.
# Of the step at hand: the time of its end, its length before it was cut to that end, the machine's rate, its error over
# the tolerance.
LATEST, STEP_END, WHOLE_STEP, RATE, ERROR_RATIO = range(8, 13)
# Of a fixed step that is taken in parts: the length that remains, and the longest part (0: all that remains).
STEP_REMAINDER, STEP_PART = 13, 14
# Share of joints' own rates that is sure to last (see ``lasting``): at TIME and a step before; at the end of the step
# at hand; over these three, whose accelerations show a rate.
LASTING, LASTING_BEFORE, LASTING_AT_END, STEP_LASTING = range(15, 19)
# What undeclared jumps cost, in parts of rtol, and when (s) the last was passed (see ``jumps``).
JUMP_SPENT, JUMP_LAST = 19, 20
# The rate (1/s) that bounds the length of steps: the machine's, but for velocities of what drifts (see ``Groups``).
PACE = 21
# Error and size of the last step that error control accepted, a safety of the next; these are forgotten where the
# machine begins anew.
RATIO_BEFORE, STEP_ACCEPTED, SAFETY = 22, 23, 24
# The largest value of the kept rows' smallest pivot since the rows were last selected (see ``watch_pivot``).
# The longest step (s) that an explicit method knows to be stable.
LARGEST_PIVOT, STABLE_STEP = 25, 26
# Of rejected attempts (see ``jumps``): up to when (s) they reach, the length of the first, and that of one (0: none)
# with the change of accelerations (1/s) in it.
REJECTED_END, REJECTED_FIRST, REJECTED_STEP, REJECTED_CHANGE, N_NUMBER = range(27, 32)

# Entries of ``State.counts``.
STEPS, REJECTED, ITERATIONS, FACTORISATIONS, EVALUATIONS = range(5)
FIXED_STEP, WORST, STORED = 5, 6, 7
# OUTCOME: of the last attempt, DONE or the code of its failure.  MOST_STORED: rows to store before a stepper returns.
# AT_BREAK: whether TIME is a break that the machine has not left yet.  KNOT: the first knot after TIME.  WATCH_ROWS:
# whether other constraint rows may become better conditioned than those kept.  RESELECT_ROWS: why rows are to be
# selected anew before the next step, PIVOT_FELL or the code of a step's failure.  JUMPS: undeclared jumps that were
# passed, SWITCHES of laws.  JUMPED: whether the attempt at hand, or that which led to TIME, passes a jump.  JUMP_AHEAD:
# whether rejected attempts show one.  NO_GROWTH: steps that may not grow.
OUTCOME, MOST_STORED, AT_BREAK, KNOT, WATCH_ROWS, RESELECT_ROWS = range(8, 14)
JUMPS, SWITCHES, JUMPED, JUMP_AHEAD, NO_GROWTH, N_COUNT = range(14, 20)
PIVOT_FELL = 1

_PIVOT_FALL = 1.0 / 16.0  # fall of the smallest pivot at which rows are selected anew

# The least that a step leaves of a coordinate's own rate: its three instants may lie about a zero of the curvature.
_FADE = 0.25
_FADING = 2.0 / math.pi  # 1 / rad: over half a period it fades to e^-2
_FADED = -math.log(_FADE) / _FADING  # rad of a vibration in a step after which that is left
# Radians of a group's motion in which what lasts of its velocities comes round, and of its accelerations.
_LASTING_VELOCITY, _LASTING_ACCELERATION = 4.0 * math.pi, 0.5 * math.pi
_ONSET = 4.0  # times that of the step before, or the machine's

ROUND_OFF = EQUAL  #: Lower bound of relative tolerances.


@dataclass(frozen=True, eq=False)
class State(ArrayStruct):
    """Where the integration stands; every array is written in place.

    With ``Groups`` and the method's own memory (``controller.Stepper``) it is all that is remembered from step to step,
    but for factors of an iteration matrix, which ``drop_factors`` makes the method forget: copies of the three restart
    it to the bit.

    x, v, a: configuration, velocity, true acceleration at TIME.
    multipliers: one a constraint row.
    numbers, counts: scalars by the entries named above.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray
    numbers: FloatArray
    counts: IntArray


@dataclass(frozen=True, eq=False)
class Groups(ArrayStruct):
    """Scales of the error norm: a group of coordinates shares one scale.

    Attributes:
        of: (nv,) group of each velocity.
        kind: (ng,) kinds.GROUP_*.
        full: (ng,) the machine's size in the group's unit (1 rad; its extent L; L sqrt(mass)).
        floor: (ng,) smallest position scale: ``full``, or a share of it for modes.
        position: (ng,) the largest magnitudes met so far.
        velocity, acceleration: (ng,) the largest magnitudes of the motion that lasts, see ``_forget_past``.
        rate: (ng,) 1/s, what they make over the position's scale.
        newest: (ng, 2) those met in the present stretch of the motion; turned: (ng, 2) rad that these have lasted.
        stiffness, softest: (ne, 2) of each force element, none where no element changes them: the magnitudes of its
            derivatives by its coordinate and by that's rate at the end of the step at hand; the smallest met so far.
        touched: (ne,) of each force element, none without contacts or where bodies are elastic: at how many of the
            instants at which the step at hand was looked at it is a contact that touches.
        gap_begin, gap_end: (ne, 2) of these the gap (m) and its rate (m/s) at the step's ends.
        held: (nv,) 1 where a coordinate moves such a contact, 0 elsewhere; none where ``touched`` has none.
        drifts: (ng,) 1 where nothing but contacts asks where the coordinates are, as of a body in free flight.
    """

    of: IntArray
    kind: IntArray
    full: FloatArray
    floor: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    rate: FloatArray
    newest: FloatArray
    turned: FloatArray
    stiffness: FloatArray
    softest: FloatArray
    touched: FloatArray
    gap_begin: FloatArray
    gap_end: FloatArray
    held: FloatArray
    drifts: FloatArray


@dataclass(frozen=True, eq=False)
class Record(ArrayStruct):
    """Output buffer: STORED rows are filled when a stepper returns.

    work: in which what elements remember is brought up to date.
    """

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    multipliers: FloatArray
    work: Work


@kernel
def machine_rate(state, groups):
    """The machine's rate (1/s): the fastest group of joint coordinates, or of modes alone.

    At least one over the simulated time, for a machine that starts at rest has none yet.
    Updates the largest velocities and accelerations of the groups, their rates, and PACE.
    """
    for k in range(state.v.shape[0]):
        g = groups.of[k]
        groups.newest[g, 0] = max(groups.newest[g, 0], abs(state.v[k]))
        groups.newest[g, 1] = max(groups.newest[g, 1], abs(state.a[k]))
    joints = 0.0
    modes = 0.0
    bound = 0.0
    for g in range(groups.floor.shape[0]):
        groups.position[g] = max(groups.position[g], groups.floor[g])
        groups.velocity[g] = max(groups.velocity[g], groups.newest[g, 0])
        groups.acceleration[g] = max(groups.acceleration[g], groups.newest[g, 1])
        size = groups.position[g]
        rate = max(groups.velocity[g] / size, math.sqrt(groups.acceleration[g] / size))
        groups.rate[g] = rate
        if groups.drifts[g] > 0.0:
            bound = max(bound, math.sqrt(groups.acceleration[g] / size))
        elif groups.kind[g] != kinds.GROUP_MODAL and groups.kind[g] != kinds.GROUP_STATE:
            bound = max(bound, rate)
        if groups.kind[g] == kinds.GROUP_MODAL:
            modes = max(modes, rate)
        elif groups.kind[g] != kinds.GROUP_STATE:
            joints = max(joints, rate)
    state.numbers[PACE] = max(bound if joints > 0.0 else modes, state.numbers[LEAST_RATE])
    return max(joints if joints > 0.0 else modes, state.numbers[LEAST_RATE])


@brief_entry_kernel
def starting_rate(free, of, full, v, a, least):
    """The rate (1/s) at a start with v, a (nv,): the fastest free coordinate's, or ``least``; as of ``Groups``."""
    fastest = 0.0
    bent = 0.0
    for i in range(free.shape[0]):
        k = free[i]
        size = full[of[k]]
        fastest = max(fastest, abs(v[k]) / size)
        bent = max(bent, abs(a[k]) / size)
    return max(least, fastest, math.sqrt(bent))


@kernel
def group_speed(groups, g, rate):
    """Velocity scale of group g: the largest met, or what its acceleration gives over its size.

    At least a small share of what the machine's ``rate`` (1/s) makes of its size.  States have their own scale.
    """
    if groups.kind[g] == kinds.GROUP_STATE:
        return max(groups.velocity[g], groups.full[g])
    size = groups.position[g]
    speed = max(groups.velocity[g], np.sqrt(size * groups.acceleration[g]))
    return max(speed, 1e-3 * size * rate)


@kernel
def vibrating_share(groups, k, modes, joints):
    """The share of coordinate k's own rates that is a vibration's: of modes, of joints; states relax and do not swing.

    Nor does what moves a contact that touches: that may let go in mid-swing.
    """
    g = groups.of[k]
    if groups.held.shape[0] > 0 and groups.held[k] > 0.0:
        return 0.0
    if groups.kind[g] == kinds.GROUP_STATE:
        return 0.0
    return modes if groups.kind[g] == kinds.GROUP_MODAL else joints


@kernel
def set_scales(state, groups, scratch, rate, limit):
    """Scales of Newton's corrections: sizes met so far, velocities over the machine's own time.

    No scale is below round-off of the machine's whole motion, for small modal coordinates are
    computed from differences of it.
    """
    for k in range(state.v.shape[0]):
        g = groups.of[k]
        least = groups.full[g] * ROUND_OFF / limit
        scratch.scale_x[k] = max(groups.position[g], least)
        scratch.scale_v[k] = max(group_speed(groups, g, rate), least * rate) + 1e-300


@kernel
def reaction_acceleration(response, reactions, j, first, last):
    """The acceleration of coordinate j that reactions (m,) cause in the machine without its loops.

    Of the rows from ``first`` to before ``last``, those of its block.

    Forces out of balance count by the acceleration that they would make of such masses, for the units of multipliers
    say nothing, and of rows that can hardly be told apart they are large without effect.  Where accelerations and
    reactions are corrected together, that is the acceleration's correction and what the reactions' corrections push.

    ``response``: (m, n) what a unit of each reaction pushes.
    """
    total = 0.0
    for r in range(first, last):
        total += response[r, j] * reactions[r]
    return total


@kernel
def own_rate(rate, before, machine_rate, h):
    """A coordinate's own rate (1/s) after a step h that shows ``rate``, ``before`` being that of the step before.

    It fades over half a period, for a vibration's curvature passes through zero within that; what shows no more after
    it has come to rest, as a relaxation does.  It rises no faster than a vibration sets in: what seems to be one within
    a single step is a jump, whose error drifts.
    """
    shown = min(rate, _ONSET * max(before, machine_rate))
    if shown >= before:
        return shown
    faded = math.exp(-_FADING * h * before) if h * before < _FADED else _FADE
    return max(shown, faded * before)


@kernel
def watch_pivot(state, pivot):
    """Make the stepper return where the smallest pivot of the kept rows has fallen much, if others may serve better.

    ``pivot``: the smallest of C B^-1 C^T, rows over the largest lengths that they had.
    """
    if state.counts[WATCH_ROWS] == 0:
        return
    if pivot < _PIVOT_FALL * state.numbers[LARGEST_PIVOT]:
        state.counts[RESELECT_ROWS] = PIVOT_FELL
        state.counts[MOST_STORED] = 0
    elif pivot > state.numbers[LARGEST_PIVOT]:
        state.numbers[LARGEST_PIVOT] = pivot


@kernel
def function_time(numbers, t):
    """The instant at which functions of time are evaluated for t: at a break at the step's end, just before it.

    Takes the numbers alone, for it is called at each stage and a whole state is some hundred words of arguments.
    """
    return min(t, numbers[LATEST])


@kernel
def _forget_past(groups, h):
    """Let go of velocities and accelerations that a group's motion, going on by a step h, meets no more.

    Stretch by stretch of its own radians, of which each knows the largest of its own and of the one before: a motion
    that comes round keeps its scales.  A start or a blow comes back no more, and would rule tolerances and the longest
    step for ever.  Accelerations count as long as they may still become velocities.
    """
    for g in range(groups.velocity.shape[0]):
        if groups.kind[g] == kinds.GROUP_STATE:
            continue
        groups.turned[g, 1] += h * groups.rate[g]
        if groups.turned[g, 1] > _LASTING_ACCELERATION:
            groups.turned[g, 0] += groups.turned[g, 1]
            groups.turned[g, 1] = 0.0
            groups.acceleration[g] = groups.newest[g, 1]
            groups.newest[g, 1] = 0.0
            if groups.turned[g, 0] > _LASTING_VELOCITY:
                groups.turned[g, 0] = 0.0
                groups.velocity[g] = groups.newest[g, 0]
                groups.newest[g, 0] = 0.0


@kernel
def store(plan, state, groups, record, h):
    """Advance TIME to STEP_END by the step h, whose end x, v, a, multipliers hold; write a row of the record."""
    for i in range(plan.tree.shape[0]):
        n, qx, qv = modes_of(plan.tree[i], plan.flex)
        for k in range(n):
            g = groups.of[qv + k]
            size = abs(state.x[qx + k])
            groups.position[g] = max(groups.position[g], size)
    if state.counts[FIXED_STEP] == 0:
        _forget_past(groups, h)
    for i in range(groups.softest.shape[0]):
        for c in range(2):
            groups.softest[i, c] = min(groups.softest[i, c], groups.stiffness[i, c])
    state.numbers[LASTING_BEFORE] = state.numbers[LASTING]
    state.numbers[LASTING] = state.numbers[LASTING_AT_END]
    state.numbers[TIME] = state.numbers[STEP_END]
    state.numbers[STEP_BEFORE] = h
    state.counts[STEPS] += 1
    if record.work.trial.shape[0] > 0:
        remember_step(plan, record.work, state.x, state.v, state.numbers[TIME])
    r = state.counts[STORED]
    record.t[r] = state.numbers[TIME]
    for k in range(state.x.shape[0]):
        record.x[r, k] = state.x[k]
    for k in range(state.v.shape[0]):
        record.v[r, k] = state.v[k]
        record.a[r, k] = state.a[k]
    for i in range(state.multipliers.shape[0]):
        record.multipliers[r, i] = state.multipliers[i]
    state.counts[STORED] = r + 1


@kernel
def error_ratio(free, state, groups, error_x, error_v, noise, h, rate):
    """Largest local error (nv,) of a step over what is tolerated: rtol per radian of the machine's motion.

    ``error_x`` is a tangent vector.  For methods that do not filter their errors of stiff modes.
    Every integrator means the same by rtol: sizes are 1 rad, the machine's extent, the largest
    deformation met; a step of h is given min(1, h rate) of it.

    ``noise``: (nv,) what rounding makes of ``error_v``, which no shorter step makes less; or without entries.
    """
    limit = state.numbers[TOLERANCE] * min(1.0, h * rate)
    largest = 0.0
    for j in range(free.shape[0]):
        k = free[j]
        g = groups.of[k]
        size = groups.position[g]
        least = ROUND_OFF * groups.full[g]
        blurred = noise[k] if noise.shape[0] > 0 else 0.0
        part = abs(error_v[k]) / max(limit * group_speed(groups, g, rate), least * rate, blurred)
        if groups.kind[g] != kinds.GROUP_STATE:
            part = max(part, abs(error_x[k]) / max(limit * size, least, h * blurred))
        if not part <= largest:
            largest = part
            state.counts[WORST] = k
    return largest
