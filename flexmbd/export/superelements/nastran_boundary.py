"""The boundary of a Nastran superelement: its GRIDs, their coordinate systems, and the order of its rows.

A GRID stands in the system CP, its displacements along that of CD; rectangular, cylindrical and spherical systems are
read, by points in another system (CORD2R, ..C, ..S) or by GRIDs (CORD1R, ..C, ..S).  EXTSEOUT's .pch says the rows by
EXTRN, with components; its .asm by SECONCT, all six of a GRID.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexmbd.export.superelements.matrix_text import Dof
from flexmbd.export.superelements.nastran_cards import number, whole
from flexmbd.export.superelements.superelement_frames import MOST_ROWS
from flexmbd.record.groups import FloatArray

#: Cards that `Boundary.add` takes.
CARDS = frozenset(
    {"GRID", "GRDSET", "SPOINT", "EXTRN", "SECONCT", *(f"CORD{n}{kind}" for n in "12" for kind in "RCS")}
)
# Of a point's distance from an axis of its system, as a share of its distance from the origin: it lies on the axis.
_ON_AXIS = 1e-9


@dataclass(frozen=True, eq=False)
class _System:
    """A coordinate system as its card says it: of points in the system `base`, or of GRIDs.

    `kind` is R, C or S.
    """

    kind: str
    base: int = 0
    points: tuple[FloatArray, ...] = ()
    grids: tuple[int, ...] = ()


@dataclass(eq=False)
class Boundary:
    """What the cards of a deck say.

    Attributes:
        placed: CP, coordinates and CD of each GRID.
        systems: by their numbers.
        points: SPOINTs.
        rows: node and component (0 of SPOINTs) of each row of the matrices, by EXTRN; empty where there is none.
        connected: nodes in the order of the rows, by SECONCT.
    """

    placed: dict[int, tuple[int, FloatArray, int]] = field(default_factory=dict)
    systems: dict[int, _System] = field(default_factory=dict)
    points: set[int] = field(default_factory=set)
    rows: list[Dof] = field(default_factory=list)
    connected: list[int] = field(default_factory=list)
    _default: tuple[int, int] = (0, 0)

    def add(self, fields: Sequence[str]) -> None:
        """Take a card of `CARDS`.

        Raises:
            ValueError: it is damaged.
        """
        name = fields[0]
        if name == "GRID":
            cp, cd = (whole(fields, at) or default for at, default in zip((2, 6), self._default, strict=True))
            self.placed[whole(fields, 1)] = cp, np.array([number(fields, i) for i in (3, 4, 5)]), cd
        elif name == "GRDSET":
            self._default = whole(fields, 2), whole(fields, 6)
        elif name == "SPOINT":
            self.points.update(_numbers(fields[1:]))
        elif name == "EXTRN":
            self.rows += _components(fields)
        elif name == "SECONCT":
            # after the first line pairs of nodes, of the part and of the assembly
            self.connected += _of_part(fields[9:])
        elif name[4] == "2":
            points = tuple(np.array([number(fields, 3 * i + j) for j in range(3)]) for i in (1, 2, 3))
            self.systems[whole(fields, 1)] = _System(name[5], base=whole(fields, 2), points=points)
        else:
            for at in (1, 5):
                if at < len(fields) and fields[at]:
                    grids = tuple(whole(fields, at + i) for i in (1, 2, 3))
                    self.systems[whole(fields, at)] = _System(name[5], grids=grids)

    def order(self) -> list[Dof]:
        """Node and component of each row of the matrices, where EXTRN or SECONCT tells; else none."""
        if self.rows or not self.connected:
            return self.rows
        return [(node, c) for node in self.connected for c in ((0,) if node in self.points else range(1, 7))]

    def place(self, grid: int) -> FloatArray:
        """(3,) position of a GRID in the basic system.

        Raises:
            ValueError: it has none, or its coordinate system has none.
        """
        return self._place(grid, ())

    def turn(self, grid: int) -> FloatArray:
        """(3, 3) rotation from the directions of a GRID's displacements to the basic system's axes.

        Raises:
            ValueError: it lies on the axis of the system that should give them, or there is no such system.
        """
        cd = self.placed[grid][2]
        if cd == 0:
            return np.eye(3)
        kind, origin, axes = self._axes(cd, ())
        if kind == "R":
            return axes
        x, y, z = axes.T @ (self.place(grid) - origin)
        radius, length = float(np.hypot(x, y)), float(np.hypot(np.hypot(x, y), z))
        if not radius > _ON_AXIS * length:
            raise ValueError(
                f"GRID {grid} lies on the axis of the coordinate system {cd}, in which its displacements have no "
                "directions there"
            )
        around = np.array([-y, x, 0.0]) / radius
        if kind == "C":
            return np.asarray(axes @ np.column_stack([[x / radius, y / radius, 0.0], around, [0.0, 0.0, 1.0]]))
        outwards = np.array([x, y, z]) / length
        return np.asarray(axes @ np.column_stack([outwards, np.cross(around, outwards), around]))

    def _place(self, grid: int, asked: tuple[int, ...]) -> FloatArray:
        if grid not in self.placed:
            raise ValueError(f"there is no GRID {grid}, and so no position of it")
        cp, coordinates, _ = self.placed[grid]
        return self._point(cp, coordinates, asked)

    def _point(self, system: int, at: FloatArray, asked: tuple[int, ...]) -> FloatArray:
        """(3,) of coordinates in a system."""
        if system == 0:
            return at
        kind, origin, axes = self._axes(system, asked)
        if kind == "R":
            return np.asarray(origin + axes @ at)
        a, b = np.radians(at[1]), np.radians(at[2])
        local = (
            [at[0] * np.cos(a), at[0] * np.sin(a), at[2]]
            if kind == "C"
            else [at[0] * np.sin(a) * np.cos(b), at[0] * np.sin(a) * np.sin(b), at[0] * np.cos(a)]
        )
        return np.asarray(origin + axes @ np.array(local))

    def _axes(self, number: int, asked: tuple[int, ...]) -> tuple[str, FloatArray, FloatArray]:
        """Kind, origin (3,) and axes (3, 3) of a system, in the basic one."""
        if number not in self.systems:
            raise ValueError(f"there is no coordinate system {number} (CORD2R, CORD2C, CORD2S or CORD1..)")
        if number in asked:
            raise ValueError(f"coordinate system {number} is defined by itself")
        system, within = self.systems[number], (*asked, number)
        a, b, c = (
            (self._place(grid, within) for grid in system.grids)
            if system.grids
            else (self._point(system.base, point, within) for point in system.points)
        )
        up, plane = b - a, np.cross(b - a, c - a)
        if not np.linalg.norm(plane) > _ON_AXIS * np.linalg.norm(up) * np.linalg.norm(c - a):
            raise ValueError(f"coordinate system {number}: its three points lie in one line")
        z, y = up / np.linalg.norm(up), plane / np.linalg.norm(plane)
        return system.kind, a, np.column_stack([np.cross(y, z), y, z])


def _numbers(words: Iterable[str]) -> list[int]:
    """Numbers, and all from one to another by THRU."""
    found: list[int] = []
    through = False
    for word in (word for word in words if word):
        if word.upper() == "THRU":
            through = True
            continue
        last = whole(["number", "", word], 2)
        first = found[-1] + 1 if through and found else last
        if len(found) + last - first + 1 > MOST_ROWS:
            raise ValueError(f"more than {MOST_ROWS} points up to number {last} are no superelement's")
        found += range(first, last + 1)
        through = False
    return found


def _of_part(words: Sequence[str]) -> list[int]:
    """The first of each pair of numbers; pairs of ranges by THRU."""
    found: list[int] = []
    there = [word for word in words if word]
    at = 0
    while at < len(there):
        length = 3 if at + 1 < len(there) and there[at + 1].upper() == "THRU" else 1
        found += _numbers(there[at : at + length])
        at += 2 * length
    return found


def _components(fields: Sequence[str]) -> list[Dof]:
    """Nodes and components of EXTRN: pairs ``node, components``, or ``first, THRU, last, components``."""
    there = [word for word in fields[1:] if word]
    rows: list[Dof] = []
    at = 0
    while at < len(there):
        length = 3 if at + 1 < len(there) and there[at + 1].upper() == "THRU" else 1
        if at + length >= len(there):
            raise ValueError(f"EXTRN names node {there[at][:20]!r} without components")
        nodes, components = _numbers(there[at : at + length]), there[at + length]
        if components != "0" and (not set(components) <= set("123456") or len(set(components)) < len(components)):
            raise ValueError(f"EXTRN {there[at][:20]}: {components[:20]!r} are no components")
        rows += [(node, int(c)) for node in nodes for c in sorted(components)]
        at += length + 1
    if len(set(rows)) < len(rows):
        raise ValueError("EXTRN names a component of a node twice")
    return rows
