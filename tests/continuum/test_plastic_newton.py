"""Newton's method in the plastic range: quadratic with the derivative of the returned stress, linear with eq. 64's."""

import itertools

from mpi4py import MPI

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.fem.petsc import assemble_matrix

from flexmbd import meshes
from flexmbd.continuum.finite_elements import assembly
from flexmbd.continuum.history.displacement_newton import Balance, Convergence, Newton
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.tangent_solver import LinearSolver
from flexmbd.continuum.slow_loading.static_path import follow, prescribed_dofs
from flexmbd.forms import hencky_plasticity as hencky
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import updated_lagrangian as updated

STEEL = {"E": 210e9, "nu": 0.3, "rho": 7800.0, "yield_stress": 0.24e9, "hardening": j2.LinearHardening(2e9)}
LAWS = {"linear": j2.LinearHardening(2e9), "Voce": j2.VoceHardening(0.1e9, 200.0)}


def rate_tangent(body):
    """A tangent of small strain from eq. 64's elasto-plastic tensor at the stress after the return."""
    (history,), u = body._histories, body._u
    form, p = body.groups[0].formulation, body.groups[0].symbols
    state, space = history._state, body.space
    strain, virtual = (ufl.sym(ufl.grad(f(space))) for f in (ufl.TrialFunction, ufl.TestFunction))
    flows = ufl.gt(form.update(u, state, p)[6] - state[6], 0.0)
    stress = form.stress(u, state, p)
    plastic = updated.continuum_tangent(strain, stress, p)
    density = ufl.inner(ufl.conditional(flows, plastic, updated.elasticity(strain, p)), virtual)
    compiled = fem.form(assembly.integral((density, form.rule(u)), body.groups[0], body.mesh.mesh))

    def tangent(increment):
        body.force(increment)
        matrix = assemble_matrix(compiled)
        matrix.assemble()
        return matrix

    return tangent


def residuals(sheared, *, rate):
    """Those of a step that shears a clamped block, m, after it was pulled far into the plastic range."""
    mesh = meshes.block(1.0, 0.6, 0.6, divisions=(3, 2, 2), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, j2, j2.Parameters(**STEEL), degree=1, cell_means=False)
    held = prescribed_dofs(body, {"x_min": "xyz", "x_max": "xyz"})
    pull, shear = (1.0 * np.isin(held, prescribed_dofs(body, {"x_max": axis})) for axis in "xy")
    newton = Newton(body, held, solver=LinearSolver(0), convergence=Convergence(tolerance=1e-11, max_iterations=200))

    def forces(increment):
        residual = body.force(increment)
        return Balance(residual, body.norm(residual[held]))

    rest = np.zeros(body.layout.n_local)
    body.commit(newton.solve(rest, 0.005 * pull, forces, body.tangent).increment)
    solution = newton.solve(rest, sheared * shear, forces, rate_tangent(body) if rate else body.tangent)
    # the first is before the faces have moved
    return np.array(solution.residuals[1:])


def quadratic(history):
    """Whether every residual below 1e-2 is followed by about its square, up to the largest ratio met and round-off."""
    late = history[history < 1e-2]
    assert len(late) >= 2
    return all(after < max(30 * before**2, 1e-10) for before, after in itertools.pairwise(late))


def test_quadratic_and_what_eq_64_leaves_of_it():
    """One table: the residuals of a large step in the plastic range, and of one a fiftieth of it.

    Eq. 64's tensor is the limit for small steps: it loses the quadratic convergence where steps are large, and it
    loses less of it the smaller the step.
    """
    table = {
        (tangent, size): residuals(sheared, rate=tangent == "eq. 64")
        for size, sheared in (("large", 0.005), ("small", 0.0001))
        for tangent in ("consistent", "eq. 64")
    }
    for key, history in table.items():
        print(*key, " ".join(f"{value:.1e}" for value in history[:12]), "..." if len(history) > 12 else "")
    for size in ("large", "small"):
        assert quadratic(table["consistent", size])
        assert not quadratic(table["eq. 64", size])
    assert len(table["consistent", "large"]) <= 8
    assert len(table["eq. 64", "large"]) >= 2 * len(table["consistent", "large"])
    # its rate at the end, a part of the residual that is left by each step
    rates = {size: np.median(table["eq. 64", size][-4:] / table["eq. 64", size][-5:-1]) for size in ("large", "small")}
    print(rates)
    assert rates["large"] > 0.1
    assert rates["small"] < rates["large"] / 2


@pytest.mark.parametrize("law", LAWS.values(), ids=list(LAWS))
@pytest.mark.parametrize("form", [j2, hencky, updated])
@pytest.mark.parametrize("means", [True, False])
def test_quadratic(form, law, means):
    """With cell means, with local unknowns, at finite strain: a clamped block stretched and sheared by 1 % a step."""
    body = NonlinearModel(
        meshes.block(1.0, 0.6, 0.6, divisions=(3, 2, 2), comm=MPI.COMM_SELF),
        form, form.Parameters(**STEEL | {"hardening": law}), degree=1, cell_means=means,
    )
    held = prescribed_dofs(body, {"x_min": "xyz", "x_max": "xyz"})
    pull = 0.01 * np.isin(held, prescribed_dofs(body, {"x_max": "x"}))
    pull += 0.004 * np.isin(held, prescribed_dofs(body, {"x_max": "y"}))
    path = follow(
        body, [1.0, 2.0], prescribed=held, displacement=lambda t: t * pull, solver=LinearSolver(0),
        convergence=Convergence(tolerance=1e-11),
    )
    assert path.cuts == 0
    for step in path.steps:
        print(" ".join(f"{value:.1e}" for value in step.residuals))
        assert quadratic(np.array(step.residuals[1:]))
