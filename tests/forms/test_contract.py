"""What every form file must do, tried on each cell and degree that it claims."""

import functools
import pkgutil

from mpi4py import MPI

import pytest

import flexmbd.forms
from flexmbd.continuum.contract import formulation
from flexmbd.continuum.contract_suite.check_report import places
from flexmbd.continuum.contract_suite.checks import CHECKS
from flexmbd.continuum.contract_suite.history_checks import HISTORY_CHECKS
from flexmbd.continuum.contract_suite.history_trial import history_place, history_trials, keeps_strains
from flexmbd.continuum.contract_suite.outcome import Verdict, attempt, verdict
from flexmbd.continuum.contract_suite.ranks import same_on_all_ranks
from flexmbd.continuum.contract_suite.trial import Trial

FORMS = [info.name for info in pkgutil.iter_modules(flexmbd.forms.__path__) if info.name[0] != "_"]
CASES = [
    pytest.param((name, cell, degree), id=f"{name}-{cell}-{degree}")
    for name in FORMS
    for cell, degree in places(formulation.load_form(name))
]
FIRST = {case.values[0][0]: case.id for case in reversed(CASES)}
# On one rank the assembly is to be compared with itself: once for each form.
ON_RANKS = [
    case if MPI.COMM_WORLD.size > 1 or case.id == FIRST[case.values[0][0]]
    else pytest.param(*case.values, id=case.id, marks=pytest.mark.whole)
    for case in CASES
]  # fmt: skip


YIELDING = [name for name in FORMS if keeps_strains(formulation.load_form(name))]


@functools.cache
def trial(name, cell, degree):
    return Trial(formulation.load_form(name), cell, degree)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
@pytest.mark.parametrize("case", CASES)
def test_form(case, check):
    outcome = attempt(check, trial(*case))
    assert verdict(outcome) is not Verdict.FAIL, outcome


@functools.cache
def yielding(name):
    form = formulation.load_form(name)
    return history_trials(form, *history_place(places(form)))


@pytest.mark.parametrize("check", HISTORY_CHECKS, ids=lambda check: check.name)
@pytest.mark.parametrize("name", YIELDING)
def test_form_that_yields(name, check):
    """With linear hardening and with a curve, on a distorted cell; small strain alone need not turn."""
    outcome = attempt(check, yielding(name))
    expected = Verdict.PASS
    if (name, check.name) == ("j2_plasticity", "frame indifference, yielding"):
        expected = Verdict.SKIP
    assert verdict(outcome) is expected, outcome


@pytest.mark.mpi
@pytest.mark.parametrize("case", ON_RANKS)
def test_same_matrices_on_all_ranks(case):
    """On one rank the model's own assembly, which may differ in nothing either."""
    name, cell, degree = case
    figures = same_on_all_ranks(formulation.load_form(name), cell, degree, comm=MPI.COMM_WORLD)
    assert all(figure.passed for figure in figures), figures


def test_all_forms_are_found():
    solids = {"solid_linear", "solid_orthotropic", "solid_nearly_incompressible", "solid_mixed"}
    assert solids | {"beam_timoshenko", "plate_mitc"} <= set(FORMS)
    assert {"j2_plasticity", "updated_lagrangian", "hencky_plasticity"} <= set(YIELDING)


def test_no_form_is_without_geometric_stiffness():
    """A linear form alone would spin soft; that is only a note of the suite, so it is held here.

    Small strain with plastic flow is linear below yield: its name says so, and the frame carries its rotation. The
    micropolar solid is that of small micro-rotations, as its file says.
    """
    (stiffening,) = (check for check in CHECKS if check.name == "geometric stiffness")
    found = {case.values[0]: verdict(attempt(stiffening, trial(*case.values[0]))) for case in CASES}
    linear = {name for (name, *_), ended in found.items() if ended is Verdict.NOTE}  # type: ignore[has-type]
    assert linear == {"j2_plasticity", "solid_micropolar"}
    assert set(found.values()) == {Verdict.PASS, Verdict.NOTE}
