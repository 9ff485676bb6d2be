"""Following a path of equilibria by predictor and corrector, with steps as long as the path is straight."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Generic

import numpy as np

from flexmbd.continuation.crossing import PathCrossing
from flexmbd.continuation.request import Bounds
from flexmbd.continuation.space import AnyPoint, PathDirection, PathSpace, PathSpectrum, until
from flexmbd.errors import ConvergenceError, PathWarning, warn

_FIRST = 0.5  # of the longest step: the first one
_SHORTEST = 1e-8  # rad, of the extent or of the range
_BEND = 0.3  # rad, between tangents: what a step aims at
_SHARP = 0.8  # rad: a step that bends by more is taken again, shorter
_AHEAD = 1.2  # steps: a bound so near ends the step
_TRIES = 6  # halvings of a step in which a critical point cannot be located
_USUAL = 6  # iterations: a step that takes more makes the next one shorter


class PathEnd(Enum):
    """Why a path ends.

    Attributes:
        REACHED: at the factor that was asked for.
        TURNED_BACK: the factor has come back to the bound on the other side, and never reached the one asked for.
        POINTS: after as many points as were allowed.
        LOST: no further equilibrium was found, however short the step (`PathError`).
    """

    REACHED = "reached"
    TURNED_BACK = "turned back"
    POINTS = "points"
    LOST = "lost"


@dataclass(frozen=True, eq=False)
class Station(Generic[AnyPoint]):
    """A point of a path with its tangent and the spectrum of its stiffness."""

    point: AnyPoint
    tangent: PathDirection
    spectrum: PathSpectrum


@dataclass(frozen=True, eq=False)
class Stretch(Generic[AnyPoint]):
    """A step of a path, from one station to the next.

    Attributes:
        before, after: its ends.
        step: that led from one to the other.
        across: what corrections were normal to.
        met: the critical points on the way, in their order, where these are looked for.
    """

    before: Station[AnyPoint]
    after: Station[AnyPoint]
    step: PathDirection
    across: PathDirection
    met: Sequence[PathCrossing[AnyPoint]] = ()


#: The critical points of a stretch; ConvergenceError where they cannot be located.
Locate = Callable[[PathSpace[AnyPoint], Stretch[AnyPoint]], Sequence[PathCrossing[AnyPoint]]]


def station(space: PathSpace[AnyPoint], point: AnyPoint, onwards: PathDirection) -> Station[AnyPoint]:
    """A point with its tangent on the side of a direction."""
    return Station(point, space.tangent(point, onwards), space.spectrum(point))


def follow(
    space: PathSpace[AnyPoint], first: Station[AnyPoint], bounds: Bounds, *, locate: Locate[AnyPoint] | None = None
) -> Iterator[Stretch[AnyPoint]]:
    """The stretches of a path, up to a bound or as many as there may be.

    Args:
        space: that it runs through.
        first: where it begins, and to which side.
        bounds: where it ends.
        locate: the critical points of a stretch; a step in which they cannot be located is taken again, shorter.

    Raises:
        ConvergenceError: however short the step is, no equilibrium is found.

    Warns:
        PathWarning: critical points could not be located.
    """
    here, share = first, _FIRST * bounds.longest / space.largest(first.tangent)
    for _ in range(bounds.points - 1):
        share = min(share, bounds.longest / space.largest(here.tangent))
        stretch, tries = None, 0
        while stretch is None:
            if not share * space.largest(here.tangent) >= _SHORTEST:  # nor is a tangent that is no number
                raise ConvergenceError(
                    f"the path of equilibria cannot be followed beyond the factor {here.point.factor:.6g}: however "
                    "short the step, Newton's method finds no equilibrium; forces or stiffnesses jump there, or a "
                    "motion is held by nothing"
                )
            stretch = _stretch(space, here, bounds, share)
            if stretch is not None and locate is not None:
                try:
                    stretch = replace(stretch, met=locate(space, stretch))
                except ConvergenceError as reason:
                    if tries == _TRIES:
                        warn(f"{reason}; the path goes on without it", PathWarning)
                    else:
                        stretch, tries = None, tries + 1
            share *= 0.5 if stretch is None else _growth(space, stretch)
        yield stretch
        here = stretch.after
        if here.point.factor in (bounds.to, bounds.back_to):
            return


def found_end(factors: Sequence[float], met: Sequence[float], bounds: Bounds) -> PathEnd:
    """Why a path ended, by the factors of its points and of the critical ones; warns unless it reached its goal.

    Warns:
        PathWarning: it turned back, or was broken off.
    """
    last = factors[-1]
    if last == bounds.to:
        return PathEnd.REACHED
    most = (max if bounds.to > bounds.back_to else min)([*factors, *met])
    if last == bounds.back_to:
        warn(
            f"the path of equilibria turned at the factor {most:.6g}, came back to {bounds.back_to:.6g} and ends "
            f"there: it never reached {bounds.to:.6g}; back_to= lets it go on",
            PathWarning,
        )
        return PathEnd.TURNED_BACK
    warn(
        f"the path of equilibria was broken off after {len(factors)} points at the factor {last:.6g}, on the way "
        f"to {bounds.to:.6g}, of which it came as near as {most:.6g}; most_points= lets it go on",
        PathWarning,
    )
    return PathEnd.POINTS


def _stretch(
    space: PathSpace[AnyPoint], here: Station[AnyPoint], bounds: Bounds, share: float
) -> Stretch[AnyPoint] | None:
    """A step of some length, which ends at a bound if it would pass one; None if it fails or bends too much."""
    step, across, before = here.tangent.times(share), here.tangent, here.point.factor
    bound = bounds.passed(before, before + _AHEAD * step.factor)  # rather than to leave a little for the next
    if bound is not None:
        step = here.tangent.times((bound - before) / here.tangent.factor)
        across = space.along_factor(np.sign(step.factor))
    point = until(lambda: space.correct(here.point, step, across))
    if point is None:
        return None
    if bound is None and bounds.passed(before, point.factor) is not None:
        return None
    accepted = until(lambda: space.remembered(point, point.factor if bound is None else bound))
    if accepted is None:
        return None
    after = station(space, accepted, here.tangent)
    return Stretch(here, after, step, across) if _angle(space, here, after) <= _SHARP else None


def _angle(space: PathSpace[AnyPoint], a: Station[AnyPoint], b: Station[AnyPoint]) -> float:
    return float(np.arccos(np.clip(space.product(a.tangent, b.tangent), -1.0, 1.0)))


def _growth(space: PathSpace[AnyPoint], stretch: Stretch[AnyPoint]) -> float:
    """By what the next step is longer."""
    angle = _angle(space, stretch.before, stretch.after)
    by_bend = _BEND / max(angle, 1e-3)
    by_effort = 2.0 ** (0.5 * (_USUAL - stretch.after.point.iterations))
    return float(np.clip(min(by_bend, by_effort), 0.5, 2.0))
