"""Nastran's GRIDs: where they lie and along which axes they move, with GRDSET's defaults and CORD1R to CORD2S.

A GRID stands in the coordinate system CP, its displacements along the axes of CD; systems are given by points in
another one (CORD2R, ..C, ..S) or by GRIDs (CORD1R, ..C, ..S). For meshes and superelements; numpy alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from flexmbd.files.bulk_cards import Card, Cards, whole

IntArray = npt.NDArray[np.int64]
Points = npt.NDArray[np.float64]

_BY_NODES = ("CORD1R", "CORD1C", "CORD1S")
_BY_POINTS = ("CORD2R", "CORD2C", "CORD2S")
# A point lies on a line where its distance from it is this share of that from a point of it: three points that give a
# system, which may be far apart; and a GRID on a system's axis, of places with the eight digits of a deck.
_ON_LINE = 1e-12
_ON_AXIS = 1e-9

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

    def directions(self, point: Points) -> Points | None:
        """(3, 3) basic components, in columns, of its unit vectors at a point (3,) of the basic system.

        None on the axis of a cylindrical or spherical system.
        """
        if self.kind == "R":
            return self.axes
        x, y, z = self.axes.T @ (point - self.origin)
        radius, length = float(np.hypot(x, y)), float(np.hypot(np.hypot(x, y), z))
        if not radius > _ON_AXIS * length:
            return None
        around = np.array([-y, x, 0.0]) / radius
        if self.kind == "C":
            local = np.column_stack([[x / radius, y / radius, 0.0], around, [0.0, 0.0, 1.0]])
        else:
            outwards = np.array([x, y, z]) / length
            local = np.column_stack([outwards, np.cross(around, outwards), around])
        turned: Points = self.axes @ local
        return turned


@dataclass(frozen=True, eq=False)
class Grids:
    """The GRIDs of a deck, in its order.

    Attributes:
        numbers: (n,).
        points: (n, 3) in the basic system.
        movers: (n,) CD, number of the system along whose axes each moves; 0 the basic one.
        systems: by which these are found.
    """

    numbers: IntArray
    points: Points
    movers: IntArray
    systems: _Systems

    @cached_property
    def rows(self) -> dict[int, int]:
        """Where each number stands, the last one where it is there twice."""
        return {int(number): row for row, number in enumerate(self.numbers)}

    def place(self, number: int) -> Points:
        """(3,) position of a GRID in the basic system.

        Raises:
            ValueError: it is not there.
        """
        place: Points = self.points[self._row(number)]
        return place

    def is_turned(self, number: int) -> bool:
        """Whether a GRID moves along the axes of a system other than the basic one, or ValueError."""
        return bool(self.movers[self._row(number)] != 0)

    def axes(self, number: int) -> Points:
        """(3, 3) basic components, in columns, of the unit vectors along which a GRID moves.

        Raises:
            ValueError: it is not there; it lies on the axis of the system that should give them, or there is no such
                system.
        """
        row = self._row(number)
        mover = int(self.movers[row])
        found = self.systems.system(mover).directions(self.points[row])
        if found is None:
            raise ValueError(
                f"GRID {number} lies on the axis of the coordinate system {mover}, where the directions of that system "
                "are not defined"
            )
        return found

    def _row(self, number: int) -> int:
        if number not in self.rows:
            raise ValueError(f"there is no GRID {number}, so that its position is unknown")
        return self.rows[number]


def read_grids(cards: Cards) -> Grids:
    """The GRIDs of a deck, their places in the basic system.

    Raises:
        ValueError: a field is no number; a coordinate system is not there, or is defined by itself.
    """
    grids = cards.get("GRID", [])
    default = cards.get("GRDSET", [[""] * 8])[0]
    numbers = _whole_numbers(grids, [f[0] for f in grids])
    # blank takes GRDSET's, zero is the basic one
    owners, movers = (_whole_numbers(grids, [f[at] or default[at] for f in grids]) for at in (1, 5))
    points = _coordinates(grids)
    systems = _Systems(cards, numbers, owners, points)
    if owners.any():
        local, points = points, points.copy()
        for owner in np.unique(owners[owners != 0]):
            inside = owners == owner
            points[inside] = systems.system(int(owner)).basic(local[inside])
    return Grids(numbers, points, movers, systems)


def _whole_numbers(grids: Sequence[Card], texts: list[str]) -> IntArray:
    try:
        return np.array([text or "0" for text in texts], dtype=np.str_).astype(np.int64)
    except (ValueError, OverflowError):  # what is none is named
        found = []
        for card, text in zip(grids, texts, strict=True):
            try:
                found.append(whole(text))
            except ValueError as error:
                raise card.error(f"{card.title}: {error}") from error
        return np.array(found, dtype=np.int64)


def _coordinates(grids: Sequence[Card]) -> Points:
    texts = [field or "0." for fields in grids for field in fields[2:5]]
    try:
        points = np.array(texts, dtype=np.str_).astype(np.float64).reshape(-1, 3)
        if np.isfinite(points).all():
            return points
    except ValueError:  # exponents without a letter
        pass
    return np.array([[card.real(at) for at in (2, 3, 4)] for card in grids]).reshape(-1, 3)


class _Systems:
    """Coordinate systems by their numbers, found as they are asked for: each may hang on others and on nodes."""

    def __init__(self, cards: Cards, numbers: IntArray, owners: IntArray, points: Points) -> None:
        self._row = {int(number): i for i, number in enumerate(numbers)} if _has_nodes(cards) else {}
        self._owners, self._points = owners, points
        self._found: dict[int, _System] = {0: _System("R", np.zeros(3), np.eye(3))}
        self._cards: dict[int, tuple[Card, int]] = {}  # and the field of the number: CORD1 gives two systems
        for name in (*_BY_POINTS, *_BY_NODES):
            for card in cards.get(name, []):
                self._add(card, 0)
                if name in _BY_NODES and card[4]:
                    self._add(card, 4)

    def _add(self, card: Card, at: int) -> None:
        number = card.whole(at)
        if number in self._cards and _definition(*self._cards[number]) != _definition(card, at):
            raise card.error(f"coordinate system {number} is given more than once")
        self._cards[number] = card, at

    def system(self, number: int, within: tuple[int, ...] = ()) -> _System:
        """The system of that number in the basic one; `within` are those that are defined by it.

        Raises:
            ValueError: there is none; it is damaged, or defined by itself.
        """
        if number in self._found:
            return self._found[number]
        if number not in self._cards:
            raise ValueError(f"coordinate system {number} is used and not given; write its CORD card into the deck")
        card, at = self._cards[number]
        if number in within:
            raise card.error(f"coordinate system {number} hangs on itself, by {list(within)}")
        within = (*within, number)
        if card.name in _BY_NODES:
            a, b, c = (self._node(card, card.whole(at + i), within) for i in (1, 2, 3))
        else:
            values = np.array([card.real(i) for i in range(2, 11)]).reshape(3, 3)
            a, b, c = self.system(card.whole(1), within).basic(values)
        self._found[number] = _System(card.name[-1], a, _axes(card, number, a, b, c))
        return self._found[number]

    def _node(self, card: Card, number: int, within: tuple[int, ...]) -> Points:
        if number not in self._row:
            raise card.error(f"{card.title} names GRID {number}, which is not there")
        row = self._row[number]
        place: Points = self.system(int(self._owners[row]), within).basic(self._points[row : row + 1])[0]
        return place


def _definition(card: Card, at: int) -> tuple[str, list[str]]:
    return card.name, card[at + 1 : at + 4] if card.name in _BY_NODES else card[1:]


def _has_nodes(cards: Cards) -> bool:
    return any(name in cards for name in _BY_NODES)


def _axes(card: Card, number: int, a: Points, b: Points, c: Points) -> Points:
    """Axes in columns: z from a to b, x to the side of c."""
    z, towards = b - a, c - a
    y = np.cross(z, towards)
    size = np.linalg.norm(z) * np.linalg.norm(towards)
    if not np.linalg.norm(y) > _ON_LINE * size:
        raise card.error(f"the three points of {card.name} {number} lie on a line")
    z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
    return np.column_stack((np.cross(y, z), y, z))
