"""Forces of patches that give way together: pressures and gaps are not negative, and one of the two is zero."""

import numpy as np
import pytest

from flexmbd.multibody.kernels.base.lanes import padded_size
from flexmbd.multibody.kernels.contact.complementarity import complementary_forces


def forces_and_gaps(C, b):
    """(m,) N and (m,) m, by flexibilities C (m, m) and the gaps b (m,) without forces."""
    m, size = len(b), padded_size(len(b))
    f, left = np.zeros((2, size))
    assert complementary_forces(C, b, f, left, np.zeros((2, size)), np.zeros(size**2))
    return f[:m], left[:m]


@pytest.mark.parametrize("seed", range(3))
def test_complementarity(seed):
    """What does not touch has no force, and what touches no gap; also where Newton's steps on the set go around."""
    rng = np.random.default_rng(seed)
    for m in (1, 2, 5, 30):
        half = rng.standard_normal((m, m))
        C, b = half @ half.T / m + 1e-3 * np.eye(m), rng.standard_normal(m)
        f, left = forces_and_gaps(C, b)
        assert (f >= 0.0).all()
        assert (left >= 0.0).all()
        assert not (f * left).any()
        np.testing.assert_allclose(C @ f + b, left, atol=1e-9)


@pytest.mark.parametrize("m", [3, 8, 13, 30])
def test_complementarity_beside_what_has_no_gap(m):
    """Where the gap is infinite nothing touches, nothing is read, and the others' forces are as without it."""
    rng = np.random.default_rng(m)
    half = rng.standard_normal((m, m))
    C, b = half @ half.T / m + 1e-3 * np.eye(m), rng.standard_normal(m)
    C -= 2.0 * np.abs(C) * (1.0 - np.eye(m)) / m  # some come to overlap by others' forces
    C = np.eye(m) + 0.5 * (C + C.T)
    there = np.sort(rng.permutation(2 * m)[:m])
    wide, gaps = np.full((2 * m, 2 * m), np.nan), np.full(2 * m, np.inf)
    wide[np.ix_(there, there)], gaps[there] = C, b
    (f, left), (among, apart) = forces_and_gaps(C, b), forces_and_gaps(wide, gaps)
    np.testing.assert_allclose(among[there], f, atol=1e-12)
    np.testing.assert_allclose(apart[there], left, atol=1e-12)
    assert not among[np.isinf(gaps)].any()
    assert (f >= 0.0).all()
    assert (left >= 0.0).all()
    assert not (f * left).any()
    np.testing.assert_allclose(C @ f + b, left, atol=1e-12)
