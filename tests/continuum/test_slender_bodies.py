"""Slow loading of slender bodies that bend a lot: in as many steps as of fat ones, to the elastica."""

import types

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from full_model import gather
from scipy.integrate import solve_bvp

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, equilibrium_path, follow, prescribed_dofs
from flexmbd.forms import neo_hookean, solid_enhanced, solid_shell, st_venant_kirchhoff

LOADS = [0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0]


def bent(slenderness, n, form=st_venant_kirchhoff, *, loads=LOADS, along=follow):
    """The path of a clamped square bar of 1 m under a dead force across its end, in E I, and the end's displacement."""
    height, degree = 1.0 / slenderness, max(form.ORDER)
    mesh = meshes.wall(meshes.sheet(1.0, height, divisions=(n, 1), comm=MPI.COMM_SELF), height)
    body = NonlinearModel(mesh, form, form.Parameters(E=1e9, nu=0.0, rho=1.0), degree=degree)
    held = prescribed_dofs(body, {"x_min": "xyz"})
    end = body.displacement_dofs[body.layout.nodes_on(2, mesh.facets("x_max"))]
    across = np.zeros(body.n_owned)
    across[end[:, 2]] = 1e9 * height**4 / 12 / len(end)
    path = along(body, loads, prescribed=held, load=lambda t: t * across)
    return path, body.displacement[end].mean(axis=0)


def elastica(load):
    """(2,) displacement of the tip over the length."""
    s = np.linspace(0.0, 1.0, 41)
    angle = solve_bvp(
        lambda s, y: np.vstack([y[1], -load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]),
        lambda a, b: np.array([a[0], b[1], a[2], a[3]]),
        s, np.vstack([s, 1.0 - s, s, 0.5 * s]), tol=1e-9,
    )  # fmt: skip
    return angle.y[2:, -1] - [1.0, 0.0]


@pytest.mark.parametrize("slenderness", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("form", [st_venant_kirchhoff, solid_shell, solid_enhanced])
def test_no_step_is_cut_however_slender(form, slenderness):
    path, _ = bent(slenderness, 10, form)
    assert [step.t for step in path.steps] == LOADS
    assert path.cuts == 0
    assert sum(len(step.residuals) - 1 for step in path.steps) < 70


@pytest.mark.parametrize(("form", "error"), [(st_venant_kirchhoff, 0.02), (solid_shell, 0.01), (solid_enhanced, 0.01)])
def test_the_bar_comes_to_the_elastica(form, error):
    found = [bent(50.0, n, form)[1] for n in (8, 16)]
    exact = elastica(LOADS[-1])
    errors = [float(np.abs(one[[0, 2]] - exact).max()) for one in found]
    assert errors[1] < errors[0] / 3
    assert errors[1] < error


@pytest.mark.parametrize("form", [st_venant_kirchhoff, solid_shell, solid_enhanced])
def test_the_prediction_of_a_homogeneous_step(form):
    """S + (dS/du) step less S at its end is that of - dH^T dH / 2; forces on a face, and what the tangent gains."""
    law = form.Parameters(E=3.0, nu=0.3, rho=1.0)
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, form, law, degree=1)
    x, dofs = body.layout.node_x, body.displacement_dofs
    first = np.array([[0.02, -0.3, 0.1], [0.2, 0.03, 0.05], [-0.1, 0.02, -0.01]])
    change = np.array([[0.03, 0.1, 0.02], [-0.05, 0.01, 0.2], [0.1, -0.1, 0.02]])
    other = np.array([[0.3, 0.5, -0.2], [0.1, -0.4, 0.7], [0.6, 0.2, -0.1]])

    def moved(gradient):
        u = np.zeros(body.layout.n_local)
        u[dofs] = x @ gradient.T
        return u

    before, after, along = moved(first), moved(first + change), moved(other)
    body.force(before)
    forces = body.predict_stress(before, after)
    gained = [along @ (gather(body.tangent(after, predicted=told)) @ along) for told in (True, False)]
    lack = -0.5 * change.T @ change
    excess = 2 * law.E / (2 * (1 + law.nu)) * (lack + law.nu / (1 - 2 * law.nu) * np.trace(lack) * np.eye(3))
    face = dofs[body.layout.nodes_on(2, mesh.facets("x_max"))]
    assert forces[face].sum(axis=0) == pytest.approx((np.eye(3) + first + change) @ excess[:, 0], rel=1e-6)
    assert gained[0] - gained[1] == pytest.approx(np.trace(excess @ other.T @ other), rel=1e-6)


def small_strain():
    """St Venant-Kirchhoff's energy of the linear strain, whose stress does not turn with the body."""
    module = types.ModuleType("small_strain")
    vars(module).update({name: value for name, value in vars(st_venant_kirchhoff).items() if name[:2] != "__"})

    def strain_energy(u, p):
        e = ufl.sym(ufl.grad(u))
        energy = p.E / (2 * (1 + p.nu)) * (ufl.inner(e, e) + p.nu / (1 - 2 * p.nu) * ufl.tr(e) ** 2)
        return [(energy, st_venant_kirchhoff.Quadrature(2))]

    module.strain_energy = strain_energy  # type: ignore[attr-defined]
    return module


def test_of_small_strain_nothing_is_predicted_whatever_the_step():
    """A step of which a hundredth is so small that nothing turns is judged as a whole."""
    law, mesh = st_venant_kirchhoff.Parameters(E=3.0, nu=0.3, rho=1.0), meshes.block(1, 1, 1, divisions=(1, 1, 1))
    body = NonlinearModel(mesh, small_strain(), law, degree=1, cell_means=False)
    slope = np.array([[0.02, -0.3, 0.1], [0.2, 0.03, 0.05], [-0.1, 0.02, -0.01]])
    for size in 10.0 ** np.arange(-8, 1):
        step = size * (body.layout.node_x @ slope.T).reshape(-1)
        force = body.norm(body.force(step))
        assert body.norm(body.predict_stress(0.0 * step, step)) < size * force


@pytest.mark.parametrize("slenderness", [100.0, 1000.0])
@pytest.mark.parametrize("load", [1e-4, 1e-7])
def test_a_law_in_f_finds_its_place_under_loads_below_its_round_off(slenderness, load):
    """That of a law in E, which has no round-off of F; forces out of balance are those across the bar."""
    (path, moved), (_, exact) = (
        bent(slenderness, 10, form, loads=[load]) for form in (neo_hookean, st_venant_kirchhoff)
    )
    assert path.cuts == 0
    assert moved[2] == pytest.approx(exact[2], rel=1e-5)


def test_a_path_of_a_law_in_f_begins_under_loads_below_its_round_off():
    def along(body, times, *, prescribed, load):
        return equilibrium_path(body, fm.Continuation(to=times[-1]), prescribed=prescribed, load=load)

    (path, moved), (_, exact) = (
        bent(1000.0, 10, form, loads=[1e-7], along=along) for form in (neo_hookean, st_venant_kirchhoff)
    )
    assert path.factors[-1] == 1e-7
    assert moved[2] == pytest.approx(exact[2], rel=1e-5)
