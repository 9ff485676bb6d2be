"""What a path of equilibria runs through: configurations and load factors, with a product of their changes.

A change of the configuration is an array xi whose meaning is its space's; <a, b> = sum_i w_i xi_a,i xi_b,i +
f_a f_b / width^2 with the factor's range, and weights w by which coordinates of all units count alike, and all of them
as much as the factor (`typical_motion`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ConvergenceError, SceneError
from flexmbd.round_off import EPSILON

FloatArray = NDArray[np.float64]

ALIKE = 1e-6  #: of what is remembered at two points: what may differ as they are one
APART = EPSILON ** (1.0 / 3.0)  #: rad, of the extent or the range: between points of a difference of stiffnesses
LOAD_DIFFERENCE = 1e-4  #: of the range of factors: over how much loads are differenced; exact of loads in proportion


@dataclass(frozen=True, eq=False)
class PathDirection:
    """A direction in configurations and factors.

    Attributes:
        xi: (n,) change of the configuration.
        factor: change of the factor.
    """

    xi: FloatArray
    factor: float

    def times(self, share: float) -> PathDirection:
        """Scaled."""
        return PathDirection(share * self.xi, share * self.factor)

    def plus(self, other: PathDirection) -> PathDirection:
        """The sum."""
        return PathDirection(self.xi + other.xi, self.factor + other.factor)


class PathPoint(Protocol):
    """An equilibrium on a path."""

    @property
    def factor(self) -> float:
        """Of the load."""

    @property
    def iterations(self) -> int:
        """Of Newton's method that led there."""


class PathSpectrum(Protocol):
    """Eigenvalues of the tangent stiffness at an equilibrium, ascending."""

    @property
    def unstable(self) -> int:
        """How many independent motions grow."""

    @property
    def has_potential(self) -> bool:
        """Whether the stiffness is symmetric."""

    @property
    def gives_way(self) -> bool:
        """Whether nothing resists some motion, up to round-off."""

    @property
    def round_off(self) -> float:
        """What is left of an eigenvalue that is zero."""

    @property
    def sign(self) -> float:
        """Of the product of all eigenvalues."""

    def smallest(self) -> float:
        """The size of the one next to zero."""

    def eigenvalue(self, k: int) -> float:
        """The real part of one of them."""

    def nearest(self) -> int:
        """Which of them is the smallest in size."""

    def mode(self, k: int) -> FloatArray:
        """(n,) its eigenvector, as a change of the configuration."""

    def flutter_mode(self) -> FloatArray | None:
        """(n,) that of the two eigenvalues that became complex last, its real part; None where none are complex."""


AnyPoint = TypeVar("AnyPoint", bound=PathPoint)


class PathSpace(Protocol[AnyPoint]):
    """A machine, or a body, under loads that follow one factor. Of a body on several ranks all calls are collective."""

    @property
    def width(self) -> float:
        """Of the range of factors."""

    def product(self, a: PathDirection, b: PathDirection) -> float:
        """<a, b>."""

    def largest(self, a: PathDirection) -> float:
        """Largest part: rad, of the extent, or of the range of factors."""

    def along_factor(self, sign: float) -> PathDirection:
        """The factor's own direction, of length one."""

    def difference(self, before: AnyPoint, after: AnyPoint) -> PathDirection:
        """The change from one point to another."""

    def remember_alike(self, one: AnyPoint, other: AnyPoint) -> bool:
        """Whether what has a memory remembers the same at two points, up to round-off."""

    def sized(self, mode: FloatArray) -> FloatArray:
        """(n,) a mode whose largest part is 1 rad, or the extent."""

    def tangent(self, here: AnyPoint, onwards: PathDirection) -> PathDirection:
        """Unit tangent of the path at a point, on the side of a direction."""

    def spectrum(self, here: AnyPoint) -> PathSpectrum:
        """Of its stiffness."""

    def other_path(self, here: AnyPoint, mode: PathDirection, tangent: PathDirection) -> PathDirection:
        """Unit direction of the path that crosses another one at a bifurcation."""

    def correct(
        self, start: AnyPoint, step: PathDirection, across: PathDirection, *, undetermined: int = 0
    ) -> AnyPoint:
        """The equilibrium in the plane through the end of a step that is normal to ``across``.

        So near to a bifurcation that round-off moves it along the modes, corrections leave out as many directions as
        are ``undetermined``.

        Raises:
            ConvergenceError: Newton's method does not converge.
            SceneError: what moves cannot be placed there.
        """

    def remembered(self, here: AnyPoint, factor: float) -> AnyPoint:
        """The point, accepted, its factor rounded to the given one, with what elements with memory note of it."""


def typical_motion(space: PathSpace[AnyPoint], tangent: PathDirection) -> float:
    """What motions come to, of their sizes, along a tangent over the range of factors; 1 where that is more.

    A shallow arch snaps through by a hundredth of its span: with motions in its extent beside factors in their range
    the path would look straight wherever it bends.
    """
    if tangent.factor == 0.0:
        return 1.0
    over_the_range = space.largest(PathDirection(tangent.xi * (space.width / tangent.factor), 0.0))
    return min(1.0, over_the_range) or 1.0


def unit(space: PathSpace[AnyPoint], a: PathDirection) -> PathDirection:
    """A direction over its length."""
    return a.times(1.0 / np.sqrt(space.product(a, a)))


def until(found: Callable[[], AnyPoint]) -> AnyPoint | None:
    """A point, or None where there is none: Newton's method fails, loops do not close, rows become singular."""
    try:
        return found()
    except (ConvergenceError, SceneError, np.linalg.LinAlgError):
        return None
