"""Stops at both ends of a coordinate's range, after Hunt & Crossley 1975.

Their numbers: lower and upper limit, stiffness, damping, transition.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, CoordinateLaw, FloatArray


@kernel
def _contact(stiffness, transition, depth):
    """Elastic force, its slope and energy at a depth > 0: quadratic up to ``transition``, then linear."""
    if depth < transition:
        slope = stiffness * depth / transition
        return 0.5 * slope * depth, slope, slope * depth * depth / 6.0
    past = depth - 0.5 * transition
    return stiffness * past, stiffness, 0.5 * stiffness * (past * past + transition * transition / 12.0)


@kernel
def _stop(stiffness, damping, transition, depth, rate):
    """Force against a depth that grows at ``rate``, and its derivatives by both; none pulls."""
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    share = 1.0 + damping * rate
    if share <= 0.0:
        return 0.0, 0.0, 0.0
    force, slope, _ = _contact(stiffness, transition, depth)
    return force * share, slope * share, force * damping


@kernel
def _law(plan, row, x, rate):
    data = plan.data
    o = row[at.EL_DATA]
    low, low_x, low_v = _stop(data[o + 2], data[o + 3], data[o + 4], data[o] - x, -rate)
    high, high_x, high_v = _stop(data[o + 2], data[o + 3], data[o + 4], x - data[o + 1], rate)
    return low - high, -low_x - high_x, -low_v - high_v


@kernel
def _energy(plan, row, x):
    data = plan.data
    o = row[at.EL_DATA]
    depth = max(data[o] - x, x - data[o + 1])
    return _contact(data[o + 2], data[o + 4], depth)[2] if depth > 0.0 else 0.0


@kernel
def _piece(plan, row, x):
    data = plan.data
    o = row[at.EL_DATA]
    piece = 0
    if x > data[o + 1]:
        piece = 1 if x - data[o + 1] < data[o + 4] else 2
    elif x < data[o]:
        piece = -1 if data[o] - x < data[o + 4] else -2
    return piece


def _misplaced(numbers: FloatArray, x: float) -> str:
    """A complaint where x lies beyond a limit by more than the transition."""
    lower, upper, _, _, transition = numbers[:5]
    if lower - transition <= x <= upper + transition:
        return ""
    return (
        f"the start at {x:.6g} lies beyond the limits {lower:g} to {upper:g} (m or rad); "
        "set the joint's position, or the limits"
    )


def _grip(numbers: FloatArray, load: float) -> tuple[float, float]:
    """Stiffness and damping at the depth at which the contact bears the load at rest."""
    stiffness, damping, transition = numbers[2:5]
    return min(stiffness, math.sqrt(2.0 * stiffness * load / transition)), load * damping


STOP = CoordinateLaw(
    Behaviour("stops", grip=_grip, changing=True, damper=(3, 1)), _law, _energy, _piece, _misplaced
)
