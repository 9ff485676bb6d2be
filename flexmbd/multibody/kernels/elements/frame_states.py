"""A law between two frames with states of its own: a user's f(t, data, z, u, d, R, rate, spin, out), or contact.

It gives the wrench on G and the rates of its states z, by these, by functions of time and signals u, and by the motion
of G against F.  Each state is the velocity of a link of its own, of unit inertia and without mass
(``Numbering.add_states``), divided by the state's scale; its rate is a torque on that link.  So every integrator solves
it, controls its error and finds it in its tangent.

Its numbers: how many states n and signals m; the row of ``Plan.tree`` of the first state's link; the scales (n); the
rows of ``Plan.times`` of the signals (m); how many numbers the law has, and these.  The function behind the address:
``user_functions.frame_states_function``.  Address 0 is contact (``contact_wrench``).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    exp_rotation,
    load3,
    scale3,
    store3,
    store9,
    sub3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_state
from flexmbd.multibody.kernels.elements.contact_wrench import (
    HEAD,
    contact_by_way,
    is_contact,
    law_numbers,
    state_value,
)
from flexmbd.multibody.kernels.elements.differences import difference_step
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness

_MOTION = 19  # how many states, d, R, rate, spin; then the states and the signals
_WRENCH = 6


def frame_states_scratch(n: int, m: int) -> int:
    """How many numbers of ``work.generalized`` a law of n states and m signals needs: what is given, two answers."""
    return _MOTION + n + m + 2 * (_WRENCH + n)


@kernel
def _sizes(plan, row):
    """How many states and signals; where the law's own numbers begin; where ``work.generalized`` has the answer."""
    o = row[at.EL_DATA]
    n, m = int(plan.data[o]), int(plan.data[o + 1])
    return n, m, law_numbers(plan, row), 0 if is_contact(row) else _MOTION + n + m


@kernel
def _ask(plan, work, row, motion, moved, along):
    """Write wrench and rates into ``work.generalized``; state ``moved`` is so much farther along.

    NaN and ``plan.flag`` where they are not finite; where the motion itself is not nobody is called.
    """
    n, m, numbers, answer = _sizes(plan, row)
    d, R, rate, spin = motion
    given = work.generalized[:answer]
    given[0] = n
    store3(given, 1, d)
    store9(given, 4, R)
    store3(given, 13, rate)
    store3(given, 16, spin)
    for i in range(n):
        given[_MOTION + i] = state_value(plan, work, row, i)
    if moved >= 0:
        given[_MOTION + moved] += along
    for j in range(m):
        given[_MOTION + n + j] = work.time[int(plan.data[row[at.EL_DATA] + HEAD + n + j]), 0]
    out = work.generalized[answer : answer + _WRENCH + n]
    total = 0.0
    for k in range(answer):
        total += given[k]
    for k in range(out.shape[0]):
        out[k] = math.nan
    if plan.flag[0] != 0 or not math.isfinite(total):
        return answer
    data = plan.data[numbers : numbers + int(plan.data[numbers - 1])]
    call_state(row[at.EL_ADDRESS], work.time[plan.times.shape[0], 0], data, given, out)
    total = 0.0
    for k in range(out.shape[0]):
        total += out[k]
    if plan.flag[0] == 0 and not math.isfinite(total):
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    return answer


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    answer = _ask(plan, work, row, (d, R, rate, spin), -1, 0.0)
    return load3(work.generalized, answer), load3(work.generalized, answer + 3)


@kernel
def _keep(work, size, answer, over):
    """Put the difference of the answer that was set aside and that at ``answer``, times ``over``, in its place."""
    out = work.generalized
    for k in range(answer, answer + size):
        out[k] = over * (out[k + size] - out[k])
    return load3(out, answer), load3(out, answer + 3)


@kernel
def _set_aside(work, size, answer):
    """Keep the answer while the law is asked again."""
    for k in range(answer, answer + size):
        work.generalized[k + size] = work.generalized[k]


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    n, _, _, answer = _sizes(plan, row)
    size = _WRENCH + n
    if step == 0.0:
        for k in range(answer, answer + size):
            work.generalized[k] = 0.0
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    turn, back = exp_rotation(scale3(step, dtheta)), exp_rotation(scale3(-step, dtheta))
    su, sw, sd = scale3(step, drate), scale3(step, dspin), scale3(step, dd)
    _ask(plan, work, row, (add3(d, sd), compose(turn, R), add3(rate, su), add3(spin, sw)), -1, 0.0)
    _set_aside(work, size, answer)
    _ask(plan, work, row, (sub3(d, sd), compose(back, R), sub3(rate, su), sub3(spin, sw)), -1, 0.0)
    return _keep(work, size, answer, 0.5 / step)


@kernel
def wrench_by_state(plan, work, row, d, R, rate, spin, i, size_v):
    """Change of force and torque by the velocity of state i's link, whose size is given; rates: `put_rates`."""
    if is_contact(row):
        return contact_by_way(plan, work, row, d, R, rate, spin, i)
    n, _, _, answer = _sizes(plan, row)
    o = row[at.EL_DATA]
    scale = plan.data[o + HEAD + i]
    velocity = work.body[int(plan.data[o + 2]) + i, at.B_W + 2]
    step = difference_step(0.0, 1.0, 1.0, max(size_v, abs(velocity), 1.0))
    _ask(plan, work, row, (d, R, rate, spin), i, scale * step)
    _set_aside(work, _WRENCH + n, answer)
    _ask(plan, work, row, (d, R, rate, spin), i, -scale * step)
    return _keep(work, _WRENCH + n, answer, 0.5 / step)


@kernel
def load_states(plan, work, row):
    """Subtract the rates that the law gave last from the torques that the states' links require."""
    n, _, _, answer = _sizes(plan, row)
    o = row[at.EL_DATA]
    for i in range(n):
        rate = work.generalized[answer + _WRENCH + i]
        work.body[int(plan.data[o + 2]) + i, at.B_T + 2] -= rate / plan.data[o + HEAD + i]


@kernel
def put_rates(plan, work, row, column, factor, rates):
    """Store in a column what the rates that were found last subtract, times ``factor``, on states' links."""
    n, _, _, answer = _sizes(plan, row)
    o = row[at.EL_DATA]
    for i in range(n):
        change = work.generalized[answer + _WRENCH + i]
        rates[i, column] = -factor * change / plan.data[o + HEAD + i]


FRAME_STATES = FrameElement(
    Behaviour("forces with states, which may be stiff", Stiffness.UNSEEN, calls_user=True), _wrench, _variation
)
