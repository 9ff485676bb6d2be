"""All kinds of force elements, and the kernels that choose among them.

A row of ``Plan.elements`` says its kind by the place of the element here (``kind_of``).  To add an element: a file
beside this one, and a line in ELEMENTS.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.base.by_kind import by_kind
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.elements.beam_wrench import BEAM_ELEMENT
from flexmbd.multibody.kernels.elements.bushing_wrench import BUSHING
from flexmbd.multibody.kernels.elements.characteristic import CHARACTERISTIC
from flexmbd.multibody.kernels.elements.contact_wrench import CONTACT, ROUGH_CONTACT
from flexmbd.multibody.kernels.elements.distance_spring import DISTANCE_SPRING
from flexmbd.multibody.kernels.elements.element import (
    Behaviour,
    CoordinateLaw,
    ElementKind,
    FrameElement,
    GeneralisedForce,
    PairsElement,
    SurfaceElement,
)
from flexmbd.multibody.kernels.elements.frame_law import FRAME_LAW, STORING_FRAME_LAW
from flexmbd.multibody.kernels.elements.frame_states import FRAME_STATES
from flexmbd.multibody.kernels.elements.friction import FRICTION
from flexmbd.multibody.kernels.elements.given_on_line import GIVEN_ON_LINE
from flexmbd.multibody.kernels.elements.given_strain import GIVEN_STRAIN
from flexmbd.multibody.kernels.elements.given_wrench import GIVEN_IN_F, GIVEN_IN_G
from flexmbd.multibody.kernels.elements.halfway_bushing import HALFWAY_BUSHING
from flexmbd.multibody.kernels.elements.hard_element import HARD_CONTACT, HARD_GROUP
from flexmbd.multibody.kernels.elements.held_expansion import HELD_EXPANSION
from flexmbd.multibody.kernels.elements.homogeneous_energy import HOMOGENEOUS_ENERGY
from flexmbd.multibody.kernels.elements.interior_wrench import INTERIOR_WRENCH
from flexmbd.multibody.kernels.elements.memory_law import ELASTOPLASTIC, ELASTOPLASTIC_LINE, MEMORY_LAW, MEMORY_LINE
from flexmbd.multibody.kernels.elements.modal_force import MODAL_FORCE
from flexmbd.multibody.kernels.elements.pairs import GRAVITATION, PAIRS_LAW, STORING_PAIRS_LAW
from flexmbd.multibody.kernels.elements.penalty import PENALTY
from flexmbd.multibody.kernels.elements.spring import SPRING
from flexmbd.multibody.kernels.elements.state_rates import STATES
from flexmbd.multibody.kernels.elements.stop import STOP
from flexmbd.multibody.kernels.elements.surface_forces import ELASTIC_SURFACE, ROUGH_SURFACE
from flexmbd.multibody.kernels.elements.surface_groups import N_UNKNOWNS
from flexmbd.multibody.kernels.elements.surface_layout import GROUP, OTHER
from flexmbd.multibody.kernels.elements.user_law import USER_LAW
from flexmbd.multibody.kernels.elements.user_state_force import SOLVED_TOGETHER, STATE_FORCE

#: All kinds, in the order in which kernels ask for them.
ELEMENTS: tuple[ElementKind, ...] = (
    SPRING, CHARACTERISTIC, STOP, FRICTION,
    USER_LAW, ELASTOPLASTIC, MEMORY_LAW, MODAL_FORCE, STATE_FORCE, SOLVED_TOGETHER, HOMOGENEOUS_ENERGY,
    DISTANCE_SPRING, BUSHING, BEAM_ELEMENT, PENALTY, INTERIOR_WRENCH, GIVEN_IN_G, GIVEN_IN_F, FRAME_LAW,
    STORING_FRAME_LAW, ELASTOPLASTIC_LINE, MEMORY_LINE, GIVEN_STRAIN, STATES,
    HALFWAY_BUSHING, GIVEN_ON_LINE, FRAME_STATES, GRAVITATION, PAIRS_LAW, STORING_PAIRS_LAW, CONTACT, ROUGH_CONTACT,
    HARD_CONTACT, HARD_GROUP, ELASTIC_SURFACE, ROUGH_SURFACE, HELD_EXPANSION,
)  # fmt: skip


def kind_of(element: ElementKind) -> int:
    """The number of a kind in rows of ``Plan.elements``."""
    return ELEMENTS.index(element)


def behaviours(plan: Plan) -> list[Behaviour]:
    """What integrators must know of each element of a plan."""
    known = [one.behaviour for one in ELEMENTS]
    kinds: Any = plan.elements[:, at.EL_KIND].tolist()
    return [known[kind] for kind in kinds]


def _by_kind(plan: Plan, holds: Callable[[ElementKind], bool]) -> NDArray[np.bool_]:
    """(k,) whether something holds of each element's kind."""
    kinds, which = np.unique(plan.elements[:, at.EL_KIND], return_inverse=True)
    return np.array([holds(ELEMENTS[kind]) for kind in kinds], bool)[which]


def stores(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan stores energy."""
    return _by_kind(plan, lambda one: one.energy is not None)


def couple_all(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether the tangent of each element of a plan may join any two coordinates.

    Interiors' frames are joined by the stiffness of what lies between them, which is added as a whole; and so are the
    frames of a group.
    """
    return _by_kind(
        plan,
        lambda one: (
            one is INTERIOR_WRENCH
            or isinstance(one, PairsElement)
            or (isinstance(one, GeneralisedForce) and one.subtract_tangent is not None and one.couples)
        ),
    )


def act_between_frames(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan acts between two frames."""
    return _by_kind(plan, lambda one: isinstance(one, FrameElement | SurfaceElement))


def own_links(plan: Plan, row: IntArray) -> range:
    """The links, rows of ``Plan.tree``, of the states that a force between frames has of its own; mostly none."""
    if row[at.EL_V] < 0:
        return range(0)
    first = int(plan.data[row[at.EL_DATA] + 2])
    return range(first, first + int(plan.data[row[at.EL_DATA]]))


def touched_modes(plan: Plan, row: IntArray) -> list[range]:
    """The velocities of the modes by which the patches of an elastic surface move, and of those that it touches."""
    found = []
    for f in (row[at.EL_G], row[at.EL_F])[: 1 + int(plan.data[row[at.EL_DATA] + OTHER] >= 0.0)]:
        link = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
        if link[at.FLEX] >= 0:
            first = int(link[at.MODAL_V])
            found.append(range(first, first + int(plan.flex[link[at.FLEX], at.N_MODES])))
    return found


def moved_unknowns(plan: Plan, row: IntArray) -> int:
    """By how many unknowns the forces of an elastic surface change that stand in ``TangentWork.path_rates``."""
    g = int(plan.data[row[at.EL_DATA] + GROUP])
    if g >= 0:
        return int(plan.data[g + N_UNKNOWNS]) + 1
    return sum(map(len, touched_modes(plan, row)))


def surface_groups(plan: Plan) -> list[IntArray]:
    """The rows of each group of elastic surfaces that give way together."""
    rows = np.flatnonzero(of_surfaces(plan))
    groups = plan.data[plan.elements[rows, at.EL_DATA] + GROUP]
    return [rows[groups == g] for g in np.unique(groups[groups >= 0.0])]


def of_surfaces(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan acts on the patches of an elastic surface."""
    return _by_kind(plan, lambda one: isinstance(one, SurfaceElement))


def of_pairs(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan acts between all pairs of a group."""
    return _by_kind(plan, lambda one: isinstance(one, PairsElement))


def call_users(plan: Plan) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan calls a user's function."""
    return _by_kind(plan, lambda one: one.behaviour.calls_user)


def are_of(plan: Plan, element: ElementKind) -> NDArray[np.bool_]:
    """(k,) whether each element of a plan is of a kind."""
    return np.asarray(plan.elements[:, at.EL_KIND] == kind_of(element))


# ------------------------------------------------------------------------------------------------ kernels, by the table


def _calls(family: type, part: str) -> Any:
    """Calls what a kind of a family has for a part."""
    return by_kind({kind_of(one): vars(one)[part] for one in ELEMENTS if _has(one, family, part)})


def _has(element: ElementKind, family: type, part: str) -> bool:
    return isinstance(element, family) and vars(element)[part] is not None


def _kinds(*which: bool) -> NDArray[np.bool_]:
    return np.array(which, bool)


_law = _calls(CoordinateLaw, "law")
_law_energy = _calls(CoordinateLaw, "energy")
_piece = _calls(CoordinateLaw, "piece")
_wrench = _calls(FrameElement, "wrench")
_variation = _calls(FrameElement, "variation")
_frame_energy = _calls(FrameElement, "energy")
_frame_memory = _calls(FrameElement, "remember")
_gap = _calls(FrameElement, "gap")
_push = _calls(PairsElement, "push")
_push_slope = _calls(PairsElement, "slope")
_subtract = _calls(GeneralisedForce, "subtract")
_subtract_tangent = _calls(GeneralisedForce, "subtract_tangent")
_force_energy = _calls(GeneralisedForce, "energy")
_slope = _calls(GeneralisedForce, "slope")
_changes_piece = _calls(GeneralisedForce, "changes_piece")

# by the numbers of kinds
_LAWS = _kinds(*(isinstance(one, CoordinateLaw) for one in ELEMENTS))
_BETWEEN_FRAMES = _kinds(*(isinstance(one, FrameElement | PairsElement | SurfaceElement) for one in ELEMENTS))
_OF_PAIRS = _kinds(*(isinstance(one, PairsElement) for one in ELEMENTS))
_SLOPED = _kinds(*(_has(one, PairsElement, "slope") for one in ELEMENTS))
_STORING_PAIRS = _kinds(*(isinstance(one, PairsElement) and one.stores for one in ELEMENTS))
_STORING_BETWEEN_FRAMES = _kinds(*(_has(one, FrameElement, "energy") for one in ELEMENTS))
_STATES = kind_of(STATES)
_OF_SURFACE = _kinds(*(isinstance(one, SurfaceElement) for one in ELEMENTS))
_CHANGING = _kinds(*(one.behaviour.changing for one in ELEMENTS))
_TOUCHING = _kinds(*(_has(one, FrameElement, "gap") for one in ELEMENTS))


@entry_kernel
def coordinate_law(plan, row, x, rate):
    """Force on a coordinate x (rad or m) and its derivatives by x and its rate, of a row that `is_coordinate_law`.

    Args:
        plan: Plan, the compiled scene.
        row: (N_ELEMENT,) int64, row of Plan.elements.
        x: float64, rad or m.
        rate: float64, rad/s or m/s.
    """
    return _law(row[at.EL_KIND], (plan, row, x, rate))


@kernel
def coordinate_energy(plan, row, x):
    """What a coordinate law stores (J)."""
    return _law_energy(row[at.EL_KIND], (plan, row, x))


@kernel
def law_piece(plan, row, x):
    """The piece of the law in which x lies, a number."""
    return _piece(row[at.EL_KIND], (plan, row, x))


@entry_kernel
def element_wrench(plan, work, row, d, R, rate, spin):
    """Force on G at G's origin and torque on G, in F's axes, of a row that `is_between_frames`.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        row: (N_ELEMENT,) int64, row of Plan.elements.
        d: three float64, m, p_FG_F.
        R: nine float64, R_FG by rows.
        rate: three float64, m/s, rate of d in F's axes.
        spin: three float64, rad/s, w_FG in F's axes.
    """
    return _wrench(row[at.EL_KIND], (plan, work, row, d, R, rate, spin))


@entry_kernel
def element_wrench_variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step):
    """Variation of `element_wrench` for d + dd, exp(dtheta) R, rate + drate, spin + dspin.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        row: (N_ELEMENT,) int64, row of Plan.elements.
        d: three float64, m, p_FG_F.
        R: nine float64, R_FG by rows.
        rate: three float64, m/s, rate of d in F's axes.
        spin: three float64, rad/s, w_FG in F's axes.
        dd: three float64, m, change of d.
        dtheta: three float64, rad, rotation of R, in F's axes.
        drate: three float64, m/s, change of rate.
        dspin: three float64, rad/s, change of spin.
        step: float64, share of the variation that a difference quotient takes, of laws without derivatives.
    """
    return _variation(row[at.EL_KIND], (plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step))


@kernel
def frame_energy(plan, work, row, d, R, rate, spin):
    """What an element between frames stores (J)."""
    return _frame_energy(row[at.EL_KIND], (plan, work, row, d, R, rate, spin))


@kernel
def write_frame_memory(plan, work, row, x, d, R, rate, spin, t):
    """Write into x (nx,) what an element between frames remembers at t (s)."""
    _frame_memory(row[at.EL_KIND], (plan, work, row, x, d, R, rate, spin, t))


@kernel
def may_touch(kind):
    """Whether a kind is a contact, which sets in and lets go on the way."""
    return _TOUCHING[kind]


@kernel
def frame_gap(plan, row, d, R, rate, spin):
    """The gap (m) of an element that `may_touch`, and its rate (m/s)."""
    return _gap(row[at.EL_KIND], (plan, row, d, R, rate, spin))


@kernel
def is_of_pairs(kind):
    """Whether a kind acts between all pairs of a group of frames."""
    return _OF_PAIRS[kind]


@kernel
def is_of_surface(kind):
    """Whether a kind acts between a frame and the patches of an elastic body."""
    return _OF_SURFACE[kind]


@kernel
def stores_of_pairs(kind):
    """Whether such a kind stores energy."""
    return _STORING_PAIRS[kind]


@kernel
def pair_push(plan, work, row, i, j, r, rate):
    """The force (N) that pushes frames i and j of a group apart, and what it stores (J)."""
    return _push(row[at.EL_KIND], (plan, work, row, i, j, r, rate))


@kernel
def pair_slope(plan, work, row, i, j, r):
    """Whether the derivative of that force by r (N/m) is known, and the derivative."""
    return _SLOPED[row[at.EL_KIND]], _push_slope(row[at.EL_KIND], (plan, work, row, i, j, r))


@kernel
def subtract_force(plan, work, row, x, v, out):
    """Subtract generalised forces, of a row that is neither of the two."""
    _subtract(row[at.EL_KIND], (plan, work, row, x, v, out))


@kernel
def subtract_force_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix):
    """Subtract their weighted derivatives."""
    _subtract_tangent(row[at.EL_KIND], (plan, work, tw, row, x, v, per_x, per_v, matrix))


@kernel
def force_energy(plan, work, row, x):
    """What they store (J)."""
    return _force_energy(row[at.EL_KIND], (plan, work, row, x))


@kernel
def force_slope(plan, work, row, x, v, size):
    """Derivative of a force on a coordinate x by it, of a row that `changes` and is no coordinate law."""
    return _slope(row[at.EL_KIND], (plan, work, row, x, v, size))


@kernel
def force_changes_piece(plan, work, row, x, v):
    """Whether a step that ends at (x, v) leads onto another piece of a law with memory."""
    return _changes_piece(row[at.EL_KIND], (plan, work, row, x, v))


@kernel
def is_coordinate_law(kind):
    """Whether a kind is a law on one coordinate."""
    return _LAWS[kind]


@kernel
def is_between_frames(kind):
    """Whether a kind acts between two frames, between those of a group, or on patches."""
    return _BETWEEN_FRAMES[kind]


@kernel
def is_state_equations(kind):
    """Whether a kind is users' state equations, whose outputs set functions of time."""
    return kind == _STATES


@kernel
def changes(kind):
    """Whether the stiffness on an element's coordinate may change on the way."""
    return _CHANGING[kind]


@kernel
def stores_between_frames(kind):
    """Whether an element between frames stores energy."""
    return _STORING_BETWEEN_FRAMES[kind]
