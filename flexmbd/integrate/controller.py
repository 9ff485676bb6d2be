"""The controller of steps: how long each is, what becomes of it, and what is stored, whatever the method.

A method is an attempt at a step, in the text of a loop of its own, as the controller is, for to hand over all arrays
takes as long as half a small step:

    h = 0.0
    while True:
        h = next_step(plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        ...

An attempt takes h from TIME to STEP_END.  It leaves OUTCOME at DONE or writes what it failed by, and where it did not,
the step's error over what is tolerated, RATIO (0 with a fixed step).  Where that is at most one it has moved x, v, a,
the multipliers and its memory to the step's end; otherwise it leaves no trace in them.

The step's length follows from the error by one law: by its size, by its trend over two steps, with a dead zone for
methods to which each change costs a factorisation.  Sources: Gustafsson 1991, 1994; Hairer & Wanner 1996, section IV.8.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.compiling import part_of_kernel

FloatArray = NDArray[np.float64]

#: Ends of stretches that no step contains whole, where there are none.
NO_KNOTS: FloatArray = np.zeros(0)

_SLIVER = 1e-6  # of a step: what rounding of the time leaves, no step of its own


class Rule(NamedTuple):
    """How a method's steps follow from its errors.

    exponent: of the step over the error.  proportional, integral: shares of it for the last error and for that before.
    trend: 1 where the error's trend over two steps foretells the next, else 0.  least_before: the smallest error of
    the step before that counts.
    least, most: a step's size over that of the step before.  failed: what is left of a step without an end.
    worth: growth that is worth a change.  tight: growth below which the step had better shrink, for its safety is
    spent; shrunk: by that then, or by more.  hold: steps without growth after a rejection.
    longest: the longest step in characteristic times of the machine; room: its share that is taken where it rules.
    shortest: part of a fixed step that may be tried in its place.
    """

    exponent: float
    proportional: float = 1.0
    integral: float = 0.0
    trend: float = 0.0
    least_before: float = 1e-4
    least: float = 0.2
    most: float = 2.0
    failed: float = 0.25
    worth: float = 1.25
    tight: float = 0.95
    shrunk: float = 0.85
    hold: int = 7
    longest: float = 0.5
    room: float = 1.0
    shortest: float = 1.0


#: The safety of a method that has no reason for another one.
SAFETY = 0.9


class Stepper(NamedTuple):
    """A method at work on a machine.

    advance: steps until TIME_END (DONE), until as many rows are stored as there is room for (OUTPUT), or until a step
    fails that cannot be done without (its code); no step contains two of the given knots (k,) s and goes on.
    begin: sets up the method's part of a state that begins here.
    drop_factors: makes it forget its iteration matrix.
    """

    advance: Callable[[st.Record, FloatArray], int]
    begin: Callable[[], None]
    drop_factors: Callable[[], None]


def no_factors() -> None:
    """What an explicit method drops: it keeps no factors from step to step."""


def driver(
    loop: Any, method: Any, rule: Rule, state: st.State, groups: st.Groups
) -> Callable[[st.Record, FloatArray], int]:
    """A stepper's ``advance`` by a method's compiled loop; ``method``: a named tuple of what its attempts work with."""

    def drive_to(record: st.Record, knots: FloatArray) -> int:
        return int(loop(method, rule, knots, state, groups, record))

    return drive_to


@part_of_kernel
def set_out(rule, knots, state, groups):
    """The step to try; writes its end, WHOLE and RATE."""
    number = state.numbers
    count = state.counts
    t = number[st.TIME]
    i = count[st.KNOT]
    while i < knots.shape[0] and knots[i] <= t:
        i += 1
    count[st.KNOT] = i
    begins = i > 0 and knots[i - 1] == t
    if begins:  # what a pulse of data made of it is no rate of the machine
        for g in range(groups.acceleration.shape[0]):
            groups.acceleration[g] = 0.0
    rate = st.machine_rate(state, groups)
    number[st.RATE] = rate
    fixed = count[st.FIXED_STEP] == 1
    if not fixed:
        number[st.STEP] = min(number[st.STEP], number[st.STEP_CEILING])
        if number[st.STEP] * rate > rule.longest:
            number[st.STEP] = rule.room * rule.longest / rate
    h = number[st.STEP]
    if number[st.REST] > 0.0:
        h = number[st.REST]
        if number[st.PART] > 0.0:
            h = min(h, number[st.PART])
    number[st.WHOLE] = h
    left = number[st.TIME_END] - t
    if left <= h * (1.0 + _SLIVER):
        h = left
        number[st.STEP_END] = number[st.TIME_END]
    else:
        if left < 2.0 * h and not fixed:
            h = 0.5 * left
        number[st.STEP_END] = t + h
    end = number[st.STEP_END]
    if i < knots.shape[0] and knots[i] < end:
        if begins or (i + 1 < knots.shape[0] and knots[i + 1] <= end):  # there is a whole stretch in it
            h = knots[i] - t
            number[st.STEP_END] = knots[i]
    return h


@part_of_kernel
def _growth(rule, number, count, h, ratio):
    """Factor from h to the next step after one whose error is ``ratio``."""
    size = max(ratio, 1e-10)
    before = max(number[st.RATIO_BEFORE], rule.least_before)
    growth = number[st.SAFETY] * size ** (-rule.exponent * rule.proportional)
    if rule.integral > 0.0:
        growth *= before ** (rule.exponent * rule.integral)
    accepted = number[st.STEP_ACCEPTED]
    if rule.trend > 0.0 and accepted > 0.0 and count[st.HOLD] == 0:
        growth = min(growth, number[st.SAFETY] * h / accepted * (before / (size * size)) ** rule.exponent)
    return min(rule.most, max(rule.least, growth))


@part_of_kernel
def _go_on(rule, state, h):
    """Set the step that follows one of h that was taken."""
    number = state.numbers
    count = state.counts
    if count[st.FIXED_STEP] == 1:
        if number[st.REST] > 0.0:
            number[st.REST] -= h
        elif h < number[st.WHOLE] * (1.0 - _SLIVER):
            if number[st.LATEST] < np.inf or number[st.TIME] < number[st.TIME_END]:
                number[st.REST] = number[st.WHOLE] - h  # from a break or a knot back to where equal steps would lead
        if number[st.REST] <= _SLIVER * number[st.STEP]:
            number[st.REST] = 0.0
            number[st.PART] = 0.0
        return
    ratio = number[st.RATIO]
    growth = _growth(rule, number, count, h, ratio)
    if h < number[st.WHOLE]:
        number[st.STEP] = number[st.WHOLE]  # it was cut short by its end alone
    elif growth > rule.worth and count[st.HOLD] == 0:
        number[st.STEP] = min(number[st.STEP_CEILING], h * growth)
    elif growth > rule.tight:
        number[st.STEP] = h
    else:
        number[st.STEP] = h * min(growth, rule.shrunk)
    number[st.RATIO_BEFORE] = max(ratio, rule.least_before)
    number[st.STEP_ACCEPTED] = h
    count[st.HOLD] = max(0, count[st.HOLD] - 1)


@part_of_kernel
def _try_again(rule, state, h):
    """Set the step to try instead of h, which failed; a code where there is none."""
    number = state.numbers
    count = state.counts
    count[st.REJECTED] += 1
    ratio = number[st.RATIO]
    solved = count[st.OUTCOME] == st.DONE
    why = count[st.OUTCOME]
    if solved:
        why = st.INACCURATE if np.isfinite(ratio) else st.NOT_FINITE
    if count[st.FIXED_STEP] == 1:
        if h <= rule.shortest * number[st.STEP]:
            return why
        number[st.REST] = max(number[st.REST], h)
        number[st.PART] = 0.5 * h
        return st.DONE
    if h <= number[st.STEP_FLOOR_SIZE]:
        return why
    count[st.HOLD] = rule.hold
    shrink = rule.failed
    if solved:
        shrink = max(rule.least, number[st.SAFETY] * ratio**-rule.exponent) if np.isfinite(ratio) else rule.least
    number[st.STEP] = h * shrink
    return st.DONE


@part_of_kernel
def settle(plan, rule, state, groups, record, h):
    """Judge the attempt at h: store its end or set another step; DONE to go on, else the code to stop with."""
    outcome = state.counts[st.OUTCOME]
    if outcome == st.CALLBACK_FAILED:
        return outcome
    if outcome == st.DONE and state.numbers[st.RATIO] <= 1.0:
        st.store(plan, state, groups, record, h)
        _go_on(rule, state, h)
        return st.DONE
    return _try_again(rule, state, h)


@part_of_kernel
def next_step(plan, rule, knots, state, groups, record, h):
    """Judge the attempt at h (0: none yet) and set out on the step to try; 0 where to return OUTCOME."""
    count = state.counts
    code = st.DONE
    if h > 0.0:
        code = settle(plan, rule, state, groups, record, h)
    count[st.OUTCOME] = code
    if code != st.DONE or state.numbers[st.TIME] >= state.numbers[st.TIME_END]:
        return 0.0
    if count[st.STORED] >= min(record.t.shape[0], count[st.ROOM]):
        count[st.OUTCOME] = st.OUTPUT
        return 0.0
    return set_out(rule, knots, state, groups)
