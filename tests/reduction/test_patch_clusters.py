"""Facets in clusters of like area: by their places, and by nothing else."""

import numpy as np
import pytest

from flexmbd.reduction.contact.clusters import clusters


def grid(n, m, *, turn=None):
    """(n m, 3) middles of the cells of an even grid."""
    x, y = np.meshgrid(np.arange(n) + 0.5, np.arange(m) + 0.5, indexing="ij")
    return np.column_stack([x.ravel(), y.ravel(), np.full(n * m, 3.0)]) @ (np.eye(3) if turn is None else turn)


def test_an_even_grid_is_cut_in_squares():
    x = grid(6, 6)
    found = clusters(x, np.ones(36), count=9)
    for one in range(9):
        corners = x[found == one]
        assert len(corners) == 4
        assert (np.ptp(corners, axis=0) == (1, 1, 0)).all()


@pytest.mark.parametrize("count", [1, 2, 5, 7, 24])
def test_every_cluster_has_its_share(count):
    """Within a row of cells of each cut; as many clusters as cells as well."""
    area = np.full(24, 0.25)
    found = clusters(grid(6, 4), area, count=count)
    sums = np.bincount(found, weights=area)
    assert len(sums) == count
    assert sums.min() > 0.0
    assert sums.max() <= 2.5 * area.sum() / count


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e4])
def test_neither_order_nor_round_off_nor_units_matter(size):
    """Places that round-off shifts to either side of each other's."""
    rng, x = np.random.default_rng(1), grid(7, 5)
    area = 1.0 + 0.3 * rng.random(35)
    first = clusters(x, area, count=8)
    for _ in range(5):
        order = rng.permutation(35)
        moved = size * x * (1 + 4e-16 * rng.integers(-2, 3, x.shape))
        found = clusters(moved[order], size**2 * area[order] * (1 + 2e-16 * rng.integers(-1, 2, 35)), count=8)
        assert (found == first[order]).all()


def test_facets_of_one_place_along_all_axes_but_a_few():
    """Fewer rows than clusters: a row is cut along another axis."""
    found = clusters(grid(1, 9), np.ones(9), count=9)
    assert sorted(found) == list(range(9))
    x = grid(2, 2, turn=np.array([[1, 1, 0], [-1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2))
    assert sorted(clusters(x, np.ones(4), count=4)) == [0, 1, 2, 3]
