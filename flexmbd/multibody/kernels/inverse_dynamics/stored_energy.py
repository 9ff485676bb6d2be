"""Whether an element's wrench is the derivative of the energy that it says it stores."""

from __future__ import annotations

import sys

from flexmbd.multibody.kernels.algebra.so3 import add3, compose, exp_rotation, scale3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.elements.differences import STEP
from flexmbd.multibody.kernels.elements.pairs import frame_of_pair, line
from flexmbd.multibody.kernels.elements.table import element_wrench, frame_energy, pair_push
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.pair_forces import frame_place
from flexmbd.multibody.kernels.physics.constraint_laws import unit

_ZERO = (0.0, 0.0, 0.0)

_EPSILON = sys.float_info.epsilon
#: In a law's energy: it is some tens of operations.
ROUNDINGS = 32.0


@entry_kernel
def energy_slopes(plan, work, i, step, out):
    """Of element i, between frames, at rest where ``work`` has its frames: out[0, :6] its wrench on G, in F's axes.

    out[1, :6], out[2, :6]: the energy's slopes by d (N) and by turns of G (N m), from ``step`` (m; rad) before to here,
    and from here to as far behind.  out[3, 0]: the energy (J).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        i: int64, row of Plan.elements.
        step: (2,) float64, m and rad.
        out: (4, 6) float64, output.
    """
    row = plan.elements[i]
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    force, torque = element_wrench(plan, work, row, d, R, _ZERO, _ZERO)
    here = frame_energy(plan, work, row, d, R, _ZERO, _ZERO)
    out[3, 0] = here
    for k in range(3):
        out[0, k] = force[k]
        out[0, 3 + k] = torque[k]
        for side in range(2):
            sign = 2.0 * side - 1.0
            moved = scale3(sign * step[0], unit(k))
            turn = exp_rotation(scale3(sign * step[1], unit(k)))
            there = frame_energy(plan, work, row, add3(d, moved), R, _ZERO, _ZERO)
            turned = frame_energy(plan, work, row, d, compose(turn, R), _ZERO, _ZERO)
            out[1 + side, k] = sign * (there - here) / step[0]
            out[1 + side, 3 + k] = sign * (turned - here) / step[1]


@kernel
def _pair_fault(plan, work, row, i, j, r):
    """How far (N) the force of a pair at rest lies from its energy's slope, beyond what that may be wrong by.

    As ``energy_check`` has it of a law between two frames.  Then the force and the slope.
    """
    h = STEP * r
    push, here = pair_push(plan, work, row, i, j, r, 0.0)
    before = (here - pair_push(plan, work, row, i, j, r - h, 0.0)[1]) / h
    behind = (pair_push(plan, work, row, i, j, r + h, 0.0)[1] - here) / h
    wide = pair_push(plan, work, row, i, j, r + 2.0 * h, 0.0)[1] - pair_push(plan, work, row, i, j, r - 2.0 * h, 0.0)[1]
    slope = 0.5 * (before + behind)
    known = abs(behind - before) + abs(wide / (4.0 * h) - slope)
    known += ROUNDINGS * _EPSILON / (2.0 * STEP) * (abs(here) / r + abs(slope))
    return abs(push + slope) - known, push, slope


@entry_kernel
def pair_faults(plan, work, e, storing, out):
    """Of the group of element e, whose frames ``work`` has: out[0], out[1] two that meet, by their places in it, or -1.

    And where it is ``storing`` out[2] the largest fault of a pair (N), 0 where there is none; out[3], out[4] the pair,
    out[5] the force that pushes it apart at rest, out[6] the energy's slope by the distance (N).
    """
    row = plan.elements[e]
    out[0] = -1.0
    out[1] = -1.0
    out[2] = 0.0
    for i in range(row[at.EL_COUNT]):
        p = frame_place(plan, work, frame_of_pair(plan, row, i))
        for j in range(i + 1, row[at.EL_COUNT]):
            d = sub3(frame_place(plan, work, frame_of_pair(plan, row, j)), p)
            if d[0] == 0.0 and d[1] == 0.0 and d[2] == 0.0:
                out[0] = i
                out[1] = j
            elif storing:
                fault, push, slope = _pair_fault(plan, work, row, i, j, line(d, _ZERO)[0])
                if fault > out[2]:
                    out[2] = fault
                    out[3] = i
                    out[4] = j
                    out[5] = push
                    out[6] = slope
