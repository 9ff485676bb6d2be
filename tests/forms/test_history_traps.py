"""Forms with history that are wrong where they yield, each by one change; the check that is meant for it fails."""

from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

from flexmbd.continuum.contract import formulation
from flexmbd.continuum.contract_suite import check_form
from flexmbd.continuum.contract_suite.history_checks import HISTORY_CHECKS
from flexmbd.continuum.contract_suite.history_trial import FIRST, history_trials
from flexmbd.continuum.contract_suite.outcome import Remark, Verdict, attempt, verdict
from flexmbd.continuum.laws.law_form import law_form
from flexmbd.forms import hencky_plasticity, j2_plasticity, updated_lagrangian

SMALL = Path(j2_plasticity.__file__).read_text()
LARGE = Path(updated_lagrangian.__file__).read_text()
ONE_CELL = [
    ('CELLS = ("tetrahedron", "hexahedron")', 'CELLS = ("tetrahedron",)'),
    ("ORDER = {1: 2, 2: 3}", "ORDER = {1: 2}"),
]
LAWS = "laws = LinearHardening(p.E / 50), VoceHardening(p.E / 2000, 50.0)"
FLOW = "plastic = tensor(state) + growth * flow"
STRESS = "return 2 * mu * (elastic - growth * flow), flow, growth"

TRAPS = {
    "no memory": (SMALL, [(FLOW, "plastic = tensor(state)")], "a history is kept", "components that never change: 6"),
    "a component that is never written": (
        SMALL, [("state[6] + growth])", "state[6]])")], "a history is kept", "components that never change: 1"
    ),
    "half of the flow is remembered": (
        SMALL, [(FLOW, "plastic = tensor(state) + growth * flow / 2")], "the same step twice", "history changed by"
    ),
    "creep below yield": (
        SMALL, [(FLOW, f"{FLOW} + 1e-2 * elastic_deviator(u, state)")], "elastic steps", "forces left"
    ),
    "flow against the stress": (
        SMALL,
        [(FLOW, "plastic = tensor(state) - growth * flow"), (STRESS, STRESS.replace("- growth", "+ growth"))],
        "dissipation",
        "dissipation below zero by",
    ),
    "energies without the flow": (
        SMALL, [('"plastic": (done, rule(u))', '"plastic": (done / 2, rule(u))')], "dissipation", "account off by"
    ),
    "a stress that is not pushed forward": (
        LARGE,
        [("rotation * (begin + whole + _convected(middle, elastic)) * rotation.T", "begin + whole")],
        "frame indifference, yielding",
        "turned off by",
    ),
    "a flow that jumps": (
        SMALL,
        [(STRESS, STRESS.replace("growth * flow)", "growth * flow * (1 + 0.1 * ufl.sign(ufl.sin(1e9 * growth))))"))],
        "consistent tangent, yielding",
        "off by",
    ),
}

CREEP = """

def elastic_deviator(u, state):
    return ufl.dev(ufl.sym(ufl.grad(u))) - tensor(state)
"""


def form_file(folder, text, changes):
    """A form with some of its text replaced, in a file."""
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "my_form.py"
    path.write_text(text + CREEP)
    return path


@pytest.mark.parametrize("trap", TRAPS)
def test_the_trap_fails_its_check(tmp_path, trap):
    text, changes, name, told = TRAPS[trap]
    if text is SMALL:
        # one material is enough
        changes = [*changes, (LAWS, "laws = (LinearHardening(p.E / 50),)")]
    form = formulation.load_form(form_file(tmp_path, text, [*ONE_CELL, *changes]))
    (check,) = (check for check in HISTORY_CHECKS if check.name == name)
    outcome = attempt(check, history_trials(form, "tetrahedron", 1))
    assert verdict(outcome) is Verdict.FAIL
    failed = outcome.text if isinstance(outcome, Remark) else "; ".join(str(f) for f in outcome if not f.passed)
    assert told in failed


def test_a_sheet_has_what_yields(tmp_path):
    """The lines of a form with history stand after the others; the form that is wrong says what to look for."""
    _, wrong, _, _ = TRAPS["half of the flow is remembered"]
    changes = [*ONE_CELL, (LAWS, "laws = (LinearHardening(p.E / 50),)"), *wrong]
    sheet = check_form(form_file(tmp_path, SMALL, changes), comm=MPI.COMM_SELF)
    verdicts = {line.name: line.verdict for line in sheet.results}
    assert [check.name for check in HISTORY_CHECKS] == list(verdicts)[-1 - len(HISTORY_CHECKS) : -1]
    assert not sheet.passed
    assert verdicts["a history is kept"] is Verdict.PASS
    assert verdicts["the same step twice"] is Verdict.FAIL
    assert "remedy: update and residual must return to the same surface" in sheet.text()


def test_a_branch_that_leaves_four_percent_is_a_history():
    """However small the strain: what is left of a cycle is no error of the steps, which shorter ones would lessen."""
    tau, share = 1.0, 0.04

    def standard_solid(step, p):
        """A spring, and beside it one of a twenty-fifth that relaxes: its stress is the state."""
        factor = 1.0 / (1.0 + step.dt / tau)
        branch = factor * (step.state + share * p.E * step.increment)
        strain = step.strain + step.increment
        return p.E * strain + branch, p.E * (1.0 + factor * share) * np.eye(6), branch

    trial = Spring(1e6, 1000.0)
    form = law_form(standard_solid, Spring, trial=trial, state={"branch": [0.0] * 6}, dt=1.0)
    (found,) = history_trials(form, "hexahedron", 1)
    assert found.strain == pytest.approx(1e-5)
    (check,) = (check for check in HISTORY_CHECKS if check.name == "elastic steps")
    assert verdict(attempt(check, [found])) is Verdict.PASS


@dataclass(frozen=True)
class Spring:
    E: float
    rho: float


@pytest.mark.parametrize("form", [updated_lagrangian, hencky_plasticity])
def test_what_adding_increments_up_leaves_is_none(form):
    """Truesdell's rate leaves stress of second order after a cycle of strain, a logarithm round-off: neither is flow.

    Yield begins at 1.1e-3 by the strain's size, sqrt(2/3) |dev FIRST| 3 mu over the yield stress E / 1000.
    """
    (found, _) = history_trials(formulation.load_form(form), "tetrahedron", 1)
    size = np.sqrt(2 / 3) * np.linalg.norm((FIRST + FIRST.T) / 2)
    first = 1e-3 * 2 * (1 + 0.3) / 3 / size
    assert first < found.strain < 2 * first
