"""Places of Nastran's nodes: GRID with GRDSET's defaults, in coordinate systems of their own (CORD1R to CORD2S)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexmbd.files.bulk_cards import real, whole

IntArray = npt.NDArray[np.int64]
Points = npt.NDArray[np.float64]
Cards = Mapping[str, list[list[str]]]

_BY_NODES = ("CORD1R", "CORD1C", "CORD1S")
_BY_POINTS = ("CORD2R", "CORD2C", "CORD2S")

#: The cards that `read_grids` takes.
GRID_CARDS = ("GRID", "GRDSET", *_BY_NODES, *_BY_POINTS)


@dataclass(frozen=True, eq=False)
class _System:
    """A coordinate system in the basic one.

    Attributes:
        kind: "R" rectangular, "C" cylindrical, "S" spherical.
        origin: (3,).
        axes: (3, 3), its axes in columns.
    """

    kind: str
    origin: Points
    axes: Points

    def basic(self, x: Points) -> Points:
        """Points (n, 3) of this system, angles in degrees, in the basic one."""
        if self.kind == "C":
            r, theta, z = x.T
            theta = np.radians(theta)
            x = np.column_stack((r * np.cos(theta), r * np.sin(theta), z))
        elif self.kind == "S":
            r, theta, phi = x[:, 0], np.radians(x[:, 1]), np.radians(x[:, 2])
            x = r[:, None] * np.column_stack(
                (np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta))
            )
        moved: Points = self.origin + x @ self.axes.T
        return moved


def read_grids(cards: Cards) -> tuple[IntArray, Points]:
    """Numbers of the nodes and their places (n, 3) in the basic system.

    Raises:
        ValueError: a field is no number; a coordinate system is not there, or hangs on itself.
    """
    grids = cards.get("GRID", [])
    default = cards.get("GRDSET", [["", ""]])[0][1]
    numbers = np.array([_named(whole, f, f[0]) for f in grids], dtype=np.int64)
    # blank takes GRDSET's, zero is the basic one
    owners = np.array([_named(whole, f, f[1] or default) for f in grids], dtype=np.int64)
    points = _coordinates(grids)
    if owners.any():
        places = _Places(cards, numbers, owners, points)
        found = points.copy()
        for owner in np.unique(owners[owners != 0]):
            inside = owners == owner
            found[inside] = places.system(int(owner)).basic(points[inside])
        return numbers, found
    return numbers, points


def _coordinates(grids: list[list[str]]) -> Points:
    texts = [field or "0." for fields in grids for field in fields[2:5]]
    try:
        return np.array(texts, dtype=np.str_).astype(np.float64).reshape(-1, 3)
    except ValueError:  # exponents without a letter
        return np.array([[_named(real, f, x) for x in f[2:5]] for f in grids]).reshape(-1, 3)


def _named(read, fields, text):  # type: ignore[no-untyped-def]
    try:
        return read(text)
    except ValueError as error:
        raise ValueError(f"GRID {fields[0]}: {error}") from error


class _Places:
    """Coordinate systems by their numbers, found as they are asked for: each may hang on others and on nodes."""

    def __init__(self, cards: Cards, numbers: IntArray, owners: IntArray, points: Points) -> None:
        self._row = {int(number): i for i, number in enumerate(numbers)} if _has_nodes(cards) else {}
        self._owners, self._points = owners, points
        self._found: dict[int, _System] = {0: _System("R", np.zeros(3), np.eye(3))}
        self._open: list[int] = []
        self._cards: dict[int, tuple[str, list[str]]] = {}
        for name in _BY_POINTS:
            for fields in cards.get(name, []):
                self._add(whole(fields[0]), name, fields[1:])
        for name in _BY_NODES:
            for fields in cards.get(name, []):
                self._add(whole(fields[0]), name, fields[1:4])
                if len(fields) > 4 and fields[4]:
                    self._add(whole(fields[4]), name, fields[5:8])

    def _add(self, number: int, name: str, fields: list[str]) -> None:
        if number in self._cards and self._cards[number] != (name, fields):
            raise ValueError(f"coordinate system {number} is given more than once")
        self._cards[number] = (name, fields)

    def system(self, number: int) -> _System:
        if number in self._found:
            return self._found[number]
        if number not in self._cards:
            raise ValueError(f"coordinate system {number} is used and not given; write its CORD card into the deck")
        if number in self._open:
            raise ValueError(f"coordinate system {number} hangs on itself, by {self._open}")
        self._open.append(number)
        name, fields = self._cards[number]
        if name in _BY_NODES:
            a, b, c = (self._node(whole(field), f"{name} {number}") for field in fields[:3])
        else:
            values = np.array([real(field) for field in (fields[1:] + [""] * 9)[:9]]).reshape(3, 3)
            a, b, c = self.system(whole(fields[0])).basic(values)
        self._open.pop()
        self._found[number] = _System(name[-1], a, _axes(f"{name} {number}", a, b, c))
        return self._found[number]

    def _node(self, number: int, where: str) -> Points:
        if number not in self._row:
            raise ValueError(f"{where} names GRID {number}, which is not there")
        row = self._row[number]
        place: Points = self.system(int(self._owners[row])).basic(self._points[row : row + 1])[0]
        return place


def _has_nodes(cards: Cards) -> bool:
    return any(name in cards for name in _BY_NODES)


def _axes(what: str, a: Points, b: Points, c: Points) -> Points:
    """Axes in columns: z from a to b, x to the side of c."""
    z, towards = b - a, c - a
    y = np.cross(z, towards)
    size = np.linalg.norm(z) * np.linalg.norm(towards)
    if not np.linalg.norm(y) > 1e-12 * size:
        raise ValueError(f"the three points of {what} lie on a line")
    z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
    return np.column_stack((np.cross(y, z), y, z))
