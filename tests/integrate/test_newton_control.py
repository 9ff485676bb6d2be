"""Verdicts on an iteration that converges linearly, whose errors are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexmbd.integrate.newton_control import CONVERGED, GO_ON, NOT_FINITE, TOO_SLOW, judge
from flexmbd.multibody.kernels.base.compiling import entry_kernel


@entry_kernel
def verdict_on(size, before, contraction, doubt, tolerance, noise, left):
    """The kernel, from Python."""
    return judge(size, before, contraction, doubt, tolerance, noise, left)


def judged(size, before, *, tolerance, expected=1.0, doubt=0.0, noise=0.0, left=math.inf):
    return verdict_on(size, before, expected, doubt, tolerance, noise, float(left))


@pytest.mark.parametrize("contraction", [0.01, 0.3, 0.65])
@pytest.mark.parametrize("most", [4, 10, math.inf])
def test_an_iteration_ends_with_its_error_below_the_tolerance_and_no_later(contraction, most):
    """It goes on until what is left of the error is small, or gives up as soon as it cannot become so in time."""
    tolerance, error, before = 3e-7, 1.0, 0.0
    ends = math.ceil(math.log(tolerance) / math.log(contraction))  # iterations that the error takes
    for iteration in range(1, 40):
        size, error = error * (1.0 - contraction), error * contraction
        verdict, seen = judged(size, before, tolerance=tolerance, left=most - iteration)
        if before > 0.0:
            assert seen == pytest.approx(contraction)
        before = size
        if verdict != GO_ON:
            break
    if most < ends:
        assert (verdict, iteration) == (TOO_SLOW, 2)  # the second shows it
    else:
        assert (verdict, iteration) == (CONVERGED, max(2, ends))
        assert error <= tolerance < error / contraction


def test_a_first_correction_is_trusted_as_the_factors_are():
    assert judged(1e-5, 0.0, tolerance=1e-6, expected=0.05)[0] == CONVERGED
    assert judged(1e-5, 0.0, tolerance=1e-6, expected=0.2)[0] == GO_ON
    assert judged(1e-5, 0.0, tolerance=1e-6, expected=0.05, doubt=1.0)[0] == GO_ON
    assert judged(1e-5, 0.0, tolerance=1e-6, expected=1.0, left=1.0)[0] == GO_ON  # nothing is measured yet


def test_what_does_not_converge_is_told():
    assert judged(0.8, 1.0, tolerance=1e-6)[0] == TOO_SLOW
    assert judged(2.0, 1.0, tolerance=1e-6)[0] == TOO_SLOW
    assert judged(np.nan, 1.0, tolerance=1e-6)[0] == NOT_FINITE
    assert judged(8e-15, 1e-14, tolerance=1e-16)[0] == TOO_SLOW
    assert judged(8e-15, 1e-14, tolerance=1e-16, noise=1e-14)[0] == CONVERGED  # round-off leaves no better
