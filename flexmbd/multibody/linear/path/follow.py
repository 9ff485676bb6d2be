"""Following a path of equilibria by predictor and corrector, with steps as long as the path is straight."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.linear.path.corrector import PathDirection, PathPoint, PathSpace, until
from flexmbd.multibody.linear.stability import MotionSpectrum

_FIRST = 0.25  # of the longest step: the first one
_SHORTEST = 1e-8  # rad, of the extent or of the range
_BEND = 0.3  # rad, between tangents: what a step aims at
_SHARP = 0.8  # rad: a step that bends by more is taken again, shorter
_AHEAD = 1.2  # steps: a bound so near ends the step
_USUAL = 6  # iterations: a step that takes more makes the next one shorter


class PathEnd(Enum):
    """Why a path ends.

    Attributes:
        REACHED: at the factor that was asked for.
        TURNED_BACK: the factor has come back to the bound on the other side, and never reached the one asked for.
        POINTS: after as many points as were allowed.
    """

    REACHED = "reached"
    TURNED_BACK = "turned back"
    POINTS = "points"


@dataclass(frozen=True)
class Bounds:
    """Where a path ends, and how long its steps may be.

    Attributes:
        to: factor to be reached.
        back_to: factor on the other side of the start at which it is given up.
        longest: step: rad, of the machine's extent, and of the range of factors.
        points: at most.
    """

    to: float
    back_to: float
    longest: float
    points: int

    def passed(self, before: float, after: float) -> float | None:
        """The bound that lies between two factors, if one does."""
        for bound in (self.to, self.back_to):
            if (before - bound) * (after - bound) <= 0.0 and before != bound:
                return bound
        return None


@dataclass(frozen=True, eq=False)
class Station:
    """A point of a path with its tangent and the spectrum of its stiffness."""

    point: PathPoint
    tangent: PathDirection
    spectrum: MotionSpectrum


@dataclass(frozen=True, eq=False)
class Stretch:
    """A step of a path, from one station to the next.

    Attributes:
        before, after: its ends.
        step: that led from one to the other.
        across: what corrections were normal to.
    """

    before: Station
    after: Station
    step: PathDirection
    across: PathDirection


def station(space: PathSpace, point: PathPoint, onwards: PathDirection) -> Station:
    """A point with its tangent on the side of a direction."""
    return Station(point, space.tangent(point, onwards), space.spectrum(point))


def follow(space: PathSpace, first: Station, bounds: Bounds) -> Iterator[Stretch]:
    """The stretches of a path, up to a bound or as many as there may be.

    Raises:
        SceneError: however short the step is, no equilibrium is found.
    """
    here, share = first, _FIRST
    for _ in range(bounds.points - 1):
        share = min(share, bounds.longest / space.largest(here.tangent))
        stretch = None
        while stretch is None:
            if share * space.largest(here.tangent) < _SHORTEST:
                raise SceneError(
                    f"the path of equilibria cannot be followed beyond the factor {here.point.factor:.6g}: however "
                    "short the step, Newton's method finds no equilibrium; forces or stiffnesses jump there, or a "
                    "motion is held by nothing"
                )
            stretch = _stretch(space, here, bounds, share)
            share *= 0.5 if stretch is None else _growth(space, stretch)
        yield stretch
        here = stretch.after
        if here.point.factor in (bounds.to, bounds.back_to):
            return


def _stretch(space: PathSpace, here: Station, bounds: Bounds, share: float) -> Stretch | None:
    """A step of some length, which ends at a bound if it would pass one; None if it fails or bends too much."""
    step, across, before = here.tangent.times(share), here.tangent, here.point.factor
    bound = bounds.passed(before, before + _AHEAD * step.factor)  # rather than to leave a little for the next
    if bound is not None:
        step = here.tangent.times((bound - before) / here.tangent.factor)
        across = space.along_factor(np.sign(step.factor))
    point = until(lambda: space.correct(here.point, step, across))
    if point is None:
        return None
    if bound is not None:
        point = replace(point, factor=bound)
    elif bounds.passed(before, point.factor) is not None:
        return None
    after = station(space, space.remembered(point), here.tangent)
    return Stretch(here, after, step, across) if _angle(space, here, after) <= _SHARP else None


def _angle(space: PathSpace, a: Station, b: Station) -> float:
    return float(np.arccos(np.clip(space.product(a.tangent, b.tangent), -1.0, 1.0)))


def _growth(space: PathSpace, stretch: Stretch) -> float:
    """By what the next step is longer."""
    angle = _angle(space, stretch.before, stretch.after)
    by_bend = _BEND / max(angle, 1e-3)
    by_effort = 2.0 ** (0.5 * (_USUAL - stretch.after.point.iterations))
    return float(np.clip(min(by_bend, by_effort), 0.5, 2.0))
