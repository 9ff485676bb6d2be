"""The other path through a bifurcation, or the same one beyond a limit point."""

from __future__ import annotations

from functools import partial

from flexmbd.continuation.crossing import CriticalKind
from flexmbd.continuation.request import Continuation, bounds_of
from flexmbd.continuation.space import AnyPoint, FloatArray, PathDirection, PathSpace, unit, until
from flexmbd.continuation.station import Station, station
from flexmbd.errors import SceneError

_HALVINGS = 20


def beside(
    space: PathSpace[AnyPoint],
    there: AnyPoint,
    path: Continuation,
    *,
    kind: CriticalKind,
    mode: FloatArray,
    tangent: PathDirection,
) -> Station[AnyPoint]:
    """A station beside a critical point, before the factor at which the path is to end.

    Args:
        space: that the path runs through.
        there: the critical point.
        path: how it is followed: to which side, in steps of what length.
        kind: what happens there.
        mode: (n,) in which it gives way.
        tangent: of the path that it was found on, of any length: other ranges of factors have other units.

    Raises:
        SceneError: none is found.
    """
    along = unit(space, tangent)
    direction = across = along
    if kind is CriticalKind.BIFURCATION:
        direction = space.other_path(there, PathDirection(mode, 0.0), along)
        # no point of the first path lies in a plane along it
        across = unit(space, direction.plus(along.times(-space.product(direction, along))))
    direction, across = direction.times(float(path.side)), across.times(float(path.side))
    share, bounds = path.longest_step / space.largest(direction), bounds_of(path, begin=there.factor)
    for _ in range(_HALVINGS):
        point = until(partial(space.correct, there, direction.times(share), across))
        if point is not None and bounds.passed(there.factor, point.factor) is None:
            found = station(space, space.remembered(point, point.factor), direction)
            if space.product(found.tangent, direction) > 0.5:
                return found
        share *= 0.5
    raise SceneError(
        f"no other path was found from the {kind.value} at the factor {there.factor:.6g} along its mode; several "
        "modes may meet there: take a smaller longest_step, or disturb what bends by a small force"
    )
