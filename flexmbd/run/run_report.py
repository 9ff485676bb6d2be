"""The report of a run: ladders of tolerances and of methods against the finest, energies, what was skipped.

`Trajectory.report` alone calls it; how a run is repeated is handed to it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError
from flexmbd.integrate.alpha.generalized_alpha import GeneralizedAlpha
from flexmbd.integrate.automatic import check_method
from flexmbd.integrate.discrete_gradient.energy_momentum import EnergyMomentum
from flexmbd.integrate.explicit.central_difference import CentralDifference
from flexmbd.integrate.explicit.explicit_runge_kutta import ExplicitRungeKutta
from flexmbd.integrate.explicit.tableau import Pair
from flexmbd.integrate.protocol import Integrator
from flexmbd.integrate.radau.radau_iia import RadauIIA
from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.contact.surface_contact import SurfaceContact
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.surface_series import SurfaceSeries
from flexmbd.report import Cell, Content, Line, Listing, Paragraph, Report, ReportSection, ReportTable, diagram
from flexmbd.run.asked import Asked, Repeatable, Run, Rung
from flexmbd.run.stats import Stats

FloatArray = NDArray[np.float64]

_RUNGS = (1e2, 1e1, 1.0, 1e-1, 1e-2)  # of rtol
_STEPS = (2.0, 1.0, 0.5)  # of a fixed step
_FINE, _FINE_STEP = 1e-3, 0.25  # of the finest run
_LEAST, _MOST = 1e-13, 0.5  # rtol
_COMPARED = 20  # times
_MOST_LINES = 8  # of a diagram of contacts
_METHODS: tuple[Integrator, ...] = (
    ExplicitRungeKutta(Pair.DORMAND_PRINCE_5), ExplicitRungeKutta(Pair.DORMAND_PRINCE_8), RadauIIA(),
    GeneralizedAlpha(), EnergyMomentum(), CentralDifference(),
)  # fmt: skip


@dataclass(frozen=True)
class _RungResult:
    """A rung that ran: its cost, and its errors in m, rad and relative to the largest modal coordinates."""

    rung: Rung
    stats: Stats
    errors: tuple[float, float, float]


_FORGOTTEN = "it was read from a file, or stepped from outside, and what it was asked is not known; simulate it"


def run_report(run: Run, repetition: Repeatable | None) -> Report:
    """The report of a run; repeats it a dozen times where it can be. On this rank alone.

    Args:
        run: the trajectory.
        repetition: what it was asked, and how to repeat it; None where that is not known.
    """
    asked = Asked(0.0, None, None, "Not known.", None, _FORGOTTEN) if repetition is None else repetition.asked(run)
    t = run.t
    summary = (
        f"{len(run.bodies)} bodies, {run.scene.nv} velocities, from {t[0]:.6g} to {t[-1]:.6g} s in {len(t) - 1} steps "
        f"by {run.stats.integrator}."
    )
    sections = [
        ReportSection("The run", [_cost(run.stats)]),
        ReportSection("Errors", _ladders(run, asked)),
        ReportSection("Energies", _energies(run)),
        *_contact_sections(run),
        ReportSection("What is computed, and what is skipped", [Listing(asked.explained)]),
    ]
    return Report("Run", "", summary, sections, {"scene": run.scene.digest()})


def _cost(stats: Stats) -> ReportTable:
    rows: tuple[tuple[Cell, ...], ...] = (
        ("integrator", stats.integrator),
        ("steps", stats.steps),
        ("rejected steps", stats.rejected),
        ("Newton iterations", stats.iterations),
        ("factorisations", stats.factorisations),
        ("evaluations", stats.evaluations),
        ("largest constraint residual at the start [m or rad]", stats.start_residual),
        ("largest constraint residual [m or rad]", stats.constraint_residual),
        ("jumps that nobody declared", stats.jumps),
        ("changes of side of laws", stats.switches),
    )
    return ReportTable("cost", "What the run took, and how well it kept its constraints", ("what", "value"), rows)


def _ladders(run: Run, asked: Asked) -> list[Content]:
    method, repeat = asked.method, asked.repeat
    if asked.obstacle or method is None or repeat is None:
        return [Paragraph(f"The run was not repeated, so that no errors are told: {asked.obstacle}.")]
    times = _times(run.t, asked.h)
    if asked.h is None:
        values = [float(f"{min(max(asked.rtol * factor, _LEAST), _MOST):.6g}") for factor in _RUNGS]
        rungs = [Rung(method, rtol, None, times) for rtol in dict.fromkeys(values)]
        fine = Rung(method, float(f"{max(asked.rtol * _FINE, _LEAST):.6g}"), None, times)
    else:
        rungs = [Rung(method, asked.rtol, asked.h * factor, times) for factor in _STEPS]
        fine = Rung(method, asked.rtol, asked.h * _FINE_STEP, times)
    others = [Rung(one, asked.rtol, asked.h, times) for one in _METHODS]
    try:
        fine, finest = _finest(fine, repeat, run.scene)
    except FlexmbdError as error:
        return [Paragraph(f"The finest run failed, so that no errors are told: {error}")]
    exact = _motion(finest, run.bodies, times)
    ladder, failed = _climbed(rungs, repeat, run.bodies, exact)
    methods, refused = _climbed(others, repeat, run.bodies, exact)
    what, unit = ("rtol", "1") if asked.h is None else ("h", "s")
    return [
        Paragraph(
            f"The machine was run again from the same start, each run against the finest, {fine.method.name} with "
            f"{what} = {_size(fine):.3g}, at {len(times)} equal times, at which steps end. Told are the largest "
            "differences of the places of bodies and interfaces (m), of the bodies' turns (rad), and of modal "
            "coordinates over the largest of their body."
        ),
        _ladder_table(f"ladder_{what}", f"Errors over {what}, by {method.name}", what, unit, ladder),
        _ladder_picture(what, unit, ladder),
        _ladder_table("methods", f"Errors of the methods at {what} = {_size(others[0]):.3g}", what, unit, methods),
        *(Paragraph(text) for text in [*failed, *refused]),
    ]


def _finest(fine: Rung, repeat: Callable[[Rung], Run], scene: CompiledScene) -> tuple[Rung, Run]:
    """What all is compared with: the method itself, or in the place of one of low order, where it can be, another.

    Raises:
        FlexmbdError: it failed.
    """
    explicit = isinstance(fine.method, CentralDifference)  # whose steps resolve all vibrations
    better: Integrator = ExplicitRungeKutta(Pair.DORMAND_PRINCE_8) if explicit else RadauIIA()
    if fine.method.order < better.order:
        try:
            check_method(better, scene)
            other = replace(fine, method=better)
            return other, repeat(other)
        except FlexmbdError:
            pass
    return fine, repeat(fine)


def _climbed(
    rungs: Sequence[Rung], repeat: Callable[[Rung], Run], bodies: Mapping[str, Body], exact: Sequence[FloatArray]
) -> tuple[list[_RungResult], list[str]]:
    """The runs, and why others did not run."""
    found, failed = [], []
    for rung in rungs:
        try:
            series = repeat(rung)
        except FlexmbdError as error:
            failed.append(f"{rung.method.name} with {_size(rung):.3g} did not run: {error}")
            continue
        errors = _differences(_motion(series, bodies, rung.times), exact)
        found.append(_RungResult(rung, series.stats, errors))
    return found, failed


def _times(t: FloatArray, h: float | None) -> tuple[float, ...]:
    """Equal times up to the end; of fixed steps, those at which steps of 2 h end as well."""
    span = float(t[-1] - t[0])
    if h is None:
        return tuple(float(one) for one in t[0] + span * np.arange(1, _COMPARED + 1) / _COMPARED)
    pairs = max(int(span / (2.0 * h) * (1.0 + 1e-12)), 1)
    every = -(-pairs // _COMPARED)
    inside = [float(t[0] + 2.0 * h * every * k) for k in range(1, pairs // every + 1)]
    return (*(one for one in inside if one < t[-1] - h / 2.0), float(t[-1]))


def _motion(series: Run, bodies: Mapping[str, Body], times: tuple[float, ...]) -> list[FloatArray]:
    """Places (k, p, 3) of links and interfaces, turns (k, links, 3, 3), and modal coordinates of each flexible body."""
    modal = [one for one in bodies.values() if isinstance(one, FlexibleBody) and one.record.n_modes]
    at = np.array(times)
    links = series.body_motion(t=at)
    frames = [body.frame(one.name) for body in modal for one in body.record.interfaces]
    places = [links[..., :3], *(series.position(frame, t=at)[:, None] for frame in frames)]
    turns = links[..., 3:12].reshape(*links.shape[:2], 3, 3)
    return [np.concatenate(places, axis=1), turns, *(series.q(body, t=at) for body in modal)]


def _differences(one: Sequence[FloatArray], other: Sequence[FloatArray]) -> tuple[float, float, float]:
    """The largest of places, turns and modal coordinates."""
    place = np.linalg.norm(one[0] - other[0], axis=-1)
    relative = np.swapaxes(one[1], -1, -2) @ other[1]
    off = relative - np.swapaxes(relative, -1, -2)
    sine = np.sqrt(off[..., 0, 1] ** 2 + off[..., 0, 2] ** 2 + off[..., 1, 2] ** 2) / 2.0
    cosine = (np.trace(relative, axis1=-2, axis2=-1) - 1.0) / 2.0
    modal = [
        float(abs(a - b).max() / abs(b).max()) for a, b in zip(one[2:], other[2:], strict=True) if abs(b).max() > 0.0
    ]
    return float(place.max()), float(np.arctan2(sine, cosine).max()), max(modal, default=float("nan"))


def _size(rung: Rung) -> float:
    return rung.rtol if rung.h is None else rung.h


def _ladder_table(name: str, caption: str, what: str, unit: str, found: Sequence[_RungResult]) -> ReportTable:
    headings = (
        "method", f"{what} [{unit}]", "steps", "rejected", "evaluations", "place [m]", "turn [rad]",
        "modal coordinates [1]",
    )  # fmt: skip
    rows = tuple(
        (one.rung.method.name, _size(one.rung), one.stats.steps, one.stats.rejected, one.stats.evaluations, *one.errors)
        for one in found
    )
    return ReportTable(name, caption, headings, rows)


def _ladder_picture(what: str, unit: str, found: Sequence[_RungResult]) -> Content:
    sizes = [_size(one.rung) for one in found]
    labels = ("place in m", "turn in rad", "modal, relative")
    lines = [
        Line(label, sizes, values)
        for k, label in enumerate(labels)
        if np.isfinite(values := [one.errors[k] or float("nan") for one in found]).any()
    ]
    label = what if unit == "1" else f"{what} in {unit}"
    return diagram(f"ladder_{what}", f"Errors over {what}", lines or [Line("", sizes, sizes)], x=label, y="error")


def _energies(series: Run) -> list[Content]:
    energy = series.energy()
    parts = {
        "kinetic": energy.kinetic, "elastic": energy.elastic, "gravitational": energy.gravitational,
        "springs": energy.spring, "total": energy.total,
    }  # fmt: skip
    rows = tuple(
        (name, float(one[0]), float(one[-1]), float(one.min()), float(one.max())) for name, one in parts.items()
    )
    exchanged = max(float(np.ptp(one)) for name, one in parts.items() if name != "total")
    change = float(abs(energy.total - energy.total[0]).max())
    share = f", {change / exchanged:.3g} of the most that one of its parts changes by" if exchanged > 0.0 else ""
    shown = [(name, one) for name, one in parts.items() if np.ptp(one) > 0.0 or name == "total"]
    lines = [Line(name, series.t, one, is_marked=False) for name, one in shown]
    with_history = () if series.scene.interiors is None else series.scene.interiors.bodies
    interiors = tuple(
        (body.name, part, float(one[0]), float(one[-1]), float(one.min()), float(one.max()))
        for body in with_history
        for part, one in series.energies(body).items()
    )
    headings = ("start [J]", "end [J]", "least [J]", "most [J]")
    beside: list[Content] = []
    if interiors:
        beside = [
            Paragraph("Bodies with history have energies of their own inside, which are not in these sums."),
            ReportTable("interiors", "Energies inside bodies with history", ("body", "part", *headings), interiors),
        ]
    return [
        Paragraph(
            f"The total changes by at most {change:.4g} J{share}. What changes it is what drives, loads that depend on "
            "time, dampers and friction do, and the error of the integration."
        ),
        ReportTable("energies", "Energies", ("part", *headings), rows),
        diagram("energies", "Energies over time", lines, x="t in s", y="J", scales=("linear", "linear")),
        *beside,
    ]


def _contact_sections(run: Run) -> list[ReportSection]:
    """One of the contacts of elastic surfaces, or none where there are none."""
    pairs = [one for one in run.scene.index.forces if isinstance(one, SurfaceContact)]
    series = [one for one in run.contacts(pairs) if isinstance(one, SurfaceSeries)]
    if not series:
        return []
    rows: list[tuple[Cell, ...]] = []
    forces: list[tuple[float, str, FloatArray]] = []
    for pair, one in zip(pairs, series, strict=True):
        force = one.normal_force.sum(axis=1)
        bears = (one.normal_force > 0.0).sum(axis=1)
        k = int(force.argmax())
        pressures = [float(part.max()) if part.size else np.nan for part in (one.pressure, one.other_pressure)]
        rows.append((pair.what, float(force[k]), float(run.t[k]), *pressures, int(bears.max())))
        forces.append((float(force[k]), pair.what, force))
    most = sorted(forces, key=lambda one: -one[0])[:_MOST_LINES]
    headings = (
        "contact", "largest force [N]", "at [s]", "largest pressure [Pa]", "on the other surface [Pa]",
        "patches that bear, at most",
    )  # fmt: skip
    lines = [Line(what, run.t, force, is_marked=False) for _, what, force in most]
    contents: list[Content] = [
        Paragraph(
            "Normal forces are sums over the patches of a surface, at the ends of steps. A pressure is the force on a "
            "patch over its area; how it is spread within a patch is not known."
        ),
        ReportTable("contacts", "Contacts of elastic surfaces", headings, tuple(rows)),
        diagram("contacts", "Normal forces over time", lines, x="t in s", y="N", scales=("linear", "linear")),
    ]
    return [ReportSection("Elastic surfaces that touch", contents)]
