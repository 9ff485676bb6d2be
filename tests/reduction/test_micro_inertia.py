"""A solid whose micro-structure turns and has inertia (Cosserat's), from its waves to a pendulum."""

from dataclasses import replace
from itertools import product

from mpi4py import MPI

import micropolar
import numpy as np
import pytest
import scipy.linalg
from numpy.polynomial.legendre import leggauss

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, rigid_body_of
from flexmbd.continuum.finite_elements.gram_matrix import gram_matrix
from flexmbd.continuum.matrices.blocks import inner, multiply
from flexmbd.errors import FormulationError
from flexmbd.forms import solid_micropolar
from flexmbd.reduction import craig_bampton

FOAM = solid_micropolar.Parameters(E=7.5e9, nu=0.25, rho=1200.0, coupling=1e9, length=0.03, micro_inertia=2e-3)
SIZE = np.array([0.3, 0.1, 0.2])


def block(divisions=(3, 1, 2), *, degree=2, ends=(), form=solid_micropolar, p=FOAM, comm=MPI.COMM_WORLD):
    mesh = meshes.block(*SIZE, divisions=divisions, comm=comm)
    return ContinuumModel(mesh, form, p, degree=degree, interfaces=[Interface(name) for name in ends])


def with_values(model, displacement, rotation):
    """(owned dofs, k) of fields given at the nodes' places (n, 3): displacements and rotations (n, 3, k)."""
    x = model.node_x[: model.n_owned_nodes]
    moved, turned = displacement(x), rotation(x)
    values = np.zeros((model.n_owned, moved.shape[2]), order="F")
    dofs = model.displacement_dofs[: model.n_owned_nodes]
    values[dofs], values[dofs + 3] = moved, turned
    return values


@pytest.mark.mpi
@pytest.mark.parametrize("branch", [0, 1])
def test_transverse_waves_have_the_frequencies_of_both_branches(branch):
    """Of u_y = U cos kx, phi_z = F sin kx: rho w^2 U = (mu + c) k^2 U - 2 c k F and
    rho j w^2 F = (2 mu l^2 k^2 + 4 c) F - 2 c k U, as Rayleigh's quotient of these fields (Eringen 1966)."""
    model, p = block((24, 1, 1)), FOAM
    mu, c, k = p.E / (2 * (1 + p.nu)), p.coupling, np.pi / SIZE[0]
    stiffness = [[(mu + c) * k**2, 2 * c * k], [2 * c * k, 2 * mu * p.length**2 * k**2 + 4 * c]]
    squares, vectors = scipy.linalg.eigh(stiffness, p.rho * np.diag([1.0, p.micro_inertia]))
    U, F = vectors[:, branch]

    def along(i, values):
        return np.eye(3)[i][None, :, None] * values[:, None, None]

    wave = with_values(
        model, lambda x: along(1, U * np.cos(k * x[:, 0])), lambda x: along(2, F * np.sin(k * x[:, 0]))
    )
    energy, mass = (inner(model.comm, wave, multiply(matrix, wave)).item() for matrix in (model.K, model.M))
    assert energy / mass == pytest.approx(squares[branch], rel=1e-5)
    gram = gram_matrix(model, wave, p=np.zeros(3), R=np.eye(3))
    assert np.trace(gram[4:, 4:]) == pytest.approx(mass, rel=1e-12)
    # half a wave: both squares are a half in the mean
    assert mass == pytest.approx(p.rho * SIZE.prod() / 2 * (U**2 + p.micro_inertia * F**2), rel=1e-5)


@pytest.mark.mpi
def test_a_rigid_body_has_the_inertia_of_its_structure_too():
    """That of the box, and rho j V about each axis."""
    body = rigid_body_of(block())
    mass = FOAM.rho * SIZE.prod()
    expected = mass / 12 * np.diag(SIZE @ SIZE - SIZE**2) + mass * FOAM.micro_inertia * np.eye(3)
    assert body.mass == pytest.approx(mass, rel=1e-12)
    assert body.com == pytest.approx([SIZE[0] / 2, 0.0, 0.0], abs=1e-14)
    np.testing.assert_allclose(body.inertia, expected, rtol=0, atol=1e-12 * expected.max())


@pytest.mark.mpi
def test_all_mass_integrals_are_those_of_points_about_each_centre():
    """Eight points at (+-r, +-r, +-r), r^2 = j / 2, in place of the structure, by Gauss' rule in the block."""

    def displacement(x):
        x, y, z = x.T
        return np.stack([[x * y, z**2 - x, 0.3 * y], [y * z, x**2, x * z + 1.0]], axis=-1).swapaxes(0, 1)

    def rotation(x):
        x, y, z = x.T
        return 7.0 * np.stack([[y + z, x * z, 0.5 - x], [z**2, y - x, 1.0 + x * y]], axis=-1).swapaxes(0, 1)

    model = block((2, 1, 1))
    turn = np.linalg.qr(np.array([[1.0, 0.3, -0.5], [0.8, 1.0, 0.3], [-0.5, 0.8, 1.0]]))[0]
    R, p = turn * np.linalg.det(turn), np.array([-0.4, 1.3, 0.2])
    gram = gram_matrix(model, with_values(model, displacement, rotation), p=p, R=R)

    points, weights = leggauss(5)
    at = np.array(list(product(points, repeat=3))) * SIZE / 2 + [SIZE[0] / 2, 0.0, 0.0]
    by = FOAM.rho * np.array(list(product(weights, repeat=3))).prod(axis=1) * SIZE.prod() / 8
    expected = np.zeros_like(gram)
    for corner in product((-1.0, 1.0), repeat=3):
        xi = np.sqrt(FOAM.micro_inertia / 2) * np.array(corner)
        moved = displacement(at) + np.cross(rotation(at), xi[None, :, None], axis=1)
        values = np.column_stack([np.ones(len(at)), (at + xi - p) @ R, *(moved[..., i] @ R for i in range(2))])
        expected += (values * by[:, None] / 8).T @ values
    assert abs(gram - expected).max() < 1e-12 * abs(expected).max()


def test_a_pendulum_swings_slower_by_it():
    """w^2 = m g d / (I + m d^2 + m j), small elastic parts apart; saved and read the same."""
    squares = []
    for p in (FOAM, replace(FOAM, micro_inertia=1e-9)):
        record = craig_bampton(block(ends=["x_min"], p=p, comm=MPI.COMM_SELF), modes=4, frame="x_min")
        scene = fm.System(gravity=(9.81, 0.0, 0.0))
        body = scene.add(fm.FlexibleBody(record), name="block")
        scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), body.frame("x_min"))
        squares.append(min(abs(np.array(scene.linearize().eigenvalues()))) ** 2)
        d, inertia = SIZE[0] / 2, (SIZE[0] ** 2 + SIZE[2] ** 2) / 12 + p.micro_inertia
        assert squares[-1] == pytest.approx(9.81 * d / (inertia + d**2), rel=1e-5)
    assert squares[0] < 0.96 * squares[1]


def test_inertia_of_unknown_points_is_refused_before_the_reduction():
    """Rotations with mass in a form that does not say which points move with them."""
    model = block(form=micropolar, p=micropolar.Parameters(), ends=["x_min"], comm=MPI.COMM_SELF)
    with pytest.raises(FormulationError, match="no Gram matrix; where unknowns beside the displacement have mass"):
        craig_bampton(model, modes=2, frame="x_min")
