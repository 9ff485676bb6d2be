"""Colours of bodies: as many as a scene has, none twice."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

GROUND = "#a8a8a8"
JOINT = "#2b2b2b"

_FIRST = ("#4c72b0", "#dd8452", "#55a868", "#8172b3", "#c44e52", "#937860", "#64b5cd", "#ccb974")
_TAKEN = ("#ffffff", "#d9dde1", GROUND, JOINT)  # of the background, floors, the ground and joints
# Lightness and chroma of colours that are seen on white and are not grey (Oklab, Ottosson 2020).
_LIGHTNESS, _CHROMA = (0.4, 0.85), 0.06
_LEAST_SIDE = 24  # of the grid of colours that are chosen from


def body_colours(count: int) -> tuple[str, ...]:
    """``count`` colours as "#rrggbb", all different; the first ones are the same for every count up to thousands.

    After the first eight each is the one that is farthest from all before it, in Oklab.
    """
    side = _LEAST_SIDE
    while len(_candidates(side)[0]) < 2 * count:
        side *= 2
    return _FIRST[:count] if count <= len(_FIRST) else (*_FIRST, *_farthest(count - len(_FIRST), side))


@cache
def _candidates(side: int) -> tuple[FloatArray, FloatArray]:
    """Colours (k, 3) of red, green and blue from 0 to 1, and the same in Oklab."""
    grid = np.linspace(0.0, 1.0, side)
    rgb = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    lab = _oklab(rgb)
    chroma = np.hypot(lab[:, 1], lab[:, 2])
    seen = (lab[:, 0] > _LIGHTNESS[0]) & (lab[:, 0] < _LIGHTNESS[1]) & (chroma > _CHROMA)
    return rgb[seen], lab[seen]


@cache
def _farthest(count: int, side: int) -> tuple[str, ...]:
    rgb, lab = _candidates(side)
    taken = _oklab(np.array([[int(text[k : k + 2], 16) / 255.0 for k in (1, 3, 5)] for text in (*_TAKEN, *_FIRST)]))
    along = np.ascontiguousarray(lab.T)
    squares = np.full(len(lab), np.inf)
    for colour in taken:
        squares = np.minimum(squares, _squares(along, colour))
    chosen = []
    for _ in range(count):
        best = int(np.argmax(squares))
        chosen.append("#" + "".join(f"{round(255.0 * part):02x}" for part in rgb[best]))
        np.minimum(squares, _squares(along, lab[best]), out=squares)
    return tuple(chosen)


def _squares(along: FloatArray, colour: FloatArray) -> FloatArray:
    """Squares of the distances of colours (3, k) from one."""
    first, second, third = (part - own for part, own in zip(along, colour, strict=True))
    return np.asarray(first * first + second * second + third * third)


def _oklab(rgb: FloatArray) -> FloatArray:
    """Oklab (k, 3) of colours (k, 3), in which distances are nearly those that are seen."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    cones = np.array(
        [
            [0.4122214708, 0.5363325363, 0.0514459929],
            [0.2119034982, 0.6806995451, 0.1073969566],
            [0.0883024619, 0.2817188376, 0.6299787005],
        ]
    )
    to_lab = np.array(
        [
            [0.2104542553, 0.7936177850, -0.0040720468],
            [1.9779984951, -2.4285922050, 0.4505937099],
            [0.0259040371, 0.7827717662, -0.8086757660],
        ]
    )
    return np.asarray(np.cbrt(linear @ cones.T) @ to_lab.T)
