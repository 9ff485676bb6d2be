"""The road of a form to a machine, tried on a small part: reduced, loaded slowly, and moved.

What `flexmbd check` does besides the contract suite, as far as the form's unknowns allow; where it stops it says why.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ContinuumModel,
    ExplicitContinuum,
    ImplicitContinuum,
    Interface,
    NonlinearModel,
    TaggedMesh,
)
from flexmbd.continuum.contract.entries import optional_entries
from flexmbd.continuum.contract.formulation import Formulation
from flexmbd.continuum.contract_suite.check_report import CheckResult, places
from flexmbd.continuum.contract_suite.fields import free_constants
from flexmbd.continuum.contract_suite.history_trial import history_place, trial_step, yielding_parameters
from flexmbd.continuum.contract_suite.outcome import Check, Figure, Outcome, Remark, Verdict, attempt
from flexmbd.continuum.contract_suite.trial import Trial
from flexmbd.continuum.finite_elements.surface_group import Surfaces
from flexmbd.continuum.slow_loading.static_path import clamped_dofs, follow
from flexmbd.errors import FormulationError
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.reduction import craig_bampton

# Of the machines' account: what the integrators' tolerance leaves of what turns over.
_CLOSED = 1e-6

_UNHELD = (
    "not reduced: a constant of a further unknown, as of an electric potential, does nothing, and static shapes are "
    "not determined; name it by gauge(p), as {'potential': (0.0, 0.0, 0.0, 1.0)}, or give the form a surface_energy "
    "that holds it, a ground, on some facets"
)

# Of the part as a full body: enough to tell whether it gains energy.
_EXPLICIT_STEPS = 100

# A slow load's strain, of those that leave something behind; none of a form without a history.
_STRAIN = 1e-4


class Road:
    """A form on a small part between two interfaces, on this rank alone."""

    def __init__(self, form: Formulation, cell: str, degree: int) -> None:
        """Not collective."""
        self.form, self.cell, self.degree = form, cell, degree
        self.ends = ("start", "end") if cell == "interval" else ("x_min", "x_max")

    @property
    def mesh(self) -> TaggedMesh:
        """A new one: a line, a sheet or a block of 1 m, in two or three cells along it."""
        n = self.degree if self.form.REFERENCE == "UPDATED" else 1
        if self.cell == "interval":
            return meshes.line(1.0, divisions=3, degree=n, comm=MPI.COMM_SELF)
        if self.cell in ("triangle", "quadrilateral"):
            return meshes.sheet(1.0, 0.5, divisions=(3, 2), cell=self.cell, degree=n, comm=MPI.COMM_SELF)
        return meshes.block(1.0, 0.5, 0.5, divisions=(2, 1, 1), cell=self.cell, degree=n, comm=MPI.COMM_SELF)

    @property
    def interfaces(self) -> list[Interface]:
        """Rigid ones at both ends."""
        return [Interface(name) for name in self.ends]

    @property
    def surfaces(self) -> Surfaces:
        """Terms on facets, on the end that carries the body's frame: springs do nothing there, a ground is one."""
        optional = optional_entries(self.form)
        if optional.surface_energy is None and optional.surface_kinetic_energy is None:
            return {}
        return {self.ends[0]: (self.form, self.form.reference().parameters)}  # type: ignore[dict-item]

    @property
    def has_free_constants(self) -> bool:
        """Whether a constant of a further unknown does nothing, no term on facets holds it, and no gauge names it."""
        trial = Trial(self.form, self.cell, self.degree)
        if self.surfaces or optional_entries(self.form).gauge is not None or trial.layout.kinematic.all():
            return False
        d = trial.scale
        return free_constants(trial, d[:, None] * trial.stiffness(trial.rest()) * d) > 0

    @cached_property
    def record(self) -> ReducedBody:
        """Reduced with the parameters of the form's reference."""
        model = ContinuumModel(
            self.mesh, self.form, self.form.reference().parameters,  # type: ignore[arg-type]
            degree=self.degree, interfaces=self.interfaces, surfaces=self.surfaces,
        )  # fmt: skip
        return craig_bampton(model, modes=3, frame=self.ends[0])


def reduction(road: Road) -> Outcome:
    """The part is reduced, and clamped at one end no mode of it is without stiffness."""
    if road.has_free_constants:
        return Remark(Verdict.NOTE, _UNHELD)
    frequencies = road.record.frequencies(clamped=[road.ends[0]])
    if not (np.isfinite(frequencies).all() and frequencies[0] > 0.0):
        return Remark(Verdict.FAIL, f"clamped at one end the reduced body has the frequencies {frequencies[:3]} Hz")
    return [Figure("lowest frequency of the part, clamped at one end,", float(frequencies[0]), np.inf, "Hz")]


def pendulum(road: Road) -> Outcome:
    """On a hinge, under its weight: what it gains in kinetic energy is what weight and deformation lose."""
    lowest = road.record.frequencies(clamped=[road.ends[0]])[0]
    # a weight that bends the part by some thousandths of its length, over some of its slowest vibrations
    scene = fm.System(gravity=(0.0, -1e-3 * (2 * np.pi * lowest) ** 2, 0.0))
    body = scene.add(fm.FlexibleBody(road.record), name="part")
    scene.connect(fm.joint.Revolute(axis="z"), scene.ground.frame(), body.frame(road.ends[0]))
    run = scene.simulate(3.0 / lowest, rtol=_CLOSED / 10)
    energy = run.energy()
    change = energy.total - energy.total[0]
    size = float(abs(energy.gravitational - energy.gravitational[0]).max())
    if road.record.damping.any():
        return [Figure("energy gained", max(float(change.max()) / size, 0.0), _CLOSED)]
    return [Figure("energy changed by", float(abs(change).max()) / size, _CLOSED)]


def free_motion(road: Road) -> Outcome:
    """Thrown, turning about all axes, without forces: neither momentum changes."""
    lowest = road.record.frequencies(clamped=[road.ends[0]])[0]
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(road.record), name="part")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame(road.ends[0]))
    free.velocity = lowest * np.array([0.1, -0.2, 0.3, 0.3, 0.2, -0.1])
    momentum = scene.simulate(3.0 / lowest, rtol=_CLOSED / 10).momentum()
    found = []
    for values in (momentum.linear, momentum.angular):
        found.append(abs(values - values[0]).max() / np.linalg.norm(values[0]))
    names = ("momentum changed by", "angular momentum by")
    return [Figure(name, float(value), _CLOSED) for name, value in zip(names, found, strict=True)]


class FullRoad(Road):
    """The part as a full body, without modes: loaded slowly, and in motion by implicit and by explicit steps."""

    def __init__(self, form: Formulation, cell: str, degree: int) -> None:
        """Not collective."""
        super().__init__(form, cell, degree)
        self.parameters = yielding_parameters(form)[0]

    @cached_property
    def body(self) -> NonlinearModel:
        """At rest between checks."""
        return NonlinearModel(
            self.mesh, self.form, self.parameters, degree=self.degree, interfaces=self.interfaces,  # type: ignore[arg-type]
            surfaces=self.surfaces,
        )

    @cached_property
    def pulled(self) -> tuple[Any, Any]:
        """Dofs of both ends, which are held, and the direction (m) of a unit strain at the far one."""
        body = self.body
        far = body.layout.nodes_on(body.mesh.dim - 1, body.mesh.facets(self.ends[1]))
        whole = np.zeros(body.layout.n_local)
        whole[body.displacement_dofs[far, 0]], whole[body.displacement_dofs[far, 1]] = 1.0, 0.5
        held = clamped_dofs(body, self.ends)
        return held, whole[held]

    @cached_property
    def reactions(self) -> Any:
        """At the dofs that are held, N, of an end that was moved slowly; the body is at rest again after."""
        body, (held, way) = self.body, self.pulled
        rest = body.snapshot()
        try:
            pace = 2.0 * trial_step(self.form) if body.is_rate_dependent else 1.0
            path = follow(
                body, [0.5, 1.0], prescribed=held, displacement=lambda t: t * _STRAIN * way,
                seconds=pace if body.needs_step else None,
            )  # fmt: skip
        finally:
            body.restore(rest)
        return path.steps[-1].reactions

    @cached_property
    def period(self) -> float:
        """s, of the part's mass on its stiffness."""
        stiffness = float(self.reactions @ self.pulled[1]) / _STRAIN
        moved, momentum = self.body.mass().createVecs()
        moved.array[self.body.displacement_dofs[:, 0]] = 1.0
        self.body.mass().mult(moved, momentum)
        return float(2 * np.pi * np.sqrt(momentum.dot(moved) / stiffness))


def slow_loading(road: FullRoad) -> Outcome:
    """With one end clamped and the other moved, equilibria are found, and what holds both ends is in balance."""
    if optional_entries(road.form).gyroscopic is not None:
        return Remark(Verdict.SKIP, "rotors inside the body (gyroscopic): reduced bodies alone have their forces")
    if road.has_free_constants:
        return Remark(Verdict.NOTE, _UNHELD)
    held, reactions = road.pulled[0], road.reactions
    directions = road.body.displacement_dofs.T
    sums = [reactions[np.isin(held, dofs)].sum() for dofs in directions]
    return [Figure("reactions out of balance by", float(np.abs(sums).max() / np.abs(reactions).max()), 1e-6)]


def history_in_motion(road: FullRoad) -> Outcome:
    """On a hinge, thrown and under its weight, by implicit steps: it moves, and gains no energy."""
    try:
        interior = ImplicitContinuum(road.body)
    except FormulationError as reason:
        return Remark(Verdict.SKIP, str(reason))
    return _moved(road, interior, road.period, rtol=1e-3, integrator=fm.GeneralizedAlpha())


def explicit_steps(road: FullRoad) -> Outcome:
    """The same by some explicit steps."""
    rest = road.body.snapshot()
    try:
        interior = ExplicitContinuum(road.body)
    except FormulationError as reason:
        road.body.restore(rest)
        return Remark(Verdict.SKIP, str(reason))
    t_end = min(road.period, _EXPLICIT_STEPS * interior.stable_step())
    return _moved(road, interior, t_end, integrator=fm.CentralDifference())


def _moved(road: FullRoad, interior: ImplicitContinuum | ExplicitContinuum, t_end: float, **how: Any) -> Outcome:
    """What an interior gains of energy on a hinge, thrown and under its weight, until t_end (s)."""
    turning = 2 * np.pi / road.period
    scene = fm.System(gravity=(0.0, -1e-4 * turning**2, 0.0))
    rest = road.body.snapshot()
    body = scene.add(fm.ContinuumBody(interior), name="part")
    hinge = scene.connect(fm.joint.Revolute(axis="z"), scene.ground.frame(), body.frame(road.ends[0]))
    hinge.velocity = 0.02 * turning
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fm.ToleranceWarning)  # updates of first order gain no energy by that
            run = scene.simulate(t_end, **how)
    finally:
        road.body.restore(rest)
    parts, machine = run.energies(body), run.energy()
    if "elastic" not in parts:
        return Remark(Verdict.NOTE, 'it moves; whether it gains energy needs energies(u, state, p) with "elastic"')
    total = machine.total + sum(parts.values())
    return [Figure("energy gained", max(float((total - total[0]).max() / parts["kinetic"][0]), 0.0), 0.01)]


REDUCED = (
    Check("reduction", reduction, "the energy must resist every motion but the six rigid ones"),
    Check("pendulum, reduced", pendulum, "kinetic_energy and strain_energy must be quadratic at rest, and finite"),
    Check("free motion, reduced", free_motion, "rigid_motion and section_inertia must be those of kinetic_energy"),
)
"""Of forms with a strain energy, on each element."""

FULL = (
    Check("slow loading", slow_loading, "residual must do no work in rigid motions, and its tangent be its derivative"),
    Check("motion, full body", history_in_motion, "energies must be those of the stress in residual"),
    Check("explicit steps, full body", explicit_steps, "energies must be those of the stress in residual"),
)
"""Of all forms, on one element."""


def road_checks(form: Formulation) -> list[CheckResult]:
    """Reduce a part of a form and load it slowly, and move both, as far as that goes; on this rank alone. Compiles.

    Args:
        form: a checked form file.
    """
    place = history_place(places(form))
    full = _along(FULL, {place: FullRoad(form, *place)})
    if optional_entries(form).residual is not None:
        return full
    return [*_along(REDUCED, {place: Road(form, *place) for place in places(form)}), *full]


def _along(checks: Sequence[Check], roads: Mapping[tuple[str, int], Road]) -> list[CheckResult]:
    results: list[CheckResult] = []
    for check in checks:
        outcomes = {place: _attempted(check, road, results) for place, road in roads.items()}
        results.append(CheckResult(check.name, outcomes, check.remedy))
    return results


def _attempted(check: Check, road: Road, before: Sequence[CheckResult]) -> Outcome:
    """Not where the part was not reduced or loaded: there is nothing to move."""
    if before and isinstance(before[0].outcomes[road.cell, road.degree], Remark):
        return Remark(Verdict.SKIP, f"not run: see '{before[0].name}'")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fm.LockingWarning)  # two cells are no body whose frequencies are wanted
        return attempt(check, road)
