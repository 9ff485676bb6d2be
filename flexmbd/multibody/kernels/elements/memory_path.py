"""Force laws with memory: what they remember, and the way along which a step leads them.

A law with memory gives the force that resists a deformation d (m or rad) on its way from one value to another, and
changes its memory on that way; between both d does not turn.  The memory stands in the configuration x behind all
coordinates, where motions carry it along: when, at which d and at which rate it was written, on which piece of its
law, and then the law's own numbers.  Trials of a step start from there and leave it alone; the step's end writes it
(``remember``).  Within a step d follows the cubic that has both ends' values and rates, so the law sees where it turns.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import call_memory_law
from flexmbd.multibody.kernels.elements.elastoplastic import elastoplastic

_LEGS = 3  # of a cubic between its ends
_NOTHING = (math.nan, math.nan, math.nan, math.nan)


@kernel
def _turns(begin, rate, end, rate_at_end, duration):
    """The values at which the cubic between two ends turns, in their order; NaN where there are fewer than two."""
    first = math.nan
    second = math.nan
    if not duration > 0.0:  # no step: the straight way
        return first, second
    m = rate * duration
    n = rate_at_end * duration
    way = end - begin
    quadratic = 3.0 * way - 2.0 * m - n
    cubic = m + n - 2.0 * way
    # roots of m + 2 quadratic s + 3 cubic s^2
    root = quadratic * quadratic - 3.0 * cubic * m
    if not root > 0.0:
        return first, second
    sharp = -(quadratic + math.copysign(math.sqrt(root), quadratic))
    s = m / sharp if sharp != 0.0 else math.nan
    r = sharp / (3.0 * cubic) if cubic != 0.0 else math.nan
    if not (s > 0.0 and s < 1.0):
        s = math.nan
    if not (r > 0.0 and r < 1.0):
        r = math.nan
    if s != s or r < s:
        s, r = r, s
    first = begin + s * (m + s * (quadratic + s * cubic))
    second = begin + r * (m + r * (quadratic + r * cubic))
    return first, second


@kernel
def _lead(plan, work, row, begin, end):
    """Force, slope, piece and energy of a law led from one deformation to another; ``work.trial`` is its memory."""
    o = row[at.EL_DATA] + at.MEMORY_LAW_NUMBERS
    if row[at.EL_ADDRESS] == 0:
        return elastoplastic(plan.data, o, work.trial, begin, end)
    if plan.flag[0] != 0:
        return _NOTHING
    numbers = plan.data.ctypes.data + 8 * o
    size = int(plan.data[o - 1])
    force, slope, piece, energy = call_memory_law(
        row[at.EL_ADDRESS], (size, row[at.EL_COUNT]), (numbers, work.trial.ctypes.data), begin, end
    )
    total = force + slope + piece + energy
    for k in range(row[at.EL_COUNT]):
        total += work.trial[k]
    if plan.flag[0] == 0 and not math.isfinite(total):
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
    return force, slope, piece, energy


@kernel
def follow(plan, work, row, source, deformation, rate, t):
    """Lead an element's law from its memory in ``source`` (nx,) to where it is at t (s), on the cubic way.

    Leaves the new memory in ``work.trial``.  Returns the force against the deformation (N or N m), its slope, the
    energy (J) that it stores, the piece of the law, and whether that changed on the way.
    """
    m = row[at.EL_MEMORY]
    begin = source[m + at.MEMORY_DEFORMATION]
    if not math.isfinite(deformation + rate):
        return math.nan, math.nan, math.nan, math.nan, False
    for k in range(row[at.EL_COUNT]):
        work.trial[k] = source[m + at.N_MEMORY_HEAD + k]
    turns = _turns(begin, source[m + at.MEMORY_RATE], deformation, rate, t - source[m + at.MEMORY_TIME])
    force, slope, piece, energy = _NOTHING
    changed = False
    for leg in range(_LEGS):
        end = deformation
        if leg < 2:
            end = turns[leg]
        if end != end:
            continue
        force, slope, piece, energy = _lead(plan, work, row, begin, end)
        changed = changed or piece != source[m + at.MEMORY_PIECE]
        begin = end
    return force, slope, energy, piece, changed


@kernel
def write_memory(plan, work, row, x, deformation, rate, t):
    """Write what an element remembers at t (s) into x (nx,), from what it remembered there before."""
    m = row[at.EL_MEMORY]
    _, _, _, piece, _ = follow(plan, work, row, x, deformation, rate, t)
    x[m + at.MEMORY_TIME] = t
    x[m + at.MEMORY_DEFORMATION] = deformation
    x[m + at.MEMORY_RATE] = rate
    x[m + at.MEMORY_PIECE] = piece
    for k in range(row[at.EL_COUNT]):
        x[m + at.N_MEMORY_HEAD + k] = work.trial[k]
