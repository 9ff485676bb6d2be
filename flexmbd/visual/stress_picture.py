"""A picture of the stress on the mesh of a body at one instant."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.record.reduced_body import ReducedBody
from flexmbd.record.stress_field import StressField
from flexmbd.visual import stage
from flexmbd.visual.camera import frame_all, oblique
from flexmbd.visual.destination import checked_path, write

FloatArray = NDArray[np.float64]

#: What ``plot_stress`` writes.
SUFFIXES = (".png",)


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

    def fill(temporary: Path) -> None:
        _draw(field, temporary, amplification, size, title)

    return write(target, fill)


def _draw(field: StressField, path: Path, amplification: float, size: tuple[int, int], title: str) -> None:
    scale, unit = stage.readable(field.max, "Pa")
    mesh, vertex = stage.surface_mesh(field.x, field.triangle)
    shown = field.x + amplification * field.displacement
    mesh.points = shown[vertex]
    mesh.point_data["value"] = field.von_mises[vertex] / scale
    plotter = stage.open_stage(size)
    try:
        largest = float(field.von_mises.max()) / scale
        stage.add_surface(plotter, mesh, largest=largest, quantity="von Mises stress", unit=unit)
        towards, up = oblique(field.x)
        points = shown[np.unique(field.triangle)]
        aspect = size[0] / size[1]
        camera = frame_all(points, towards, up, aspect=aspect, above=0.14, below=0.16)
        stage.place_camera(plotter, camera)
        words = [title] if title else []
        words.append(f"largest von Mises stress in a cell {field.max / scale:.3g} {unit}")
        if amplification != 1.0:
            words.append(f"deformation × {amplification:g}")
        stage.add_words(plotter, "\n".join(words))
        plotter.screenshot(path)
    finally:
        plotter.close()


class StressModel(Protocol):
    """What can turn modal coordinates into a stress field: a ContinuumModel."""

    def stress_field(self, body: ReducedBody, q: FloatArray) -> StressField:
        """Stress on the mesh at modal coordinates q (n,)."""
