"""State equations of a user, z' = f(t, z, u) with outputs g(t, z, u), that are solved with the machine.

Each state is the velocity of a link of its own, of unit inertia and without mass (``Numbering.add_states``), divided by
the state's scale: its acceleration is the rate f.  So every integrator solves it, controls its error and finds it in
its tangent.  The outputs are put where loads read their functions of time: those on joints' coordinates do so after all
elements have been asked (``inverse_dynamics.residual``), those on frames and on modes before (``put_outputs``).

Its numbers: how many states, quantities and outputs; whether the function takes x and v of the whole machine in place
of z and u; how many loads there are, whether any is on frames, and how many are on modes; the scales; of each quantity
its kind, its place and the velocity that goes with it; of each load its output and its row of ``Plan.times``; of each
load on modes its output, the first velocity, how many, where their forces begin in ``Plan.data``, and the place in x
that ``modal_force`` has.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_state
from flexmbd.multibody.kernels.elements.differences import difference_step, put_moved_state
from flexmbd.multibody.kernels.elements.element import Behaviour, GeneralisedForce, Stiffness
from flexmbd.multibody.kernels.elements.modal_force import modal_force
from flexmbd.multibody.kernels.elements.user_law import address_at_side

# Kinds of quantities: a coordinate, its rate, a function of time, a weighted sum of the coordinates of a body's modes
# or of their rates, whose place is that of its numbers: how many, 0 or 1 for rates, the first in x and in v, whether
# there is a matrix, how many functions of time, weights w, matrix G, of each of these functions f its row of
# ``Plan.times`` and a factor c. The sum is w . q + q . G q / 2 + c . f.
OF_POSITION, OF_VELOCITY, OF_TIME, OF_MODES = range(4)
_STATES, _QUANTITIES, _OUTPUTS, _WHOLE, _LOADS, ON_FRAMES, ON_MODES, N_HEAD = range(8)
_SUM_COUNT, _SUM_ORDER, _SUM_X, _SUM_V, _SUM_HAS_MATRIX, _SUM_TIMES, _SUM_WEIGHTS = range(7)


@kernel
def _sizes(plan, row):
    """How many states, quantities, outputs and loads; where scales, quantities and loads begin in ``Plan.data``."""
    o = row[at.EL_DATA]
    n, m, k = int(plan.data[o + _STATES]), int(plan.data[o + _QUANTITIES]), int(plan.data[o + _OUTPUTS])
    scales = o + N_HEAD
    return n, m, k, int(plan.data[o + _LOADS]), scales, scales + n, scales + n + 3 * m


@kernel
def _product(plan, o, i, values, first):
    """(G values)_i of a sum's matrix; 0 where it has none."""
    n = int(plan.data[o + _SUM_COUNT])
    total = 0.0
    if plan.data[o + _SUM_HAS_MATRIX] != 0.0:
        for k in range(n):
            total += plan.data[o + _SUM_WEIGHTS + n * (1 + i) + k] * values[first + k]
    return total


@kernel
def _sum_of_modes(plan, work, o, x, v):
    """w . q + q . G q / 2 + c . f of modal coordinates, or the rate of the first two."""
    total = 0.0
    n = int(plan.data[o + _SUM_COUNT])
    t = o + _SUM_WEIGHTS + n + (n * n if plan.data[o + _SUM_HAS_MATRIX] != 0.0 else 0)
    for i in range(int(plan.data[o + _SUM_TIMES])):
        total += plan.data[t + 2 * i + 1] * work.time[int(plan.data[t + 2 * i]), 0]
    first_x, first_v = int(plan.data[o + _SUM_X]), int(plan.data[o + _SUM_V])
    for i in range(int(plan.data[o + _SUM_COUNT])):
        turned = _product(plan, o, i, x, first_x)
        if plan.data[o + _SUM_ORDER] != 0.0:
            total += (plan.data[o + _SUM_WEIGHTS + i] + turned) * v[first_v + i]
        else:
            total += (plan.data[o + _SUM_WEIGHTS + i] + 0.5 * turned) * x[first_x + i]
    return total


@kernel
def _fill(plan, work, row, x, v):
    """Write the states and the quantities that they follow into ``work.generalized``."""
    n, m, _, _, scales, quantities, _ = _sizes(plan, row)
    for i in range(n):
        work.generalized[i] = plan.data[scales + i] * v[row[at.EL_V] + i]
    for j in range(m):
        o = quantities + 3 * j
        place = int(plan.data[o + 1])
        if plan.data[o] == OF_POSITION:
            work.generalized[n + j] = x[place]
        elif plan.data[o] == OF_VELOCITY:
            work.generalized[n + j] = v[place]
        elif plan.data[o] == OF_MODES:
            work.generalized[n + j] = _sum_of_modes(plan, work, place, x, v)
        else:
            work.generalized[n + j] = work.time[place, 0]


@kernel
def _call(plan, work, row, x, v):
    """Write rates (n,) and outputs (k,) into ``work.generalized``, behind what they follow; where they begin there.

    NaN and ``plan.flag`` where they are not finite.  Where the machine's state itself is not nobody is called.
    """
    n, m, k, _, _, _, _ = _sizes(plan, row)
    out = work.generalized[n + m : n + m + n + k]
    total = 0.0
    for i in range(v.shape[0]):
        total += abs(v[i])
    for i in range(x.shape[0]):
        total += abs(x[i])
    for i in range(out.shape[0]):
        out[i] = math.nan
    if plan.flag[0] != 0 or not math.isfinite(total):
        return n + m
    t = work.time[plan.times.shape[0], 0]
    if plan.data[row[at.EL_DATA] + _WHOLE] != 0.0:
        call_state(address_at_side(row, x), t, x, v, out)
    else:
        call_state(address_at_side(row, x), t, work.generalized[:n], work.generalized[n : n + m], out)
    total = 0.0
    for i in range(out.shape[0]):
        total += abs(out[i])
    if plan.flag[0] == 0 and not math.isfinite(total):
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    return n + m


@kernel
def _subtract(plan, work, row, x, v, out):
    """Subtract the rates as forces on the states' links; put the outputs among the functions of time."""
    n, _, _, loads, scales, _, places = _sizes(plan, row)
    _fill(plan, work, row, x, v)
    found = _call(plan, work, row, x, v)
    for i in range(n):
        out[row[at.EL_V] + i] -= work.generalized[found + i] / plan.data[scales + i]
    _put(plan, work, found + n, loads, places)


@kernel
def _put(plan, work, outputs, loads, places):
    """Put the outputs, which begin there in ``work.generalized``, among the functions of time."""
    for j in range(loads):
        output = outputs + int(plan.data[places + 2 * j])
        work.time[int(plan.data[places + 2 * j + 1]), 0] = work.generalized[output]


@kernel
def put_outputs(plan, work, row, x, v, loads_there):
    """Put the outputs among the functions of time, if loads of a kind read them, ON_FRAMES or ON_MODES."""
    if plan.data[row[at.EL_DATA] + loads_there] == 0.0:
        return
    n, _, _, loads, _, _, places = _sizes(plan, row)
    _fill(plan, work, row, x, v)
    _put(plan, work, _call(plan, work, row, x, v) + n, loads, places)


@kernel
def _add_change(plan, work, tw, row, x, found, column, factor, matrix):
    """Subtract ``factor`` times rates and outputs from a column of the matrix, in the rows that they act on."""
    n, _, _, loads, scales, _, places = _sizes(plan, row)
    for i in range(n):
        matrix[row[at.EL_V] + i, column] -= factor * work.generalized[found + i] / plan.data[scales + i]
    for j in range(loads):
        time = int(plan.data[places + 2 * j + 1])
        change = factor * work.generalized[found + n + int(plan.data[places + 2 * j])]
        for i in range(plan.forces.shape[0]):
            if plan.forces[i, at.FORCE_TIME] == time:
                matrix[plan.forces[i, at.FORCE_V], column] -= change
        for i in range(tw.frame_loads.shape[0]):
            if tw.frame_load_times[i] == time:
                for r in range(matrix.shape[0]):
                    matrix[r, column] -= change * tw.frame_loads[i, r]
    o = places + 2 * loads
    for _ in range(int(plan.data[row[at.EL_DATA] + ON_MODES])):
        change = factor * work.generalized[found + n + int(plan.data[o])]
        first, count = int(plan.data[o + 1]), int(plan.data[o + 2])
        for r in range(count):
            force = modal_force(plan, int(plan.data[o + 3]), int(plan.data[o + 4]), count, x, r)
            matrix[first + r, column] -= change * force
        o += 5


@kernel
def _subtract_sum_tangent(plan, work, tw, row, x, v, i, per_x, per_v, matrix):
    """Derivatives by the modes and their rates of which quantity i is a sum."""
    n, _, _, _, _, quantities, _ = _sizes(plan, row)
    o = int(plan.data[quantities + 3 * (i - n) + 1])
    count, first_x, first = int(plan.data[o + _SUM_COUNT]), int(plan.data[o + _SUM_X]), int(plan.data[o + _SUM_V])
    rates = plan.data[o + _SUM_ORDER] != 0.0
    size = 0.0
    for j in range(count):
        slope = plan.data[o + _SUM_WEIGHTS + j] + _product(plan, o, j, x, first_x)
        of_mode = max(tw.size_v[first + j], abs(v[first + j])) if rates else tw.size_x[first + j]
        size += abs(slope) * of_mode
    if size == 0.0:
        return
    step = difference_step(1.0, 0.0, size, 1.0)
    for sign in (-1.0, 1.0):
        _fill(plan, work, row, x, v)
        work.generalized[i] += sign * step
        found = _call(plan, work, row, x, v)
        for j in range(count):
            slope = plan.data[o + _SUM_WEIGHTS + j] + _product(plan, o, j, x, first_x)
            weight = per_v * slope + per_x * _product(plan, o, j, v, first) if rates else per_x * slope
            _add_change(plan, work, tw, row, x, found, first + j, sign * weight / (2.0 * step), matrix)


@kernel
def _subtract_own_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    """Derivatives by the states and the quantities that they follow, by central differences."""
    n, m, _, _, scales, quantities, _ = _sizes(plan, row)
    for i in range(n + m):
        column = row[at.EL_V] + i
        per, size = per_v, 0.0
        unit = 1.0  # of the column's velocity or coordinate
        if i < n:
            unit = plan.data[scales + i]
            size = unit * max(1.0, abs(v[column]))
        else:
            o = quantities + 3 * (i - n)
            kind = plan.data[o]
            column = int(plan.data[o + 2])
            if kind == OF_TIME:
                continue
            if kind == OF_MODES:
                _subtract_sum_tangent(plan, work, tw, row, x, v, i, per_x, per_v, matrix)
                continue
            if kind == OF_POSITION:
                per, size = per_x, tw.size_x[column]
            else:
                size = max(tw.size_v[column], abs(v[column]))
        if per == 0.0:
            continue
        step = difference_step(1.0, 0.0, size, 1.0)
        for sign in (-1.0, 1.0):
            _fill(plan, work, row, x, v)
            work.generalized[i] += sign * step
            found = _call(plan, work, row, x, v)
            _add_change(plan, work, tw, row, x, found, column, sign * per * unit / (2.0 * step), matrix)


@kernel
def _subtract_whole_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    """Derivatives by all coordinates and velocities, by central differences."""
    nv = v.shape[0]
    for c in range(nv):
        step = difference_step(per_x, per_v, tw.size_x[c], max(tw.size_v[c], abs(v[c])))
        if step == 0.0:
            return
        for sign in (-1.0, 1.0):
            put_moved_state(plan, tw, x, v, c, sign * per_x * step, sign * per_v * step)
            found = _call(plan, work, row, tw.moved_x, tw.moved_v)
            _add_change(plan, work, tw, row, tw.moved_x, found, c, sign / (2.0 * step), matrix)


@kernel
def _subtract_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    if plan.flag[0] != 0:
        return
    if plan.data[row[at.EL_DATA] + _WHOLE] != 0.0:
        _subtract_whole_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix)
    else:
        _subtract_own_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix)


STATES = GeneralisedForce(
    Behaviour("state equations", Stiffness.SEEN, calls_user=True, drives=True), _subtract, _subtract_tangent
)
