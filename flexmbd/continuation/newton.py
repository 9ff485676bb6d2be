"""Newton's method: how corrections follow each other, when they end and when they are given up; the only one there is.

What is solved says how it is corrected and moved (`NewtonProblem`); users of the method say in their own words what
fails where.  Machines' equilibria and loops, bodies' steps and points of paths are found from here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Generic, Protocol, TypeVar, cast

import numpy as np

from flexmbd.continuation.space import AnyPoint, PathDirection, PathSpace
from flexmbd.errors import ConvergenceError

CLOSE = 1e-7  # rad, of the extent or of the range: after a correction of this size the next one is round-off
SETTLED = 1e-9  #: rad, or of the extent: the same where no digit is to be left open, as in a single equilibrium
_GROWS = 2.0  # corrections that grow by more do not converge
_ASTRAY = 0.4  # of a step: the largest first correction of it; along an arc of 0.8 rad it is that

#: Goes on by a change, in iteration 1, 2, ..: the point there if it is in balance, else the next correction.  The last
#: argument is whether the change was a correction so small that its end is in balance but for round-off.
Iterate = Callable[[PathDirection, int, bool], AnyPoint | PathDirection]

AnyPlace = TypeVar("AnyPlace")
AnyChange = TypeVar("AnyChange")


@dataclass(frozen=True, eq=False)
class Correction(Generic[AnyChange]):
    """What the linear equations give at a place.

    Attributes:
        change: of the place.
        size: of it, in the measure of what is solved.
        share: of it that is to be gone at most.
        scale: of the sizes, in units of which a correction is small.
        ends: whether a small one leads to what is looked for, as it does not from where a machine is unstable.
    """

    change: AnyChange
    size: float
    share: float = 1.0
    scale: float = 1.0
    ends: bool = True


class NewtonProblem(Protocol[AnyPlace, AnyChange]):
    """Equations that are solved by Newton's method. Of what is spread over ranks all calls are collective."""

    def is_solved(self, here: AnyPlace, *, close: bool) -> bool:
        """Whether a place is a solution; ``close``: the correction that led there left round-off alone."""

    def correction(self, here: AnyPlace) -> Correction[AnyChange]:
        """Newton's step from a place."""

    def moved(self, here: AnyPlace, correction: Correction[AnyChange], *, close: bool) -> AnyPlace:
        """The place after a step, or after less of it where a search along it says so; none where it is ``close``."""


class NewtonEnd(Enum):
    """Why Newton's method ended.

    Attributes:
        SOLVED: at a solution.
        GROWN: a correction grew, or was no number.
        MOST: after as many corrections as were allowed.
    """

    SOLVED = "solved"
    GROWN = "grown"
    MOST = "most"


@dataclass(frozen=True, eq=False)
class Iterated(Generic[AnyPlace]):
    """Where Newton's method ended.

    Attributes:
        place: the last one.
        end: why.
        iterations: corrections that were gone.
    """

    place: AnyPlace
    end: NewtonEnd
    iterations: int

    @property
    def is_solution(self) -> bool:
        """Whether it is what was looked for."""
        return self.end is NewtonEnd.SOLVED


def newton(
    problem: NewtonProblem[AnyPlace, AnyChange],
    start: AnyPlace,
    *,
    most: int,
    close: float,
    grows: float = np.inf,
) -> Iterated[AnyPlace]:
    """Go on by Newton's corrections.

    Args:
        problem: the equations.
        start: where to begin.
        most: corrections at most.
        close: a correction of this size is the last one but for round-off.
        grows: a correction so many times as large as the one before is given up, unless it is close.
    """
    here, before, is_close = start, np.inf, False
    for iterations in range(most + 1):
        if problem.is_solved(here, close=is_close):
            return Iterated(here, NewtonEnd.SOLVED, iterations)
        if iterations == most:
            break
        found = problem.correction(here)
        is_small = found.size <= close * found.scale
        if not np.isfinite(found.size) or (found.size > grows * before and not is_small):
            return Iterated(here, NewtonEnd.GROWN, iterations)
        is_close = found.ends and is_small
        here, before = problem.moved(here, found, close=is_close), found.size
    return Iterated(here, NewtonEnd.MOST, most)


class _Corrections(Generic[AnyPoint]):
    """Corrections of a step along a path: a place is the point, or the next correction where that is not in balance."""

    def __init__(self, space: PathSpace[AnyPoint], step: PathDirection, iterate: Iterate[AnyPoint]) -> None:
        self._space, self._step, self._iterate, self._count = space, step, iterate, 0

    def after(self, change: PathDirection, *, close: bool) -> AnyPoint | PathDirection:
        self._count += 1
        return self._iterate(change, self._count, close)

    def is_solved(self, here: AnyPoint | PathDirection, *, close: bool) -> bool:
        return not isinstance(here, PathDirection)

    def correction(self, here: AnyPoint | PathDirection) -> Correction[PathDirection]:
        change = cast(PathDirection, here)  # or it would be solved
        size = self._space.largest(change)
        if self._count == 1 and size > CLOSE and is_astray(self._space, change, self._step):
            raise ConvergenceError("Newton's method leads to another path")
        return Correction(change, size)

    def moved(
        self, here: AnyPoint | PathDirection, correction: Correction[PathDirection], *, close: bool
    ) -> AnyPoint | PathDirection:
        return self.after(correction.change, close=close)


def corrected(space: PathSpace[AnyPoint], step: PathDirection, iterate: Iterate[AnyPoint], *, most: int) -> AnyPoint:
    """The point to which Newton's corrections lead from the end of a step, after as many iterations at most.

    Raises:
        ConvergenceError: the first correction is so large that it leads to another path, a later one grows, or there is
            no balance after the last iteration.
    """
    corrections = _Corrections(space, step, iterate)
    first = corrections.after(step, close=False)
    found = newton(corrections, first, most=most - 1, close=CLOSE, grows=_GROWS).place
    if isinstance(found, PathDirection):
        raise ConvergenceError("Newton's method does not converge")
    return found


def is_astray(space: PathSpace[AnyPoint], correction: PathDirection, step: PathDirection) -> bool:
    """Whether what is beside the end of a step is so far from it, by the step's length, that another path is there."""
    return space.product(correction, correction) > _ASTRAY**2 * space.product(step, step) > 0.0
