"""A given force along the line between two frames, scaled by a function of time; a push that lengthens is positive."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement
from flexmbd.round_off import NO_LENGTH

_ZERO = (0.0, 0.0, 0.0)
_LEAST = NO_LENGTH


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    force = work.time[row[at.EL_TIME], 0]
    return scale3(force / max(math.sqrt(dot3(d, d)), _LEAST), d), _ZERO


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    force = work.time[row[at.EL_TIME], 0]
    length = max(math.sqrt(dot3(d, d)), _LEAST)
    n = scale3(1.0 / length, d)
    return scale3(force / length, add3(dd, scale3(-dot3(n, dd), n))), _ZERO


GIVEN_ON_LINE = FrameElement(Behaviour("given forces", given=True), _wrench, _variation)
