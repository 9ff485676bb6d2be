"""Following a path of equilibria by predictor and corrector, with steps as long as the path is straight."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from enum import Enum

import numpy as np

from flexmbd.continuation.closing import closed
from flexmbd.continuation.crossing import PathCrossing
from flexmbd.continuation.request import Bounds
from flexmbd.continuation.space import AnyPoint, PathSpace, until
from flexmbd.continuation.station import Station, Stretch, angle, station
from flexmbd.errors import ConvergenceError, PathWarning, warn

_FIRST = 0.5  # of the longest step: the first one
_SHORTEST = 1e-8  # rad, of the extent or of the range
_BEND = 0.3  # rad, between tangents: what a step aims at
_SHARP = 0.8  # rad: a step that bends by more is taken again, shorter
_KINK, _SAME = 3, 0.99  # lengths of a step over which a bend stays as it is, to this share: the path has a corner there
_AHEAD = 1.2  # steps: a bound so near ends the step
_TRIES = 6  # halvings of a step in which a critical point cannot be located
_USUAL = 6  # iterations: a step that takes more makes the next one shorter


class PathEnd(Enum):
    """Why a path ends.

    Attributes:
        REACHED: at the factor that was asked for.
        CLOSED: it has come back to where it began, in the same direction, without reaching it.
        TURNED_BACK: the factor has come back to the bound on the other side, and never reached the one asked for.
        POINTS: after as many points as were allowed.
        LOST: no further equilibrium was found, however short the step (`PathError`).
    """

    REACHED = "reached"
    CLOSED = "closed"
    TURNED_BACK = "turned back"
    POINTS = "points"
    LOST = "lost"


#: The critical points of a stretch; ConvergenceError where they cannot be located.
Locate = Callable[[PathSpace[AnyPoint], Stretch[AnyPoint]], Sequence[PathCrossing[AnyPoint]]]


def follow(
    space: PathSpace[AnyPoint], first: Station[AnyPoint], bounds: Bounds, *, locate: Locate[AnyPoint] | None = None
) -> Iterator[Stretch[AnyPoint]]:
    """The stretches of a path, up to a bound, once round if it is closed, or as many as there may be.

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
    here, share = first, _FIRST * _longest_share(space, first, bounds)
    for _ in range(bounds.points - 1):
        share = min(share, _longest_share(space, here, bounds))
        stretch, tries, bends = None, 0, _Bends()
        while stretch is None:
            if not share * space.largest(here.tangent) >= _SHORTEST:  # nor is a tangent that is no number
                raise ConvergenceError(
                    f"the path of equilibria cannot be followed beyond the factor {here.point.factor:.6g}: however "
                    "short the step, Newton's method finds no equilibrium; forces or stiffnesses jump there, or a "
                    "motion is held by nothing"
                )
            stretch = bends.gentle(space, _stretch(space, here, bounds, share))
            if stretch is not None:
                stretch = closed(space, first, stretch) or stretch
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
        if bends.corner:  # another path begins
            share = _FIRST * _longest_share(space, here, bounds)
        if stretch.closes or here.point.factor in (bounds.to, bounds.back_to):
            return


def _longest_share(space: PathSpace[AnyPoint], here: Station[AnyPoint], bounds: Bounds) -> float:
    """How many tangents the longest step has; none of a tangent without length, as of a path without a direction."""
    size = space.largest(here.tangent)
    return bounds.longest / size if size != 0.0 else 0.0


def found_end(factors: Sequence[float], met: Sequence[float], bounds: Bounds, *, closes: bool) -> PathEnd:
    """Why a path ended, by the factors of its points and of the critical ones; warns unless it reached its goal.

    Warns:
        PathWarning: it is closed, turned back, or was broken off.
    """
    last, to, back_to = factors[-1], bounds.to, bounds.back_to
    if last == to:
        return PathEnd.REACHED
    most = (max if to > back_to else min)([*factors, *met])
    if closes:
        end = PathEnd.CLOSED
        told = f"is closed: after {len(factors)} points it came back to where it began, the factor {last:.6g}"
        told += f", having come as near to {to:.6g} as {most:.6g}"
    elif last == back_to:
        end = PathEnd.TURNED_BACK
        told = f"turned at the factor {most:.6g}, came back to {back_to:.6g} and ends there"
        told += f": it never reached {to:.6g}; back_to= lets it go on"
    else:
        end = PathEnd.POINTS
        told = f"was broken off after {len(factors)} points at the factor {last:.6g}, on the way to {to:.6g}"
        told += f", of which it came as near as {most:.6g}; most_points= lets it go on"
    warn(f"the path of equilibria {told}", PathWarning)
    return end


class _Bends:
    """The bends of steps of falling length from one station.

    A path that is smooth bends by half as much over half a step.  One that has a corner, as where bodies come to touch,
    bends by as much over any step that goes past it: once it lies close behind the station it is gone past.
    """

    def __init__(self) -> None:
        self._last, self._alike = 0.0, 0

    @property
    def corner(self) -> bool:
        """Whether the path has one behind the station."""
        return self._alike >= _KINK

    def gentle(self, space: PathSpace[AnyPoint], stretch: Stretch[AnyPoint] | None) -> Stretch[AnyPoint] | None:
        """The stretch, if it does not bend too much, or turns a corner."""
        if stretch is None:
            self._alike = 0
            return None
        bend = angle(space, stretch.before, stretch.after)
        if bend <= _SHARP:
            return stretch
        self._alike = self._alike + 1 if bend >= _SAME * self._last and self._alike else 1
        self._last = bend
        return stretch if self.corner else None


def _stretch(
    space: PathSpace[AnyPoint], here: Station[AnyPoint], bounds: Bounds, share: float
) -> Stretch[AnyPoint] | None:
    """A step of some length, which ends at a bound if it would pass one; None if it fails."""
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
    return Stretch(here, after, step, across)


def _growth(space: PathSpace[AnyPoint], stretch: Stretch[AnyPoint]) -> float:
    """By what the next step is longer."""
    by_bend = _BEND / max(angle(space, stretch.before, stretch.after), 1e-3)
    by_effort = 2.0 ** (0.5 * (_USUAL - stretch.after.point.iterations))
    return float(np.clip(min(by_bend, by_effort), 0.5, 2.0))
