"""What the surface of a body with history touches, as its interior is told: shapes, and surfaces of other bodies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.continuum_body import FrameMotion, Interior

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A rigid shape before the nodes of an interior's surface.

    Attributes:
        name: of the contact, in results and messages; unlike all others of the body.
        surface: the group of facets whose nodes touch it.
        frame: that carries the shape.
        distances: signed distances (m) and their gradients, (n, 4), of points (n, 3) m, in the frame's axes.
        box: (2, 3) m, corners in the frame's axes between which the shape is; infinite where it has no end.
        friction: Coulomb's coefficient.
        penalty: of explicit steps, dimensionless, as of a `RigidPlane`; None for none.
        stiffness_ratio: of implicit steps: the stiffness of contact over that which a node feels with its neighbours
            held.
        mass: (6, 6) of the body that carries it, about the frame's origin and in its axes, translations first; None of
            the ground, which nothing moves.
    """

    name: str
    surface: str
    frame: Frame
    distances: Callable[[FloatArray], FloatArray]
    box: FloatArray
    friction: float
    penalty: float | None
    stiffness_ratio: float
    mass: FloatArray | None


@dataclass(frozen=True, eq=False)
class FacingSurface:
    """A surface of another body with history before the nodes of an interior's surface.

    Attributes:
        name: of the contact, as of an `Obstacle`.
        surface: the group of facets whose nodes touch it.
        other: the interior of the other body.
        facets: the group of its facets that they touch.
        friction, penalty, stiffness_ratio: as of an `Obstacle`; the last one over what a node and the facets feel in
            series.
    """

    name: str
    surface: str
    other: Interior
    facets: str
    friction: float
    penalty: float
    stiffness_ratio: float


@dataclass(frozen=True, eq=False)
class ReducedFacets:
    """A surface of a reduced elastic body before the nodes of an interior's surface.

    A point X of it is at p + R (X + S y): the first frame, of c, stands at p, turned by R, and the others at
    p + R y_k with y of these three numbers each.  What forces on the points do to the frames follows by their virtual
    work.

    Attributes:
        name: of the contact, as of an `Obstacle`.
        surface: the group of facets whose nodes touch it.
        frames: (c,) the body's, and one of each three modes, which they move against it.
        points: (k, 3) m, undeformed, in the body's axes.
        shapes: (k, 3, 3 (c - 1)) S, in these axes, per unit displacement of the frames of modes.
        facets: (f, 3 or 4) rows of points, against the clock as seen from outside.
        mobility: (3 + 3 c, 3 + 3 c) the inverse of the undeformed body's mass matrix: translation and rotation of its
            frame, in its axes, then y.
        rate: 1/s^2, the body's largest squared angular frequency, free.
        friction, penalty, stiffness_ratio: as of an `Obstacle`.
    """

    name: str
    surface: str
    frames: tuple[Frame, ...]
    points: FloatArray
    shapes: FloatArray
    facets: NDArray[np.int64]
    mobility: FloatArray
    rate: float
    friction: float
    penalty: float
    stiffness_ratio: float


@runtime_checkable
class TouchingInterior(Interior, Protocol):
    """An interior whose surface touches rigid shapes.

    Wherever it is told of its frames' motion, those of the obstacles' frames follow its own, in the order of the
    obstacles; and the wrenches that it gives, and their derivatives, are on all of these frames.
    """

    def check_surface(self, surface: str, *, what: str) -> None:
        """Refuse a surface that it has not; ``what`` asks for it.  Collective.

        Raises:
            SceneError: names the surfaces that there are.
        """

    def meet(self, obstacles: Sequence[Obstacle]) -> None:
        """Take these obstacles, and no others, from the next ``begin`` or ``restore`` on.  Collective."""

    def face(self, facing: FacingSurface) -> None:
        """Let a surface touch one of another interior as well, after `meet` of both.  Collective.

        Raises:
            SceneError: interiors of their kinds do not touch each other.
        """


@runtime_checkable
class ReducedTouchingInterior(TouchingInterior, Protocol):
    """An interior whose surface touches reduced bodies as well.

    Their frames follow those of the obstacles, surface by surface.
    """

    def meet_reduced(self, surfaces: Sequence[ReducedFacets]) -> None:
        """Take these surfaces, after `meet`, and no others.  Collective."""


@runtime_checkable
class CoupledInterior(TouchingInterior, Protocol):
    """An interior that is solved for together with those that it faces, and with those that these face."""

    @property
    def beside(self) -> tuple[Interior, ...]:
        """The others.

        Their frames, each one's with those of what it touches, follow its own and those of what it touches, one body's
        after the other's; its wrenches on them are zero, its own ones have derivatives by their motions.
        """


@runtime_checkable
class PairedInterior(Protocol):
    """An interior that says where it will be at a step's end before any of them steps."""

    def plan(self, h: float, start: FrameMotion, end: FrameMotion) -> None:
        """Make ready for ``advance`` with the same arguments.  Collective."""
