"""A picture of one mode of a body: of vibration, or of buckling."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from flexmbd.errors import PictureError
from flexmbd.given import checked, is_number
from flexmbd.record.reduced_body import Surface
from flexmbd.visual.destination import checked_path
from flexmbd.visual.drawn_scene import DrawnScene, portrait
from flexmbd.visual.library import require
from flexmbd.visual.show import write_picture
from flexmbd.visual.skin import DisplacementSkin

#: What ``plot_shape`` writes.
SUFFIXES = (".png",)


@checked("surface", "mode", "title", error=PictureError)
def plot_shape(
    surface: Surface,
    path: str | Path,
    *,
    mode: int = 0,
    amplitude: float = 0.1,
    size: tuple[int, int] = (1280, 720),
    title: str = "",
) -> Path:
    """Draw a body's surface displaced by one mode and coloured by the displacement's size, off-screen, to a .png.

    Not collective: call it on the root alone.

    Args:
        surface: `BucklingModes.shape`, or `ReducedBody.surface` of a record with `Keep(surface=True)`.
        path: where to; an existing file survives a failure.
        mode: which one, from 0.
        amplitude: the largest displacement drawn, as a part of the body's length.
        size: width and height in pixels, even numbers.
        title: written above.

    Returns:
        The path.

    Raises:
        PictureError: another suffix, a bad size, no such mode, or the file cannot be written.
    """
    target = checked_path(path, SUFFIXES)
    require("pyvista")
    scene = mode_scene(surface, mode=mode, amplitude=amplitude, title=title)
    write_picture(scene, target, size=size)
    return target


def mode_scene(
    surface: Surface, *, mode: int, amplitude: float = 0.1, title: str = "", phases: ArrayLike = 1.0
) -> DrawnScene:
    """A body's surface displaced by one mode and coloured by the displacement's size, over its largest.

    Args:
        surface: with modes.
        mode: which one, from 0.
        amplitude: the largest displacement drawn, as a part of the body's length.
        title: written above.
        phases: (nt,) factors on the displacement, one a picture.

    Raises:
        PictureError: no such mode, or an amplitude that is no number.
    """
    count = surface.phi.shape[2]
    if not (isinstance(mode, int) and 0 <= mode < count):
        raise PictureError(f"mode must be one of the {count} there are, counted from 0, got {mode!r}")
    if not is_number(amplitude):
        raise PictureError(f"amplitude must be a number, a part of the body's length, got {amplitude!r:.100}")
    shape = surface.phi[:, :, mode : mode + 1]
    unit = np.asarray(shape / (float(np.linalg.norm(shape, axis=1).max(initial=0.0)) or 1.0))
    length = float(np.ptp(surface.x, axis=0).max())
    q = np.atleast_1d(np.asarray(phases, dtype=np.float64))[:, None]
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    moved = amplitude * length * unit
    share = ("displacement over its largest", "")
    skin = DisplacementSkin("body", (), surface.x, surface.triangle, unit, moved, q, pose, share)
    return portrait(skin, notes=[title] * len(q))
