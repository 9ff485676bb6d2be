"""A picture of the stress on the mesh of a body at one instant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import PictureError
from flexmbd.given import checked
from flexmbd.record.stress_field import StressField
from flexmbd.visual.destination import checked_path
from flexmbd.visual.drawn_scene import DrawnScene, portrait, refuse_bad_look
from flexmbd.visual.library import require
from flexmbd.visual.scales import readable
from flexmbd.visual.show import write_picture
from flexmbd.visual.skin import field_skin

FloatArray = NDArray[np.float64]

#: What ``plot_stress`` writes.
SUFFIXES = (".png",)


@checked("field", "title", error=PictureError)
def plot_stress(
    field: StressField,
    path: str | Path,
    *,
    amplification: float = 1.0,
    size: tuple[int, int] = (1280, 720),
    title: str = "",
) -> Path:
    """Draw a body's surface coloured by von Mises stress, off-screen, to a .png.

    Seen mostly along the body's thinnest direction, its longest one to the right.  Not
    collective: call it on the root alone.

    Args:
        field: as `Trajectory.stress` or `ContinuumModel.stress_field` gives it.
        path: where to; an existing file survives a failure.
        amplification: factor on the displacement.
        size: width and height in pixels, even numbers.
        title: written above.

    Returns:
        The path.

    Raises:
        PictureError: another suffix, a bad size, or the file cannot be written.
    """
    target = checked_path(path, SUFFIXES)
    require("pyvista")
    scene = stress_scene(field, amplification=amplification, title=title)
    write_picture(scene, target, size=size)
    return target


def stress_scene(field: StressField, *, amplification: float = 1.0, title: str = "") -> DrawnScene:
    """A body's surface coloured by von Mises stress.

    Raises:
        PictureError: a negative amplification.
    """
    refuse_bad_look(amplification=amplification)
    scale, unit = readable(field.max, "Pa")
    words = [title] if title else []
    words.append(f"largest von Mises stress in a cell {field.max / scale:.3g} {unit}")
    if amplification != 1.0:
        words.append(f"deformation × {amplification:g}")
    return portrait(field_skin(field, amplification), notes=["\n".join(words)])
