"""A picture of one mode of a body: of vibration, or of buckling."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexmbd.errors import PictureError
from flexmbd.record.reduced_body import Surface
from flexmbd.visual import stage
from flexmbd.visual.camera import frame_all, oblique
from flexmbd.visual.destination import checked_path, write

#: What ``plot_shape`` writes.
SUFFIXES = (".png",)


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
    count = surface.phi.shape[2]
    if not (isinstance(mode, int) and 0 <= mode < count):
        raise PictureError(f"mode must be one of the {count} there are, counted from 0, got {mode!r}")

    def fill(temporary: Path) -> None:
        _draw(surface, temporary, mode, amplitude, size, title)

    return write(target, fill)


def _draw(surface: Surface, path: Path, mode: int, amplitude: float, size: tuple[int, int], title: str) -> None:
    shape = surface.phi[:, :, mode]
    sizes = np.linalg.norm(shape, axis=1)
    share = sizes / (sizes.max(initial=0.0) or 1.0)
    length = float(np.ptp(surface.x, axis=0).max())
    shown = surface.x + amplitude * length / (sizes.max(initial=0.0) or 1.0) * shape
    mesh, vertex = stage.surface_mesh(surface.x, surface.triangle)
    mesh.points = shown[vertex]
    mesh.point_data["value"] = share[vertex]
    plotter = stage.open_stage(size)
    try:
        stage.add_surface(plotter, mesh, largest=1.0, quantity="displacement over its largest", unit="")
        towards, up = oblique(surface.x)
        camera = frame_all(shown, towards, up, aspect=size[0] / size[1], above=0.14, below=0.16)
        stage.place_camera(plotter, camera)
        if title:
            stage.add_words(plotter, title)
        plotter.screenshot(path)
    finally:
        plotter.close()
