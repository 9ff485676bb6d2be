"""A penalty in place of a constraint row's multiplier: k phi + c dphi/dt.

Its numbers: k, c; its count: the row of ``Plan.penalties`` with phi.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, scale3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements.element import Behaviour, FrameElement, Stiffness
from flexmbd.multibody.kernels.physics.constraint_laws import row_value, row_wrench, row_wrench_variation, wrap


@kernel
def _reaction(plan, work, row, d, R, rate, spin):
    """A penalised row's value and rate, its reaction in place of a multiplier, and its unit wrench."""
    held = plan.penalties[row[at.EL_COUNT]]
    o = row[at.EL_DATA]
    force, torque = row_wrench(plan.data, held, d, R)
    value = row_value(plan.data, held, d, R)
    speed = dot3(force, rate) + dot3(torque, spin)
    f = held[at.ROW_TIME]
    if f >= 0:
        speed -= work.time[f, 1]
        value -= work.time[f, 0]
        if held[at.ROW_KIND] == kinds.ROW_ANGLE:
            value = wrap(value)
    return value, speed, plan.data[o] * value + plan.data[o + 1] * speed, force, torque


@kernel
def _wrench(plan, work, row, d, R, rate, spin):
    _, _, pull, force, torque = _reaction(plan, work, row, d, R, rate, spin)
    return scale3(-pull, force), scale3(-pull, torque)


@kernel
def _variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    held = plan.penalties[row[at.EL_COUNT]]
    o = row[at.EL_DATA]
    _, _, pull, force, torque = _reaction(plan, work, row, d, R, rate, spin)
    force_change, torque_change = row_wrench_variation(plan.data, held, d, R, dd, dtheta)
    value_change = 0.0
    if held[at.ROW_LEVEL] == kinds.LEVEL_POSITION:
        value_change = dot3(force, dd) + dot3(torque, dtheta)
    speed_change = dot3(force_change, rate) + dot3(torque_change, spin) + dot3(force, drate) + dot3(torque, dspin)
    pull_change = plan.data[o] * value_change + plan.data[o + 1] * speed_change
    return (
        scale3(-1.0, add3(scale3(pull_change, force), scale3(pull, force_change))),
        scale3(-1.0, add3(scale3(pull_change, torque), scale3(pull, torque_change))),
    )


@kernel
def _energy(plan, work, row, d, R, rate, spin):
    value, _, _, _, _ = _reaction(plan, work, row, d, R, rate, spin)
    return 0.5 * plan.data[row[at.EL_DATA]] * value * value


PENALTY = FrameElement(Behaviour("penalties", Stiffness.UNSEEN, damper=(1, 1)), _wrench, _variation, _energy)
