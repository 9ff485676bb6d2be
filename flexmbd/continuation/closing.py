"""Paths that come back to where they began: closed ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmbd.continuation.newton import is_astray
from flexmbd.continuation.space import AnyPoint, PathDirection, PathSpace, until
from flexmbd.continuation.station import Station, Stretch, angle, station

_SAME = 1e-5  # of a step: how far apart Newton's method leaves what it finds of one point
_SAME_WAY = 0.1  # rad: how far apart the tangents there; paths that cross part by more


def closed(
    space: PathSpace[AnyPoint], first: Station[AnyPoint], stretch: Stretch[AnyPoint]
) -> Stretch[AnyPoint] | None:
    """The part of a stretch up to where a path began, if it comes back to there in the same direction.

    The path's own point is found in the plane through its beginning, by a step along the stretch: where the path only
    passes near, that is another point.
    """
    if stretch.before is first:
        return None
    part = _part(space, first, stretch)
    if part is None:
        return None
    step = stretch.step.times(part)
    found = until(lambda: space.correct(stretch.before.point, step, stretch.across))
    if found is None or not _same(space, found, first.point, stretch.step):
        return None
    accepted = until(lambda: space.remembered(found, first.point.factor))
    if accepted is None or not space.remember_alike(accepted, first.point):
        return None
    end = station(space, accepted, stretch.before.tangent)
    if angle(space, end, first) > _SAME_WAY:
        return None
    return replace(stretch, after=end, step=step, closes=True)


def _part(space: PathSpace[AnyPoint], first: Station[AnyPoint], stretch: Stretch[AnyPoint]) -> float | None:
    """Of the stretch's step, at which it comes as far as the path's beginning; None where that is not beside it."""
    gap, step = space.difference(stretch.before.point, first.point), stretch.step
    part = space.product(stretch.across, gap) / space.product(stretch.across, step)
    if not 0.0 < part <= 1.0 + _SAME:
        return None
    return None if is_astray(space, gap.plus(step.times(-part)), step) else part


def _same(space: PathSpace[AnyPoint], one: AnyPoint, other: AnyPoint, step: PathDirection) -> bool:
    apart = space.difference(one, other)
    return bool(np.sqrt(space.product(apart, apart)) <= _SAME * np.sqrt(space.product(step, step)))
