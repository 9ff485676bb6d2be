"""The change to normal form, where stiffnesses lie decades apart."""

import numpy as np
import pytest

from flexmbd.errors import ReductionError
from flexmbd.reduction.normal_form import normal_form


def graded(n, decades):
    """Stiffnesses from soft to stiff by row and column, and a mass that couples them all."""
    rng = np.random.default_rng(2)
    soft_to_stiff = np.geomspace(1.0, 10.0 ** (decades / 2), n)
    a, b = (np.eye(n) + 0.2 * rng.normal(size=(n, n)) / np.sqrt(n) for _ in range(2))
    return soft_to_stiff[:, None] * (a.T @ a) * soft_to_stiff, b.T @ b


def relative(found, expected):
    size = np.sqrt(np.diag(expected))
    return abs((found - expected) / np.outer(size, size)).max()


@pytest.mark.parametrize("decades", [0, 4, 8, 12])
def test_stiffness_is_diagonal_to_the_last_digits(decades):
    stiffness, mass = graded(15, decades)
    k, x = normal_form(stiffness, mass)
    assert (np.diff(k) > 0).all()
    assert relative(x.T @ stiffness @ x, np.diag(k)) < 1e-14
    # so that no static response is lost
    assert relative(x / k @ x.T, np.linalg.inv(stiffness)) < 1e-13
    assert np.diag(x.T @ mass @ x) == pytest.approx(np.ones(15), abs=1e-13)


def test_mass_is_one():
    stiffness, mass = graded(15, 6)
    _, x = normal_form(stiffness, mass)
    assert abs(x.T @ mass @ x - np.eye(15)).max() < 1e-10
    assert abs(x.T @ mass @ x - np.eye(15))[:5, :5].max() < 1e-14


def test_closed_form():
    """Two equal masses between three equal springs: 1 and 3."""
    k, x = normal_form(np.array([[20.0, -10.0], [-10.0, 20.0]]), 10.0 * np.eye(2))
    assert k == pytest.approx([1.0, 3.0], rel=1e-15)
    assert abs(x) == pytest.approx(np.full((2, 2), np.sqrt(0.05)), rel=1e-14)
    assert x[0, 0] * x[1, 0] > 0


def test_no_modes():
    k, x = normal_form(np.zeros((0, 0)), np.zeros((0, 0)))
    assert (k.shape, x.shape) == ((0,), (0, 0))


def test_singular_stiffness():
    with pytest.raises(ReductionError, match="not positive definite"):
        normal_form(np.array([[1.0, -1.0], [-1.0, 1.0 - 1e-9]]), np.eye(2))
