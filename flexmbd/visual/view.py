"""A drawn scene on a plotter of pyvista: the picture, and beside it a panel with the legend and the colour bars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.visual.camera import Camera
from flexmbd.visual.drawn_scene import BARE, DrawnScene, refuse_bad_look
from flexmbd.visual.legend import add_legend
from flexmbd.visual.library import load
from flexmbd.visual.part import Part
from flexmbd.visual.scales import bar_end, readable

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Picture = NDArray[np.uint8]

TEXT = "#202020"
#: Share of the width that the panel takes.
PANEL = 0.2

_COLOURS = (BARE, "#f7d84a", "#ee6c2b", "#a1001f")
_LINE = 18  # letters of a colour bar's title


class SceneView:
    """A plotter that shows a drawn scene, one instant at a time.

    Attributes:
        plotter: of pyvista.
        scene: what is drawn.
        camera: where from.
    """

    def __init__(
        self, scene: DrawnScene, *, size: tuple[int, int], view: FloatArray | None = None, off_screen: bool = True
    ) -> None:
        """Put the scene on a plotter.

        Raises:
            PictureError: the size is not two positive even numbers (films need them even); or there is no pyvista.
        """
        refuse_bad_look(size=size)
        self.scene = scene
        names = scene.legend if len(scene.legend) > 1 else {}
        panel = bool(names or scene.quantities)
        layout = {"shape": (1, 2), "col_weights": [1.0 - PANEL, PANEL], "border": False} if panel else {}
        self.plotter = load("pyvista").Plotter(off_screen=off_screen, window_size=list(size), **layout)
        self.plotter.set_background("white")
        self.plotter.enable_anti_aliasing("msaa", multi_samples=8)
        self._height = size[1]
        self._focus_scene(panel)
        self.camera = scene.camera((1.0 - PANEL if panel else 1.0) * size[0] / size[1], view)
        _place_camera(self.plotter, self.camera)
        self._bars: dict[tuple[str, str], Any] = {}
        self._movers = [self._add(part) for part in (*scene.parts, *scene.fixed)]
        self._words = self._write(scene.notes[0])
        if panel:
            self.plotter.subplot(0, 1)
            panel_size = (round(PANEL * size[0]), size[1])
            bottom = 0.36 * min(2, len(scene.quantities))
            add_legend(self.plotter.renderer, names, size=panel_size, bottom=max(0.02, bottom))
            self._add_bars()
            self._focus_scene(panel)
        self.move_to(0)

    def move_to(self, k: int) -> None:
        """Show instant k."""
        for move in self._movers:
            move(k)
        self._words.input = self.scene.notes[k]

    def screenshot(self) -> Picture:
        """The picture as it is now, (height, width, 3)."""
        self.plotter.render()
        shot: Picture = self.plotter.screenshot(return_img=True)
        return shot

    def close(self) -> None:
        """Free the plotter."""
        self.plotter.close()

    def _focus_scene(self, panel: bool) -> None:
        if panel:
            self.plotter.subplot(0, 0)

    def _add(self, part: Part) -> Callable[[int], None]:
        mesh, vertex = surface_mesh(part.x, part.triangle)
        if part.colour is not None:
            actor = self.plotter.add_mesh(mesh, color=part.colour, smooth_shading=True, ambient=0.3, specular=0.1)

            def turn(k: int, pose: FloatArray = part.pose) -> None:
                actor.user_matrix = pose[k]

            return turn
        largest = self.scene.largest(part.quantity)
        scale, _ = readable(largest, part.quantity[1])
        mesh.point_data["value"] = np.zeros(mesh.n_points)
        actor = self._add_valued(mesh, bar_end(largest / scale)[0])
        self._bars.setdefault(part.quantity, actor.mapper)

        def move(k: int) -> None:
            places, value = part.at(k)
            mesh.points = places[vertex]
            mesh.point_data["value"] = value[vertex] / scale
            if part.turns:
                mesh.compute_normals(cell_normals=False, consistent_normals=False, inplace=True)
            actor.user_matrix = part.pose[k]

        return move

    def _add_valued(self, mesh: Any, end: float) -> Any:
        segmented = load("matplotlib.colors").LinearSegmentedColormap
        return self.plotter.add_mesh(
            mesh,
            scalars="value",
            clim=(0.0, end),
            cmap=segmented.from_list("steel", _COLOURS),
            smooth_shading=True,
            ambient=0.25,
            specular=0.2,
            show_scalar_bar=False,
        )

    def _add_bars(self) -> None:
        quantities = self.scene.quantities
        for row, quantity in enumerate(quantities):
            largest = self.scene.largest(quantity)
            scale, unit = readable(largest, quantity[1])
            _, labels = bar_end(largest / scale)
            each = min(0.32, 0.9 / len(quantities))
            self.plotter.add_scalar_bar(
                title=_title(quantity[0], unit),
                mapper=self._bars[quantity],
                vertical=True,
                position_x=0.08,
                position_y=0.03 + (each + 0.02) * row,
                width=0.5,
                height=each,
                n_labels=labels,
                fmt="%.6g",
                color=TEXT,
                title_font_size=max(8, self._height // 46),
                label_font_size=max(8, self._height // 44),
                render=False,
            )

    def _write(self, words: str) -> Any:
        text = self.plotter.add_text(
            words, position=(0.02, 0.97), viewport=True, font_size=max(1, self._height // 55), color=TEXT
        )
        text.prop.justification_vertical = "top"
        return text


def surface_mesh(x: FloatArray, triangle: IntArray) -> tuple[Any, IntArray]:
    """A pyvista surface, and for each of its points the vertex that it is.

    Points on sharp edges are doubled, so that smooth shading does not blur the edges.

    Args:
        x: (v, 3) m.
        triangle: (t, 3) vertices, oriented outwards.
    """
    mesh = load("pyvista").PolyData.from_regular_faces(x, triangle)
    mesh.point_data["vertex"] = np.arange(len(x))
    mesh = mesh.compute_normals(cell_normals=False, split_vertices=True, feature_angle=35.0, consistent_normals=False)
    return mesh, np.asarray(mesh.point_data["vertex"], dtype=np.int64)


def _place_camera(plotter: Any, camera: Camera) -> None:
    plotter.enable_parallel_projection()
    plotter.camera.position = camera.focus + camera.distance * camera.towards
    plotter.camera.focal_point = camera.focus
    plotter.camera.up = camera.up
    plotter.camera.parallel_scale = camera.half_height
    plotter.camera.clipping_range = (0.01 * camera.distance, 3.0 * camera.distance)


def _title(name: str, unit: str) -> str:
    """Of a colour bar, in lines that fit the panel."""
    words = f"{name} in {unit}" if unit else name
    if len(words) <= _LINE:
        return f"{words}\n "
    cut = words.rfind(" ", 0, _LINE)
    return words[:cut] + "\n" + words[cut + 1 :] + "\n " if cut > 0 else f"{words}\n "
