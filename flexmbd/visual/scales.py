"""Units and ends of scales that read well."""

from __future__ import annotations

import math

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_MOST_STEPS = 5


def readable(largest: float, unit: str) -> tuple[float, str]:
    """The (size, name) of the unit in which ``largest`` reads as a number from 1 to 1000."""
    if not unit:  # a share is read as it is
        return 1.0, ""
    for size, prefix in _PREFIXES:
        if largest >= size:
            return size, prefix + unit
    return 1.0, unit


def bar_end(largest: float) -> tuple[float, int]:
    """A round end of a scale from 0 that reaches ``largest``, and how many labels make all of them round.

    Steps are 1, 2, 2.5 or 5 times a power of ten, five at the most; without any value the end is 1.
    """
    if not largest > 0.0:
        return 1.0, 2
    power = 10.0 ** math.floor(math.log10(largest / _MOST_STEPS))
    # the slack lets a value that is a step but for round-off be one
    step = next(size * power for size in _STEPS if largest / (size * power) <= _MOST_STEPS * (1.0 + 1e-12))
    count = max(1, math.ceil(largest / step - 1e-9))
    return count * step, count + 1
