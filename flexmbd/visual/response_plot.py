"""Frequency responses, drawn with matplotlib."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.given import checked
from flexmbd.multibody.team import Team
from flexmbd.visual.destination import checked_path, save
from flexmbd.visual.palette import body_colours
from flexmbd.visual.panels import empty_figure, legend_beside, remove_frame
from flexmbd.visual.series_plot import SUFFIXES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FloatArray = NDArray[np.float64]


@runtime_checkable
class Responding(Protocol):
    """A system with a frequency response: a linearised machine."""

    @property
    def team(self) -> Team:
        """Who writes files."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs."""

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of its inputs."""

    def frequency_response(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """(k, outputs, drivers) amplitudes at rad/s."""


@checked("machine", "omega", "title", error=PictureError)
def plot_response(
    machine: Responding, omega: ArrayLike, *, path: str | Path | None = None, title: str = ""
) -> Figure:
    """Draw gain and phase of every output over frequency, a line for each output and input that answers at all.

    The machine's root writes; it may be called on the root alone.

    Args:
        machine: linearised, with inputs and outputs.
        omega: (k,) rad/s, positive and ascending.
        path: .png, .pdf or .svg to write; without it the figure is pyplot's.
        title: of the picture.

    Raises:
        PictureError: no inputs or outputs, bad frequencies, or the file cannot be written.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    frequency = np.atleast_1d(np.asarray(omega, dtype=np.float64))
    if not machine.outputs or not machine.drivers:
        raise PictureError("a frequency response needs inputs and outputs; name them in `linearize`")
    if frequency.ndim != 1 or not len(frequency) or not (np.diff(frequency, prepend=0.0) > 0.0).all():
        raise PictureError("omega, the frequencies of a response, must be positive and ascending (rad/s)")
    response = machine.frequency_response(frequency)
    figure = empty_figure((9.0, 6.0), shown=target is None)
    gain, phase = figure.subplots(2, 1, sharex=True)
    colours = body_colours(len(machine.outputs) * len(machine.drivers))
    for i, output in enumerate(machine.outputs):
        for j, name in enumerate(machine.drivers):
            values = response[:, i, j]
            if np.abs(values).max() <= 1e-12 * np.abs(response).max():
                continue
            colour = colours[i * len(machine.drivers) + j]
            label = f"{output}\nby {name}"
            gain.loglog(frequency / (2.0 * np.pi), np.abs(values), label=label, linewidth=1.4, color=colour)
            turn = np.degrees(np.unwrap(np.angle(values)))
            phase.semilogx(frequency / (2.0 * np.pi), turn, linewidth=1.4, color=colour)
    gain.set_ylabel("gain")
    legend_beside(gain)
    gain.set_title(title)
    phase.set_ylabel("phase in degrees")
    phase.set_xlabel("frequency in Hz")
    for axes in (gain, phase):
        remove_frame(axes)
    if target is not None:
        save(figure, target, machine.team)
    return figure
