"""Flat triangles of a surface, the edges that they share, and what is refused of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.round_off import EQUAL, SEVEN_DIGITS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Facets:
    """Triangles with a neighbour, or none, across each edge; edge k runs from corner k to the next one.

    Attributes:
        corners: (t, 3, 3) m.
        rows: (t, 3) the corners' points by numbers.
        across: (t, 3) the neighbour's edge, 3 times its triangle and the edge's number there; -1 on a rim.
        normals: (t, 3) unit.
        angles: (t, 3) rad at the corners.
    """

    corners: FloatArray
    rows: IntArray
    across: IntArray
    normals: FloatArray
    angles: FloatArray

    @classmethod
    def of(cls, points: FloatArray, triangles: IntArray, what: str) -> Facets:
        """Those of points (n, 3) m and triangles (t, 3); points at one place are one.

        Raises:
            SceneError: a triangle without area; an edge of more than two, or of two that pass it the same way.
        """
        places, place_of = np.unique(points, axis=0, return_inverse=True)
        rows = place_of.reshape(-1)[triangles].astype(np.int64)
        x = places[rows]
        edges = np.roll(x, -1, axis=1) - x
        normals = np.asarray(np.cross(edges[:, 0], edges[:, 1]), dtype=np.float64)
        area = np.linalg.norm(normals, axis=1)
        flat = np.flatnonzero(area <= EQUAL * np.einsum("tei,tei->te", edges, edges).max(axis=1))
        if len(flat):
            raise SceneError(
                f"{what}: {len(flat)} triangles have no area, as number {flat[0]} with corners {_places(x[flat[0]])}; "
                "leave them out, and join what they were between"
            )
        normals /= area[:, None]
        back = -np.roll(edges, 1, axis=1)
        angles = np.arctan2(np.linalg.norm(np.cross(edges, back), axis=2), np.einsum("tei,tei->te", edges, back))
        return cls(x, rows, _across(rows, places, what), normals, np.asarray(angles, dtype=np.float64))

    @cached_property
    def arms(self) -> FloatArray:
        """(t, 3, 3) m, the corners as seen from the first one."""
        return self.corners - self.corners[:, :1]

    def refuse_rim(self, what: str) -> None:
        """Raise SceneError if an edge has one triangle alone."""
        rim = np.argwhere(self.across < 0)
        if len(rim):
            t, k = rim[0]
            ends = _places(self.corners[t][[k, (k + 1) % 3]])
            raise SceneError(
                f"{what}: the surface is open: {len(rim)} edges have one triangle alone, as {ends}; close it, or say "
                "open=True if spheres only come from its front"
            )

    def refuse_inwards(self, what: str) -> None:
        """Raise SceneError if the closed surface encloses a negative volume."""
        x = self.corners - self.corners.reshape(-1, 3).mean(axis=0)
        if np.einsum("ti,ti->", x[:, 0], np.cross(x[:, 1], x[:, 2])) <= 0.0:
            raise SceneError(
                f"{what}: the surface faces inwards; turn its triangles, triangles[:, ::-1], or say open=True if what "
                "touches it is inside, as in a hollow"
            )

    def sharp(self, crease_angle: float) -> BoolArray:
        """(t, 3) whether an edge is a rim, or its triangles' normals differ by the crease angle (rad) or more."""
        other = self.normals[np.maximum(self.across, 0) // 3]
        n = self.normals[:, None]
        angle = np.arctan2(np.linalg.norm(np.cross(n, other), axis=2), np.sum(n * other, axis=2))
        one_plane = angle <= SEVEN_DIGITS
        return np.asarray((self.across < 0) | ~((angle < crease_angle) | one_plane))

    def signing_normals(self, sharp: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Of edges and of corners (t, 3, 3 each) the normals that sign what is nearest to them; 0 where smooth.

        A rim is signed as if a wall went down from it: what is beside it is not behind the surface.
        """
        there = (self.across >= 0)[..., None]
        along = self.arms[:, [1, 2, 0]] - self.arms
        walls = np.cross(along, self.normals[:, None])
        walls = np.where(there, 0.0, walls / np.linalg.norm(walls, axis=2, keepdims=True))
        beyond = np.where(there, self.normals[self.across // 3], walls)
        edges = np.where(sharp[..., None], self.normals[:, None] + beyond, 0.0)
        count = int(self.rows.max()) + 1
        weighed = np.zeros((count, 3))
        for k in range(3):
            np.add.at(weighed, self.rows[:, k], self.angles[:, k, None] * self.normals)
            for end in (k, (k + 1) % 3):
                np.add.at(weighed, self.rows[:, end], 0.5 * np.pi * walls[:, k])
        creased = np.zeros(count, dtype=np.bool_)
        creased[self.rows[sharp]] = True  # where a sharp edge ends, the other triangle's, or another of the rim, begins
        return edges, np.where(creased[self.rows][..., None], weighed[self.rows], 0.0)

    def has_curved_edge(self, control: FloatArray) -> BoolArray:
        """(t,) whether an edge of control points (t, 19, 3), seen from the first corner, is no straight line."""
        curved = np.zeros(len(self.rows), dtype=np.bool_)
        for k in range(3):
            ends = self.arms[:, k], self.arms[:, (k + 1) % 3]
            chord = ends[1] - ends[0]
            size = np.einsum("ti,ti->t", chord, chord)
            for j in range(1, 4):
                beside = np.linalg.norm(np.cross(control[:, 4 * k + j] - ends[0], chord), axis=1)
                curved |= beside > EQUAL * size
        return curved


def _across(rows: IntArray, places: FloatArray, what: str) -> IntArray:
    """(t, 3) the neighbour's edge of each edge."""
    start, end = rows.ravel(), np.roll(rows, -1, axis=1).ravel()
    key = np.minimum(start, end) * (int(rows.max()) + 1) + np.maximum(start, end)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    count = np.diff(np.append(first, len(order)))
    many = np.flatnonzero(count > 2)
    if len(many):
        e = order[first[many[0]]]
        raise SceneError(
            f"{what}: {len(many)} edges have more than two triangles, as {_places(places[[start[e], end[e]]])}; which "
            "side is out is not known there"
        )
    across = np.full(len(key), -1)
    one, other = order[first[count == 2]], order[first[count == 2] + 1]
    turned = np.flatnonzero(start[one] == start[other])
    if len(turned):
        e = one[turned[0]]
        raise SceneError(
            f"{what}: the triangles do not agree which side is out: on {len(turned)} edges both pass the same way, as "
            f"{_places(places[[start[e], end[e]]])}; list the corners of all anticlockwise as seen from outside"
        )
    across[one], across[other] = other, one
    return across.reshape(-1, 3)


def _places(x: FloatArray) -> str:
    return " to ".join("(" + ", ".join(f"{value:g}" for value in p) + ")" for p in x) + " m"
