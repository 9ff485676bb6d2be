"""Jumps of accelerations that nobody declared: how attempts tell them, and how a step passes one.

In a smooth motion accelerations change over a step in proportion to it.  Where they change as much in an attempt of a
sixteenth, they jump in it, and no step that contains the jump has an error in proportion to its length, as ``rtol``
asks: attempts become ever shorter.  But with da, how far accelerations at an attempt's instants are from those at its
start, h da is a bound of the error of velocities, and h^2 da / 2 of positions.  An attempt is taken where that is at
most a tenth of what is left of rtol, which is there once for each radian of the machine's motion.  So jumps add at most
rtol a radian, however many there are; what jumps endlessly, as dry friction at rest does, uses it up and ends the run.
Behind a jump the method begins anew.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel

_SHARE = 0.1  # of what is left of rtol that one jump may cost
_ROUND_OFF = 16.0 * sys.float_info.epsilon  # of a time: the length of the shortest step there
# Times shorter than an attempt in which accelerations changed as much: where a jump is looked for, and where it is one.
_SUSPICION, _EVIDENCE = 4.0, 16.0
_ENDLESS = 1e-3  # of rtol: less is left by seventy jumps without a thousandth of a radian of motion between them
_MUCH = 0.5  # of rtol
_CREEP = 0.02  # of what is left of rtol that one of the shortest steps costs


@kernel
def shortest_step(state):
    """The shortest step (s) to try: where a jump is looked for, as short as rounding of the time allows.

    Not where many have followed each other, which would not end.
    """
    number = state.numbers
    least = number[st.STEP_FLOOR_SIZE]
    ahead = state.counts[st.JUMP_AHEAD] == 1 and number[st.REJECTED_END] > number[st.TIME]
    if not ahead or number[st.JUMP_SPENT] > _MUCH:
        return least
    return min(least, _ROUND_OFF * max(abs(number[st.TIME]), abs(number[st.TIME_END])))


@kernel
def _changes(free, state, groups, begin, found, h):
    """Largest change (1/s) of accelerations from those at the start, relative to speeds; what it costs.

    The cost is the error that it bounds, relative to sizes and speeds.  Speeds are those met, or what the machine's
    size makes of the whole time: those that follow from accelerations are far larger where something hits hard.
    """
    change = 0.0
    cost = 0.0
    for j in range(free.shape[0]):
        k = free[j]
        g = groups.of[k]
        jump = abs(found[k] - begin[k])
        speed = max(groups.velocity[g], groups.full[g] * state.numbers[st.LEAST_RATE])
        if groups.kind[g] == kinds.GROUP_STATE:
            speed = max(speed, groups.full[g])
        change = max(change, jump / speed) if jump < np.inf else np.inf
        cost = max(cost, h * jump / speed)
        if groups.kind[g] != kinds.GROUP_STATE:
            cost = max(cost, 0.5 * h * h * jump / groups.position[g])
    return change, cost


@kernel
def _spent(number):
    """What jumps have cost of rtol, that of radians gone by left out."""
    return max(0.0, number[st.JUMP_SPENT] - number[st.RATE] * (number[st.TIME] - number[st.JUMP_LAST]))


@kernel
def count_shortest(state, h):
    """Let a step as short as the shortest cost a little, where jumps have cost much: these are below rounding then.

    DONE, or that jumps are endless.
    """
    number = state.numbers
    if number[st.JUMP_SPENT] < _MUCH or h > 2.0 * number[st.STEP_FLOOR_SIZE] or h < number[st.WHOLE_STEP]:
        return st.DONE
    spent = _spent(number)
    if spent < _MUCH:
        return st.DONE
    number[st.JUMP_SPENT] = spent + _CREEP * max(0.0, 1.0 - spent)
    number[st.JUMP_LAST] = number[st.TIME]
    return st.ENDLESS_JUMPS if number[st.JUMP_SPENT] > 1.0 - _ENDLESS else st.DONE


@kernel
def is_endless(state):
    """Whether jumps have used up what there is of rtol: the shortest step that fails then fails by them."""
    return 1.0 - _spent(state.numbers) < _ENDLESS


@deferred_kernel(FLAG)
def take_jump(free, state, groups, begin, found, gain, h):
    """Whether an attempt whose error is too large is taken, for accelerations jump within it; sets JUMPED then.

    Else notes what it shows, for the next attempts.

    ``begin``: (nv,) accelerations at its start; ``found``: (nv,) those of each coordinate that differ most from it at
    the attempt's instants; ``gain``: how many times that the method's weights sum up.
    """
    number = state.numbers
    count = state.counts
    if count[st.FIXED_STEP] == 1 or count[st.OUTCOME] != st.DONE:
        return False
    change, cost = _changes(free, state, groups, begin, found, h)
    if not (change > 0.0 and change < np.inf):
        return False
    t = number[st.TIME]
    known = number[st.REJECTED_STEP] > 0.0 and number[st.REJECTED_END] > t
    if not known:
        number[st.REJECTED_FIRST] = h
    number[st.REJECTED_END] = t + h
    step = number[st.REJECTED_STEP]
    before = number[st.REJECTED_CHANGE]
    # a longer attempt may have missed turns of a smooth motion
    if not known or h >= step or change > 2.0 * before or change < before * math.sqrt(h / step):
        number[st.REJECTED_STEP] = h
        number[st.REJECTED_CHANGE] = change
        count[st.JUMP_AHEAD] = 0
        return False
    if _SUSPICION * h > step:
        return False
    count[st.JUMP_AHEAD] = 1
    spent = _spent(number)
    allowed = max(0.0, 1.0 - spent)
    if allowed < _ENDLESS:  # steps are shortened as in a smooth motion, which round-off may hide; see is_endless
        return False
    if h > 2.0 * shortest_step(state):
        allowed *= _SHARE
    cost *= gain / number[st.TOLERANCE]
    if _EVIDENCE * h <= step and cost <= allowed:
        number[st.JUMP_SPENT] = spent + cost
        number[st.JUMP_LAST] = t
        count[st.JUMPED] = 1
        return True
    return False


@kernel
def put_widest(begin, found, out):
    """Write accelerations ``begin`` (nv,) with their largest changes in ``found`` (k, nv) added into ``out`` (nv,)."""
    for k in range(begin.shape[0]):
        most = 0.0
        for i in range(found.shape[0]):
            most = max(most, abs(found[i, k] - begin[k]))
        out[k] = begin[k] + most


@kernel
def sum_of_sizes(weights):
    """Of a method's weights: how many times a change of accelerations it may sum up."""
    total = 0.0
    for j in range(weights.shape[0]):
        total += abs(weights[j])
    return total


@kernel
def leave_jump(state):
    """Set the step behind a jump, where the method begins anew."""
    number = state.numbers
    count = state.counts
    count[st.JUMPS] += 1
    count[st.AT_BREAK] = 1
    count[st.JUMP_AHEAD] = 0
    number[st.STEP] = number[st.REJECTED_FIRST]
    number[st.REJECTED_STEP] = 0.0
