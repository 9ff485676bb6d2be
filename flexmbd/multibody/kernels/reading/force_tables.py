"""Readers of a plan's force elements and functions of time, and copies of the plan without some of them."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan

IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]

_CHANGING = (kinds.ON_CHARACTERISTIC, kinds.ON_STOP, kinds.ON_FRICTION, kinds.ON_FUNCTION, kinds.ON_STATE)


@dataclass(frozen=True, eq=False)
class ForceElements:
    """Force elements, each array (k,).

    Attributes:
        kind: ``kinds.ON_*`` or ``BETWEEN_*``.
        time: row of ``plan.times`` that scales it, or -1.
        count: its meaning follows from the kind.
        address: of a user's function, or 0.
    """

    kind: IntArray
    time: IntArray
    count: IntArray
    address: IntArray


def force_elements(plan: Plan) -> ForceElements:
    """All force elements."""
    kind, time, count, address = (
        plan.elements[:, k] for k in (at.EL_KIND, at.EL_TIME, at.EL_COUNT, at.EL_ADDRESS)
    )
    return ForceElements(kind, time, count, address)


def stiffness_may_change(plan: Plan) -> bool:
    """Whether a force's stiffness may change on the way, as that of a stop does."""
    return bool(np.isin(plan.elements[:, at.EL_KIND], _CHANGING).any())


def joint_force_times(plan: Plan) -> IntArray:
    """(k,) rows of ``plan.times`` of forces that are functions of time on a coordinate."""
    return plan.forces[:, at.FORCE_TIME]


def keep_forces(plan: Plan, forces: Sequence[int] | IntArray | Mask, elements: Sequence[int] | IntArray | Mask) -> Plan:
    """``plan`` with these rows of joint forces and of force elements alone, by number or mask."""
    return plan.replace(
        forces=np.ascontiguousarray(plan.forces[np.asarray(forces, _index(forces))]),
        elements=np.ascontiguousarray(plan.elements[np.asarray(elements, _index(elements))]),
    )


def _index(rows: Sequence[int] | IntArray | Mask) -> type:
    return bool if isinstance(rows, np.ndarray) and rows.dtype == np.bool_ else np.int64


def keep_elements(plan: Plan, wanted: Collection[int]) -> Plan:
    """``plan`` with force elements of these kinds alone, and without forces of time on coordinates."""
    return keep_forces(plan, [], np.isin(plan.elements[:, at.EL_KIND], list(wanted)))


def without_loads(plan: Plan) -> Plan:
    """``plan`` without all force elements; weights stay."""
    return keep_forces(plan, [], [])


def without_forces(plan: Plan) -> Plan:
    """``plan`` without force elements and gravity: inertia, elasticity and loops alone."""
    elements = plan.elements[plan.elements[:, at.EL_KIND] == kinds.ON_ENERGY]
    return plan.replace(forces=plan.forces[:0], elements=elements, gravity=np.zeros(3))


def without_function(plan: Plan, address: int) -> Plan:
    """``plan`` without the force element that calls the function at ``address``."""
    return keep_forces(plan, range(len(plan.forces)), plan.elements[:, at.EL_ADDRESS] != address)


#: Force elements that store what they take: where their parameters hold the damper, first entry and how many.
_DAMPERS = {
    kinds.ON_SPRING: (2, 1),
    kinds.ON_CHARACTERISTIC: (1, 1),
    kinds.ON_STOP: (3, 1),
    kinds.ON_ENERGY: (0, 0),
    kinds.BETWEEN_SPRING: (2, 1),
    kinds.BETWEEN_PENALTY: (1, 1),
    kinds.BETWEEN_BUSHING: (36, 36),
}


def storing_plan(plan: Plan) -> Plan:
    """``plan`` without loads and dampers: what remains stores the energy it takes."""
    flex, data = plan.flex.copy(), plan.data.copy()
    flex[:, at.MODAL_DAMPING] = -1
    kept = keep_elements(plan, _DAMPERS)
    for row in kept.elements:
        first, count = _DAMPERS[int(row[at.EL_KIND])]
        o = int(row[at.EL_DATA]) + first
        data[o : o + count] = 0.0
    return kept.replace(flex=flex, data=data)


def time_kinds(plan: Plan) -> IntArray:
    """(k,) ``kinds.TIME_*`` of each function of time."""
    return plan.times[:, at.TIME_KIND]


def data_functions(plan: Plan, *, motions: bool) -> IntArray:
    """(k,) 1 for each function of time that is a polynomial of several pieces, 0 for others; motions or not."""
    data = (plan.times[:, at.TIME_KIND] == kinds.TIME_PIECEWISE) & (plan.times[:, at.TIME_COUNT] > 1)
    if not motions:
        data[plan.driven[:, at.DRIVEN_TIME]] = False
    return data.astype(np.int64)


def constant_place(plan: Plan, time: int) -> int:
    """Where in ``plan.time_data`` the value of a constant lies, a polynomial of one piece and order 0."""
    return int(plan.times[time, at.TIME_OFFSET]) + 3  # after the order and two breakpoints


def is_constant(plan: Plan, time: int) -> bool:
    """Whether a function of time is a polynomial of one piece and order 0."""
    kind, offset, count = plan.times[time, [at.TIME_KIND, at.TIME_OFFSET, at.TIME_COUNT]]
    return bool(kind == kinds.TIME_PIECEWISE and count == 1 and plan.time_data[offset] == 1.0)
