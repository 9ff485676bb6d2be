"""Slow loading of slender bodies that bend a lot: in as many steps as of fat ones, to the elastica."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from flexmbd import meshes
from flexmbd.continuum import NonlinearModel, follow, prescribed_dofs
from flexmbd.forms import st_venant_kirchhoff

LOADS = [0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0]


def bent(slenderness, n):
    """The path of a clamped square bar of 1 m under a dead force across its end, in E I, and the end's displacement."""
    height = 1.0 / slenderness
    mesh = meshes.block(1.0, height, height, divisions=(n, 1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, st_venant_kirchhoff, st_venant_kirchhoff.Parameters(E=1e9, nu=0.0, rho=1.0), degree=2)
    held = prescribed_dofs(body, {"x_min": "xyz"})
    end = body.displacement_dofs[body.layout.nodes_on(2, mesh.facets("x_max"))]
    across = np.zeros(body.n_owned)
    across[end[:, 1]] = 1e9 * height**4 / 12 / len(end)
    path = follow(body, LOADS, prescribed=held, load=lambda t: t * across)
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
def test_no_step_is_cut_however_slender(slenderness):
    path, _ = bent(slenderness, 10)
    assert [step.t for step in path.steps] == LOADS
    assert path.cuts == 0
    assert sum(len(step.residuals) - 1 for step in path.steps) < 70


def test_the_bar_comes_to_the_elastica():
    found = [bent(50.0, n)[1] for n in (8, 16)]
    exact = elastica(LOADS[-1])
    errors = [float(np.abs(one[:2] - exact).max()) for one in found]
    assert errors[1] < errors[0] / 4
    assert errors[1] < 0.02
