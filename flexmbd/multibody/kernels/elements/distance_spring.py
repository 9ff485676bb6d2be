"""A spring and damper along the line between the origins of two frames.  Its numbers: k, unstretched length, c."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness
from flexmbd.round_off import NO_LENGTH

_ZERO = (0.0, 0.0, 0.0)
_LEAST = NO_LENGTH


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    data = plan.data
    o = row[at.EL_DATA]
    length = max(math.sqrt(dot3(d, d)), _LEAST)
    pull = data[o] * (length - data[o + 1]) + data[o + 2] * dot3(d, rate) / length
    return scale3(-pull / length, d), _ZERO


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    data = plan.data
    o = row[at.EL_DATA]
    length = max(math.sqrt(dot3(d, d)), _LEAST)
    n = scale3(1.0 / length, d)
    along = dot3(n, dd)
    dn = scale3(1.0 / length, add3(dd, scale3(-along, n)))
    pull = data[o] * (length - data[o + 1]) + data[o + 2] * dot3(n, rate)
    dpull = data[o] * along + data[o + 2] * (dot3(dn, rate) + dot3(n, drate))
    return scale3(-1.0, add3(scale3(dpull, n), scale3(pull, dn))), _ZERO


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    o = row[at.EL_DATA]
    return 0.5 * plan.data[o] * (math.sqrt(dot3(d, d)) - plan.data[o + 1]) ** 2


DISTANCE_SPRING = FrameElement(
    Behaviour("springs", Stiffness.SEEN, spring=(0, 1), damper=(2, 1)), _wrench, _variation, _energy
)
