"""Functions of time inside a step: piecewise polynomials, sines, compiled and Python ones."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import brief_entry_kernel, kernel
from flexmbd.multibody.kernels.base.native import call_row, call_scalar


@kernel
def _piece(data, o, pieces, t):
    """Which piece of a piecewise polynomial holds at t."""
    low = 0
    high = pieces - 1
    while low < high:
        middle = (low + high + 1) // 2
        if data[o + 1 + middle] <= t:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def integrals(data, o, pieces, t):
    """Integrals to t of a polynomial of several pieces and of its rate and acceleration, without their jumps.

    From the first breakpoint on; see ``piecewise``.
    """
    order = int(data[o])
    low = _piece(data, o, pieces, t)
    s = t - data[o + 1 + low]
    c = o + 2 + pieces + order * low
    value = rate = total = 0.0
    for k in range(order):
        rate = rate * s + value
        value = value * s + data[c + k]
        total = total * s + data[c + k] / (order - k)
    begin = data[c + order - 1]
    begin_rate = data[c + order - 2] if order > 1 else 0.0
    c = o + 2 + pieces + order * pieces + 3 * low
    return data[c] + total * s, data[c + 1] + value - begin, data[c + 2] + rate - begin_rate


@kernel
def piecewise(data, o, pieces, t):
    """Value and derivatives of a piecewise polynomial; the end pieces go on outside.

    data[o:]: order k, pieces + 1 breakpoints, then k coefficients a piece, highest power first; of several pieces then
    three a piece, the ``integrals`` at its beginning.
    """
    order = int(data[o])
    low = _piece(data, o, pieces, t)
    s = t - data[o + 1 + low]
    c = o + 2 + pieces + order * low
    value = rate = half = 0.0
    for k in range(order):
        half = half * s + rate
        rate = rate * s + value
        value = value * s + data[c + k]
    return value, rate, 2.0 * half


@kernel
def _sine(data, o, t):
    """offset + amplitude sin(omega t + phase)."""
    offset, amplitude, omega, phase = data[o], data[o + 1], data[o + 2], data[o + 3]
    s = amplitude * math.sin(omega * t + phase)
    return offset + s, amplitude * omega * math.cos(omega * t + phase), -omega * omega * s


@brief_entry_kernel
def evaluate_times(plan, t, out):
    """Write value, rate and acceleration of every function of time at t.

    The last row of ``out`` gets t.  Where a user's function fails or gives no finite number, ``plan.flag`` says so.

    Args:
        plan: Plan, the compiled scene.
        t: float64, s.
        out: (times + 1, 3) float64, output: Work.time.
    """
    out[plan.times.shape[0], 0] = t
    for i in range(plan.times.shape[0]):
        row = plan.times[i]
        kind = row[at.TIME_KIND]
        o = row[at.TIME_OFFSET]
        if kind == kinds.TIME_PIECEWISE:
            out[i, 0], out[i, 1], out[i, 2] = piecewise(
                plan.time_data, o, row[at.TIME_COUNT], t
            )
        elif kind == kinds.TIME_SINE:
            out[i, 0], out[i, 1], out[i, 2] = _sine(plan.time_data, o, t)
        elif kind == kinds.TIME_COMPILED:
            for k in range(3):
                address = row[at.TIME_ADDRESS + k]
                out[i, k] = call_scalar(address, t) if address != 0 else 0.0
                if plan.flag[0] == 0 and not math.isfinite(out[i, k]):
                    plan.flag[0] = kinds.FLAG_TIME - i
        else:
            call_row(row[at.TIME_ADDRESS], t, out.ctypes.data + 24 * i)
