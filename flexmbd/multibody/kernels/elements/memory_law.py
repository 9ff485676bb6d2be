"""Laws with memory on a coordinate, and along the line between two frames; see ``memory_path``.

Their numbers: the coordinate or length (m or rad) at which the deformation is zero, how many the law has, and these.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, GeneralisedForce, Stiffness
from flexmbd.multibody.kernels.elements.memory_path import follow, write_memory
from flexmbd.round_off import NO_LENGTH

_ZERO = (0.0, 0.0, 0.0)
_LEAST = NO_LENGTH


@kernel
def _follow_coordinate(plan, work, row, x, position, rate):
    t = work.time[plan.times.shape[0], 0]
    return follow(plan, work, row, x, position - plan.data[row[at.EL_DATA]], rate, t)


@kernel
def _subtract(plan, work, row, x, v, out):
    k = row[at.EL_V]
    out[k] += _follow_coordinate(plan, work, row, x, x[row[at.EL_X]], v[k])[0]


@kernel
def _subtract_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    # that the place of a turn within the step moves too makes the true slope a little smaller
    k = row[at.EL_V]
    matrix[k, k] += per_x * _follow_coordinate(plan, work, row, x, x[row[at.EL_X]], v[k])[1]


@kernel
def _slope(plan, work, row, x, v, size):
    return -_follow_coordinate(plan, work, row, x, x[row[at.EL_X]], v[row[at.EL_V]])[1]


@kernel
def _energy(plan, work, row, x):
    # without its rate: the straight way from what it remembers
    position = x[row[at.EL_X]] - plan.data[row[at.EL_DATA]]
    return follow(plan, work, row, x, position, 0.0, -math.inf)[2]


@kernel
def _changes_piece(plan, work, row, x, v):
    return _follow_coordinate(plan, work, row, x, x[row[at.EL_X]], v[row[at.EL_V]])[4]


@kernel
def _elongation(plan, row, d, rate):
    """What the distance between two frames has grown by (m), its rate (m/s), and the distance."""
    length = max(math.sqrt(dot3(d, d)), _LEAST)
    return length - plan.data[row[at.EL_DATA]], dot3(d, rate) / length, length


@kernel
def _follow_line(plan, work, row, d, rate):
    grown, growth, length = _elongation(plan, row, d, rate)
    force, slope, energy, _, _ = follow(
        plan, work, row, work.memory, grown, growth, work.time[plan.times.shape[0], 0]
    )
    return force, slope, energy, length


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    force, _, _, length = _follow_line(plan, work, row, d, rate)
    return scale3(-force / length, d), _ZERO


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    force, slope, _, length = _follow_line(plan, work, row, d, rate)
    n = scale3(1.0 / length, d)
    along = dot3(n, dd)
    dn = scale3(1.0 / length, add3(dd, scale3(-along, n)))
    return scale3(-1.0, add3(scale3(slope * along, n), scale3(force, dn))), _ZERO


@kernel
def _frame_energy(plan, work, row, d, R, rate, spin):
    grown, _, _ = _elongation(plan, row, d, rate)
    return follow(plan, work, row, work.memory, grown, 0.0, -math.inf)[2]


@kernel
def _remember(plan, work, row, x, d, R, rate, spin, t):
    grown, growth, _ = _elongation(plan, row, d, rate)
    write_memory(plan, work, row, x, grown, growth, t)


def _kinds(name: str, stiffness: Stiffness, *, calls_user: bool) -> tuple[GeneralisedForce, FrameElement]:
    """The two kinds of elements; what they store is no potential, for it hangs on the way."""
    behaviour = Behaviour(name, stiffness, changing=True, calls_user=calls_user, remembers=True)
    on_line = Behaviour(name, stiffness, calls_user=calls_user, remembers=True)
    force = GeneralisedForce(
        behaviour, _subtract, _subtract_tangent, _energy, slope=_slope, changes_piece=_changes_piece, couples=False
    )
    return force, FrameElement(on_line, _wrench, _variation, _frame_energy, _remember)


ELASTOPLASTIC, ELASTOPLASTIC_LINE = _kinds("elasto-plastic springs", Stiffness.SEEN, calls_user=False)
MEMORY_LAW, MEMORY_LINE = _kinds("forces with memory, which may be stiff", Stiffness.UNSEEN, calls_user=True)
