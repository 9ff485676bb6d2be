"""A formulation's own dissipation, from the file to the damping matrix of a record and the decay of a machine."""

from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
from one_element import one_element

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, check_form, homogeneous_energy, load_form, lumped_rotations
from flexmbd.errors import FlexmbdError, FormulationError, ReductionError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, ModalDamping, craig_bampton, prestressed

FILE = Path(__file__).parents[1] / "data" / "viscous_solid.py"
TEXT = FILE.read_text()
FORM = load_form(FILE)
MU, BULK, TAU = 8.0e10, 1.7e11, 2e-5
RUBBER = FORM.Parameters(mu=MU, bulk=BULK, rho=7850.0, eta=TAU * MU, zeta=TAU * BULK)
RATE = "return [(ufl.inner(_stress(rate, p.eta, p.zeta), rate) / 2, Quadrature(2 * _degree(v)))]"


def beam(form=FORM, parameters=RUBBER, *, comm=MPI.COMM_WORLD):
    mesh = meshes.block(0.4, 0.04, 0.03, divisions=(8, 2, 2), cell="hexahedron", comm=comm)
    return ContinuumModel(mesh, form, parameters, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])


@pytest.mark.mpi
def test_a_viscosity_that_goes_with_the_stiffness_is_kelvin_and_voigts():
    """Whose matrix is tau K_qq, diagonal; the ratio of each mode is tau omega / 2."""
    reduced = craig_bampton(beam(), modes=5, frame="x_min")
    omega = np.sqrt(reduced.stiffness)
    np.testing.assert_allclose(reduced.damping, np.diag(TAU * omega**2), rtol=0, atol=1e-9 * TAU * omega.max() ** 2)
    assert reduced.provenance["damping"] == "dissipation of the formulation"


@pytest.mark.mpi
def test_viscosities_of_their_own_couple_the_modes():
    """D = Phi^T K' Phi with the stiffness K' of an elastic solid whose moduli are the viscosities."""
    p = replace(RUBBER, eta=4e5, zeta=9e6)
    model = beam(parameters=p)
    damping = ModalDamping(0.01, held=["x_min"])
    reduced = craig_bampton(model, modes=5, frame="x_min", keep=Keep(modes=True), damping=damping)
    nu, E = (3 * p.zeta - 2 * p.eta) / (6 * p.zeta + 2 * p.eta), 9 * p.zeta * p.eta / (3 * p.zeta + p.eta)
    alone = beam(solid_linear, solid_linear.Parameters(E=E, nu=nu, rho=1.0), comm=MPI.COMM_SELF)
    order = np.lexsort(alone.node_x.round(9).T)
    kept = reduced.modes.x + reduced.p_MB_M
    phi = np.zeros((alone.n_owned, reduced.n_modes))
    phi[alone.displacement_dofs[order]] = reduced.modes.phi[np.lexsort(kept.round(9).T)]
    images = np.column_stack([matrix_product(alone.K, column) for column in phi.T])
    expected = phi.T @ images + np.diag(2 * 0.01 * np.sqrt(reduced.stiffness))
    np.testing.assert_allclose(reduced.damping, expected, rtol=0, atol=1e-9 * abs(expected).max())
    off = expected - np.diag(np.diag(expected))
    assert abs(off).max() > 1e-3 * abs(expected).max()
    assert reduced.provenance["damping"] == f"{damping}; dissipation of the formulation"


def matrix_product(matrix, column):
    x, y = matrix.createVecs()
    x.array[:] = column
    matrix.mult(x, y)
    return y.array.copy()


def test_a_machine_decays_by_it():
    """The body alone, clamped: eigenvalues omega (-ratio +- sqrt(ratio^2 - 1)) with the ratio tau omega / 2."""
    reduced = craig_bampton(beam(comm=MPI.COMM_SELF), modes=3, frame="x_min")
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(reduced), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    found = np.array(scene.linearize().eigenvalues())
    omega = np.sqrt(reduced.stiffness)
    ratio = TAU * omega / 2
    expected = np.concatenate([omega * (-ratio + sign * np.sqrt(ratio**2 - 1 + 0j)) for sign in (1, -1)])
    found, expected = (values[np.lexsort((values.real, values.imag.round(3)))] for values in (found, expected))
    np.testing.assert_allclose(found, expected, rtol=1e-7)


def test_the_suite_passes_it_and_says_so():
    """With the lines of the other checks; the form without it is skipped."""
    sheet = check_form(one_element(FORM, "tetrahedron", 2), comm=MPI.COMM_SELF)
    assert sheet.passed, sheet.text()
    (line,) = (one for one in sheet.results if one.name == "viscous forces")
    assert line.verdict.value == "PASS"


@pytest.mark.parametrize(
    ("density", "told"),
    [
        ("p.eta * ufl.tr(rate) ** 2 - p.eta * ufl.inner(rate, rate)", "is not convex"),
        ("p.eta * ufl.inner(rate, rate) - 2 / 3 * p.eta * ufl.tr(rate) ** 2", "is not convex"),
        ("p.eta * rate[0, 1]", "no part linear in the rates"),
        ("p.eta * (1 + ufl.inner(rate, rate))", "must be zero where nothing moves"),
        ("p.eta * ufl.inner(v, v)", "a rigid motion dissipates"),
        ("p.eta * ufl.inner(ufl.grad(v), ufl.grad(v))", "a rigid motion dissipates"),
        ("p.eta * ufl.sqrt(ufl.inner(rate, rate))", "first derivative at u = 0 is not finite"),
        ("p.eta * (ufl.inner(rate, rate) - ufl.inner(rate, rate) ** 2 / 100)", "is not convex"),
    ],
)
def test_what_is_no_dissipation_is_refused(tmp_path, density, told):
    assert RATE in TEXT
    path = tmp_path / "my_form.py"
    path.write_text(TEXT.replace(RATE, f"return [({density}, Quadrature(2 * _degree(v)))]"))
    with pytest.raises(FormulationError, match=f"dissipation: (term 0: )?.*({told})"):
        load_form(path)


@pytest.mark.mpi
def test_values_that_make_it_gain_energy_are_refused_before_anything_is_made():
    with pytest.raises(FormulationError, match=r"with Parameters.*zeta=-1.*dissipation is not convex"):
        beam(parameters=replace(RUBBER, zeta=-1.0))


def test_a_dissipation_without_a_matrix_is_refused_before_the_reduction(tmp_path):
    """Convex, and not quadratic: sound, and a reduced body cannot carry it."""
    path = tmp_path / "my_form.py"
    path.write_text(TEXT.replace(RATE, RATE.replace(", Q", " + p.eta * ufl.inner(rate, rate) ** 2, Q")))
    form = load_form(path)
    p = form.Parameters(mu=MU, bulk=BULK, rho=7850.0, eta=1e5, zeta=1e5)
    model = beam(form, p, comm=MPI.COMM_SELF)
    with pytest.raises(ReductionError, match="not quadratic in the rates"):
        craig_bampton(model, modes=2, frame="x_min")


def test_what_would_leave_it_out_refuses_it():
    model = beam(comm=MPI.COMM_SELF)
    loaded = prestressed(model, frame="x_min", angular_velocity=(0.0, 0.0, 10.0))
    refused = [
        (lambda: craig_bampton(loaded, modes=2, frame="x_min"), "about a loaded state"),
        (lambda: lumped_rotations(model), "an explicit run would leave out"),
        (lambda: homogeneous_energy(FORM, RUBBER), "a pseudo-rigid body would leave out"),
    ]
    for attempt, told in refused:
        with pytest.raises(FlexmbdError, match=told):
            attempt()


@pytest.mark.parametrize("rate", [1e-8, 1.0, 1e9])
def test_a_function_that_turns_concave_is_found_at_its_own_rates(tmp_path, rate):
    """Whatever their size; a force that saturates is sound, one that falls is not."""
    path = tmp_path / "my_form.py"
    convex = "p.eta * RATE**2 * (ufl.sqrt(1 + ufl.inner(rate, rate) / RATE**2) - 1)"
    concave = "p.eta * RATE**2 * ufl.ln(1 + ufl.inner(rate, rate) / RATE**2)"

    def load(density):
        path.write_text(TEXT.replace(RATE, f"return [({density.replace('RATE', repr(rate))}, Quadrature(2))]"))
        return load_form(path)

    assert load(convex).dissipation
    with pytest.raises(FormulationError, match="is not convex"):
        load(concave)
