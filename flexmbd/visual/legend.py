"""The legend of a scene: squares in the colours of the bodies, with their names in the colour of words."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexmbd.visual.library import load

#: Names that a legend has at most.
MOST_NAMES = 60

_TEXT = (0.125, 0.125, 0.125)
_LONGEST = 24  # letters of a name
_TOP, _ROW = 0.96, 0.045  # shares of the panel's height: where it begins, and of a row at the most
_LEFT, _SIDE = 0.06, 0.07  # shares of the panel's width: where squares begin, and of their side at the most


def add_legend(renderer: Any, names: Mapping[str, str], *, size: tuple[int, int], bottom: float) -> None:
    """Put names and colours into a panel.

    Args:
        renderer: of pyvista, the panel.
        names: their colours, "#rrggbb".
        size: width and height of the panel, pixels.
        bottom: share of the panel's height that is left free below.
    """
    shown = dict(list(names.items())[:MOST_NAMES])
    count = len(shown) + (len(names) > MOST_NAMES)
    if not count:
        return
    row = min(_ROW, (_TOP - bottom) / count)
    tall = 0.6 * row
    wide = min(_SIDE, tall * size[1] / size[0])
    middles = _TOP - row * (np.arange(count) + 0.5)
    corners = [[_LEFT, y - tall / 2, 0.0] for y in middles[: len(shown)]]
    renderer.AddViewProp(_squares(np.array(corners), list(shown.values()), wide, tall))
    words = [*map(_short, shown), *([f"and {len(names) - len(shown)} more"] if count > len(shown) else [])]
    letters = max(len(word) for word in words)
    room = (1.0 - _LEFT - 1.8 * wide) * size[0] / (0.62 * letters)  # a letter is some 0.6 of the size wide
    font = max(6, int(min(0.9 * row * size[1], 0.034 * size[1], room)))
    for word, y in zip(words, middles, strict=True):
        renderer.AddViewProp(_word(word, _LEFT + 1.8 * wide, float(y), font))


def _squares(corners: Any, colours: list[str], wide: float, tall: float) -> Any:
    """All squares as one actor; lower left corners (k, 3) and sides as shares of the panel."""
    pyvista, vtk = load("pyvista"), load("vtkmodules.vtkRenderingCore")
    ring = np.array([[0.0, 0.0, 0.0], [wide, 0.0, 0.0], [wide, tall, 0.0], [0.0, tall, 0.0]])
    points = (corners[:, None] + ring).reshape(-1, 3)
    faces = np.hstack([np.full((len(corners), 1), 4), np.arange(len(points)).reshape(-1, 4)])
    mesh = pyvista.PolyData(points, faces.ravel())
    mesh.cell_data.set_scalars(np.array([pyvista.Color(one).int_rgb for one in colours], np.uint8), "colour")
    place = vtk.vtkCoordinate()
    place.SetCoordinateSystemToNormalizedViewport()
    mapper = vtk.vtkPolyDataMapper2D()
    mapper.SetInputData(mesh)
    mapper.SetTransformCoordinate(place)
    actor = vtk.vtkActor2D()
    actor.SetMapper(mapper)
    return actor


def _word(word: str, x: float, y: float, font: int) -> Any:
    text = load("vtkmodules.vtkRenderingCore").vtkTextActor()
    text.SetInput(word)
    text.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    text.SetPosition(x, y)
    style = text.GetTextProperty()
    style.SetFontSize(font)
    style.SetColor(*_TEXT)
    style.SetVerticalJustificationToCentered()
    return text


def _short(name: str) -> str:
    return name if len(name) <= _LONGEST else f"{name[: _LONGEST - 3]}..."
