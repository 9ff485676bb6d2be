"""A given wrench on frame G, scaled by a function of time, in the axes of F or of G.

Its numbers: force (3) at G's origin, torque (3).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import cross3, load3, rotate, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement


@kernel
def _in_axes_of_F(plan, work, row, d, R, rate, spin):
    o = row[at.EL_DATA]
    factor = 1.0 if row[at.EL_TIME] < 0 else work.time[row[at.EL_TIME], 0]
    return scale3(factor, load3(plan.data, o)), scale3(factor, load3(plan.data, o + 3))


@kernel
def _in_axes_of_G(plan, work, row, d, R, rate, spin):
    force, torque = _in_axes_of_F(plan, work, row, d, R, rate, spin)
    return rotate(R, force), rotate(R, torque)


@kernel
def _turned_with_G(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    force, torque = _in_axes_of_G(plan, work, row, d, R, rate, spin)
    return cross3(dtheta, force), cross3(dtheta, torque)


GIVEN_IN_F = FrameElement(Behaviour("given forces", given=True), _in_axes_of_F)
GIVEN_IN_G = FrameElement(Behaviour("given forces", given=True), _in_axes_of_G, _turned_with_G)
