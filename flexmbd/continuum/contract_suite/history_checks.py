"""The contract's conditions on a form with history that yields: each a function from a trial to figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np
import scipy.linalg

from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract_suite.fields import SMALL_STRAIN
from flexmbd.continuum.contract_suite.history_trial import FIRST, SECOND, HistoryTrial
from flexmbd.continuum.contract_suite.measures import difference, largest, ratio
from flexmbd.continuum.contract_suite.outcome import Check, Figure, Outcome, Remark, Verdict
from flexmbd.continuum.contract_suite.trial import FloatArray

# A strain that is tried where none changes later forces.
_UNREAD = 0.003

# Steps of a stretch of a path, over which work is summed by the trapezoidal rule; and what this leaves.
_STEPS, _SUMMED = 16, 0.02

_ROTATION = scipy.linalg.expm(np.cross(np.eye(3), [0.9, -0.5, 0.7]))


def kept(trial: HistoryTrial) -> Outcome:
    """Strains change every component of the history, and all values are finite there without an increment."""
    trial.restart()
    strain = trial.strain or _UNREAD
    before, never = trial.history, np.full(trial.history.shape[1], True)
    for gradient in (2 * FIRST, 4 * FIRST, 2 * SECOND, FIRST - 3 * SECOND):
        trial.go(strain * gradient, noise=strain / 4)
        never &= (trial.history == before).all(axis=0)
    values = trial.force(), trial.body.tangent(trial.still(), dt=0.0).norm(), trial.history, trial.stress
    if not all(np.isfinite(value).all() for value in values):
        return Remark(Verdict.FAIL, "not finite without an increment, after yielding")
    if trial.strain is None and not never.any():
        return Remark(Verdict.NOTE, "the history changes no forces: strains of up to 2 % change none of later ones")
    which = ", ".join(map(str, np.flatnonzero(never)))
    return [Figure("components that never change:", float(never.sum()), 0.0, which)]


def repeated(trial: HistoryTrial) -> Outcome:
    """A step to where the body stands, in no time, changes nothing."""
    trial.restart()
    begin = trial.history
    trial.go(3 * _strain(trial) * FIRST, noise=_strain(trial) / 4)
    history, force = trial.history, trial.force()
    trial.commit(trial.still(), dt=0.0)
    sizes = abs(history - begin).max(axis=0)
    sizes[sizes == 0.0] = 1.0
    return [
        Figure("history changed by", largest((trial.history - history) / sizes), EXACT),
        Figure("forces by", ratio(largest(trial.force() - force), largest(force)), EXACT),
    ]


def elastic(trial: HistoryTrial) -> Outcome:
    """A closed path below yield, in no time, takes no work, and leaves nothing."""
    trial.restart()
    a, b = _strain(trial) / 4 * FIRST, _strain(trial) / 4 * SECOND
    works = np.cumsum([_go(trial, goal, dt=0.0) for goal in (a, (a + b) / 2, b, 0 * a)])
    left = largest(trial.force())
    figures = [
        Figure("work of a closed path, over what was stored,", ratio(abs(works[-1]), works.max()), _SUMMED),
        Figure("forces left", ratio(left, trial.elastic_force(_strain(trial) / 4)), _SUMMED),
    ]
    return figures


def dissipation(trial: HistoryTrial) -> Outcome:
    """No stretch of a path among yielding strains gives more work than was stored, and the account closes."""
    if "elastic" not in trial.body.energies():
        return Remark(Verdict.SKIP, 'needs energies(u, state, p) with "elastic"')
    trial.restart()
    random = np.random.default_rng(5)
    rows, works = [trial.body.energies()], []
    for _ in range(5):
        works.append(_go(trial, 2.5 * _strain(trial) * random.uniform(-1, 1, (3, 3)), dt=trial.dt))
        rows.append(trial.body.energies())
    stored = np.diff([row["elastic"] for row in rows])
    lost = np.array(works) - stored
    size = largest(works)
    figures = [Figure("dissipation below zero by", max(ratio(-lost.min(), size), 0.0), _SUMMED)]
    if "plastic" in rows[0]:
        plastic = np.diff([row["plastic"] for row in rows])
        figures.append(Figure("account off by", ratio(largest(lost - plastic), size), 2 * _SUMMED))
    return figures


def indifference(trial: HistoryTrial) -> Outcome:
    """A finite rotation within a step that yields turns stress and forces, then and in the step after it."""
    strain = _strain(trial)
    trial.restart()
    small = trial.force(trial.to(strain / 8 * FIRST))
    spin = strain * np.cross(np.eye(3), [0.9, -0.5, 0.7])
    if largest(trial.force(trial.to(strain / 8 * FIRST + spin)) - small) < 1e-9 * largest(small):
        return Remark(Verdict.SKIP, SMALL_STRAIN)
    begin, noise = 2 * strain * FIRST, strain / 4
    goals = (begin + 2 * strain * SECOND, 4 * strain * SECOND)
    straight: list[tuple[FloatArray, ...]] = []
    turned: list[tuple[FloatArray, ...]] = []
    for found, rotation in ((straight, np.eye(3)), (turned, _ROTATION)):
        trial.restart()
        trial.go(begin, noise=noise)
        for goal in goals:
            trial.go(goal, rotation=rotation, noise=noise)
            force = trial.force().reshape(-1, 3) @ rotation
            energies = np.array([*trial.body.energies().values()])
            found.append((rotation.T @ trial.stress @ rotation, force, energies))
    figures = []
    for when, one, other in zip(("turned", "a step later"), straight, turned, strict=True):
        off = [ratio(largest(b - a), largest(a)) for a, b in zip(one, other, strict=True)]
        figures.append(Figure(f"stress, forces, energies {when} off by", max(off), 1e-9))
    return figures


def tangent(trial: HistoryTrial) -> Outcome:
    """Where all points yield, the tangent is the difference of the forces."""
    strain = _strain(trial)
    trial.restart()
    trial.go(3 * strain * FIRST, noise=strain / 4)
    at = trial.settled(trial.to(6 * strain * FIRST, noise=strain / 2), dt=trial.dt)
    random = np.random.default_rng(6).uniform(-1, 1, at.shape)
    way = strain / 10 * random
    # of further unknowns in proportion to what they are there
    way[trial.further] = 0.1 * random[trial.further] * largest(at[trial.further])
    change = trial.dense_tangent(at, dt=trial.dt) @ way
    slopes = difference(lambda u: trial.body.force(u, dt=trial.dt), at, way)
    return [Figure("off by", _off(trial, change, slopes), 1e-6)]


def unloading(trial: HistoryTrial) -> Outcome:
    """Where all points have yielded, the tangent with raised limits is the difference of the forces on the way back.

    Of a history without a limit, whose parameters `scaled_yield` gives back, it is that of the way ahead as well.
    """
    if optional_entries(trial.form).scaled_yield is None:
        return Remark(Verdict.SKIP, "needs scaled_yield(p, factor), without which no machine is linearised about it")
    strain, form = _strain(trial), cast(Any, trial.form)
    raises_nothing = form.scaled_yield(trial.parameters, 2.0) == trial.parameters
    trial.restart()
    trial.go(3 * strain * FIRST)
    way = trial.to(2.9 * strain * FIRST)
    rows = np.arange(len(way), dtype=np.int32)
    change = trial.body.unloading_tangent().getValues(rows, rows) @ way

    def off(side: float) -> float:
        """By the slope of the forces on one side alone, for on the other what has a limit flows."""
        begin, half, end = (trial.body.force(side * share * way, dt=0.0) for share in (0.0, 0.5, 1.0))
        slopes = side * (4 * half - end - 3 * begin)
        return _off(trial, change, slopes)

    figures = [Figure("off by", off(1.0), 1e-6)]
    if raises_nothing:
        figures.append(Figure("ahead, where scaled_yield lets nothing flow, off by", off(-1.0), 1e-6))
    return figures


def _off(trial: HistoryTrial, found: FloatArray, expected: FloatArray) -> float:
    """The largest relative difference, of forces and of what belongs to further unknowns each by itself."""
    parts = [rows for rows in (trial.displaced, trial.further) if len(rows)]
    return max(ratio(largest((found - expected)[rows]), largest(expected[rows])) for rows in parts)


class _NoStrainError(Exception):
    """No strain of up to 2 % changes later forces."""


def _strain(trial: HistoryTrial) -> float:
    if trial.strain is None:
        raise _NoStrainError
    return trial.strain


def _go(trial: HistoryTrial, goal: FloatArray, *, dt: float) -> float:
    """Work, J, of the forces on the straight way to a map of the undeformed cell, which takes dt (s)."""
    whole, work, force = trial.to(goal) / _STEPS, 0.0, trial.force()
    way = whole[trial.displaced]
    for _ in range(_STEPS):
        trial.commit(whole, dt=dt / _STEPS)
        before, force = force, trial.force()
        work += float(way @ (before + force)) / 2
    return work


def _each(one: Callable[[HistoryTrial], Outcome]) -> Callable[[Sequence[HistoryTrial]], Outcome]:
    """The figures of all materials that a form is tried with."""

    def run(trials: Sequence[HistoryTrial]) -> Outcome:
        figures: list[Figure] = []
        for trial in trials:
            try:
                outcome = one(trial)
            except _NoStrainError:
                return Remark(Verdict.SKIP, "no strain of up to 2 % changes what comes after it")
            if isinstance(outcome, Remark):
                return outcome
            figures += outcome
        return figures

    return run


HISTORY_CHECKS = (
    Check(
        "a history is kept",
        _each(kept),
        "update must return every component as it is at the step's end, and residual must see what the state says; "
        "guard norms by ufl.max_value; reference().yielding are materials that yield at strains of a percent",
    ),
    Check(
        "the same step twice",
        _each(repeated),
        "update and residual must return to the same surface: what flowed in the step belongs to the history whole",
    ),
    Check(
        "elastic steps",
        _each(elastic),
        "below yield the update must leave the history alone, and the stress follow from an energy",
    ),
    Check(
        "dissipation",
        _each(dissipation),
        "flow must go the way of the stress it is found with, at the step's end; energies must be those of that stress",
    ),
    Check(
        "frame indifference, yielding",
        _each(indifference),
        "push the tensors of the history forward with the step's gradient, f t f^T, before the increment is added",
    ),
    Check(
        "consistent tangent, yielding",
        _each(tangent),
        "what depends on u must be UFL of u, without jumps; local_residual must have all that z follows",
    ),
    Check(
        "unloading",
        _each(unloading),
        "scaled_yield must multiply all yield limits by its factor, and leave the elasticity alone",
    ),
)
"""Of forms with history, after the others."""
