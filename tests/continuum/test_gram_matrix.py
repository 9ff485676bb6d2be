"""The Gram matrix against integrals done by hand."""

import types
from itertools import product

import numpy as np
import pytest
import ufl
from numpy.polynomial.legendre import leggauss

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.finite_elements.gram_matrix import gram_matrix
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_linear

RHO = 1200.0
MATERIAL = solid_linear.Parameters(E=3.0e9, nu=0.28, rho=RHO)
SIZE = np.array([0.3, 0.1, 0.2])


def model(cell, degree, form=solid_linear):
    mesh = meshes.block(*SIZE, divisions=(3, 1, 2), cell=cell, degree=degree)
    return ContinuumModel(mesh, form, MATERIAL, degree=degree)


def rotation(a, b, c):
    """Columns are three orthonormal vectors that are along no axis."""
    q, r = np.linalg.qr(np.array([[1.0, a, b], [c, 1.0, a], [b, c, 1.0]]))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


FRAMES = {
    "mesh": (np.zeros(3), np.eye(3)),
    "turned": (np.array([-0.4, 1.3, 0.2]), rotation(0.3, -0.5, 0.8)),
}


@pytest.mark.mpi
@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize(("cell", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_mass_centre_and_inertia_of_a_box(cell, degree, frame):
    p, R = FRAMES[frame]
    body = model(cell, degree)
    gram = gram_matrix(body, np.zeros((body.n_owned, 0)), p=p, R=R)
    mass = RHO * SIZE.prod()
    centre = R.T @ ([SIZE[0] / 2, 0.0, 0.0] - p)
    second = R.T @ np.diag(mass * SIZE**2 / 12) @ R + mass * np.outer(centre, centre)
    expected = np.block(
        [[np.array([[mass]]), mass * centre[None]], [mass * centre[:, None], second]]
    )
    assert abs(gram - expected).max() < 1e-12 * abs(expected).max()


def fields(x):
    """Two displacement fields of degree 2, (n, 3, 2)."""
    x, y, z = x.T
    return np.stack([[x * y, z**2 - x, 0.3 * y], [y * z, x**2, x * z + 1.0]], axis=-1).swapaxes(
        0, 1
    )


@pytest.mark.mpi
@pytest.mark.parametrize("frame", FRAMES)
def test_products_of_fields_by_quadrature(frame):
    """Five Gauss points in each direction of the box are exact for every product."""
    p, R = FRAMES[frame]
    body = model("tetrahedron", 2)
    x = body.space.tabulate_dof_coordinates()[: body.n_owned // 3]
    gram = gram_matrix(body, fields(x).reshape(-1, 2), p=p, R=R)

    points, weights = leggauss(5)
    at = np.array(list(product(points, repeat=3))) * SIZE / 2 + [SIZE[0] / 2, 0.0, 0.0]
    by = RHO * np.array(list(product(weights, repeat=3))).prod(axis=1) * SIZE.prod() / 8
    values = np.column_stack(
        [np.ones(len(at)), (at - p) @ R, *(fields(at)[..., i] @ R for i in range(2))]
    )
    expected = (values * by[:, None]).T @ values
    assert abs(gram - expected).max() < 1e-12 * abs(expected).max()
    assert np.array_equal(gram, gram.T)


@pytest.mark.mpi
def test_all_ranks_have_the_same_bits():
    body = model("hexahedron", 1)
    gram = gram_matrix(body, np.zeros((body.n_owned, 0)), p=np.zeros(3), R=np.eye(3))
    assert len(set(body.comm.allgather(gram.tobytes()))) == 1


@pytest.mark.mpi
def test_mass_that_differs_by_direction_has_no_gram_matrix():
    form = types.ModuleType("added_mass")
    content = dict(vars(solid_linear))
    content["kinetic_energy"] = lambda v, p: [
        (p.rho / 2 * (ufl.inner(v, v) + v[0] ** 2), solid_linear.Quadrature(2))
    ]
    form.__dict__.update({**content, "__name__": "added_mass"})
    body = model("hexahedron", 1, form)
    with pytest.raises(FormulationError, match=r"added_mass: .*no Gram matrix"):
        gram_matrix(body, np.zeros((body.n_owned, 0)), p=np.zeros(3), R=np.eye(3))


@pytest.mark.mpi
def test_many_modes_are_pairs_of_modes():
    """Fields are multiplied in blocks: each pair of modes has what it has alone."""
    body = model("hexahedron", 1)
    p, R = FRAMES["turned"]
    start = body.M.getOwnershipRange()[0]
    every = np.random.default_rng(5).normal(size=(body.M.getSize()[0], 40))
    modes = np.asfortranarray(every[start : start + body.n_owned])
    gram = gram_matrix(body, modes, p=p, R=R)
    assert abs(gram - gram.T).max() == 0.0
    for pair in ([0, 39], [39, 13], [14, 15], [31, 32]):
        places = np.concatenate([np.arange(4), *(4 + 3 * i + np.arange(3) for i in pair)])
        alone = gram_matrix(body, modes[:, pair], p=p, R=R)
        np.testing.assert_allclose(gram[np.ix_(places, places)], alone, rtol=1e-12, atol=1e-13 * abs(alone).max())
