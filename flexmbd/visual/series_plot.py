"""Series over time, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.joint.connection import Connection
from flexmbd.visual.destination import checked_path, save
from flexmbd.visual.library import load
from flexmbd.visual.recorded_motion import RecordedMotion

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


FloatArray = NDArray[np.float64]

#: What can be drawn: a joint's coordinates, a frame's position, a flexible body's modal coordinates, a function of
#: times (k,) that gives (k,) or (k, m), or values at the trajectory's instants.
Drawn: TypeAlias = Connection | Frame | FlexibleBody | Callable[[FloatArray], ArrayLike] | ArrayLike

#: What ``plot_series`` writes.
SUFFIXES = (".pdf", ".png", ".svg")

#: Instants that a curve is drawn through at the least: more than a picture has columns.
_INSTANTS = 2000

_EVENT_STYLES = ("--", ":", "-.")


def plot_series(
    trajectory: RecordedMotion,
    series: Sequence[tuple[str, Drawn]] = (),
    *,
    path: str | Path | None = None,
    ylabel: str = "",
    title: str = "",
) -> Figure:
    """Draw series over time; without any, the trajectory's energies.  Events are marked by vertical lines.

    Collective over the trajectory's team where ``path`` is given; its root writes.

    Args:
        trajectory: gives the times t (nt,) and the motion between them.
        series: pairs (label, what).  Joints, frames, flexible bodies and functions are drawn through
            the instants of ``fine_times``; values (nt,) or (nt, k) by straight lines from
            instant to instant; k columns become k lines.
        path: .png, .pdf or .svg to write; an existing file survives a failure.  Without it the
            figure is pyplot's, to be shown by a notebook or ``matplotlib.pyplot.show()``.
        ylabel: what the values are, with their unit.
        title: of the picture.

    Returns:
        The figure, to be drawn on further.

    Raises:
        PictureError: values do not fit the times, or the file cannot be written.
        SceneError: a joint or body without coordinates in this trajectory.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    fine = fine_times(trajectory.t)
    lines = [_line(trajectory, fine, *pair) for pair in series] or _energies(trajectory, fine)
    if not series:
        ylabel = ylabel or "energy in J"
    figure = new_figure(4.5, shown=target is None)
    axes = figure.subplots()
    for label, t, values in lines:
        _draw(axes, t, label, values)
    axes.set_xlabel("time in s")
    axes.set_ylabel(ylabel or (lines[0][0] if len(axes.lines) == 1 else ""))
    axes.set_title(title)
    curves = len(axes.lines)
    _mark_events(axes, trajectory)
    _format_axes(axes, legend=curves > 1 or len(axes.lines) > curves)
    if target is not None:
        save(figure, target, trajectory.team)
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


def _line(trajectory: RecordedMotion, fine: FloatArray, label: str, what: Drawn) -> tuple[str, FloatArray, FloatArray]:
    """Label, times (k,) and values (k,) or (k, m) of a series."""
    if isinstance(what, Connection):
        return label, fine, trajectory.beta(what, t=fine)
    if isinstance(what, Frame):
        return label, fine, trajectory.position(what, t=fine)
    if isinstance(what, FlexibleBody):
        return label, fine, trajectory.q(what, t=fine)
    t, source = (fine, "times it was asked at") if callable(what) else (trajectory.t, "instants of the trajectory")
    values = np.asarray(what(fine) if callable(what) else what, dtype=np.float64)
    if values.ndim not in (1, 2) or len(values) != len(t):
        raise PictureError(
            f"series {label!r} has shape {values.shape}; it needs one row for each of the {len(t)} {source}"
        )
    return label, t, values


def _energies(trajectory: RecordedMotion, fine: FloatArray) -> list[tuple[str, FloatArray, FloatArray]]:
    energy = trajectory.energy(t=fine)
    parts = {name: getattr(energy, name) for name in ("kinetic", "elastic", "gravitational", "spring")}
    # parts that a machine does not have are left out
    shown = {name: part for name, part in parts.items() if part.any()}
    return [(name, fine, part) for name, part in {**shown, "total": energy.total}.items()]


def new_figure(height: float, *, shown: bool) -> Figure:
    """A figure, this high in inches: pyplot's where it is to be shown; else one that nothing else holds."""
    owner = load("matplotlib.pyplot").figure if shown else load("matplotlib.figure").Figure
    figure: Figure = owner(figsize=(8.0, height), layout="constrained")
    return figure


def _draw(axes: Axes, t: FloatArray, label: str, values: FloatArray) -> None:
    if values.ndim == 1:
        axes.plot(t, values, label=label, linewidth=1.4)
        return
    names = "xyz" if values.shape[1] == 3 else [f"[{k}]" for k in range(values.shape[1])]
    for name, column in zip(names, values.T, strict=True):
        axes.plot(t, column, label=f"{label} {name}", linewidth=1.4)


def _mark_events(axes: Axes, trajectory: RecordedMotion) -> None:
    """A vertical line at each event; those of one name look alike and stand in the legend once."""
    names = list(dict.fromkeys(occurrence.name for occurrence in trajectory.events))
    seen: set[str] = set()
    for occurrence in trajectory.events:
        name = occurrence.name
        style = _EVENT_STYLES[names.index(name) % len(_EVENT_STYLES)]
        axes.axvline(
            occurrence.t, color="0.4", linewidth=0.9, linestyle=style, zorder=1.0, label=None if name in seen else name
        )
        seen.add(name)


def _format_axes(axes: Axes, *, legend: bool) -> None:
    remove_frame(axes)
    if legend:
        axes.legend(frameon=False)


def remove_frame(axes: Axes) -> None:
    """A grid, and no lines at the top and the right."""
    axes.grid(color="0.9")
    axes.spines[["top", "right"]].set_visible(False)
