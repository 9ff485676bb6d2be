"""Newton's method at quadrature points: equations for which its whole steps run away or turn in a circle."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from one_element import one_element
from running_away import running_away
from scipy.optimize import brentq

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, check_form, follow, load_form, prescribed_dofs
from flexmbd.continuum.history.cell_pass import LocalEquationError
from flexmbd.continuum.history.displacement_newton import Balance, Newton
from flexmbd.forms import j2_plasticity as j2

FILE = Path(__file__).parents[1] / "data" / "mohr_coulomb.py"
FORM = load_form(FILE)
SOIL = FORM.Parameters(
    E=6.778e9, nu=0.25, rho=2000.0, cohesion=3.45e6, friction=np.radians(30), dilatancy=np.radians(20)
)


def cube(form, parameters):
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    return NonlinearModel(mesh, form, parameters, degree=1, cell_means=False)


def test_steps_that_run_away_are_shortened():
    body = cube(running_away(), j2.Parameters(E=2e11, nu=0.3, rho=7850.0, yield_stress=2e8))
    y = body.layout.node_x[:, 1]
    u = np.zeros((len(y), 3))
    u[:, 0] = 0.05 * y
    body.commit(u.ravel())
    np.testing.assert_allclose(body.history()[0], 0.05, rtol=1e-9)


def test_the_suite_passes_mohr_and_coulomb():
    sheet = check_form(one_element(FORM, "hexahedron", 1), comm=MPI.COMM_SELF)
    assert sheet.passed, sheet.text()


def surface(stress, angle):
    """Mohr and Coulomb's surface of a bar's stress, Pa: K by the three conditions at the transition angle."""
    j2_, lode = stress**2 / 3, np.sign(-stress)  # sin(3 theta) is 1 under pressure, -1 in tension
    theta, h = lode * SOIL.transition, 1e-5
    s = np.sin(3 * theta)
    mohr = [np.cos(x) - np.sin(angle) * np.sin(x) / np.sqrt(3) for x in theta + h * np.arange(-1, 2)]
    rows = [[1, x, x**2] for x in np.sin(3 * (theta + h * np.arange(-1, 2)))]
    k = np.linalg.solve(rows, mohr) @ [1, lode, 1.0]
    a = SOIL.apex * SOIL.cohesion / np.tan(angle)
    assert abs(s) < 1.0
    return (
        stress / 3 * np.sin(angle)
        + np.sqrt(j2_ * k**2 + (a * np.sin(angle)) ** 2)
        - SOIL.cohesion * np.cos(angle)
    )


@pytest.mark.parametrize("sign", [-1.0, 1.0], ids=["pressed", "pulled"])
def test_a_bar_of_soil_yields_at_its_strength(sign):
    """In steps of a percent, whose trial stress is many times the strength; neither hardens nor softens."""
    body = cube(FORM, SOIL)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z", "x_max": "x"})
    moved = (held % 3 == 0) & (body.layout.node_x[held // 3, 0] > 0.5)
    path = follow(body, [0.01, 0.02, 0.05], prescribed=held, displacement=lambda t: sign * t * moved)
    assert path.cuts == 0
    bound = sign * 20 * SOIL.cohesion
    strength = brentq(lambda stress: surface(stress, SOIL.friction), 1e-3 * bound, bound, xtol=1.0)
    for step in path.steps:
        np.testing.assert_allclose(step.reactions[moved].sum(), strength, rtol=1e-6)


def test_a_step_beyond_which_points_have_no_solution_is_halved():
    """The first whole step of equilibrium fails at a point; half of it does not, and the rest follows."""
    body = cube(FORM, SOIL)
    held = prescribed_dofs(body, {"x_min": "xyz"})
    load = np.zeros(body.n_owned)
    load[1::3] = 1e3
    load[held] = 0.0
    tried = []

    def forces(u):
        tried.append(u.copy())
        if len(tried) == 2:
            raise LocalEquationError("beyond")
        return Balance(body.force(u) - load, np.linalg.norm(load))

    zero = np.zeros(body.layout.n_local)
    solution = Newton(body, held).solve(zero, np.zeros(len(held)), forces, body.tangent)
    np.testing.assert_allclose(tried[2], 0.5 * tried[1], rtol=1e-12)
    free = np.setdiff1d(np.arange(body.n_owned), held)
    assert np.linalg.norm((body.force(solution.increment) - load)[free]) < 1e-8 * np.linalg.norm(load)
