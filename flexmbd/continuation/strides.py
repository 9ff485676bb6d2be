"""Going along a parameter that only grows, in strides as long as each of them leads somewhere.

For what follows loads, or what joints are set to, and does not turn; what may turn goes along the arc (`follow`).
"""

from __future__ import annotations

from collections.abc import Callable

#: Tries to go from one parameter to a further one: how many times as long the next stride is, or None where it fails.
Attempt = Callable[[float, float], float | None]


def stride_along(attempt: Attempt, begin: float, end: float, *, first: float, least: float) -> float:
    """The parameter that was reached: the end, or that from which no stride leads on.

    Args:
        attempt: of a stride; one that failed is tried again, half as long.
        begin: where to begin.
        end: beyond it.
        first: the first stride.
        least: no stride is shorter but the last one.
    """
    reached, stride = begin, first
    while reached < end:
        ahead = end if stride >= end - reached else reached + stride
        longer = attempt(reached, ahead)
        if longer is not None:
            reached, stride = ahead, longer * stride
            continue
        stride = 0.5 * min(stride, end - reached)
        if stride < least:
            break
    return reached
