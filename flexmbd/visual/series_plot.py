"""Series over time, drawn with matplotlib: one panel a unit, the legend beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.files.result_table import ResultTable
from flexmbd.given import checked, is_list
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.visual.destination import checked_path, save, write
from flexmbd.visual.panels import Curve, draw_panels, new_figure
from flexmbd.visual.recorded_motion import RecordedMotion

if TYPE_CHECKING:
    from matplotlib.figure import Figure


FloatArray = NDArray[np.float64]

#: What can be drawn: a joint's coordinates, a frame's position, a flexible body's modal coordinates, a function of
#: times (k,) that gives (k,) or (k, m), or values at the trajectory's instants.
Drawn: TypeAlias = Connection | Frame | FlexibleBody | Callable[[FloatArray], ArrayLike] | ArrayLike

#: What ``plot_series`` writes.
SUFFIXES = (".pdf", ".png", ".svg")

#: Instants that a curve is drawn through at the least: more than a picture has columns.
_INSTANTS = 2000


@checked("trajectory", "title", "ylabel", error=PictureError)
def plot_series(
    trajectory: RecordedMotion,
    series: Sequence[tuple[str, Drawn] | Connection | Frame | FlexibleBody] = (),
    *,
    path: str | Path | None = None,
    ylabel: str = "",
    title: str = "",
) -> Figure:
    """Draw series over time; without any, the trajectory's energies.  Events are marked by vertical lines.

    Each unit has a panel of its own, the legend beside it.  The trajectory's root writes; it may be called on the root
    alone, if the functions drawn may be.

    Args:
        trajectory: gives the times t (nt,) and the motion between them.
        series: joints, frames and flexible bodies, which are called by their names, or pairs (label, what).  Joints,
            frames, flexible bodies and functions are drawn through the instants of ``fine_times``; values (nt,) or
            (nt, k) by straight lines from instant to instant; k columns become k lines.  The unit of functions and
            values stands at the end of the label, "speed [m/s]"; those without one share a panel.
        path: .png, .pdf or .svg to write; an existing file survives a failure.  Without it the
            figure is pyplot's, to be shown by a notebook or ``matplotlib.pyplot.show()``.
        ylabel: what values without a unit are; where there is one panel, what it shows.
        title: of the picture.

    Returns:
        The figure, to be drawn on further.

    Raises:
        PictureError: values do not fit the times, or the file cannot be written.
        SceneError: a joint or body without coordinates in this trajectory.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    fine = fine_times(trajectory.t)
    if not is_list(series):
        raise PictureError(f"series must be a list of joints, frames, bodies or (label, what), got {series!r:.100}")
    curves = [curve for one in series for curve in _curves(trajectory, fine, *_labelled(one))]
    if not series:
        curves, ylabel = _energies(trajectory, fine), ylabel or "energy in J"
    if not curves:
        raise PictureError("nothing to draw: the series have no columns")
    figure = new_figure(curves, shown=target is None)
    events = [(one.name, one.t) for one in trajectory.events]
    draw_panels(figure, curves, across="time in s", ylabel=ylabel, title=title, events=events)
    if target is not None:
        save(figure, target, trajectory.team)
    return figure


@checked(error=PictureError)
def plot_table(
    table: ResultTable, names: Sequence[str] = (), *, path: str | Path | None = None, title: str = ""
) -> Figure:
    """Draw columns of a table over its first one, one panel a unit. Not collective.

    Args:
        table: of results.
        names: of the columns; by default all.
        path: .png, .pdf or .svg to write; without it the figure is pyplot's.
        title: of the picture.

    Raises:
        ExportError: there is no such column.
        PictureError: the file cannot be written.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    units = dict(zip(table.names, table.units, strict=True))
    t = table.values[:, 0]
    curves = [Curve(name, units.get(name, ""), t, table.column(name)) for name in names or table.names[1:]]
    if not curves:
        raise PictureError("nothing to draw: the table has no column but its first")
    figure = new_figure(curves, shown=target is None)
    draw_panels(figure, curves, across=f"{table.names[0]} in {table.units[0]}", title=title)
    if target is not None:
        write(target, lambda temporary: figure.savefig(temporary, dpi=150))
    return figure


def fine_times(t: FloatArray) -> FloatArray:
    """The instants t (nt,) and as many between them as a curve needs.

    Of an event's two instants of one time the first is put the least bit earlier, for there the motion is that
    before the event.
    """
    marked = t.copy()
    twice = np.flatnonzero(np.diff(t) == 0.0)
    marked[twice] = np.nextafter(t[twice], -np.inf)
    return np.union1d(marked, np.linspace(t[0], t[-1], _INSTANTS))


def _labelled(one: Any) -> tuple[str, Drawn]:
    """A pair (label, what) of what is given."""
    if isinstance(one, Connection | FlexibleBody):
        return one.name, one
    if isinstance(one, Frame):
        return one.label, one
    if isinstance(one, tuple) and len(one) == 2 and isinstance(one[0], str):
        return one
    raise PictureError(f"a series is a joint, a frame, a flexible body or a pair (label, what), got {one!r:.100}")


def _curves(trajectory: RecordedMotion, fine: FloatArray, label: str, what: Drawn) -> list[Curve]:
    """The lines of a series."""
    if isinstance(what, Connection):
        return _columns(label, fine, trajectory.beta(what, t=fine), *_coordinates(what))
    if isinstance(what, Frame):
        return _columns(label, fine, trajectory.position(what, t=fine), list("xyz"), ["m"] * 3)
    if isinstance(what, FlexibleBody):
        q = trajectory.q(what, t=fine)
        return _columns(label, fine, q, [f"q{k + 1}" for k in range(q.shape[1])], ["kg^(1/2) m"] * q.shape[1])
    t, source = (fine, "times it was asked at") if callable(what) else (trajectory.t, "instants of the trajectory")
    values = np.asarray(what(fine) if callable(what) else what, dtype=np.float64)
    if values.ndim not in (1, 2) or len(values) != len(t):
        raise PictureError(
            f"series {label!r} has shape {values.shape}; it needs one row for each of the {len(t)} {source}"
        )
    name, unit = _split_unit(label)
    count = 1 if values.ndim == 1 else values.shape[1]
    endings = list("xyz") if count == 3 else [f"[{k}]" for k in range(count)]
    return _columns(name, t, values, endings, [unit] * count)


def _columns(
    label: str, t: FloatArray, values: FloatArray, endings: Sequence[str], units: Sequence[str]
) -> list[Curve]:
    if values.ndim == 1:
        return [Curve(label, units[0], t, values)]
    return [
        Curve(f"{label} {ending}", unit, t, column)
        for ending, unit, column in zip(endings, units, values.T, strict=True)
    ]


def _coordinates(connection: Connection) -> tuple[list[str], list[str]]:
    """Names and units of a joint's coordinates."""
    joint = connection.joint
    if len(joint.start) == len(joint.velocity_names):
        return list(joint.velocity_names), ["rad" if angular else "m" for angular in joint.angular]
    places = len(joint.start) - 4  # a quaternion, after the displacements of a free joint
    return [*"xyz"[:places], "e0", "e1", "e2", "e3"], ["m"] * places + ["1"] * 4


def _split_unit(label: str) -> tuple[str, str]:
    """A label "speed [m/s]" as its name and its unit."""
    name, bracket, unit = label.rpartition(" [")
    return (name, unit[:-1]) if bracket and unit.endswith("]") else (label, "")


def _energies(trajectory: RecordedMotion, fine: FloatArray) -> list[Curve]:
    energy = trajectory.energy(t=fine)
    parts = {name: getattr(energy, name) for name in ("kinetic", "elastic", "gravitational", "spring")}
    # parts that a machine does not have are left out
    shown = {name: part for name, part in parts.items() if part.any()}
    return [Curve(name, "J", fine, part) for name, part in {**shown, "total": energy.total}.items()]
