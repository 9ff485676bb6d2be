"""Shapes whose numbers fill a table, searched by a tree of boxes: planar profiles, surfaces of triangles."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers, shown
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.protocol import ElementTable
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.kernels.contact import signed_distance as at

FloatArray = NDArray[np.float64]

_MOST_BALLS = 30  # shrinkings of one, most take five
_SAMPLES = 500  # of the points at which the thickness is looked for
_OPPOSED = -0.5  # cosine of the normals at both ends, below which a ball is between two sides, not in a corner


class NumberedShape(Protocol):
    """A shape that numbers tell."""

    def numbers(self) -> FloatArray:
        """(4,) its kind and sizes (``kernels.contact.signed_distance``)."""


class LoneShape:
    """Base of shapes that are touched one by one: not among those whose contacts are found in each step."""

    frame: Frame


class TableShape(LoneShape, ABC):
    """Base of shapes with a table."""

    _kind: int

    @cached_property
    @abstractmethod
    def table(self) -> SharedNumbers:
        """The table, which all contacts of the shape read."""

    @abstractmethod
    def _behind(self) -> tuple[FloatArray, FloatArray, SharedNumbers]:
        """Points (n, 3) m on it, and the normals (n, 3) there, behind which its thickness is looked for; n may be 0.

        The third is the table in which it is looked for.
        """

    def numbers(self) -> FloatArray:
        """Kind, the table's place, which is filled in where it stands, half the thickness or 0, 0."""
        return np.array([self._kind, 0.0, self._half_thickness, 0.0])

    def signed_distance(self, points: ArrayLike) -> FloatArray:
        """Distances (n,) m of points (n, 3) m, in the frame's axes, negative inside.

        Raises:
            SceneError: the points are not finite numbers of this shape.
        """
        p = finite_points(points, 3, f"signed_distance of {type(self).__name__} on {self.frame.label}")
        return self.distances(p)[:, 0]

    def distances(self, points: FloatArray) -> FloatArray:
        """Signed distances (m) and gradients, (n, 4), of points (n, 3) m in the frame's axes."""
        return self._distances(points, self.table)

    def _distances(self, points: FloatArray, table: SharedNumbers) -> FloatArray:
        """Signed distances and gradients, (n, 4), of points (n, 3)."""
        head = [self._kind, float(at.SHAPE_NUMBERS), 0.0, 0.0]
        out = np.zeros((len(points), 4))
        at.distances(np.concatenate([head, table.values]), np.ascontiguousarray(points), out)
        return out

    @cached_property
    def _half_thickness(self) -> float:
        """m, the radius of the smallest ball that touches two sides from inside, of some; 0: nothing is behind.

        Those in corners tell nothing.
        """
        x, n, table = self._behind()
        if not len(x):
            return 0.0
        radius, cosine = self._balls(x, n, table)
        across = cosine < _OPPOSED
        return float(radius[across].min() if across.any() else radius.min())

    def _balls(self, x: FloatArray, n: FloatArray, table: SharedNumbers) -> tuple[FloatArray, FloatArray]:
        """Radii (m) of the largest balls that touch it from behind the normals n (k, 3) at points x (k, 3), of some.

        And the cosines of the angles between n and the gradients at their other ends.  The balls shrink until nothing
        is in them (Ma, Bae & Choi 2012); their cosines are 1 where nothing ever was.
        """
        some = np.arange(0, len(x), max(1, len(x) // _SAMPLES))
        x, n = x[some], n[some]
        radius = np.full(len(x), float(np.linalg.norm(np.ptp(x, axis=0))))
        facing = n.copy()
        for _ in range(_MOST_BALLS):
            centre = x - radius[:, None] * n
            found = self._distances(centre, table)
            shrinks = np.abs(found[:, 0]) < 0.99 * radius
            if not shrinks.any():
                break
            apart = x - (centre - found[:, :1] * found[:, 1:])
            along = np.einsum("ij,ij->i", apart, n)
            square = np.einsum("ij,ij->i", apart, apart)
            shrinks &= along > 0.0
            radius[shrinks] = 0.5 * square[shrinks] / along[shrinks]
            facing[shrinks] = found[shrinks, 1:]
        return radius, np.einsum("ij,ij->i", facing, n)


def tabulated(low: FloatArray, high: FloatArray, items: list[FloatArray]) -> SharedNumbers:
    """The table of items with these boxes, (n, 3) m each (``kernels.contact.box_tree``)."""
    nodes = _box_tree(low, high)
    begins = 1 + nodes.size + np.cumsum([0, *(one.size for one in items)])
    leaves = nodes[:, 7] >= 0.0
    nodes[leaves, 7] = begins[nodes[leaves, 7].astype(np.int64)]
    return SharedNumbers(np.concatenate([[float(len(nodes))], nodes.ravel(), *items]))


def _box_tree(low: FloatArray, high: FloatArray) -> FloatArray:
    """Nodes (2 n - 1, 8), halved at the median along the longest side; leaves have the items' numbers."""
    n = len(low)
    nodes = np.empty((2 * n - 1, 8))
    order = np.arange(n)
    start, count, place = np.array([0]), np.array([n]), np.array([0])
    while len(start):  # one level of the tree
        first = np.cumsum(count) - count
        where = np.arange(count.sum()) + np.repeat(start - first, count)
        items = order[where]
        nodes[place, :3] = np.minimum.reduceat(low[items], first)
        nodes[place, 3:6] = np.maximum.reduceat(high[items], first)
        nodes[place, 6] = place + 2 * count - 1
        nodes[place, 7] = np.where(count == 1, items[first], -1)
        middle = low[items] + high[items]
        axis = np.argmax(np.maximum.reduceat(middle, first) - np.minimum.reduceat(middle, first), axis=1)
        along = middle[np.arange(len(items)), np.repeat(axis, count)]
        order[where] = items[np.lexsort((along, np.repeat(np.arange(len(count)), count)))]
        split = count > 1
        start, count, place = start[split], count[split], place[split]
        half = count // 2
        start = np.concatenate([start, start + half])
        place = np.concatenate([place + 1, place + 2 * half])
        count = np.concatenate([half, count - half])
    return nodes


def finite_points(given: object, columns: int, what: str) -> FloatArray:
    """Points (n, columns) m.

    Raises:
        SceneError: they are of another shape, or not finite: the message has the first that is not.
    """
    x = numbers(given)
    if x.ndim != 2 or x.shape[1] != columns:
        found = shown(given) if x.ndim == 0 else f"shape {x.shape}"
        raise SceneError(f"{what}: points must be finite numbers of shape (n, {columns}) (m), got {found}")
    wrong = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if len(wrong):
        raise SceneError(
            f"{what}: points must be finite, and {len(wrong)} of {len(x)} are not, the first of them number "
            f"{wrong[0]}, ({', '.join(f'{value:g}' for value in x[wrong[0]])}) m"
        )
    return x


def tables_of(shape: object) -> tuple[SharedNumbers, ...]:
    """The table of a shape, if it has one."""
    return (shape.table,) if isinstance(shape, TableShape) else ()


def placed_numbers(shape: NumberedShape, table: ElementTable) -> FloatArray:
    """(4,) a shape's numbers, with the place of its table, if it has one."""
    found = shape.numbers()
    if isinstance(shape, TableShape):
        found[at.TABLE] = table.shared(shape.table)
    return found


def refuse_table(shape: object) -> None:
    """Raise SceneError for a shape that is touched one by one among those whose contacts are found in each step."""
    if isinstance(shape, LoneShape):
        raise SceneError(
            f"{type(shape).__name__} on {shape.frame.label}: it is not among the shapes whose contacts are found in "
            "each step: spheres and vertices touch it, one by one; call touch for it and each of them, not for a list"
        )
