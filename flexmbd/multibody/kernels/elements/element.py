"""What a force element says of itself: its functions, by what it acts on, and what integrators must know of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Stiffness(Enum):
    """How fast the vibrations may be that an element makes.

    Attributes:
        NONE: it makes none: a given force, or one of bounded size.
        SEEN: as fast as the tangent at the start shows.
        UNSEEN: perhaps much faster than at the start: a user's function, or a penalty.
    """

    NONE = 0
    SEEN = 1
    UNSEEN = 2


@dataclass(frozen=True)
class Behaviour:
    """What integrators, and whoever else does not evaluate it, must know of a kind of element.

    Attributes:
        name: in words, in the plural.
        stiffness: how fast the vibrations are that it makes.
        grip: of a force that sets in and lets go, or reverses, within a step: (its numbers, a load > 0 in N or N m) ->
            the stiffness and damping at which it bears that load; what remains of both where it lets it go.
        changing: whether the stiffness on its coordinate may change on the way, as that of a stop does.
        given: whether it follows functions of time alone, so that it may be an input of a linear machine.
        calls_user: whether it calls a function of the user at each evaluation.
        drives: whether it counts among what drives joints, as a motor does and a spring does not.
        spring: its numbers that make it elastic, the first and how many: zeros are a damper alone; none: it always is.
        damper: its numbers that make it dissipate, the first and how many: without them it stores all that it takes.
        lets_go: whether it is no spring that lasts, as a contact is, so that what swings fast on it is a blow and no
            vibration: all of its error counts.
        hard: whether it is no force but a contact that a method solves for by impulses.
        undefined: where it gives no finite number what that means, and a remedy; empty of users' functions.
        remembers: whether it has a memory, so that what it stores hangs on the way and not on where it is alone.
    """

    name: str
    stiffness: Stiffness = Stiffness.NONE
    grip: Callable[[FloatArray, float], tuple[float, float]] | None = None
    changing: bool = False
    given: bool = False
    calls_user: bool = False
    drives: bool = False
    spring: tuple[int, int] = (0, 0)
    damper: tuple[int, int] = (0, 0)
    remembers: bool = False
    lets_go: bool = False
    hard: bool = False
    undefined: str = ""


@dataclass(frozen=True, eq=False)
class CoordinateLaw:
    """A force on one coordinate (rad or m) that follows from it and its rate.

    Attributes:
        behaviour: what integrators must know.
        law: (plan, row, x, rate) -> force on the coordinate, its derivative by x, by the rate.
        energy: (plan, row, x) -> J that it stores; None where it stores nothing.
        piece: (plan, row, x) -> the number of the piece of the law in which x lies; None where it is smooth.
        misplaced: (numbers, x) -> a complaint where a start at x does not suit these parameters, else nothing.
    """

    behaviour: Behaviour
    law: Any
    energy: Any = None
    piece: Any = None
    misplaced: Callable[[FloatArray, float], str] | None = None


@dataclass(frozen=True, eq=False)
class FrameElement:
    """A wrench between frames F and G, by the motion of G against F in F's axes.

    d = p_FG_F (m), R = R_FG, ``rate`` of d (m/s), ``spin`` the angular velocity of G against F (rad/s).

    Attributes:
        behaviour: what integrators must know.
        wrench: (plan, work, row, d, R, rate, spin) -> force on G at G's origin, torque on G, in F's axes (N, N m); F
            gets the opposite.
        variation: (plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step) -> change of both for d + dd,
            exp(dtheta) R, rate + drate, spin + dspin; ``step`` is how much of that a difference should take.  None
            where the wrench keeps to F's axes whatever G does.
        energy: (plan, work, row, d, R, rate, spin) -> J that it stores; None where it stores nothing.
        remember: (plan, work, row, x, d, R, rate, spin, t) writes into the configuration x what it remembers at t (s);
            None where it has no memory.
        misplaced: (numbers, memory) -> a complaint where a start that wrote this memory does not suit these parameters,
            else nothing; of those that remember alone.
        gap: (plan, row, d, R, rate, spin) -> the gap (m), below zero where it bears, and its rate (m/s); of a force
            that sets in and lets go on the way alone.
    """

    behaviour: Behaviour
    wrench: Any
    variation: Any = None
    energy: Any = None
    remember: Any = None
    misplaced: Callable[[FloatArray, FloatArray], str] | None = None
    gap: Any = None


@dataclass(frozen=True, eq=False)
class GeneralisedForce:
    """Forces on any of the velocities.

    Attributes:
        behaviour: what integrators must know.
        subtract: (plan, work, row, x, v, out) subtracts them from ``out`` (nv,).
        subtract_tangent: (plan, work, tw, row, x, v, per_x, per_v, matrix) subtracts per_x times their derivatives by x
            and per_v times those by v from the ``matrix`` (nv, nv).  None where they have none.
        energy: (plan, work, row, x) -> J that they store; None where they store nothing.
        slope: (plan, work, row, x, v, size) -> derivative by its coordinate of a force on it, whose group's size is
            given; for those that are ``changing``.
        changes_piece: (plan, work, row, x, v) -> whether a step that ends there leads onto another piece of a law with
            memory; None where it has none.
        couples: whether ``subtract_tangent`` writes entries between bodies that move independently of each other.
    """

    behaviour: Behaviour
    subtract: Any
    subtract_tangent: Any = None
    energy: Any = None
    slope: Any = None
    changes_piece: Any = None
    couples: bool = True


@dataclass(frozen=True, eq=False)
class PairsElement:
    """Forces along the lines between the origins of all pairs of a group of frames (``elements.pairs``).

    Attributes:
        behaviour: what integrators must know.
        push: (plan, work, row, i, j, r, rate) -> the force (N) that pushes the group's frames i and j apart at the
            distance r (m), which grows by ``rate`` (m/s), and what the pair stores (J).
        slope: (plan, work, row, i, j, r) -> the derivative of a force by r alone.  None: by differences.
        stores: whether it stores energy.
    """

    behaviour: Behaviour
    push: Any
    slope: Any = None
    stores: bool = False

    @property
    def energy(self) -> Any:
        """What gives the energy, None where it stores nothing."""
        return self.push if self.stores else None


@dataclass(frozen=True, eq=False)
class SurfaceElement:
    """Forces between frame F and the patches of an elastic body, whose frame is G, on its modes too.

    Its kernels stand in ``elements.surface_forces``; there is one kind.

    Attributes:
        behaviour: what integrators must know.
        energy: what stores; for ``table.stores``.
    """

    behaviour: Behaviour
    energy: Any


ElementKind = CoordinateLaw | FrameElement | GeneralisedForce | PairsElement | SurfaceElement
