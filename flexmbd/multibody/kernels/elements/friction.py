"""Regularised dry friction on a coordinate.

Its numbers: Coulomb's and the static friction, the speed of the regularisation, Stribeck's speed, viscous damping.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, CoordinateLaw, FloatArray


@kernel
def _law(plan, row, x, rate):
    data = plan.data
    o = row[at.EL_DATA]
    ratio = rate / data[o + 3]
    fade = math.exp(-ratio * ratio)
    excess = data[o + 1] - data[o]
    size = data[o] + excess * fade
    sign = math.tanh(rate / data[o + 2])
    slope = size * (1.0 - sign * sign) / data[o + 2] - 2.0 * excess * fade * ratio / data[o + 3] * sign
    return -size * sign - data[o + 4] * rate, 0.0, -slope - data[o + 4]


def _grip(numbers: FloatArray, load: float) -> tuple[float, float]:
    """Damping at the speed at which it creeps under the load; under more than it can bear it slides."""
    _, static, speed, _, viscous = numbers[:5]
    share = load / static if load < static else 1.0
    return 0.0, static * (1.0 - share * share) / speed + viscous


FRICTION = CoordinateLaw(Behaviour("friction", grip=_grip, changing=True), _law)
