"""How much of a step is gone: all of it if that is good, else less and less."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from flexmbd.errors import FlexmbdError

AnyPlace = TypeVar("AnyPlace")

_HALF = 0.5  # of a share that failed: the next one
_LEAST = 0.1  # of a share: the next one at least


@dataclass(frozen=True, eq=False)
class ShareTrial(Generic[AnyPlace]):
    """What a share of a step leads to.

    Attributes:
        place: there.
        share: of the step.
        excess: by how much it is worse than it may be; none, or less, where it is good.
        then: of the share, what is tried next where it is not.
    """

    place: AnyPlace
    share: float
    excess: float
    then: float = _HALF


def searched(
    trial: Callable[[float], ShareTrial[AnyPlace]], *, most: int, fails: tuple[type[FlexmbdError], ...] = ()
) -> ShareTrial[AnyPlace]:
    """The first good trial of a step, or the best of as many as there may be.

    Args:
        trial: of a share of the step.
        most: trials.
        fails: errors that say that there is nothing at a share, for which it is halved.

    Raises:
        FlexmbdError: the last of ``fails``, where no share leads anywhere.
    """
    share, best, failure = 1.0, None, FlexmbdError("no share of the step was tried")
    for _ in range(most):
        try:
            found = trial(share)
        except fails as reason:
            share, failure = _HALF * share, reason
            continue
        if best is None or found.excess < best.excess:
            best = found
        if found.excess <= 0.0:
            break
        share *= found.then
    if best is None:
        raise failure
    return best


def by_work(place: AnyPlace, share: float, *, work: float, before: float, ratio: float) -> ShareTrial[AnyPlace]:
    """A trial that is good where the forces do no more work on the step than a ratio of that at its beginning.

    Args:
        place: at a share of the step.
        share: of it.
        work: of the forces that are out of balance there on the whole step, of whatever sign.
        before: the same at its beginning.
        ratio: below 1.
    """
    excess = abs(work) - ratio * abs(before)
    if work * before >= 0.0:
        return ShareTrial(place, share, excess)
    # where the work would vanish if it were linear in the share
    return ShareTrial(place, share, excess, min(max(before / (before - work), _LEAST), _HALF))
