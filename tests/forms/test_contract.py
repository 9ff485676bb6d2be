"""What every form file must do, tried on small meshes of each cell and degree it claims."""

import itertools
import pkgutil
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse.linalg
import ufl
from assembled import Assembled, cube
from dolfinx import fem

import flexmbd.forms
from flexmbd.continuum import formulation

FORMS = [info.name for info in pkgutil.iter_modules(flexmbd.forms.__path__)]
CASES = [
    pytest.param((name, cell, degree), id=f"{name}-{cell}-{degree}")
    for name in FORMS
    for form in [formulation.load(name)]
    for cell, degree in itertools.product(form.CELLS, form.ORDER)
]


@pytest.fixture(scope="module", params=CASES)
def body(request) -> Assembled:
    """The form on a distorted cube, whose cells are curved where the degree allows it."""
    name, cell, degree = request.param
    mesh = cube(cell, n=2, degree=degree, amplitude=0.08)
    return Assembled(formulation.load(name), mesh, degree)


def total(assemble, terms, at):
    return sum(assemble(term, at) for term in terms)


def rest(body):
    return np.zeros(len(body.u.x.array))


def some_displacement(body, *, size):
    return size * np.random.default_rng(1).uniform(-1, 1, len(rest(body)))


def stiffness(body):
    return total(body.hessian, body.strain_terms, rest(body)).toarray()


def mass(body):
    return total(body.hessian, body.kinetic_terms, rest(body)).toarray()


def test_rest_is_free_of_energy_and_force_and_finite(body):
    for term in body.strain_terms:
        assert body.energy(term, rest(body)) == 0.0
        assert np.array_equal(body.gradient(term, rest(body)), rest(body))
        assert np.isfinite(body.hessian(term, rest(body)).data).all()


def test_third_derivative_is_there_and_finite_at_rest(body):
    """Geometric stiffness is (dK/du) u; a small-strain energy would have none."""
    load = fem.Function(body.space)
    load.x.array[:] = some_displacement(body, size=1e-3)
    body.u.x.array[:] = 0
    geometric = 0.0
    for term in body.strain_terms:
        second = ufl.derivative(ufl.derivative(term, body.u), body.u)
        third = fem.form(ufl.derivative(second, body.u, load))
        matrix = fem.assemble_matrix(third).to_scipy()
        assert np.isfinite(matrix.data).all()
        geometric += abs(matrix).max()
    assert geometric > 1e-6 * abs(stiffness(body)).max()


def test_stiffness_is_symmetric_with_six_rigid_motions(body):
    k, r = stiffness(body), body.rigid()
    scale = abs(k).max()
    assert abs(k - k.T).max() < 1e-14 * scale
    assert abs(k @ r).max() < 1e-13 * scale
    values = np.linalg.eigvalsh(k)
    assert abs(values[:6]).max() < 1e-12 * values[-1]
    # the seventh is an elastic mode of the whole cube, not a spurious one
    assert values[6] > 1e-4 * values[-1]


def test_mass_is_symmetric_and_positive(body):
    m = mass(body)
    assert abs(m - m.T).max() < 1e-14 * abs(m).max()
    assert np.linalg.eigvalsh(m)[0] > 1e-6 * abs(m).max()


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
    """A linear displacement is in equilibrium inside, on curved cells too, and has its energy."""
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


def test_gradient_and_tangent_are_derivatives(body):
    u, step = some_displacement(body, size=0.02), some_displacement(body, size=1e-5)[::-1]
    for term in body.strain_terms:
        work = body.energy(term, u + step) - body.energy(term, u - step)
        assert 2 * body.gradient(term, u) @ step == pytest.approx(work, rel=1e-5)
        change = body.gradient(term, u + step) - body.gradient(term, u - step)
        tangent = 2 * body.hessian(term, u) @ step
        assert abs(tangent - change).max() < 1e-5 * abs(change).max()


def test_matrix_residual_and_energy_agree(body):
    """Int_0^1 A(s u) u ds = F(u), each term alone; Int_0^1 F(s u) u ds = W(u), their sum.

    Five Gauss points are exact to degree 9 in s. A rule that differs between the matrix and the
    residual of a term, as with two rules in one form, would show here.
    """
    u = some_displacement(body, size=0.02)
    points, weights = np.polynomial.legendre.leggauss(5)
    points, weights = (points + 1) / 2, weights / 2
    for term in [*body.strain_terms, *body.kinetic_terms]:
        pairs = list(zip(points, weights, strict=True))
        along = sum(w * (body.hessian(term, s * u) @ u) for s, w in pairs)
        residual = body.gradient(term, u)
        assert abs(along - residual).max() < 1e-11 * abs(residual).max()
        work = sum(w * (body.gradient(term, s * u) @ u) for s, w in pairs)
        assert work == pytest.approx(body.energy(term, u), rel=1e-11)


def test_superposed_rotation_changes_no_energy(body):
    """Frame indifference: W(R (x + u) - x) = W(u), and zero where u = 0."""
    angle = 0.7
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    # about a second axis too
    rotation = rotation @ rotation[[1, 2, 0]][:, [1, 2, 0]]
    x, u = body.nodes.ravel(), some_displacement(body, size=0.02)

    def rotated(u):
        return ((x + u).reshape(-1, 3) @ rotation.T).ravel() - x

    energy = total(body.energy, body.strain_terms, u)
    assert total(body.energy, body.strain_terms, rotated(u)) == pytest.approx(energy, rel=1e-11)
    assert abs(total(body.energy, body.strain_terms, rotated(0 * u))) < 1e-12 * energy


@pytest.mark.parametrize("case", CASES)
def test_observed_order(case):
    """The L2 error of the reference problem falls with the order the form claims."""
    name, cell, degree = case
    form = formulation.load(name)
    divisions = {1: (4, 8), 2: (3, 6)}[degree]
    errors = [reference_error(form, cell=cell, degree=degree, n=n) for n in divisions]
    assert np.log2(errors[0] / errors[1]) > form.ORDER[degree] - 0.15


def reference_error(form, *, cell, degree, n):
    """Relative L2 error of the displacement."""
    body = Assembled(form, cube(cell, n=n, degree=1, amplitude=0), degree)
    problem = form.reference()
    x = ufl.SpatialCoordinate(body.mesh)
    fine = SimpleNamespace(degree=2 * degree + 4, scheme="default")
    load = body.integral(ufl.inner(problem.body_force(x), body.u), fine)
    exact = problem.displacement(x)
    u = body.interpolated(exact)
    k = total(body.hessian, body.strain_terms, rest(body)).tocsr()
    f = body.gradient(load, rest(body))
    inside = np.setdiff1d(np.arange(len(u)), body.boundary)
    u[inside] = 0
    right = (f - k @ u)[inside]
    u[inside] = scipy.sparse.linalg.spsolve(k[inside][:, inside].tocsc(), right)
    error = body.integral(ufl.inner(body.u - exact, body.u - exact), fine)
    norm = body.integral(ufl.inner(exact, exact), fine)
    return np.sqrt(body.energy(error, u) / fem.assemble_scalar(fem.form(norm)))
