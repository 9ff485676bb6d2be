"""Where a value passes zero: known roots by few evaluations, up to what round-off lets be found."""

import numpy as np
import pytest

from flexmbd.continuation.zero import zero
from flexmbd.errors import ConvergenceError

ROOT = 0.3


@pytest.mark.parametrize(
    ("value", "most"),
    [
        (lambda x: 2.0 * (ROOT - x), 3),
        (lambda x: np.sin(3.0 * (x - ROOT)), 7),
        (lambda x: np.expm1(x - ROOT) * (1.0 + 4.0 * x), 9),
        (lambda x: np.arctan(50.0 * (x - ROOT)), 12),
        (lambda x: np.cbrt(x - ROOT), 30),
        (lambda x: 1.0 if x >= ROOT else -1.0, 30),
    ],
)
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e12])
def test_a_root_is_found_by_few_evaluations(value, most, scale):
    seen = []

    def counted(x):
        seen.append(x)
        return scale * value(x)

    found = zero(counted, 0.0, 1.0, within=1e-7)
    assert found == pytest.approx(ROOT, abs=1e-6)
    assert found in seen  # it was evaluated there
    assert len(seen) <= most


def test_round_off_ends_the_search():
    """Below it the value is noise, in which there is nothing to be found."""
    seen = []

    def noisy(x):
        seen.append(x)
        return x - ROOT + 1e-5 * np.sin(1e9 * x)

    assert zero(noisy, 0.0, 1.0, within=1e-9, round_off=2e-5) == pytest.approx(ROOT, abs=2e-5)
    assert len(seen) <= 8


def test_an_end_is_a_root():
    assert zero(lambda x: x, 0.0, 1.0, within=1e-7) == 0.0


def test_values_of_one_sign():
    with pytest.raises(ConvergenceError, match=r"what passes zero between them is 1 and 2 at their ends"):
        zero(lambda x: 1.0 + x, 0.0, 1.0, within=1e-7)
