"""Checks of forms whose unknown holds more than displacements: a damage, a potential, strains of a cell."""

import types
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import ufl

from flexmbd import meshes
from flexmbd.command.form_road import road_checks
from flexmbd.continuum import NonlinearModel, Verdict, check_form, follow, load_form, prescribed_dofs
from flexmbd.continuum.contract_suite.checks import CHECKS
from flexmbd.continuum.contract_suite.expansion import free_expansion
from flexmbd.continuum.contract_suite.fields import is_uniform
from flexmbd.continuum.contract_suite.history_checks import HISTORY_CHECKS
from flexmbd.continuum.contract_suite.history_trial import FIRST, HistoryTrial, history_trials
from flexmbd.continuum.contract_suite.outcome import Remark, attempt, verdict
from flexmbd.continuum.contract_suite.ranks import same_on_all_ranks
from flexmbd.continuum.contract_suite.trial import Trial
from flexmbd.forms import plane_stress, solid_linear, solid_mixed, solid_nearly_incompressible
from flexmbd.reduction import Pressure, load_vectors

DATA = Path(__file__).parents[1] / "data"


def changed(folder, name, *changes):
    text = (DATA / name).read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / name
    path.write_text(text)
    return path


def test_a_phase_field_passes():
    sheet = check_form(DATA / "phase_field.py", comm=MPI.COMM_SELF)
    found = {line.name: line.verdict for line in sheet.results}
    assert sheet.passed, sheet.text()
    names = [check.name for check in HISTORY_CHECKS]
    passed = [name for name in names if found[name] is Verdict.PASS]
    assert passed == [names[0], names[1], names[2], names[5]]
    assert "broadcast" not in sheet.text()


def test_damage_is_in_balance_with_the_strain():
    """Of a uniform strain d = 2 H / (2 H + Gc / ell): the phase field's own equation without gradients."""
    form = load_form(DATA / "phase_field.py")
    p = form.Parameters(E=2.1e11, nu=0.3, rho=7850.0, Gc=1e6, ell=0.2)
    trial = HistoryTrial(form, "hexahedron", 1, parameters=p)
    strain = 1e-3 * (FIRST + FIRST.T) / 2
    stress = p.E / (1 + p.nu) * (strain + p.nu / (1 - 2 * p.nu) * np.trace(strain) * np.eye(3))
    energy = np.sum(stress * strain) / 2
    damage = trial.settled(trial.to(1e-3 * FIRST), dt=0.0)[trial.further]
    np.testing.assert_allclose(damage, 2 * energy / (2 * energy + p.Gc / p.ell), rtol=1e-9)
    assert damage.max() > 0.03


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (("[_h(u, state, p)]", "[state[0] + _psi(u, p)]"), "the same step twice"),
        (("[_h(u, state, p)]", "[0 * _h(u, state, p)]"), "a history is kept"),
    ],
)
def test_a_wrong_history_of_a_phase_field_fails(tmp_path, change, name):
    form = load_form(changed(tmp_path, "phase_field.py", change))
    (check,) = (check for check in HISTORY_CHECKS if check.name == name)
    assert verdict(attempt(check, history_trials(form, "hexahedron", 1))) is not Verdict.PASS


def test_a_potential_without_a_ground(tmp_path):
    """Its constant is no motion without energy; a reduction says that something must hold it."""
    grounded = load_form(DATA / "piezoelectric.py")
    ground = ("def surface_energy(", "def _no_energy(")
    alone = load_form(changed(tmp_path, "piezoelectric.py", ground))
    (check,) = (check for check in CHECKS if check.name.startswith("rigid motions"))
    outcome = attempt(check, Trial(alone, "hexahedron", 1))
    assert verdict(outcome) is Verdict.PASS
    assert "a constant of a further unknown" in outcome[1].remark
    assert [line.verdict for line in road_checks(alone)] == [Verdict.NOTE, Verdict.SKIP, Verdict.SKIP] * 2
    assert [line.verdict for line in road_checks(grounded)] == [Verdict.PASS] * 6


def test_whether_a_material_varies_with_the_place(tmp_path):
    """Strains of a cell are written with the place and vary with nothing; a graded material does."""
    enhanced = Trial(load_form(DATA / "enhanced_strain.py"), "hexahedron", 1)
    assert enhanced.holds_place
    assert is_uniform(enhanced)
    law, stiffer = "(ufl.inner(s, e) - ", "((1 + ufl.SpatialCoordinate(ufl.domain.extract_unique_domain(u))[0]) * "
    graded = (law, f"{stiffer}ufl.inner(s, e) - ")
    assert not is_uniform(Trial(load_form(changed(tmp_path, "piezoelectric.py", graded)), "hexahedron", 1))


@pytest.mark.parametrize("form", [solid_nearly_incompressible, solid_mixed])
@pytest.mark.parametrize("geometry", [1, 2])
def test_small_loads_of_a_nearly_incompressible_cylinder(form, geometry):
    """Lame's cylinder in plane strain, nu = 0.4999: the answer is in proportion down to a billionth of E."""
    E, nu, inner, outer = 210e9, 0.4999, 0.1, 0.2
    way = 2.0 * (1.0 - nu**2) * inner**2 * outer / (E * (outer**2 - inner**2))
    mesh = meshes.quarter_ring(0.02, outer, inner, divisions=(4, 6, 1), degree=geometry, comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, form, form.Parameters(E=E, nu=nu, rho=7800.0), degree=2)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "bottom": "z", "top": "z"})
    force = load_vectors(body, [Pressure("p", "inner")])[:, 0]
    outside = prescribed_dofs(body, {"outer": "xy"})
    x = body.layout.node_x[outside // 3] if form is solid_nearly_incompressible else None
    rest, found = body.snapshot(), []
    for share in (1e-6, 1e-9):
        path = follow(body, [1.0], prescribed=held, load=lambda t, share=share: t * share * E * force)
        assert (len(path.steps), path.cuts) == (1, 0)
        found.append(body.displacement[outside] / (share * E))
        body.restore(rest)
    np.testing.assert_allclose(found[0], found[1], atol=1e-4 * way)
    if x is not None:
        radial = np.abs(x[np.arange(len(outside)), outside % 3]) / np.linalg.norm(x[:, :2], axis=1)
        np.testing.assert_allclose(2 * found[0] @ radial / len(outside), way, rtol=0.05 if geometry == 1 else 1e-3)


@pytest.mark.mpi
@pytest.mark.skipif(MPI.COMM_WORLD.size < 2, reason="needs several ranks")
def test_a_damage_has_the_same_matrices_on_all_ranks():
    """Its history too: what is no displacement is not moved by the check."""
    form = load_form(DATA / "phase_field.py")
    for figure in same_on_all_ranks(form, "hexahedron", 1, comm=MPI.COMM_WORLD):
        assert figure.value <= figure.limit, figure


FORMS = Path(__file__).parents[2] / "forms"


def test_what_expands_freely_is_without_force():
    """With pressures in the cells, with history, of finite strain, of plates."""
    tried = {"solid_mixed": "hexahedron", "j2_plasticity": "tetrahedron",
             "neo_hookean": "tetrahedron", "plate_mitc": "quadrilateral"}  # fmt: skip
    for name, cell in tried.items():
        figures = free_expansion(Trial(load_form(FORMS / f"{name}.py"), cell, 1))
        assert not isinstance(figures, Remark), name
        assert all(figure.value <= figure.limit for figure in figures), (name, figures)


def own(module, **functions):
    form = types.ModuleType("own_form")
    form.__dict__.update({**vars(module), "__name__": "own_form", "__file__": None, **functions})
    return form


def test_what_is_held_to_its_place_does_not_expand_freely():
    def founded(u, p):
        (energy, rule), *_ = solid_linear.strain_energy(u, p)
        return [(energy + 1e-2 * p.E * ufl.inner(u, u), rule)]

    figures = free_expansion(Trial(own(solid_linear, strain_energy=founded), "tetrahedron", 1))
    assert figures[0].value > 1e3 * figures[0].limit


def test_a_slice_that_is_held_along_its_normal_is_told_and_not_failed():
    material = plane_stress.Parameters(E=7e10, nu=0.3, rho=2700.0, t=0.05, plane_strain=True)
    form = own(plane_stress, reference=lambda: plane_stress.Reference(material))
    told = free_expansion(Trial(form, "quadrilateral", 2))
    assert told.verdict is Verdict.NOTE
    assert "along the normal" in told.text
