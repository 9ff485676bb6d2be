"""All checks on every cell and degree of a form file, and the report of their results."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import TypeAlias, cast

from mpi4py import MPI

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.formulation import Formulation, load_form, orders
from flexmbd.continuum.contract_suite.checks import CHECKS
from flexmbd.continuum.contract_suite.history_checks import HISTORY_CHECKS
from flexmbd.continuum.contract_suite.history_trial import history_place, history_trials, keeps_strains
from flexmbd.continuum.contract_suite.outcome import (
    Figure,
    Outcome,
    Raised,
    Remark,
    Verdict,
    attempt,
    verdict,
)
from flexmbd.continuum.contract_suite.ranks import same_on_all_ranks
from flexmbd.continuum.contract_suite.trial import Trial
from flexmbd.errors import FormulationError
from flexmbd.given import checked

CellOfDegree: TypeAlias = tuple[str, int]
"""A cell and a degree."""

_RANKS = "the same matrices on all ranks"
_SAME = "the form must return the same at each call and on each rank"
_WIDTH = max(len(check.name) for check in CHECKS) + 2


@dataclass(frozen=True)
class CheckResult:
    """One check on all cells and degrees.

    Attributes:
        name: of the check.
        outcomes: by cell and degree.
        remedy: of the check.
    """

    name: str
    outcomes: Mapping[CellOfDegree, Outcome]
    remedy: str

    @property
    def verdict(self) -> Verdict:
        """The gravest of all places."""
        found = {verdict(outcome) for outcome in self.outcomes.values()}
        gravest = (Verdict.FAIL, Verdict.NOTE, Verdict.PASS, Verdict.SKIP)
        return next(one for one in gravest if one in found)

    def text(self) -> str:
        """One line with the worst figures, and below it each place where the check failed."""
        head = f"{self.verdict.value}  {self.name:<{_WIDTH}}"
        failed = {
            place: outcome for place, outcome in self.outcomes.items() if verdict(outcome) is Verdict.FAIL
        }
        if failed:
            places = "" if len(self.outcomes) == 1 else f" on {len(failed)} of {len(self.outcomes)} elements"
            told: dict[str, list[str]] = {}
            for (cell, degree), outcome in failed.items():
                told.setdefault(_outcome_text(outcome), []).append(f"{cell} {degree}")
            lines = [f"      {', '.join(where)}: {text}" for text, where in told.items()]
            # an error says itself what is wrong
            if not all(isinstance(outcome, Raised) for outcome in failed.values()):
                lines.append(f"      remedy: {self.remedy}")
            return "\n".join([f"{head}failed{places}", *lines])
        figures = [outcome for outcome in self.outcomes.values() if not isinstance(outcome, Remark)]
        if figures:
            return head + "; ".join(map(str, _worst(figures)))
        remarks = dict.fromkeys(_outcome_text(outcome) for outcome in self.outcomes.values())
        return head + "; ".join(remarks)


@dataclass(frozen=True)
class FormReport:
    """The findings of the contract suite about one form file.

    Attributes:
        name: of the form.
        lines: one a check.
    """

    name: str
    results: Sequence[CheckResult]

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(line.verdict is not Verdict.FAIL for line in self.results)

    def text(self) -> str:
        """For a person to read: a line a check, with the worst figures of all cells and degrees."""
        places = dict.fromkeys(place for line in self.results for place in line.outcomes)
        elements = ", ".join(f"{cell} {degree}" for cell, degree in places)
        counts = [sum(line.verdict is one for line in self.results) for one in (Verdict.PASS, Verdict.FAIL)]
        return "\n".join(
            [
                f"{self.name}: {elements}",
                f"PASS  {'names, signatures and results':<{_WIDTH}}",
                *(line.text() for line in self.results),
                f"{self.name}: {counts[0] + 1} passed, {counts[1]} failed",
            ]
        )


@checked("comm", error=FormulationError)
def check_form(
    source: str | Path | ModuleType,
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    further: Callable[[Formulation], Sequence[CheckResult]] = lambda form: (),
) -> FormReport:
    """Run the contract suite on a form file. Collective.

    All checks but the last run on rank 0; the last compares the ranks, and needs two.

    Args:
        source: as `flexmbd.continuum.contract.formulation.load_form` takes it.
        comm: the ranks.
        further: more checks, called on rank 0 where none of the suite has failed; `flexmbd check` reduces and moves a
            part by `flexmbd.command.form_road.road_checks`.

    Raises:
        FormulationError: on all ranks: the file cannot be loaded, or breaks the contract in what
            shows without a mesh.
    """
    error: FormulationError | None = None
    try:
        form = load_form(source)
    except FormulationError as caught:
        error = caught
    parallel.raise_collectively(comm, error)
    results = parallel.on_root(comm, lambda: _try_all(form, further))
    return FormReport(cast(ModuleType, form).__name__.rpartition(".")[2], [*results, _try_ranks(form, comm)])


def places(form: Formulation) -> list[CellOfDegree]:
    """Every cell and degree of a form."""
    return [(cell, degree) for cell in form.CELLS for degree in orders(form, cell)]


def _try_all(form: Formulation, further: Callable[[Formulation], Sequence[CheckResult]]) -> list[CheckResult]:
    results = _try_suite(form)
    if any(line.verdict is Verdict.FAIL for line in results):
        return results
    return [*results, *further(form)]


def _try_suite(form: Formulation) -> list[CheckResult]:
    outcomes = {place: _try_place(form, *place) for place in places(form)}
    results = [
        CheckResult(check.name, {place: found[check.name] for place, found in outcomes.items()}, check.remedy)
        for check in CHECKS
    ]
    if not keeps_strains(form) or results[0].verdict is Verdict.FAIL:
        return results
    return [*results, *_try_history(form, history_place(places(form)))]


def _try_place(form: Formulation, cell: str, degree: int) -> dict[str, Outcome]:
    """The outcome of each check; where the form has no values at rest, only that."""
    trial = Trial(form, cell, degree)
    first, *others = CHECKS
    outcomes = {first.name: attempt(first, trial)}
    if isinstance(outcomes[first.name], Remark):
        why = Remark(Verdict.SKIP, f"not run: see '{first.name}'")
        return {**outcomes, **dict.fromkeys([check.name for check in others], why)}
    return {**outcomes, **{check.name: attempt(check, trial) for check in others}}


def _try_history(form: Formulation, place: CellOfDegree) -> list[CheckResult]:
    """What yields, on one cell and degree: history lies at points."""
    try:
        trials = history_trials(form, *place)
    except Exception as error:  # noqa: BLE001  (a form file is foreign code)
        why = Raised(Verdict.FAIL, f"{type(error).__name__}: {error}")
        return [CheckResult(HISTORY_CHECKS[0].name, {place: why}, HISTORY_CHECKS[0].remedy)]
    return [CheckResult(check.name, {place: attempt(check, trials)}, check.remedy) for check in HISTORY_CHECKS]


def _try_ranks(form: Formulation, comm: MPI.Comm) -> CheckResult:
    """Collective."""
    if comm.size == 1:
        why = Remark(Verdict.SKIP, "needs two ranks: mpirun -n 2 flexmbd check ...")
        return CheckResult(_RANKS, dict.fromkeys(places(form), why), _SAME)
    outcomes: dict[CellOfDegree, Outcome] = {}
    for cell, degree in places(form):
        error: Exception | None = None
        try:
            outcomes[cell, degree] = same_on_all_ranks(form, cell, degree, comm=comm)
        except Exception as caught:  # noqa: BLE001  (a form file is foreign code)
            error = caught
        failures = [text for text in comm.allgather(error and f"{type(error).__name__}: {error}") if text]
        if failures:
            outcomes[cell, degree] = Raised(Verdict.FAIL, failures[0])
    return CheckResult(_RANKS, outcomes, _SAME)


def _outcome_text(outcome: Outcome) -> str:
    if isinstance(outcome, Remark):
        return outcome.text
    return "; ".join(str(figure) for figure in outcome if not figure.passed or verdict(outcome) is Verdict.PASS)


def _worst(outcomes: Sequence[Sequence[Figure]]) -> list[Figure]:
    """Of each kind of figure the one nearest to its limit."""
    worst: dict[str, Figure] = {}
    for figure in (figure for outcome in outcomes for figure in outcome):
        if figure.name not in worst or figure.strain > worst[figure.name].strain:
            worst[figure.name] = figure
    return list(worst.values())
