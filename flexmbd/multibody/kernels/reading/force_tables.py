"""Readers of a plan's force elements and functions of time, and copies of the plan without some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.elements.contact_wrench import CONTACT, ROUGH_CONTACT
from flexmbd.multibody.kernels.elements.element import Behaviour, Stiffness
from flexmbd.multibody.kernels.elements.hard_element import (
    FRICTION,
    GROUP_FRAMES,
    HARD_CONTACT,
    HARD_GROUP,
    LAW_FRICTION,
)
from flexmbd.multibody.kernels.elements.homogeneous_energy import HOMOGENEOUS_ENERGY
from flexmbd.multibody.kernels.elements.pairs import HEAD
from flexmbd.multibody.kernels.elements.surface_forces import ROUGH_SURFACE
from flexmbd.multibody.kernels.elements.surface_layout import POINT_RADIUS, SHAPE
from flexmbd.multibody.kernels.elements.table import are_of, behaviours, kind_of, stores
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class ForceElements:
    """Force elements, each array (k,).

    Attributes:
        behaviour: (k,) what integrators must know of each.
        time: row of ``plan.times`` that scales it, or -1.
        address: of a user's function, or 0.
        number: its place among all of the scene, whose names are ``CompiledScene.element_names``.
    """

    behaviour: tuple[Behaviour, ...]
    time: IntArray
    address: IntArray
    number: IntArray


def force_elements(plan: Plan) -> ForceElements:
    """All force elements."""
    time, address, number = (plan.elements[:, k] for k in (at.EL_TIME, at.EL_ADDRESS, at.EL_NUMBER))
    return ForceElements(tuple(behaviours(plan)), time, address, number)


def stiffness_may_change(plan: Plan) -> bool:
    """Whether a force's stiffness may change on the way, as that of a stop does."""
    return any(one.changing for one in behaviours(plan))


def has_smooth_contacts(plan: Plan) -> bool:
    """Whether there are contacts with a law, which set in and let go on the way."""
    return any(one.lets_go and not one.hard for one in behaviours(plan))


def gripping(plan: Plan) -> Mask:
    """(k,) whether each force element sets in and lets go, or reverses, within a step."""
    return np.array([one.grip is not None for one in behaviours(plan)], bool)


def reversing(plan: Plan) -> Mask:
    """(k,) whether each force element grips by its reversal alone and without a stiffness, as friction does."""
    found = np.zeros(len(plan.elements), bool)
    for k, (row, one) in enumerate(zip(plan.elements, behaviours(plan), strict=True)):
        found[k] = one.grip is not None and one.grip(plan.data[row[at.EL_DATA] :], 1.0)[0] == 0.0
    return found


def gripped_velocities(plan: Plan) -> IntArray:
    """(g,) the velocity on which each of those acts."""
    return plan.elements[gripping(plan), at.EL_V]


def grips(plan: Plan, loads: FloatArray) -> FloatArray:
    """(g, 2) the stiffness and damping at which each of those bears a load (g,), N or N m."""
    found = np.zeros((len(loads), 2))
    places = iter(range(len(loads)))
    for row, one in zip(plan.elements, behaviours(plan), strict=True):
        if one.grip is not None:
            k = next(places)
            found[k] = one.grip(plan.data[row[at.EL_DATA] :], float(loads[k]))
    return found


def can_vibrate(plan: Plan) -> bool:
    """Whether anything makes joints vibrate: springs, users' laws, rows that an augmented Lagrangian enforces.

    Stops, friction and contacts do not, whose grip passes, and neither do dampers: what they hold comes to rest.
    """
    return _has_springs(plan) or bool(constraint_rows(plan).augmented.any())


def hard_contact_places(plan: Plan) -> IntArray:
    """(n,) rows of the elements that are hard contacts."""
    return np.flatnonzero(are_of(plan, HARD_CONTACT))


def has_hard_contacts(plan: Plan) -> bool:
    """Whether there are contacts that a method solves for by impulses."""
    return any(one.hard for one in behaviours(plan))


def has_hard_groups(plan: Plan) -> bool:
    """Whether there are groups of shapes among these."""
    return bool(are_of(plan, HARD_GROUP).any())


def friction_of_hard_contact(plan: Plan, number: int) -> float:
    """The coefficient of friction of the hard contact that is this element of the scene."""
    row = plan.elements[plan.elements[:, at.EL_NUMBER] == number][0]
    place = LAW_FRICTION if row[at.EL_KIND] == kind_of(HARD_GROUP) else FRICTION
    return float(plan.data[row[at.EL_DATA] + place])


def group_frames(plan: Plan, row: int) -> IntArray:
    """(n,) rows of the frames of the shapes of the group of hard contacts in this row of the elements."""
    element = plan.elements[row]
    first = element[at.EL_DATA] + GROUP_FRAMES
    return plan.data[first : first + element[at.EL_COUNT]].astype(np.int64)


def contact_frames(plan: Plan, row: int) -> tuple[int, int]:
    """Rows of the frames F and G of the contact in this row of the elements."""
    return int(plan.elements[row, at.EL_F]), int(plan.elements[row, at.EL_G])


def element_numbers(plan: Plan, rows: Sequence[int]) -> IntArray:
    """(k,) the numbers in the scene of these rows of the elements."""
    return np.ascontiguousarray(plan.elements[list(rows), at.EL_NUMBER])


def undefined_forces(plan: Plan) -> dict[int, str]:
    """What it means where an element gives no finite number, by its number in the scene; not of users' functions."""
    told = zip(map(int, plan.elements[:, at.EL_NUMBER]), behaviours(plan), strict=True)
    return {number: one.undefined for number, one in told if one.undefined}


def refuse_hard_contacts(plan: Plan, what: str) -> None:
    """Raise SceneError where there are contacts that act by impulses, of which ``what`` knows nothing."""
    if has_hard_contacts(plan):
        raise SceneError(
            f"{what} is not known in a scene with hard contacts (fm.contact.Hard), whose impulses are no forces of the "
            "equations; take a smooth law, as fm.contact.PowerLaw, where it is needed"
        )


def has_stiff_elements(plan: Plan) -> bool:
    """Whether there are force elements with a stiffness, whatever its size."""
    return any(one.stiffness is not Stiffness.NONE for one in behaviours(plan))


def _has_springs(plan: Plan) -> bool:
    for row, one, storing in zip(plan.elements, behaviours(plan), stores(plan), strict=True):
        first, count = one.spring
        numbers = plan.data[row[at.EL_DATA] + first : row[at.EL_DATA] + first + count]
        elastic = storing or one.stiffness is not Stiffness.NONE
        if elastic and one.grip is None and not one.lets_go and (count == 0 or numbers.any()):
            return True
    return False


def rough_contacts(plan: Plan) -> IntArray:
    """(k,) rows of ``Plan.elements`` of contacts with friction."""
    return np.flatnonzero(are_of(plan, ROUGH_CONTACT))


def contacts_by_law(plan: Plan) -> IntArray:
    """(k,) rows of ``Plan.elements`` of contacts with a law, not of those of elastic surfaces."""
    return np.flatnonzero(are_of(plan, CONTACT) | are_of(plan, ROUGH_CONTACT))


def touched_shape(plan: Plan, row: int) -> tuple[int, float]:
    """Where in ``Plan.data`` the shape is that an elastic surface, in this row, touches; and its points' radius.

    The radius (m) is 0 but of a sphere that is its only point.
    """
    o = int(plan.elements[row, at.EL_DATA])
    return o + SHAPE, float(plan.data[o + POINT_RADIUS])


def rough_surfaces(plan: Plan) -> IntArray:
    """(k,) rows of ``Plan.elements`` of elastic surfaces with friction."""
    return np.flatnonzero(are_of(plan, ROUGH_SURFACE))


def slid_ways(plan: Plan) -> IntArray:
    """(k,) velocities of links whose state is how far rough surfaces have slid or turned, maybe for ever."""
    rough = plan.elements[rough_contacts(plan)]
    counts = plan.data[rough[:, at.EL_DATA]].astype(np.int64)
    ways = (first + np.arange(n) for first, n in zip(rough[:, at.EL_V], counts, strict=True))
    return np.concatenate([np.zeros(0, np.int64), *ways])


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


def without_loads(plan: Plan) -> Plan:
    """``plan`` without all force elements; weights stay."""
    return keep_forces(plan, [], [])


def without_forces(plan: Plan) -> Plan:
    """``plan`` without force elements and gravity: inertia, elasticity and loops alone."""
    elements = plan.elements[are_of(plan, HOMOGENEOUS_ENERGY)]
    return plan.replace(forces=plan.forces[:0], elements=elements, gravity=np.zeros(3))


def without_function(plan: Plan, address: int) -> Plan:
    """``plan`` without the force element that calls the function at ``address``."""
    return keep_forces(plan, range(len(plan.forces)), plan.elements[:, at.EL_ADDRESS] != address)


def storing_plan(plan: Plan) -> Plan:
    """``plan`` without loads and dampers: what remains stores the energy it takes."""
    flex, data = plan.flex.copy(), plan.data.copy()
    flex[:, at.MODAL_DAMPING] = -1
    remembers = np.array([one.remembers for one in behaviours(plan)], bool)
    kept = keep_forces(plan, [], stores(plan) & ~remembers)
    for row, behaviour in zip(kept.elements, behaviours(kept), strict=True):
        first, count = behaviour.damper
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


def straight_places(plan: Plan, time: int) -> tuple[int, int, int]:
    """Where in ``plan.time_data`` a straight line has its beginning (s), its slope and its value there.

    A polynomial of one piece and order 2.
    """
    first = int(plan.times[time, at.TIME_OFFSET])
    return first + 1, first + 3, first + 4  # after the order; after two breakpoints


def is_constant(plan: Plan, time: int) -> bool:
    """Whether a function of time is a polynomial of one piece and order 0."""
    kind, offset, count = plan.times[time, [at.TIME_KIND, at.TIME_OFFSET, at.TIME_COUNT]]
    return bool(kind == kinds.TIME_PIECEWISE and count == 1 and plan.time_data[offset] == 1.0)


def frames_of_group(plan: Plan, k: int) -> IntArray:
    """(n,) rows of ``Plan.frames`` of the group that element k acts in."""
    o, n = int(plan.elements[k, at.EL_DATA]), int(plan.elements[k, at.EL_COUNT])
    common, own = map(int, plan.data[o + 1 : o + HEAD])
    first = o + HEAD + common + n * own
    return plan.data[first : first + n].astype(np.int64)
