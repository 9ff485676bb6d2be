"""Each trap that the contract suite is there for, laid in a sound form, fails the check that is meant for it."""

import types
from pathlib import Path

from mpi4py import MPI

import flat_shell
import micropolar
import pytest
import saddle_point

from flexmbd.continuum.contract import formulation
from flexmbd.continuum.contract_suite import check_form
from flexmbd.continuum.contract_suite.checks import CHECKS
from flexmbd.continuum.contract_suite.outcome import Remark, Verdict, attempt, verdict
from flexmbd.continuum.contract_suite.ranks import same_on_all_ranks
from flexmbd.continuum.contract_suite.trial import Trial
from flexmbd.errors import FormulationError
from flexmbd.forms import beam_timoshenko, solid_nearly_incompressible

LINEAR = (Path(__file__).parents[1] / "data" / "own_solid.py").read_text()
ENERGY = "return [(energy, Quadrature(degree))]"
KINETIC = "return [(p.rho / 2 * ufl.inner(v, v), Quadrature(2 * n + jacobian))]"
RUBBER = Path(solid_nearly_incompressible.__file__).read_text()
STRAIN = "return (h + h.T + h.T * h) / 2"
SPLIT = "return [(lam / 2 * ufl.tr(strain) ** 2, Quadrature(0)), (mu * ufl.inner(strain, strain), Quadrature(2))]"

RESIDUAL = """def residual(u, v, state, p):
    flow = p.E * u[0].dx(1) * v[1].dx(1)
    return [(ufl.inner(_small_strain_stress(u, p), ufl.grad(v)) + flow, Quadrature(2))]


def _no_energy("""

FORCE = "force of a rigid motion"
FREE = "motions without energy besides six"


def energy(density):
    return ENERGY, ENERGY.replace("energy", density)


def mass(density):
    return KINETIC, KINETIC.replace("ufl.inner(v, v)", density)


def form_file(folder, text, *changes):
    """A form with some of its text replaced, in a file."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "my_form.py"
    path.write_text(text)
    return path


def outcome_of(name, trial):
    (check,) = (check for check in CHECKS if check.name == name)
    return attempt(check, trial)


TRAPS = {
    "a foundation": (energy("energy + p.E * ufl.inner(u, u)"), "rigid motions cost no energy", FORCE),
    "too few points": ((ENERGY, "return [(energy, Quadrature(0))]"), "rigid motions cost no energy", FREE),
    "twice the density": (mass("2 * ufl.inner(v, v)"), "translational mass", "off rho V by 1"),
    "more mass along z": (mass("(ufl.inner(v, v) + v[2] ** 2)"), "translational mass", "off the integral by 0.5"),
    "no mass along z": (mass("(v[0] ** 2 + v[1] ** 2)"), "positive mass", "displacements without mass: 27"),
    "no energy": (("def strain_energy(", RESIDUAL), "symmetry", "at rest, off by"),
    "stiffness by size of cell": (
        energy("energy / ufl.JacobianDeterminant(u.ufl_function_space().ufl_domain())"),
        "patch test, distorted mesh",
        "displacements off by",
    ),
    "half the stress": (
        ("return _small_strain_stress(u, p)", "return _small_strain_stress(u, p) / 2"),
        "stress does the energy's work",
        "work off by 0.5",
    ),
    "an energy with jumps": (
        energy("ufl.conditional(ufl.gt(ufl.sin(1e6 * ufl.tr(strain)), 0), 1.01, 1.0) * energy"),
        "tangent against differences",
        "tangent off the force's difference by",
    ),
    "an energy with a kink": (
        energy("ufl.conditional(ufl.gt(ufl.tr(strain), 0), 1.1, 1.0) * energy"),
        "A(u) u against the residual",
        "a term's force off by",
    ),
    "a claim too high": (("ORDER = {1: 2, 2: 3}", "ORDER = {1: 3}"), "observed order", "of 3"),
    "half of a finite strain": ((STRAIN, "return (h + h.T) / 2 + h.T * h"), "frame indifference", "turned forces"),
}


@pytest.mark.parametrize("trap", TRAPS)
def test_the_trap_fails_its_check(tmp_path, trap):
    change, name, told = TRAPS[trap]
    form = formulation.load_form(form_file(tmp_path, LINEAR, change))
    outcome = outcome_of(name, Trial(form, "hexahedron", 1))
    assert verdict(outcome) is Verdict.FAIL
    assert told in "; ".join(str(figure) for figure in outcome if not figure.passed)


def test_the_trap_of_two_rules_in_one_form(tmp_path, monkeypatch):
    """A linear energy whose volumetric part has one point: each by itself it is right, as one form it is off.

    A form file cannot make that one form, so the test does. The matrix is right; the residual, which has a
    coefficient, is not.
    """
    form = formulation.load_form(form_file(tmp_path, LINEAR, (ENERGY, SPLIT), (STRAIN, "return (h + h.T) / 2")))
    name = "A(u) u against the residual"
    assert verdict(outcome_of(name, Trial(form, "hexahedron", 1))) is Verdict.PASS
    apart = Trial._forms

    def as_one(self, what):
        forms = apart(self, what)
        return [sum(forms[1:], forms[0])]

    monkeypatch.setattr(Trial, "_forms", as_one)
    outcome = outcome_of(name, Trial(form, "hexahedron", 1))
    force = next(figure for figure in outcome if "force" in figure.name)
    assert force.value > 0.1


def test_the_trap_of_the_vertex_rule_for_quadratic_cells(tmp_path):
    """It leaves the middles of the edges without mass; linear cells have it for lumping."""
    change = (KINETIC, 'return [(p.rho / 2 * ufl.inner(v, v), Quadrature(1, "vertex"))]')
    form = formulation.load_form(form_file(tmp_path, LINEAR, change))
    (missing, _) = outcome_of("positive mass", Trial(form, "tetrahedron", 2))
    assert missing.value > 0
    for name in ("positive mass", "translational mass"):
        assert verdict(outcome_of(name, Trial(form, "tetrahedron", 1))) is Verdict.PASS


def test_the_trap_of_locking(tmp_path):
    """Fully integrated, a nearly incompressible solid converges an order slower than it claims."""
    rules = ("(volumetric, Quadrature(2 * n - 1))", "(volumetric, Quadrature(2 * n + 1))")
    form = formulation.load_form(form_file(tmp_path, RUBBER, rules))
    (short,) = outcome_of("observed order", Trial(form, "hexahedron", 2))
    assert short.value > 0.8


def test_the_trap_of_a_linear_energy(tmp_path):
    """Its third derivative, the geometric stiffness, is zero: right for who wants no more, so a note."""
    form = formulation.load_form(form_file(tmp_path, LINEAR, (STRAIN, "return (h + h.T) / 2")))
    outcome = outcome_of("geometric stiffness", Trial(form, "tetrahedron", 1))
    assert isinstance(outcome, Remark)
    assert outcome.verdict is Verdict.NOTE
    assert "no geometric stiffening" in outcome.text


# Hencky's energy, whose strain is the logarithm of the principal stretches.
SPECTRAL = """
    c = 2 * strain + ufl.Identity(3)
    mean = ufl.tr(c) / 3
    off = c - mean * ufl.Identity(3)
    size = ufl.sqrt(ufl.inner(off, off) / 6)
    angle = ufl.acos(ufl.det(off) / (2 * size**3)) / 3
    logs = [ufl.ln(mean + 2 * size * ufl.cos(angle + k * 2 * ufl.pi / 3)) / 2 for k in range(3)]
    energy = lam / 2 * sum(logs) ** 2 + mu * sum(e**2 for e in logs)
    n, g = _degrees(u)
"""


def test_the_trap_of_a_spectral_logarithm(tmp_path):
    """It has no value at u = 0, which is where every computation begins."""
    with pytest.raises(FormulationError, match="strain_energy: term 0: the value at u = 0 is not finite"):
        formulation.load_form(form_file(tmp_path, LINEAR, ("\n    n, g = _degrees(u)\n    if", f"{SPECTRAL}    if")))


def test_what_only_a_mesh_shows_to_have_no_value_ends_the_checks(tmp_path):
    """One failure with its reason, and not ten of which nine only follow."""
    density = "energy * (1 + ufl.sqrt(ufl.tr(strain)) * ufl.bessel_J(0, 0 * u[0]))"
    changes = [('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("hexahedron",)')]
    changes += [("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2}"), energy(density)]
    sheet = check_form(form_file(tmp_path, LINEAR, *changes), comm=MPI.COMM_SELF)
    first, *others = sheet.results
    assert first.verdict is Verdict.FAIL
    assert "hexahedron 1: not finite at u = 0: force, tangent, derivative of the tangent" in first.text()
    assert {line.verdict for line in others} == {Verdict.SKIP}
    assert "symmetry                       not run: see 'finite at rest'" in sheet.text()


def test_a_residual_without_an_energy_may_be_sound(tmp_path):
    """That of the linear solid, with a history that is written but not read: no check fails."""
    residual = """def residual(u, v, state, p):
    return [(ufl.inner(_small_strain_stress(u, p), ufl.grad(v)) + 0 * state[0] * v[0], Quadrature(2))]


def state(p):
    return ufl.as_vector([0.0])


def update(u, state, p):
    return ufl.as_vector([state[0] + ufl.div(u)])


def _no_energy("""
    changes = [("def strain_energy(", residual), ("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2}")]
    changes += [('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("tetrahedron",)')]
    sheet = check_form(form_file(tmp_path, LINEAR, *changes), comm=MPI.COMM_SELF)
    assert sheet.passed
    verdicts = {line.name: line.verdict for line in sheet.results}
    assert verdicts["symmetry"] is verdicts["tangent against differences"] is Verdict.PASS
    assert verdicts["geometric stiffness"] is verdicts["a history is kept"] is Verdict.NOTE
    assert verdicts["the same step twice"] is Verdict.SKIP


@pytest.mark.parametrize("module", [micropolar, saddle_point, flat_shell], ids=lambda module: module.__name__)
def test_forms_of_other_kinds_are_sound(module):
    """Rotations at the points of a solid, a pressure, a surface; each on one cell. No body force is a force too."""
    trial = Trial(formulation.load_form(module), module.CELLS[-1], max(formulation.orders(module, module.CELLS[-1])))
    found = {check.name: attempt(check, trial) for check in CHECKS}
    assert [name for name, outcome in found.items() if verdict(outcome) is Verdict.FAIL] == []
    for name in ("patch test, distorted mesh", "observed order", "rigid motions cost no energy"):
        assert verdict(found[name]) is Verdict.PASS


def test_the_trap_of_a_shell_whose_shear_has_four_points(tmp_path):
    """The nine-node quadrilateral then has one motion of the deflection without energy (Hughes 2000, chapter 5)."""
    rules = ("ufl.inner(shear, shear), Quadrature(4)", "ufl.inner(shear, shear), Quadrature(3)")
    form = formulation.load_form(form_file(tmp_path, Path(flat_shell.__file__).read_text(), rules))
    _, free = outcome_of("rigid motions cost no energy", Trial(form, "quadrilateral", 2))
    assert (free.value, free.remark) == (1.0, "7 in all")


def test_the_trap_of_sections_that_are_not_the_kinetic_energys():
    form = types.ModuleType("beam")
    form.__dict__.update(vars(beam_timoshenko))
    form.section_inertia = lambda p: 1.1 * beam_timoshenko.section_inertia(p)  # type: ignore[attr-defined]
    *_, sections = outcome_of("translational mass", Trial(form, "interval", 1))
    assert sections.value == pytest.approx(0.1, abs=0.05)


COUNTER = """

_calls = []


def reference() -> Reference:
    _calls.append(None)
    return Reference(Parameters(E=2.1e11 + 1e8 * len(_calls), nu=0.3, rho=7850.0))


def _reference("""


@pytest.mark.mpi
def test_the_trap_of_a_form_that_differs_from_call_to_call(shared_path):
    """What the ranks together make of it is not what one makes of it alone."""
    comm = MPI.COMM_WORLD
    if comm.rank == 0:
        form_file(shared_path, LINEAR, ("\n\ndef reference(", COUNTER))
    comm.barrier()
    form = formulation.load_form(shared_path / "my_form.py")
    stiffness, mass, _ = same_on_all_ranks(form, "tetrahedron", 1, comm=comm)
    assert not stiffness.passed
    assert mass.passed
