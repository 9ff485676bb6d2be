"""Errors that an embedded method estimates of fixed steps: of each eighth, onto a law's next piece, and while large.

What stiffens on the way, as a stop that is met, may make a fixed step unstable that was stable at the start.  A motion
that something bounds stays finite then, but the errors of its steps add up to the motion itself.
"""

from __future__ import annotations

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.compiling import kernel

#: Entries: the sum of the errors looked at, each over the machine's sizes; the last; the largest, its time (s), and the
#: velocity that it is of.
SUM, LAST, LARGEST, WHEN, WHOSE, N_ERRORS = range(6)

_EACH = 8
#: A mean error in a stretch of a thousand steps that spoils its result.
SPOILING = 1e-4


@kernel
def is_looked_at(state, errors):
    """Whether the error of the step at hand is to be estimated."""
    return errors[LAST] > SPOILING or state.counts[st.STEPS] % _EACH == 0


@kernel
def take_error(state, errors, ratio, h, rate, looks):
    """Take the error of a fixed step h (s), ``ratio`` of what is tolerated at a rate (1/s) of the machine; returns 0.

    ``looks``: whether it was estimated.
    """
    if not looks:
        return 0.0
    error = ratio * state.numbers[st.TOLERANCE] * min(1.0, h * rate)
    errors[LAST] = error
    if error < 1e300:  # what is not finite stops the run
        errors[SUM] += error
    if error > errors[LARGEST]:
        errors[LARGEST] = error
        errors[WHEN] = state.numbers[st.TIME]
        errors[WHOSE] = state.counts[st.WORST]
    return 0.0
