"""Forms whose rules are exact on curved cells too: mass of the curved volume, patch of constant strain."""

import itertools

import numpy as np
import pytest
import ufl
from assembled import Assembled, cube
from dolfinx import fem

from flexmbd.forms import solid_linear, solid_orthotropic

CASES = [
    pytest.param((form, cell, degree), id=f"{form.__name__.rpartition('.')[2]}-{cell}-{degree}")
    for form in (solid_linear, solid_orthotropic)
    for cell, degree in itertools.product(form.CELLS, form.ORDER)
]


@pytest.fixture(scope="module", params=CASES)
def body(request) -> Assembled:
    """The form on a distorted cube, whose cells are curved where the degree allows it."""
    form, cell, degree = request.param
    return Assembled(form, cube(cell, n=2, degree=degree, amplitude=0.08), degree)


def rest(body):
    return np.zeros(len(body.u.x.array))


def stiffness(body):
    return sum(body.hessian(term, rest(body)) for term in body.strain_terms).toarray()


def mass(body):
    return sum(body.hessian(term, rest(body)) for term in body.kinetic_terms).toarray()


def test_rigid_mass_is_that_of_the_curved_volume(body):
    """Exactly: volume, first and second moments, against a rule of higher degree than any needs."""
    r, rho = body.rigid(), body.form.reference().parameters.rho
    x = ufl.SpatialCoordinate(body.mesh)
    t, w, other_t, other_w = (fem.Constant(body.mesh, np.zeros(3)) for _ in range(4))
    density = ufl.inner(t + ufl.cross(w, x), other_t + ufl.cross(other_w, x))
    moment = fem.form(density * ufl.dx(domain=body.mesh, degree=10))
    exact = np.empty((6, 6))
    for i, j in itertools.product(range(6), range(6)):
        (t.value[:], w.value[:]), (other_t.value[:], other_w.value[:]) = (
            np.split(np.eye(6)[k], 2) for k in (i, j)
        )
        exact[i, j] = rho * fem.assemble_scalar(moment)
    assert r.T @ mass(body) @ r == pytest.approx(exact, rel=1e-13, abs=1e-12 * rho)


def test_rigid_mass_of_a_straight_cube_is_the_closed_form(body):
    cell = body.mesh.topology.cell_name()
    straight = Assembled(body.form, cube(cell, n=1, degree=1, amplitude=0), body.degree)
    rho = body.form.reference().parameters.rho
    first, second, product = 1 / 2, 2 / 3, -1 / 4
    cross = first * np.array([[0, 1, -1], [-1, 0, 1], [1, -1, 0]])
    inertia = (second - product) * np.eye(3) + product
    exact = rho * np.block([[np.eye(3), cross], [cross.T, inertia]])
    r = straight.rigid()
    assert r.T @ mass(straight) @ r == pytest.approx(exact, rel=1e-13, abs=1e-12 * rho)


def test_patch_of_constant_strain(body):
    """A linear displacement is in equilibrium inside, and has its energy."""
    gradient = np.random.default_rng(2).uniform(-1, 1, (3, 3))
    u = (body.nodes @ gradient.T).ravel()
    k = stiffness(body)
    inside = np.setdiff1d(np.arange(len(u)), body.boundary)
    assert len(inside) > 0
    assert abs((k @ u)[inside]).max() < 1e-13 * abs(k).max()
    field = fem.Function(body.space)
    field.x.array[:] = u
    sigma = body.form.stress(field, None, body.form.reference().parameters)
    density = ufl.inner(sigma, ufl.sym(ufl.grad(field))) / 2
    work = fem.assemble_scalar(fem.form(density * ufl.dx(domain=body.mesh, degree=8)))
    assert u @ k @ u / 2 == pytest.approx(work, rel=1e-12)
