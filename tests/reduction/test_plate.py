"""A square plate with one edge clamped, as a solid: the unreduced model and the reduced one against plate theory."""

from functools import cache

from mpi4py import MPI

import numpy as np
import pytest
import scipy.sparse.linalg
from full_model import FullModel

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.coupling import Coupling
from flexmbd.forms import solid_linear
from flexmbd.reduction import Truncation, craig_bampton

# Hz; 1 m by 1 m by 0.01 m: f = k / (2 pi) sqrt(D / (rho t a^4)), k = 3.492, 8.525, 21.43, 27.33, 31.11, 54.44.
THEORY = np.array([8.7266, 21.3042, 53.5542, 68.2984, 77.7448, 136.0471])


@cache
def plate(cells):
    """One brick of degree 2 through the thickness. The edge across is free, its mean motion an interface."""
    mesh = meshes.plate(1.0, 1.0, 0.01, h=1.0 / cells)
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7800.0)
    edges = [Interface("x_min"), Interface("x_max", coupling=Coupling.AVERAGED)]
    return ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=edges)


@cache
def unreduced(cells):
    """Frequencies, Hz, by scipy."""
    full = FullModel(plate(cells))
    free = np.repeat(full.x[:, 0] > 1e-9, 3)
    k, m = (matrix[free][:, free] for matrix in (full.K, full.M))
    values = scipy.sparse.linalg.eigsh(k, len(THEORY), m, sigma=0.0, return_eigenvectors=False)
    return np.sqrt(np.sort(values)) / (2 * np.pi)


@pytest.mark.mpi
def test_frequencies_of_the_mesh_go_to_those_of_the_plate():
    errors = np.array([unreduced(cells) / THEORY - 1.0 for cells in (7, 10, 14)])
    assert abs(errors[0]).max() < 0.03
    assert abs(errors[1]).max() < 0.01
    assert abs(errors[2]).max() < 2.5e-3
    # stiff at first; then the plate of the theory, thin beyond measure, is the stiffer one
    assert (np.diff(errors, axis=0) < 0.0).all()


@pytest.mark.mpi
def test_reduction_adds_less_than_the_mesh_does():
    """The first six within 0.25 % of the theory, and as near to the unreduced plate as the tolerance says."""
    enough = Truncation(tol=1e-3, below_hz=140.0)
    body = craig_bampton(plate(14), modes=enough, frame="x_min", geometric_stiffness=False)
    assert 6 < body.n_modes < 60
    found = body.frequencies(["x_min"])[: len(THEORY)]
    added = found / unreduced(14) - 1.0
    # frequencies have half of the eigenvalues' error
    assert -1e-9 < added.min() < added.max() < 0.5e-3
    assert abs(found / THEORY - 1.0).max() < 2.5e-3
    assert MPI.COMM_WORLD.allgather(body.fingerprint()) == [body.fingerprint()] * MPI.COMM_WORLD.size


@pytest.mark.mpi
def test_as_many_modes_as_the_plate_has_below_a_frequency():
    """Held at its edge and in the mean of the other, counted without the reduction: by Sylvester's law."""
    model, below = plate(7), 400.0
    body = craig_bampton(model, modes=Truncation(below_hz=below), frame="x_min", geometric_stiffness=False)
    full = FullModel(model)
    free = np.repeat(full.x[:, 0] > 1e-9, 3)
    average = averages(model, full)[free]
    k, m = (matrix[free][:, free].toarray() for matrix in (full.K, full.M))
    dynamic = k - (2 * np.pi * below) ** 2 * m
    # constraints C u = 0 by multipliers: as many more negative signs as there are of them
    negative = int(np.sum(np.linalg.eigvalsh(dynamic) < 0.0))
    small = average.T @ np.linalg.solve(dynamic, average)
    count = negative - int(np.sum(np.linalg.eigvalsh(small) < 0.0))
    assert int(body.provenance["fixed-interface modes"]) == count > 5


def averages(model, full):
    """(3 n, 6) C^T of the averaged edge by its definition: L2 moments of the displacement over the facet."""
    edge = abs(full.x[:, 0] - 1.0) < 1e-9
    x = full.x[edge]
    rigid = full.rigid(model.interface("x_max").p)[np.repeat(edge, 3)]
    # the facet's mass matrix on its grid of nodes: a product of lines of degree 2
    y, z = np.unique(x[:, 1].round(9)), np.unique(x[:, 2].round(9))
    line_y, line_z = line_mass(y), line_mass(z)
    at_y, at_z = np.searchsorted(y, x[:, 1] - 1e-6), np.searchsorted(z, x[:, 2] - 1e-6)
    mass = line_y[np.ix_(at_y, at_y)] * line_z[np.ix_(at_z, at_z)]
    columns = np.zeros((3 * len(full.x), 6))
    columns[np.repeat(edge, 3)] = np.kron(mass, np.eye(3)) @ rigid
    return columns


def line_mass(nodes):
    """Mass matrix of elements of degree 2 on a line, whose nodes are given in order."""
    mass = np.zeros((len(nodes), len(nodes)))
    element = np.array([[4.0, 2.0, -1.0], [2.0, 16.0, 2.0], [-1.0, 2.0, 4.0]]) / 30.0
    for first in range(0, len(nodes) - 2, 2):
        mass[first : first + 3, first : first + 3] += (nodes[first + 2] - nodes[first]) * element
    return mass
