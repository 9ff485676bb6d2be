"""Any number of local unknowns: thirteen of two back stresses, against closed forms and differences."""

import types
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, check_form, follow, load_form, prescribed_dofs
from flexmbd.errors import ConvergenceError
from flexmbd.forms import j2_plasticity as j2

FILE = Path(__file__).parents[1] / "data" / "back_stresses.py"
FORM = load_form(FILE)
STEEL = FORM.Parameters(E=2.0e11, nu=0.3, rho=7850.0, yield_stress=2.0e8)
SIZE = 0.1


def cube(*, comm=MPI.COMM_WORLD):
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=(1, 1, 1), comm=comm)
    return NonlinearModel(mesh, FORM, STEEL, degree=1)


def closed_form(alpha):
    """Stress, Pa, and whole strain of a bar after the plastic strain alpha."""
    C, gamma = np.array(STEEL.C)[:, None], np.array(STEEL.gamma)[:, None]
    stress = STEEL.yield_stress + (C / gamma * (1 - np.exp(-gamma * alpha))).sum(axis=0)
    return stress, alpha + stress / STEEL.E


def test_the_suite_passes_it():
    sheet = check_form(FILE, comm=MPI.COMM_SELF)
    assert sheet.passed, sheet.text()
    (tangent,) = (line for line in sheet.results if line.name == "consistent tangent, yielding")
    assert tangent.verdict.value == "PASS"


def test_a_bar_that_is_pulled_hardens_as_its_back_stresses_say():
    """Of first order in the step, and Newton's method of equilibrium is quadratic: the tangent is consistent."""
    strains = closed_form(np.linspace(0.0, 0.01, 5))[1]
    exact = closed_form(np.linspace(0.0, 0.01, 5))[0][-1]
    errors = []
    for n in (8, 16, 32):
        body = cube(comm=MPI.COMM_SELF)
        held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z", "x_max": "x"})
        pulled = (held % 3 == 0) & (body.layout.node_x[held // 3, 0] > 0.5 * SIZE)
        times = [strains[0], *np.linspace(strains[0], strains[-1], n + 1)[1:]]
        path = follow(body, times, prescribed=held, displacement=lambda t, on=pulled: t * SIZE * on)
        errors.append(abs(path.steps[-1].reactions[pulled].sum() / SIZE**2 - exact) / exact)
        assert path.cuts == 0
        assert max(len(step.residuals) for step in path.steps) <= 7
    assert errors[2] < 3e-3
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, rtol=0.15)


def test_where_the_equations_have_no_solution_cell_point_and_history_are_named():
    body = cube(comm=MPI.COMM_SELF)
    bad = np.zeros(body.layout.n_local)
    bad[:] = np.nan
    with pytest.raises(ConvergenceError, match=r"point \d of the cell around \(0\.05, 0, 0\) m, whose history is \[0"):
        body.force(bad)


@pytest.mark.mpi
def test_equations_that_have_no_solution_from_some_strain_on():
    """exp(z) = 1 - 1000 tr(strain) has one up to a volume strain of a thousandth: told on all ranks, and by names."""
    form = types.ModuleType("exhausted")
    vars(form).update({name: value for name, value in vars(j2).items() if name[:2] != "__"})
    form.local_residual = lambda z, u, state, p, *, mean=None: ufl.exp(z) - 1 + 1e3 * ufl.div(u)  # type: ignore[attr-defined]
    form.local_unknowns = lambda p: 0.0  # type: ignore[attr-defined]
    p = j2.Parameters(E=2e11, nu=0.3, rho=7850.0, yield_stress=2e8, hardening=j2.VoceHardening(1e8, 50.0))
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=(4, 1, 1))
    body = NonlinearModel(mesh, form, p, degree=1)
    x = body.layout.node_x
    swelling = np.zeros_like(x)
    swelling[:, 0] = np.maximum(x[:, 0] - 0.75 * SIZE, 0.0)
    body.force(9e-4 * swelling.ravel())
    before = [values.copy() for values in body.history()]
    told = r"point \d of the cell around \(0\.0875, 0, 0\) m, whose history is plastic_strain_tensor \[0.*_strain \[0\]"
    with pytest.raises(ConvergenceError, match=f"exhausted: .* were not solved.*{told}"):
        body.force(2e-3 * swelling.ravel())
    body.revert()
    assert all(np.array_equal(*pair) for pair in zip(before, body.history(), strict=True))
