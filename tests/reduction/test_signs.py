"""The rule for signs and for rotations inside clusters."""

from mpi4py import MPI

import numpy as np
import pytest
import scipy.stats
from bracket import bracket

from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.reduction.modes.signs import FIELDS, asymmetric_fields, determined_rotation

EIGENVALUES = np.array([1.0, 2.0, 2.0 + 1e-12, 5.0, 7.0, 7.0, 7.0 + 3e-11, 9.0])


def projections(n):
    return np.random.default_rng(8).normal(size=(n, FIELDS))


def test_projections_become_triangular_with_a_positive_diagonal():
    p = projections(8)
    q = determined_rotation(EIGENVALUES, p)
    assert abs(q.T @ q - np.eye(8)).max() < 1e-14
    turned = q.T @ p
    for cluster in ([0], [1, 2], [3], [4, 5, 6], [7]):
        part = turned[cluster][:, : len(cluster)]
        assert (np.diag(part) > 0).all()
        assert abs(np.tril(part, -1)).max() < 1e-14
        outside = np.delete(q[cluster], cluster, axis=1)
        assert (outside == 0.0).all()


@pytest.mark.parametrize("seed", range(3))
def test_result_does_not_depend_on_what_the_eigensolver_chose(seed):
    rng = np.random.default_rng(seed)
    p = projections(8)
    chosen = np.zeros((8, 8))
    for cluster in ([0], [1, 2], [3], [4, 5, 6], [7]):
        k = len(cluster)
        turn = scipy.stats.ortho_group.rvs(k, random_state=rng) if k > 1 else -np.eye(1)
        chosen[np.ix_(cluster, cluster)] = turn
    found = chosen @ determined_rotation(EIGENVALUES, chosen.T @ p)
    assert abs(found - determined_rotation(EIGENVALUES, p)).max() < 1e-13


def test_cluster_larger_than_the_number_of_fields():
    q = determined_rotation(np.ones(FIELDS + 2), projections(FIELDS + 2))
    assert abs(q.T @ q - np.eye(FIELDS + 2)).max() < 1e-14


def test_no_modes():
    assert determined_rotation(np.zeros(0), np.zeros((0, FIELDS))).shape == (0, 0)


@pytest.mark.mpi
def test_fields_are_the_same_on_any_number_of_ranks():
    grams = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        model = bracket(comm=comm)
        fields = asymmetric_fields(model)
        grams.append(inner(model.comm, fields, multiply(model.M, fields)))
    assert abs(grams[0] - grams[1]).max() < 1e-12 * abs(grams[1]).max()
    # far from dependent on each other
    size = np.sqrt(np.diag(grams[1]))
    assert np.linalg.eigvalsh(grams[1] / np.outer(size, size))[0] > 0.05
