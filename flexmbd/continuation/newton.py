"""Newton's corrections after a step along a path: when they end, and when they lead astray; for all spaces alike."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexmbd.continuation.space import AnyPoint, PathDirection, PathSpace
from flexmbd.errors import ConvergenceError

CLOSE = 1e-7  # rad, of the extent or of the range: after a correction of this size the next one is round-off
_GROWS = 2.0  # corrections that grow by more do not converge
_ASTRAY = 0.4  # of a step: the largest first correction of it; along an arc of 0.8 rad it is that

#: Goes on by a change, in iteration 1, 2, ..: the point there if it is in balance, else the next correction.  The last
#: argument is whether the change was a correction so small that its end is in balance but for round-off.
Iterate = Callable[[PathDirection, int, bool], AnyPoint | PathDirection]


def corrected(space: PathSpace[AnyPoint], step: PathDirection, iterate: Iterate[AnyPoint], *, most: int) -> AnyPoint:
    """The point to which Newton's corrections lead from the end of a step, after as many iterations at most.

    Raises:
        ConvergenceError: the first correction is so large that it leads to another path, a later one grows, or there is
            no balance after the last iteration.
    """
    change, close = step, False
    for iteration in range(1, most + 1):
        found = iterate(change, iteration, close)
        if not isinstance(found, PathDirection):
            return found
        size = space.largest(found)
        astray = is_astray(space, found, step) if iteration == 1 else size > _GROWS * space.largest(change)
        change, close = found, size <= CLOSE
        if not np.isfinite(size) or (astray and not close):
            break
    raise ConvergenceError("Newton's method does not converge")


def is_astray(space: PathSpace[AnyPoint], correction: PathDirection, step: PathDirection) -> bool:
    """Whether what is beside the end of a step is so far from it, by the step's length, that another path is there."""
    return space.product(correction, correction) > _ASTRAY**2 * space.product(step, step) > 0.0
