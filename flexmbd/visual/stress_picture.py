"""StressPicture: stress on the mesh of a body at one instant, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexmbd.record.reduced_body import ReducedBody
from flexmbd.visual import stage
from flexmbd.visual.camera import frame_all
from flexmbd.visual.destination import checked_path, write

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: What ``StressPicture.plot`` writes.
SUFFIXES = (".png",)


@dataclass(frozen=True, eq=False)
class StressPicture:
    """Displacement and stress of a body at its mesh nodes, in body axes.

    Stress jumps from cell to cell; the values here are plain averages over the cells that share
    a node, good to look at.  ``max`` is not averaged: it is the largest value in any cell.

    Attributes:
        node: (k,) node numbers of the mesh's input, ascending: no partition matters.
        x: (k, 3) m, undeformed node positions.
        triangle: (t, 3) the surface as rows of ``x``, oriented outwards.
        displacement: (k, 3) m, against the body frame.
        stress: (k, 3, 3) Pa, Cauchy stress.
        von_mises: (k,) Pa, averages of the cells' von Mises stresses.
        max: Pa, the largest von Mises stress in any cell.
        max_x: (3,) m, where that is, undeformed.
    """

    node: IntArray
    x: FloatArray
    triangle: IntArray
    displacement: FloatArray
    stress: FloatArray
    von_mises: FloatArray
    max: float
    max_x: FloatArray

    def plot(
        self,
        path: str | Path,
        *,
        amplification: float = 1.0,
        size: tuple[int, int] = (1280, 720),
        title: str = "",
    ) -> Path:
        """Draw the surface coloured by von Mises stress, off-screen, to a .png.

        Seen mostly along the body's thinnest direction, its longest one to the right.  Not
        collective: call it on the root alone.

        Args:
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
            self._draw(temporary, amplification, size, title)

        return write(target, fill)

    def _draw(
        self, path: Path, amplification: float, size: tuple[int, int], title: str
    ) -> None:
        scale, unit = stage.readable(self.max, "Pa")
        mesh, vertex = stage.surface_mesh(self.x, self.triangle)
        shown = self.x + amplification * self.displacement
        mesh.points = shown[vertex]
        mesh.point_data["value"] = self.von_mises[vertex] / scale
        plotter = stage.open_stage(size)
        try:
            largest = float(self.von_mises.max()) / scale
            stage.add_surface(plotter, mesh, largest=largest, quantity="von Mises stress", unit=unit)
            towards, up = _oblique(self.x)
            points = shown[np.unique(self.triangle)]
            aspect = size[0] / size[1]
            camera = frame_all(points, towards, up, aspect=aspect, above=0.14, below=0.16)
            stage.place_camera(plotter, camera)
            words = [title] if title else []
            words.append(f"largest von Mises stress in a cell {self.max / scale:.3g} {unit}")
            if amplification != 1.0:
                words.append(f"deformation × {amplification:g}")
            stage.add_words(plotter, "\n".join(words))
            plotter.screenshot(path)
        finally:
            plotter.close()


class StressModel(Protocol):
    """What can turn modal coordinates into a stress field: a ContinuumModel."""

    def stress_picture(self, body: ReducedBody, q: FloatArray) -> StressPicture:
        """Stress on the mesh at modal coordinates q (n,)."""


def _oblique(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(towards, up): along the thinnest axis, from a little above and aside."""
    thin, middle, long = np.eye(3)[np.argsort(np.ptp(x, axis=0), kind="stable")]
    thin = np.cross(long, middle)  # right-handed: right, up, towards
    towards = thin + 0.35 * middle - 0.25 * long
    towards /= np.linalg.norm(towards)
    up = middle - towards * (middle @ towards)
    return towards, up / np.linalg.norm(up)
