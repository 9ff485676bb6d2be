"""Bad input of the forms that yield, each refused with a message that names it."""

from pathlib import Path

import numpy as np
import pytest
from assembled import cube
from driven import Driven

from flexmbd import meshes
from flexmbd.continuum.contract import formulation
from flexmbd.continuum.contract_suite.trial_mesh import tagged
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.continuum.history.trial_errors import InvertedCellError
from flexmbd.errors import FormulationError
from flexmbd.forms import hencky_plasticity, j2_plasticity, neo_hookean, st_venant_kirchhoff, updated_lagrangian
from flexmbd.forms.j2_plasticity import LinearHardening, TabulatedHardening, VoceHardening

FORMS = (j2_plasticity, updated_lagrangian, hencky_plasticity)
STEEL = {"E": 2.1e11, "nu": 0.3, "rho": 7850.0, "yield_stress": 2.5e8}


@pytest.mark.parametrize(
    ("law", "values", "message"),
    [
        (TabulatedHardening, ((0.0, 0.1, 0.05), (1.0, 2.0, 3.0)), "not a function: plastic strain 0.05 follows 0.1"),
        (TabulatedHardening, ((0.0, 0.1, 0.1), (1.0, 2.0, 3.0)), "not a function: plastic strain 0.1 follows 0.1"),
        (TabulatedHardening, ((0.0, 0.1, 0.2), (1.0, 3.0, 2.0)), "falls from 3.0 to 2.0 Pa at plastic strain 0.2"),
        (TabulatedHardening, ((0.1, 0.2), (1.0, 2.0)), "must begin at plastic strain 0, not at 0.1"),
        (TabulatedHardening, ((0.0,), (1.0,)), "two points or more"),
        (TabulatedHardening, ((0.0, 0.1), (1.0, 2.0, 3.0)), "2 strains and 3 stresses"),
        (TabulatedHardening, ((0.0, float("nan")), (1.0, 2.0)), "plastic_strain of the hardening table must be finite"),
        (LinearHardening, (-1.0,), "plastic modulus must be finite and at least 0"),
        (LinearHardening, ("1e9",), "modulus must be a number"),
        (VoceHardening, (-1.0, 3.0), "saturation must be finite and at least 0"),
        (VoceHardening, (1.0, 0.0), "rate must be positive"),
    ],
)
def test_hardening(law, values, message):
    with pytest.raises(ValueError, match=message):
        law(*values)


@pytest.mark.parametrize("form", FORMS, ids=lambda form: form.__name__.split(".")[-1])
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"yield_stress": 0.0}, "yield_stress must be positive"),
        ({"yield_stress": -1.0}, "yield_stress must be positive"),
        ({"yield_stress": float("nan")}, "yield_stress must be positive"),
        ({"yield_stress": "250"}, "yield_stress must be a number"),
        ({"nu": 0.5}, "nu must lie between"),
        ({"hardening": 1e9}, r"hardening must be LinearHardening\(...\), VoceHardening\(...\), Tab"),
        ({"hardening": TabulatedHardening((0.0, 0.1), (2.4e8, 3e8))}, "begins at 240000000.0 Pa and not at the yield"),
    ],
)
def test_parameters(form, changes, message):
    with pytest.raises(ValueError, match=message):
        form.Parameters(**{**STEEL, **changes})


def test_a_kinematic_modulus_below_zero():
    with pytest.raises(ValueError, match="kinematic_modulus must be finite and at least 0"):
        j2_plasticity.Parameters(**STEEL, kinematic_modulus=-1.0)


def changed(folder, *changes):
    """The small-strain form with some of its text replaced, loaded from a file."""
    text = Path(j2_plasticity.__file__).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "my_form.py"
    path.write_text(text)
    return formulation.load_form(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("state[6] + growth])", "growth])[0]"), r"update: .*\(7,\), got \(\)"),
        (("*components(plastic), state[6] + growth", "*components(plastic)"), r"update: .*\(7,\), got \(6,\)"),
        (("ufl.as_vector([0.0] * 7)", "ufl.as_vector([0.0] * 6)"), "update: "),
        (("return ufl.as_vector([0.0] * 7)", "return ufl.as_ufl(0.0)"), r"that is a vector, of shape \(n,\)"),
        (("def update(", "def _update("), "state goes with update, which is missing"),
    ],
)
def test_an_update_that_misses_a_state_is_refused_when_it_is_loaded(tmp_path, change, message):
    with pytest.raises(FormulationError, match=message):
        changed(tmp_path, change)


def test_two_rules_in_one_history(tmp_path):
    """History lies at the points of one rule; terms without it may have others."""
    one = "    return [(ufl.inner(deviator, strain) + pressure * ufl.div(v), rule(u))]\n"
    half, other = "ufl.inner(deviator, strain) / 2", "pressure * ufl.div(v)"
    mesh = tagged(cube("hexahedron", n=1, degree=1, amplitude=0.0))
    free = changed(tmp_path, (one, f"    return [(2 * {half}, rule(u)), ({other}, Quadrature(1))]\n"))
    NonlinearModel(mesh, free, free.Parameters(**STEEL), degree=1)
    both = changed(tmp_path, (one, f"    return [({half}, rule(u)), ({half} + {other}, Quadrature(1))]\n"))
    with pytest.raises(FormulationError, match=r"terms with the history have the quadrature rules .*the same rule"):
        NonlinearModel(mesh, both, both.Parameters(**STEEL), degree=1)


@pytest.mark.parametrize("form", [updated_lagrangian, hencky_plasticity], ids=["Truesdell", "logarithmic"])
def test_a_degree_unlike_the_geometrys(form):
    mesh = tagged(cube("hexahedron", n=1, degree=1, amplitude=0.0))
    with pytest.raises(FormulationError, match=r"degree=2 needs a mesh of degree 2, and this one has degree 1"):
        NonlinearModel(mesh, form, form.Parameters(**STEEL), degree=2)


def test_initial_and_updated_groups_in_one_body():
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 2), layers=("low", "high"))
    pairs = {
        "low": (j2_plasticity, j2_plasticity.Parameters(**STEEL)),
        "high": (hencky_plasticity, hencky_plasticity.Parameters(**STEEL)),
    }
    message = r"j2_plasticity refers to the initial configuration and .*hencky_plasticity to the updated one"
    with pytest.raises(FormulationError, match=message):
        NonlinearModel(mesh, pairs, degree=1)


@pytest.mark.parametrize("form", FORMS[1:], ids=["Truesdell", "logarithmic"])
@pytest.mark.parametrize("means", [True, False])
def test_an_increment_that_inverts_a_cell(form, means):
    """One node is pushed through its brick; the message names the one of the eight cells."""
    driven = Driven(form, form.Parameters(**STEEL), n=2, means=means)
    corner = int(driven.x.sum(axis=1).argmax())
    increment = np.zeros_like(driven.x)
    increment[corner] = -0.9
    with pytest.raises(InvertedCellError, match=r"cell \d, at \(0.75, 0.75, 0.75\) m .* turned inside out"):
        driven.body.force(increment.ravel())
    # it stands where it stood
    assert abs(driven.body.force(np.zeros(driven.x.size))).max() < 1e-3


@pytest.mark.parametrize("form", [neo_hookean, st_venant_kirchhoff], ids=["neo-Hookean", "St Venant-Kirchhoff"])
def test_stress_of_the_elastic_solids_is_the_energys(form):
    """Turned and stretched, the traction on the faces of a cube is what its forces are."""
    cubic = Driven(form, form.Parameters(E=3.0, nu=0.25, rho=1.0))
    gradient = np.array([[0.2, 1.3, -0.1], [-0.9, 0.3, 0.2], [0.1, 0.1, 1.2]])
    stress = cubic.go(gradient)
    # the sum of x f over the nodes is the integral of the first Piola-Kirchhoff stress, times F^T: J sigma
    force = cubic.body.force(np.zeros(24)).reshape(8, 3)
    moments = force.T @ (cubic.x @ gradient.T)
    assert np.allclose(moments, np.linalg.det(gradient) * stress, rtol=0, atol=1e-12)
    assert abs(stress).max() > 0.1
    before = cubic.body.energies()["elastic"]
    h = 1e-5
    energies = []
    for sign in (1, -1):
        cubic.go(gradient @ (np.eye(3) + sign * h * np.diag([1.0, -2.0, 0.5])))
        energies.append(cubic.body.energies()["elastic"])
    nominal = np.linalg.det(gradient) * stress @ np.linalg.inv(gradient).T
    expected = (nominal * (gradient @ np.diag([1.0, -2.0, 0.5]))).sum()
    assert (energies[0] - energies[1]) / (2 * h) == pytest.approx(expected, rel=1e-7)
    assert before > 0
