"""Single bodies as scenes: shapes, records and their modes, meshes.

The `show` of records, stress fields, shapes and the continuum's models reach it through `flexmbd.portraits`, by which
they know its functions and do not import it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import PictureError
from flexmbd.given import is_number
from flexmbd.multibody.bodies.shape import Shape
from flexmbd.record.reduced_body import ReducedBody, Surface
from flexmbd.visual.destination import checked_path
from flexmbd.visual.drawn_scene import BARE, DrawnScene, checked_view, portrait
from flexmbd.visual.film import SUFFIXES, write_film
from flexmbd.visual.library import require
from flexmbd.visual.notebook import html_of as html_of
from flexmbd.visual.palette import body_colours
from flexmbd.visual.part import Part, RigidPart
from flexmbd.visual.shape_picture import mode_scene
from flexmbd.visual.show import present as present
from flexmbd.visual.sketch import AXES, ball, cylinder, stick_radius
from flexmbd.visual.stress_picture import stress_scene as stress_scene

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_STILL = np.eye(4)[None]

if TYPE_CHECKING:  # has mypy compare the functions with what they are known by
    import flexmbd.visual.portraits as _here
    from flexmbd.portraits import Portraits

    _known_by: Portraits = _here


def shape_scene(shape: Shape) -> DrawnScene:
    """A shape in its own axes."""
    (first,) = body_colours(1)
    parts = [RigidPart("shape", one.colour or first, one.points, one.triangles, _STILL) for one in shape.pieces()]
    return portrait(*parts, notes=[""])


def record_scene(
    record: ReducedBody, *, mode: int | None = None, amplitude: float = 0.1, phases: ArrayLike = 1.0
) -> DrawnScene:
    """A reduced body in B, undeformed with its interfaces' axes, or displaced by a mode.

    Args:
        record: with `surface`.
        mode: which one, from 0.
        amplitude: the largest displacement drawn, as a part of the body's length.
        phases: (nt,) factors on the displacement, one a picture.

    Raises:
        PictureError: the record has no surface, or no such mode.
    """
    surface = _surface(record)
    if mode is None:
        frames = {face.name: (face.p_BI_B, face.R_BI) for face in record.interfaces}
        return mesh_scene(surface.x, surface.triangle, frames=frames)
    scene = mode_scene(surface, mode=mode, amplitude=amplitude, phases=phases, title=_title(record, mode))
    return scene


def show_record(
    record: ReducedBody,
    *,
    mode: int | None = None,
    amplitude: float = 0.1,
    path: str | Path | None = None,
    size: tuple[int, int] = (1280, 720),
    view: ArrayLike | None = None,
) -> Path | None:
    """Show a reduced body or one of its modes; see ``ReducedBody.show``. Not collective."""
    return present(record_scene(record, mode=mode, amplitude=amplitude), path=path, size=size, view=view)


def film_mode(
    record: ReducedBody,
    path: str | Path,
    *,
    mode: int,
    amplitude: float = 0.1,
    seconds: float = 2.0,
    fps: int = 30,
    size: tuple[int, int] = (1280, 720),
    view: ArrayLike | None = None,
) -> Path:
    """Film one period of a mode; see ``ReducedBody.animate``. Not collective."""
    target = checked_path(path, SUFFIXES)
    require("pyvista")
    if not (is_number(seconds) and seconds > 0.0 and isinstance(fps, int) and fps > 0):
        raise PictureError(f"seconds must be positive and fps a positive whole number, got {seconds!r} and {fps!r}")
    try:
        count = max(2, round(seconds * fps))
        phases = np.sin(2.0 * np.pi * np.arange(count) / count)  # the last picture goes on to the first
        scene = record_scene(record, mode=mode, amplitude=amplitude, phases=phases)
    except (MemoryError, OverflowError, ValueError) as error:  # numpy says so in three ways
        raise PictureError(f"seconds={seconds:g} at fps={fps:g} are more pictures than memory holds") from error
    write_film(scene, target, fps=fps, size=size, view=checked_view(view))
    return target


def mesh_scene(
    x: FloatArray,
    triangles: IntArray,
    *,
    lines: IntArray | None = None,
    frames: Mapping[str, tuple[FloatArray, FloatArray]] | None = None,
) -> DrawnScene:
    """A mesh with the axes of its interfaces.

    Args:
        x: (n, 3) m.
        triangles: (t, 3) rows of x, oriented outwards.
        lines: (k, 2) rows of x, drawn as sticks.
        frames: by name origins (3,) m and rotations (3, 3).
    """
    size = stick_radius(x)
    parts: list[Part] = []
    if len(triangles):
        used, rows = np.unique(triangles, return_inverse=True)
        parts.append(RigidPart("mesh", BARE, x[used], rows.reshape(-1, 3), _STILL))
    for a, b in x[lines] if lines is not None else ():
        parts.append(cylinder(a[None], b[None], size, BARE, "mesh"))
    colours = body_colours(len(frames or {}))
    legend = {}
    for (name, (p, R)), colour in zip((frames or {}).items(), colours, strict=True):
        legend[name] = colour
        parts.append(ball(p[None], 1.6 * size, colour, name))
        for axis, axis_colour in enumerate(AXES):
            parts.append(cylinder(p[None], (p + 12.0 * size * R[:, axis])[None], 0.5 * size, axis_colour, name))
    scene = portrait(*parts, notes=[""], legend=legend)
    return scene


def _surface(record: ReducedBody) -> Surface:
    if record.surface is None:
        raise PictureError("the record has no surface to be shown by: reduce the body with keep=Keep(surface=True)")
    return record.surface


def _title(record: ReducedBody, mode: int) -> str:
    if not (isinstance(mode, int) and 0 <= mode < record.n_modes):
        raise PictureError(f"mode must be one of the {record.n_modes} there are, counted from 0, got {mode!r}")
    if record.frame is None:
        hz = record.frequencies()[mode]
    else:
        hz = float(np.sqrt(record.stiffness[mode])) / (2.0 * np.pi)
    held = "free" if record.frame is None else f"{record.frame} held"
    return f"mode {mode} of {record.n_modes}, counted from 0: {hz:.4g} Hz, {held}"
