"""A scene in a window, in a notebook or as a picture in a file."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.given import checked, is_number
from flexmbd.multibody.bodies.body import Body, FlexibleBody
from flexmbd.multibody.bodies.continuum_body import ContinuumBody
from flexmbd.record.stress_field import StressModel
from flexmbd.visual.destination import checked_path, write
from flexmbd.visual.drawn_scene import DrawnScene, Zoom, checked_view, drawn_scene, refuse_bad_look
from flexmbd.visual.force_arrows import ForcesAt
from flexmbd.visual.library import load, require
from flexmbd.visual.pressure_skin import PressuresAt
from flexmbd.visual.recorded_motion import RecordedMotion
from flexmbd.visual.recorded_skin import FieldSeries, Look
from flexmbd.visual.scales import readable
from flexmbd.visual.view import SceneView

FloatArray = NDArray[np.float64]

#: What ``show`` writes.
SUFFIXES = (".png",)

_INSTANTS = 121  # that a slider runs over


@checked("motion", "models", "recordings", "looks", "frames", "hide", error=PictureError)
def show(
    motion: RecordedMotion,
    *,
    t: float | None = None,
    path: str | Path | None = None,
    size: tuple[int, int] = (1280, 720),
    amplification: float = 1.0,
    models: Mapping[FlexibleBody, StressModel] | None = None,
    recordings: Sequence[FieldSeries] = (),
    looks: Mapping[ContinuumBody, Look] | None = None,
    view: ArrayLike | None = None,
    frames: bool = False,
    forces: ForcesAt | None = None,
    pressures: PressuresAt | None = None,
    hide: Sequence[Body] = (),
    zoom: Zoom | None = None,
) -> Path | None:
    """Show a machine: in a window or a notebook, to be turned by the mouse, or in a file.

    Without ``t`` a slider runs over the whole motion; in a file it is the first instant.  The camera sees all that
    moves at all of these instants.  As for ``animate`` the root alone draws, and may be the only one that calls.

    Args:
        motion: of the machine.
        t: s, the instant.
        path: .png to write off-screen instead; needs no display.
        size: width and height in pixels, even numbers.
        amplification: factor on the deformation of surfaces; stated in the picture.
        models: colours these bodies by von Mises stress instead of displacement; then ``t`` or ``path`` is needed.
        recordings: of bodies with history; what ``Trajectory.show`` gives is its own.
        looks: how bodies with history are shown.
        view: (3,) direction from the scene to the camera, instead of the natural one.
        frames: whether the axes of all frames are drawn: x red, y green, z blue.
        forces: drawn as arrows, as of ``animate``; ``Trajectory.show`` gives those of ``contacts``.
        pressures: as of ``animate``.
        hide: as of ``animate``.
        zoom: as of ``animate``.

    Returns:
        The path, where one is given.

    Raises:
        PictureError: there is no display and no notebook; another suffix, a bad choice; the file cannot be written.
        SceneError: ``t`` is outside the motion.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    require("pyvista")
    if target is None:
        refuse_no_display()
    times = _times(motion, t, still=target is not None)
    if models and len(times) > 1:
        raise PictureError("a window coloured by stress shows one instant: give t, or film it by animate(models=...)")
    refuse_bad_look(amplification=amplification, size=size)
    eye = checked_view(view)
    if not (models or motion.team.is_root):
        return target
    suffix = f"    deformation × {amplification:g}" if amplification != 1.0 else ""
    scale, unit = readable(float(np.abs(times).max()), "s")
    scene = drawn_scene(
        motion,
        times,
        notes=[f"t = {one / scale:.5g} {unit}{suffix}" for one in times],
        amplification=amplification,
        models=models,
        recordings=recordings,
        looks=looks,
        frames=frames,
        forces=forces,
        pressures=pressures,
        hide=hide,
        zoom=zoom,
    )
    if not motion.team.is_root:
        return target
    if target is not None:
        write_picture(scene, target, size=size, view=eye)
    else:
        open_window(scene, times, size=size, view=eye)
    return target


def present(
    scene: DrawnScene,
    *,
    path: str | Path | None = None,
    size: tuple[int, int] = (1280, 720),
    view: ArrayLike | None = None,
) -> Path | None:
    """Show a scene of one instant in a window or a notebook; or write it to ``path``, a .png. Not collective.

    Raises:
        PictureError: there is no display; another suffix, a bad choice; the file cannot be written.
    """
    target = None if path is None else checked_path(path, SUFFIXES)
    require("pyvista")
    eye = checked_view(view)
    if target is not None:
        write_picture(scene, target, size=size, view=eye)
    else:
        refuse_no_display()
        open_window(scene, np.zeros(1), size=size, view=eye)
    return target


def _times(motion: RecordedMotion, t: float | None, *, still: bool) -> FloatArray:
    """The instants (nt,) s that are shown."""
    if t is not None:
        if not is_number(t):
            raise PictureError(f"t must be one time in s, got {t!r:.100}")
        return np.array([float(t)])
    if still or motion.t[0] == motion.t[-1]:
        return np.array([float(motion.t[0])])
    return np.linspace(motion.t[0], motion.t[-1], _INSTANTS, dtype=np.float64)


def write_picture(
    scene: DrawnScene, target: Path, *, size: tuple[int, int], view: FloatArray | None = None, k: int = 0
) -> None:
    """Draw instant k of a scene off-screen to a .png. Not collective.

    Raises:
        PictureError: a bad size, or the file cannot be written.
    """

    def fill(temporary: Path) -> None:
        drawn = SceneView(scene, size=size, view=view)
        try:
            drawn.move_to(k)
            drawn.plotter.screenshot(temporary)
        finally:
            drawn.close()

    write(target, fill)


def open_window(
    scene: DrawnScene, times: FloatArray, *, size: tuple[int, int], view: FloatArray | None = None
) -> None:
    """Show a scene in a window, or in the notebook that runs this; with a slider where it moves. Not collective."""
    drawn = SceneView(scene, size=size, view=view, off_screen=bool(load("pyvista").OFF_SCREEN))
    live = _has_trame() if drawn.plotter.notebook else not drawn.plotter.off_screen
    if len(times) > 1 and live:
        _add_slider(drawn, times)
    if drawn.plotter.notebook:
        drawn.plotter.show(jupyter_backend="trame" if live else "static")
    else:
        drawn.plotter.show()


def _add_slider(drawn: SceneView, times: FloatArray) -> None:
    def slide(value: float) -> None:
        drawn.move_to(int(np.argmin(np.abs(times - value))))

    drawn.plotter.add_slider_widget(
        slide,
        (float(times[0]), float(times[-1])),
        value=float(times[0]),
        title="time in s",
        pointa=(0.05, 0.06),
        pointb=(0.75, 0.06),
        style="modern",
        fmt="%.4g",
        interaction_event="always",
    )


def refuse_no_display() -> None:
    """Raise PictureError where neither a window nor a notebook can show anything."""
    if not (_has_display() or _in_notebook()):
        raise PictureError(
            "there is no display here (DISPLAY is not set) and no notebook: give path='machine.png' to draw off-screen"
        )


def _has_display() -> bool:
    if not sys.platform.startswith("linux"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _in_notebook() -> bool:
    """Whether IPython's kernel runs this, as a notebook has it."""
    shell: Any = sys.modules.get("IPython")
    return shell is not None and "IPKernelApp" in getattr(shell.get_ipython(), "config", {})


def _has_trame() -> bool:
    """Whether pyvista has what it needs to show a scene live in a notebook; which packages, its versions differ in."""
    try:
        importlib.import_module("pyvista.trame")
    except ImportError:
        return False
    return importlib.util.find_spec("ipywidgets") is not None
