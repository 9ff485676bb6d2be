"""What films and stress pictures share: an off-screen plotter, its camera, surfaces and scales."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import PictureError
from flexmbd.visual.camera import Camera
from flexmbd.visual.library import load

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TEXT = "#202020"

# From bare steel to red: shape stays visible where there is nothing to show.
BARE = "#b9c2cc"
_COLOURS = (BARE, "#f7d84a", "#ee6c2b", "#a1001f")

_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def open_stage(size: tuple[int, int]) -> Any:
    """A pyvista plotter that draws off-screen, ``size`` pixels wide and high.

    Raises:
        PictureError: the size is not two positive even numbers (films need them even); or there
            is no pyvista.
    """
    if len(size) != 2 or not all(isinstance(n, int) and n > 0 and n % 2 == 0 for n in size):
        raise PictureError(f"the size must be two positive even numbers of pixels, got {size!r}")
    plotter = load("pyvista").Plotter(off_screen=True, window_size=list(size))
    plotter.set_background("white")
    plotter.enable_anti_aliasing("msaa", multi_samples=8)
    return plotter


def place_camera(plotter: Any, camera: Camera) -> None:
    """Let the plotter see what the camera sees."""
    plotter.enable_parallel_projection()
    plotter.camera.position = camera.focus + camera.distance * camera.towards
    plotter.camera.focal_point = camera.focus
    plotter.camera.up = camera.up
    plotter.camera.parallel_scale = camera.half_height
    plotter.camera.clipping_range = (0.01 * camera.distance, 3.0 * camera.distance)


def surface_mesh(x: FloatArray, triangle: IntArray) -> tuple[Any, IntArray]:
    """A pyvista surface, and for each of its points the vertex that it is.

    Points on sharp edges are doubled, so that smooth shading does not blur the edges.

    Args:
        x: (v, 3) m.
        triangle: (t, 3) vertices, oriented outwards.
    """
    mesh = load("pyvista").PolyData.from_regular_faces(x, triangle)
    mesh.point_data["vertex"] = np.arange(len(x))
    mesh = mesh.compute_normals(
        cell_normals=False, split_vertices=True, feature_angle=35.0, consistent_normals=False
    )
    return mesh, np.asarray(mesh.point_data["vertex"], dtype=np.int64)


def readable(largest: float, unit: str) -> tuple[float, str]:
    """The (size, name) of the unit in which ``largest`` reads as a number from 1 to 1000."""
    if not unit:  # a share is read as it is
        return 1.0, ""
    for size, prefix in _PREFIXES:
        if largest >= size:
            return size, prefix + unit
    return 1.0, unit


def add_surface(
    plotter: Any, mesh: Any, *, largest: float, quantity: str, unit: str, row: int = 0
) -> Any:
    """Put a surface on the stage, coloured by its point data "value"; return its actor.

    Args:
        plotter: the stage.
        mesh: of ``surface_mesh``.
        largest: the value of the last colour; the first one is 0.
        quantity: what the values are; surfaces of one quantity share a colour bar.
        unit: of the values.
        row: of the colour bar, counted from below.
    """
    height = plotter.window_size[1]
    segmented = load("matplotlib.colors").LinearSegmentedColormap
    return plotter.add_mesh(
        mesh,
        scalars="value",
        clim=(0.0, largest or 1.0),
        cmap=segmented.from_list("steel", _COLOURS),
        smooth_shading=True,
        ambient=0.25,
        specular=0.2,
        scalar_bar_args={
            "title": f"{quantity} in {unit}\n" if unit else f"{quantity}\n",
            "position_x": 0.66,
            "position_y": 0.02 + 0.13 * row,
            "width": 0.31,
            "height": 0.11,
            "n_labels": 5,
            "fmt": "%.3g",
            "color": TEXT,
            "title_font_size": height // 36,
            "label_font_size": height // 40,
        },
    )


def add_words(plotter: Any, words: str) -> Any:
    """Write one line or more at the upper left; return the text, which has an ``input``."""
    text = plotter.add_text(
        words,
        position=(0.02, 0.97),
        viewport=True,
        font_size=max(1, plotter.window_size[1] // 55),
        color=TEXT,
    )
    text.prop.justification_vertical = "top"
    return text
