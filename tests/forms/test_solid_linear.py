"""The elastic solid against closed forms and a hexahedron written out in numpy."""

import itertools
import subprocess
import sys

import numpy as np
import pytest
from assembled import Assembled, cube

from flexmbd.forms import solid_linear
from flexmbd.forms.solid_linear import Parameters

P = solid_linear.reference().parameters


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("E", 0.0),
        ("E", -1.0),
        ("E", float("nan")),
        ("E", float("inf")),
        ("E", "2.1e11"),
        ("E", None),
        ("E", True),
        ("nu", 0.5),
        ("nu", -1.0),
        ("nu", float("nan")),
        ("nu", 1j),
        ("rho", 0.0),
        ("rho", -7850.0),
        ("rho", float("inf")),
        ("rho", [7850.0]),
        ("rho", np.array([7850.0, 7800.0])),
    ],
)
def test_bad_parameters_are_refused_by_name(name, value):
    good = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0}
    with pytest.raises(ValueError, match=rf"\b{name} must"):
        Parameters(**good | {name: value})


def test_parameters_become_floats():
    p = Parameters(E=np.int64(10), nu=np.float32(0.25), rho=1)
    assert (p.E, p.nu, p.rho) == (10.0, 0.25, 1.0)
    assert all(type(value) is float for value in (p.E, p.nu, p.rho))


@pytest.fixture(scope="module", params=solid_linear.CELLS)
def solid(request):
    return Assembled(solid_linear, cube(request.param, n=1, degree=1, amplitude=0), 1)


def linear_field(solid, gradient):
    return (solid.nodes @ np.asarray(gradient).T).ravel()


def test_uniaxial_tension_has_youngs_modulus_and_poissons_ratio(solid):
    """Force on the face x = 1 is E times the strain, none on the sides."""
    strain = 1e-3
    u = linear_field(solid, strain * np.diag([1, -P.nu, -P.nu]))
    force = (solid.hessian(solid.strain_terms[0], 0 * u) @ u).reshape(-1, 3)
    end = np.isclose(solid.nodes[:, 0], 1)
    assert force[end].sum(axis=0) == pytest.approx([P.E * strain, 0, 0], abs=1e-12 * P.E * strain)
    assert force[:, 1:] == pytest.approx(0, abs=1e-12 * P.E * strain)


def test_shear_has_the_shear_modulus(solid):
    gamma = 1e-3
    u = linear_field(solid, [[0, gamma, 0], [0, 0, 0], [0, 0, 0]])
    force = (solid.hessian(solid.strain_terms[0], 0 * u) @ u).reshape(-1, 3)
    top = np.isclose(solid.nodes[:, 1], 1)
    assert force[top, 0].sum() == pytest.approx(P.E / (2 * (1 + P.nu)) * gamma, rel=1e-12)


def test_energy_of_a_large_stretch(solid):
    """W = (lambda / 2 + mu) ((a^2 - 1) / 2)^2 for the stretch a along one axis."""
    a = 1.4
    u = linear_field(solid, np.diag([a - 1, 0, 0]))
    constrained = P.E * (1 - P.nu) / ((1 + P.nu) * (1 - 2 * P.nu))
    exact = constrained / 2 * ((a**2 - 1) / 2) ** 2
    assert solid.energy(solid.strain_terms[0], u) == pytest.approx(exact, rel=1e-13)


def test_geometric_stiffness_of_a_prestressed_rotation(solid):
    """r' K_g(u) r = integral of sigma : W' W, here E strain for W about z."""
    strain, step = 1e-3, 1e-3
    u = linear_field(solid, strain * np.diag([1, -P.nu, -P.nu]))
    r = linear_field(solid, [[0, -1, 0], [1, 0, 0], [0, 0, 0]])
    term = solid.strain_terms[0]
    # the tangent is quadratic in u, so the central difference is exact
    change = solid.hessian(term, step * u) - solid.hessian(term, -step * u)
    assert r @ (change @ r) / (2 * step) == pytest.approx(P.E * strain, rel=1e-8)


def test_distorted_hexahedron_is_the_standard_one():
    """Trilinear, 2 x 2 x 2 Gauss points for K; M integrated exactly."""
    body = Assembled(solid_linear, cube("hexahedron", n=1, degree=1, amplitude=0.15), 1)
    nodes = body.nodes
    corners = np.array(list(itertools.product((0, 1), repeat=3)))
    # nodes move by less than half an edge: the nearest corner of the cube tells them apart
    corners = corners[np.argmin(np.linalg.norm(nodes[:, None] - corners[None], axis=2), axis=1)]
    assert len(np.unique(corners, axis=0)) == 8
    zero = np.zeros(24)
    k = body.hessian(body.strain_terms[0], zero).toarray()
    m = body.hessian(body.kinetic_terms[0], zero).toarray()
    k_numpy, _ = hexahedron(nodes, 2 * corners - 1, points=2)
    _, m_numpy = hexahedron(nodes, 2 * corners - 1, points=4)
    assert abs(k - k_numpy).max() < 1e-14 * abs(k).max()
    assert abs(m - m_numpy).max() < 1e-14 * abs(m).max()


def hexahedron(nodes, signs, *, points):
    """Stiffness by B'DB and mass of an 8-node hexahedron; signs are its nodes' local places."""
    lam = P.E * P.nu / ((1 + P.nu) * (1 - 2 * P.nu))
    mu = P.E / (2 * (1 + P.nu))
    d = np.diag([2 * mu] * 3 + [mu] * 3)
    d[:3, :3] += lam
    k, m = np.zeros((24, 24)), np.zeros((24, 24))
    gauss = list(zip(*np.polynomial.legendre.leggauss(points), strict=True))
    for rule in itertools.product(gauss, repeat=3):
        xi = np.array([x for x, _ in rule])
        factors = 1 + signs * xi
        shape = factors.prod(axis=1) / 8
        local = np.stack(
            [signs[:, i] * np.delete(factors, i, axis=1).prod(axis=1) / 8 for i in range(3)], axis=1
        )
        jacobian = nodes.T @ local
        gradient = local @ np.linalg.inv(jacobian)
        volume = np.prod([w for _, w in rule]) * np.linalg.det(jacobian)
        b = np.zeros((6, 24))
        for i, j in enumerate(((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))):
            b[i, j[0] :: 3] += gradient[:, j[1]]
            if j[0] != j[1]:
                b[i, j[1] :: 3] += gradient[:, j[0]]
        k += volume * b.T @ d @ b
        m += volume * P.rho * np.kron(np.outer(shape, shape), np.eye(3))
    return k, m


@pytest.mark.parametrize("cell", solid_linear.CELLS)
def test_stiffness_of_straight_cells_is_integrated_exactly(cell):
    """By the same form with a rule of higher degree; quadratic elements, parallelepipeds."""
    body = Assembled(solid_linear, cube(cell, n=1, degree=2, amplitude=0), 2)
    zero = np.zeros(len(body.u.x.array))
    ((integrand, rule),) = solid_linear.strain_energy(body.u, body.p)
    finer = body.integral(integrand, solid_linear.Quadrature(rule.degree + 4))
    k, exact = body.hessian(body.strain_terms[0], zero), body.hessian(finer, zero)
    assert abs(k - exact).max() < 1e-14 * abs(exact).max()


def test_forms_are_reached_by_name_without_the_continuums_libraries():
    """In a fresh process, where nothing else has imported the form file."""
    script = (
        "import sys; from flexmbd import forms; "
        "print(forms.solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0).E); "
        "sys.exit(any(name in sys.modules for name in ('dolfinx', 'petsc4py', 'mpi4py', 'gmsh')))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "210000000000.0\n", "")
