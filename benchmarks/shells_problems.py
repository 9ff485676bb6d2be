"""The walls of shells.py as surfaces, for shells and for bricks: numpy alone, so that other programs read it too.

Scordelis-Lo roof (the deep shell's number), pinched cylinder, pinched hemisphere (MacNeal & Harder 1985), by symmetry a
part of each, and the hemisphere far bent, under half the load of Sze, Liu & Lo (2004).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Problem:
    """A wall about a surface of n x n quadrilaterals.

    Attributes:
        place: of points (i, j) of the unit square on the surface.
        normals: of the surface at points (3, n), of any length.
        thickness, E, nu: m, Pa.
        held: axes along which the surface does not move, and about which it does not turn, on the four sides i = 0,
            i = 1, j = 0, j = 1.
        point: of the surface in (i, j), and the axes along which it is held as well; or None.
        forces: at points of the surface in (i, j), N.
        weight: Pa, force per area of the surface.
        watched: point in (i, j) and the direction along which it moves.
        exact: m, how far.
    """

    place: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]
    normals: Callable[[np.ndarray], np.ndarray]
    thickness: float
    E: float
    nu: float
    held: tuple[tuple[str, str], ...]
    forces: tuple[tuple[tuple[int, int], tuple[float, float, float]], ...]
    watched: tuple[tuple[int, int], tuple[float, float, float]]
    exact: float
    point: tuple[tuple[int, int], str] | None = None
    weight: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def grid(self, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (k, 3), corners (n * n, 4) around each cell, number (n + 1, n + 1) of a point by (i, j)."""
        share = np.linspace(0.0, 1.0, n + 1)
        i, j = np.meshgrid(share, share, indexing="ij")
        points = np.stack(np.broadcast_arrays(*self.place(i, j)), axis=-1).reshape(-1, 3)
        number = np.arange(len(points)).reshape(i.shape)
        around = [(0, 0), (1, 0), (1, 1), (0, 1)]
        cells = np.stack([number[a : a + n, b : b + n].ravel() for a, b in around], axis=1)
        return points, cells, number

    def sides(self, number: np.ndarray) -> list[tuple[np.ndarray, str, str]]:
        """Points of each side that is held, and the axes of displacement and of rotation."""
        lines = (number[0], number[-1], number[:, 0], number[:, -1])
        found = [(line, *axes) for line, axes in zip(lines, self.held, strict=True) if any(axes)]
        if self.point is not None:
            found.append((np.array([number[_corner(self.point[0])]]), self.point[1], ""))
        return found

    def loads(self, points: np.ndarray, cells: np.ndarray, number: np.ndarray) -> np.ndarray:
        """(k, 3) N at points of the surface."""
        found = np.zeros_like(points)
        x = points[cells]
        area = 0.5 * np.linalg.norm(np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]), axis=1)
        np.add.at(found, cells, 0.25 * area[:, None, None] * np.asarray(self.weight))
        for at, force in self.forces:
            found[number[_corner(at)]] += force
        return found

    def at(self, number: np.ndarray) -> int:
        """Number of the point that is watched."""
        return int(number[_corner(self.watched[0])])


def _corner(at: tuple[int, int]) -> tuple[int, int]:
    return -at[0], -at[1]


def _tube(radius: float, half: float, angle: float) -> Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]:
    return lambda i, j: (radius * np.sin(angle * i), half * j, radius * np.cos(angle * i))


def _sphere(i: np.ndarray, j: np.ndarray) -> tuple[np.ndarray, ...]:
    polar, around = np.radians(18.0 + 72.0 * j), 0.5 * np.pi * i
    return 10 * np.sin(polar) * np.cos(around), 10 * np.sin(polar) * np.sin(around), 10 * np.cos(polar)


def _radial(x: np.ndarray) -> np.ndarray:
    return x * [[1.0], [0.0], [1.0]]


_HEMISPHERE = Problem(
    _sphere, lambda x: x, 0.04, 6.825e7, 0.3, held=(("y", "xz"), ("x", "yz"), ("", ""), ("", "")),
    forces=(((0, 1), (1.0, 0.0, 0.0)), ((1, 1), (0.0, -1.0, 0.0))), watched=((0, 1), (1.0, 0.0, 0.0)), exact=0.0940,
    point=((0, 1), "z"),
)  # fmt: skip
LINEAR = {
    "Scordelis-Lo roof": Problem(
        _tube(25.0, 25.0, np.radians(40.0)), _radial, 0.25, 4.32e8, 0.0,
        held=(("x", "yz"), ("", ""), ("xz", ""), ("y", "xz")), forces=(), weight=(0.0, 0.0, -90.0),
        watched=((1, 1), (0.0, 0.0, -1.0)), exact=0.3006,
    ),
    "pinched cylinder": Problem(
        _tube(300.0, 300.0, 0.5 * np.pi), _radial, 3.0, 3e6, 0.3,
        held=(("x", "yz"), ("z", "xy"), ("xz", ""), ("y", "xz")), forces=(((0, 1), (0.0, 0.0, -0.25)),),
        watched=((0, 1), (0.0, 0.0, -1.0)), exact=1.8248e-5,
    ),
    "pinched hemisphere": _HEMISPHERE,
}  # fmt: skip
FAR = replace(
    _HEMISPHERE, forces=(((0, 1), (100.0, 0.0, 0.0)), ((1, 1), (0.0, -100.0, 0.0))),
    watched=((1, 1), (0.0, -1.0, 0.0)), exact=5.902,
)  # fmt: skip
