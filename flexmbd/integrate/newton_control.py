"""Newton's iteration with old factors, for all implicit methods: when it has converged, and when it is given up.

With factors of another iterate it converges linearly.  The ratio of a correction to the one before, the contraction,
says what is left of the error (Hairer & Wanner 1996, section IV.8); that of the step before lets a good predictor pass
after one iteration.
"""

from __future__ import annotations

import numpy as np

from flexmbd.multibody.kernels.base.compiling import kernel

#: Verdicts, the worse the smaller.
NOT_FINITE, TOO_SLOW, GO_ON, CONVERGED = range(-1, 3)

#: Corrections over their scales that round-off leaves of the best residual.
LEAST = 1e-15

_SLOWEST = 0.7  # a slower contraction counts as none
_STALLED = 0.25  # corrections that shrink no more than that, and are round-off, shrink no more
_LONGEST_RENEWAL = 32  # steps in a row that do not try old factors, where trying failed again and again
_GROWTH, _FIRST, _POWER = 1.3, 1e-3, 0.8  # of a contraction that is taken from the step before


@kernel
def expected_contraction(remembered):
    """What factors are trusted to leave of the error in their next first iteration."""
    return max(remembered, _FIRST) ** _POWER


@kernel
def contraction_to_remember(contraction, iterations):
    """What the next step is told after so many iterations; unmeasured, in the first, it is trusted a little less."""
    return min(_GROWTH * contraction if iterations == 1 else contraction, 1.0)


@kernel
def remaining_error(contraction):
    """The error left after a linear iteration, over its last correction."""
    return contraction / (1.0 - contraction) if contraction < 1.0 else np.inf


@kernel
def has_stalled(contraction, size, noise):
    """Whether corrections shrink no more for round-off, which makes corrections as large as ``noise``."""
    return contraction > _STALLED and size <= noise


@kernel
def judge(size, before, contraction, doubt, tolerance, noise, left):
    """Verdict on a correction of ``size``, and the contraction.

    ``before``: the correction before it, 0 for none: then ``contraction`` is what is expected of the factors, and at
    least ``doubt`` of the correction counts as error.  ``noise``: see ``has_stalled``.  ``left``: how many iterations
    there may be yet; infinite: those to come are not judged.
    """
    if not np.isfinite(size):
        return NOT_FINITE, contraction
    measured = before > 0.0
    if measured:
        contraction = size / before
        doubt = 0.0
    error = size * max(remaining_error(contraction), doubt)
    if error <= tolerance or size <= LEAST:
        return CONVERGED, contraction
    if not measured:
        return GO_ON, contraction
    if has_stalled(contraction, size, noise):
        return CONVERGED, contraction
    if contraction > _SLOWEST or error * contraction**left > tolerance:
        return TOO_SLOW, contraction
    return GO_ON, contraction


@kernel
def give_up_old_factors(memory, least):
    """Old factors have failed: at least so many of the next steps do not try them, next time about twice as many."""
    memory.renewals[0] = max(least, memory.next_renewals[0])
    memory.next_renewals[0] = min(_LONGEST_RENEWAL, 2 * memory.next_renewals[0] + 1)


@kernel
def count_solved_step(memory, renewed, old):
    """A step was solved: one of those that try no old factors (``renewed``), with ``old`` ones, or with new ones."""
    if renewed:
        memory.renewals[0] -= 1
    elif old:
        memory.next_renewals[0] = 0
