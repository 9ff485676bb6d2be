"""The step-size controller: length of each step, acceptance or rejection, and the record, for all methods.

A method is an attempt at a step.  Attempt and controller are inlined into a loop of the method's own, for passing all
arrays takes as long as half a small step:

    h = 0.0
    while True:
        h = next_step(plan, rule, knots, state, groups, record, h)
        if h == 0.0:
            return state.counts[st.OUTCOME]
        ...

An attempt takes h from TIME to STEP_END.  It leaves OUTCOME at DONE or writes what it failed by, and where it did not,
the step's error over what is tolerated, RATIO (0 with a fixed step).  Where that is at most one it has moved x, v, a,
the multipliers and the method's memory to the step's end; otherwise it leaves no trace in them.

The step's length follows from the error by one law: by its size, by its trend over two steps, with a dead zone for
methods to which each change costs a factorisation.  Sources: Gustafsson 1991, 1994; Hairer & Wanner 1996, section IV.8.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.integrate import state as st
from flexmbd.integrate.jumps import count_shortest, is_endless, leave_jump, shortest_step
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.compiling import kernel

FloatArray = NDArray[np.float64]

#: Ends of stretches that no step contains whole, where there are none.
NO_KNOTS: FloatArray = np.zeros(0)

_SLIVER = 1e-6  # of a step: a remainder that rounding of the time leaves, not a step
_EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Rule(ArrayStruct):
    """Constants of a method's step-size controller.

    exponent: of the step over the error.  proportional, integral: shares of it for the last error and for that before.
    trend: 1 for a predictive controller, by the error's trend over two steps (Gustafsson 1994), else 0.
    least_before: lower bound of the error of the step before.
    least, most: bounds of the factor from a step to the next.  failed: factor after a step that was not solved.
    worth, tight: dead zone; with a growth factor between them the step stays.  shrunk: the factor, at most, below it.
    hold: steps without growth after a rejection.
    longest: the longest step in characteristic times of the machine (PACE); room: its share where it rules.
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


#: The safety with which every method begins.
SAFETY = 0.9


class Stepper(NamedTuple):
    """A method bound to a machine.

    advance: steps until TIME_END (DONE), until as many rows are stored as there is room for (OUTPUT), or until a step
    fails that cannot be done without (its code); no step contains two of the given knots (k,) s and goes on.
    begin: sets up the memory of a method that begins here, from zeros.
    drop_factors: makes it forget its iteration matrix.
    memory: arrays by their names, all that the method remembers from step to step beside the state; they are copied,
    written to checkpoints and put back.
    refit: brings what the method keeps of masses and frames up to date after the plan's arrays got other ones; False
    where it cannot, so that a new stepper is needed.
    steps_a_radian: about how many steps the tolerance asks for in a radian of smooth motion; infinite where nothing but
    the motion makes steps shorter, or they are given.
    refuse_step: raises SceneError where the given step is beyond the method's stability; after ``begin``, at a start.
    fixed_errors: (N_ERRORS,) what the method estimates of the errors of given steps, see ``explicit/step_errors``.
    """

    advance: Callable[[st.Record, FloatArray], int]
    begin: Callable[[], None]
    drop_factors: Callable[[], None]
    memory: ArrayStruct
    refit: Callable[[], bool] = lambda: False
    steps_a_radian: float = np.inf
    refuse_step: Callable[[], None] = lambda: None
    fixed_errors: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class NoMemory(ArrayStruct):
    """Of a method that remembers nothing from step to step."""


def arrays_of(memory: ArrayStruct) -> dict[str, NDArray[Any]]:
    """The arrays themselves of a method's memory, and of the structures in it, by their names."""
    found: dict[str, NDArray[Any]] = {}
    for name, part in memory.fields().items():
        if isinstance(part, ArrayStruct):
            found |= {f"{name}.{inner}": array for inner, array in arrays_of(part).items()}
        else:
            found[name] = part
    return found


def no_factors() -> None:
    """``Stepper.drop_factors`` of an explicit method, which keeps no factors."""


def make_advance(
    loop: Any, method: ArrayStruct, rule: Rule, state: st.State, groups: st.Groups
) -> Callable[[st.Record, FloatArray], int]:
    """A stepper's ``advance`` by a method's compiled loop; ``method``: what its attempts work with."""
    for part in (method, rule, state, groups):
        part.lay_out()  # once a run, and not within its first step

    def drive_to(record: st.Record, knots: FloatArray) -> int:
        return int(loop(method, rule, knots, state, groups, record))

    return drive_to


@kernel
def settle(plan, state, solved):
    """Write the OUTCOME of an attempt whose equations were ``solved`` or not; whether its error is to be judged."""
    count = state.counts
    if plan.flag[0] != 0:
        count[st.OUTCOME] = st.CALLBACK_FAILED
        return False
    if solved:
        count[st.OUTCOME] = st.DONE  # whatever failed on the way
    elif count[st.OUTCOME] == st.DONE:
        count[st.OUTCOME] = st.NOT_CONVERGED
    return solved


@kernel
def propose_step(rule, knots, state, groups):
    """The length (s) of the step to try; writes STEP_END, WHOLE_STEP and RATE."""
    number = state.numbers
    count = state.counts
    t = number[st.TIME]
    i = count[st.KNOT]
    while i < knots.shape[0] and knots[i] <= t:
        i += 1
    passed = i > count[st.KNOT]
    count[st.KNOT] = i
    begins = i > 0 and knots[i - 1] == t
    if passed:  # accelerations of a pulse of data are not the machine's rate
        for g in range(groups.acceleration.shape[0]):
            groups.acceleration[g] = 0.0
            groups.newest[g, 1] = 0.0
    rate = st.machine_rate(state, groups)
    number[st.RATE] = rate
    fixed = count[st.FIXED_STEP] == 1
    if not fixed:
        number[st.STEP] = min(number[st.STEP], number[st.STEP_CEILING], number[st.STABLE_STEP])
        if number[st.STEP] * number[st.PACE] > rule.longest:
            number[st.STEP] = rule.room * rule.longest / number[st.PACE]
        if not number[st.STEP] >= number[st.STEP_FLOOR_SIZE]:  # a rate beyond all steps: the shortest one, which fails
            least = shortest_step(state)
            if not number[st.STEP] >= least:
                number[st.STEP] = least
    h = number[st.STEP]
    if number[st.STEP_REMAINDER] > 0.0:
        h = number[st.STEP_REMAINDER]
        if number[st.STEP_PART] > 0.0:
            h = min(h, number[st.STEP_PART])
    number[st.WHOLE_STEP] = h
    left = number[st.TIME_END] - t
    if left <= h * (1.0 + _SLIVER):
        # rounding of sums of h is not another step: what is stepped on and what is stepped at once are the same
        if not fixed or abs(left - h) > _EPSILON * (count[st.STEPS] + 1) * max(abs(t), abs(number[st.TIME_END])):
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


@kernel
def _step_ratio(rule, number, count, h, ratio):
    """Factor from h to the next step after one whose error is ``ratio``."""
    size = max(ratio, 1e-10)
    before = max(number[st.RATIO_BEFORE], rule.least_before)
    growth = number[st.SAFETY] * size ** (-rule.exponent * rule.proportional)
    if rule.integral > 0.0:
        growth *= before ** (rule.exponent * rule.integral)
    accepted = number[st.STEP_ACCEPTED]
    if rule.trend > 0.0 and accepted > 0.0 and count[st.NO_GROWTH] == 0:
        growth = min(growth, number[st.SAFETY] * h / accepted * (before / (size * size)) ** rule.exponent)
    return min(rule.most, max(rule.least, growth))


@kernel
def _after_acceptance(rule, state, h):
    """Set the length of the step after an accepted one of h."""
    number = state.numbers
    count = state.counts
    if count[st.FIXED_STEP] == 1:
        if number[st.STEP_REMAINDER] > 0.0:
            number[st.STEP_REMAINDER] -= h
        elif h < number[st.WHOLE_STEP] * (1.0 - _SLIVER):
            if number[st.LATEST] < np.inf or number[st.TIME] < number[st.TIME_END]:
                # from a break or a knot back to where equal steps would lead
                number[st.STEP_REMAINDER] = number[st.WHOLE_STEP] - h
        if number[st.STEP_REMAINDER] <= _SLIVER * number[st.STEP]:
            number[st.STEP_REMAINDER] = 0.0
            number[st.STEP_PART] = 0.0
        return
    ratio = number[st.ERROR_RATIO]
    growth = _step_ratio(rule, number, count, h, ratio)
    if count[st.JUMPED] == 1:
        leave_jump(state)
    elif h < number[st.WHOLE_STEP]:
        number[st.STEP] = number[st.WHOLE_STEP]  # it was cut short by its end alone
    elif growth > rule.worth and count[st.NO_GROWTH] == 0:
        number[st.STEP] = min(number[st.STEP_CEILING], h * growth)
    elif growth > rule.tight:
        number[st.STEP] = h
    else:
        number[st.STEP] = h * min(growth, rule.shrunk)
    if count[st.JUMP_AHEAD] == 1 and number[st.REJECTED_END] > number[st.TIME]:
        number[st.STEP] = min(number[st.STEP], number[st.REJECTED_END] - number[st.TIME])
    number[st.RATIO_BEFORE] = max(ratio, rule.least_before)
    number[st.STEP_ACCEPTED] = h
    count[st.NO_GROWTH] = max(0, count[st.NO_GROWTH] - 1)


@kernel
def _after_rejection(rule, state, h):
    """Set the shorter step to try after a rejected one of h; a failure's code where h is the shortest."""
    number = state.numbers
    count = state.counts
    count[st.REJECTED] += 1
    ratio = number[st.ERROR_RATIO]
    solved = count[st.OUTCOME] == st.DONE
    why = count[st.OUTCOME]
    if solved:
        why = st.INACCURATE if np.isfinite(ratio) else st.NOT_FINITE
    if count[st.FIXED_STEP] == 1:
        if h <= rule.shortest * number[st.STEP] or why == st.INTERIOR_FAILED:
            return why
        number[st.STEP_REMAINDER] = max(number[st.STEP_REMAINDER], h)
        number[st.STEP_PART] = 0.5 * h
        return st.DONE
    if h <= number[st.STEP_FLOOR_SIZE] and h <= shortest_step(state):
        return st.ENDLESS_JUMPS if solved and is_endless(state) else why
    count[st.JUMPED] = 0
    count[st.NO_GROWTH] = rule.hold
    shrink = rule.failed
    if solved:
        shrink = max(rule.least, number[st.SAFETY] * ratio**-rule.exponent) if np.isfinite(ratio) else rule.least
    number[st.STEP] = h * shrink
    return st.DONE


@kernel
def accept_or_reject(plan, rule, state, groups, record, h):
    """Accept the attempt at h and store its end, or set a shorter step; DONE to go on, else the code to stop with."""
    outcome = state.counts[st.OUTCOME]
    if outcome == st.CALLBACK_FAILED:
        return outcome
    if outcome == st.DONE and state.numbers[st.ERROR_RATIO] <= 1.0:
        st.store(plan, state, groups, record, h)
        _after_acceptance(rule, state, h)
        return count_shortest(state, h) if state.numbers[st.JUMP_SPENT] > 0.0 else st.DONE
    return _after_rejection(rule, state, h)


@kernel
def next_step(plan, rule, knots, state, groups, record, h):
    """Accept or reject the attempt at h (0: none yet); the length of the step to try, 0 where to return OUTCOME."""
    count = state.counts
    code = st.DONE
    if h > 0.0:
        code = accept_or_reject(plan, rule, state, groups, record, h)
    if count[st.FIXED_STEP] == 0:
        state.numbers[st.STEP] = min(state.numbers[st.STEP], plan.horizon[0])
    plan.horizon[0] = np.inf
    count[st.OUTCOME] = code
    if code != st.DONE or state.numbers[st.TIME] >= state.numbers[st.TIME_END] or count[st.AT_BREAK] == 1:
        return 0.0
    if count[st.STORED] >= min(record.t.shape[0], count[st.MOST_STORED]):
        count[st.OUTCOME] = st.OUTPUT
        return 0.0
    return propose_step(rule, knots, state, groups)
