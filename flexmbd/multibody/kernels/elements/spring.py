"""A spring and damper on a coordinate: -k (x - rest) - c dx/dt.  Its numbers: k, rest, c."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, CoordinateLaw, Stiffness


@kernel
def _law(plan, row, x, rate):
    data = plan.data
    o = row[at.EL_DATA]
    return -data[o] * (x - data[o + 1]) - data[o + 2] * rate, -data[o], -data[o + 2]


@kernel
def _energy(plan, row, x):
    data = plan.data
    o = row[at.EL_DATA]
    return 0.5 * data[o] * (x - data[o + 1]) ** 2


SPRING = CoordinateLaw(Behaviour("springs", Stiffness.SEEN, spring=(0, 1), damper=(2, 1)), _law, _energy)
