"""Volume, centre and second moments inside a closed surface of triangles, by the divergence theorem."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Edges that a message names.
_SHOWN = 3


class Moments(NamedTuple):
    """Integrals over a volume: 1 (m^3), position over volume (m), (x - centre)(x - centre)^T (3, 3) (m^5)."""

    volume: float
    centre: FloatArray
    second: FloatArray


def outward(points: ArrayLike, triangles: ArrayLike) -> tuple[FloatArray, IntArray]:
    """A closed surface with every triangle facing out of what it encloses: points (k, 3) m and triangles (s, 3).

    The surface may be of several pieces: bodies side by side, cavities in them.  A piece that is inside out is
    turned; a cavity may face either way.  Points at the same place count as one, as in files that list the corners of
    each triangle anew; triangles with two corners at one place are left out.

    Args:
        points: (n, 3) m.
        triangles: (t, 3) rows of points.

    Raises:
        SceneError: arrays that do not fit; a surface that is open or whose triangles disagree which side is out, with
            edges named.
    """
    x, corners = _checked(points, triangles)
    piece = _pieces(x, corners)
    inwards = _facing(x, corners, piece, _cones(x, corners)[0])[piece] < 0.0
    corners[inwards] = corners[inwards, ::-1]
    return x, corners


def enclosed_moments(x: FloatArray, corners: IntArray) -> Moments:
    """Integrals over what a surface of ``outward`` encloses, exact for its flat triangles.

    Args:
        x: (n, 3) m.
        corners: (t, 3) rows of x.

    Raises:
        SceneError: no volume.
    """
    middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
    volume, (a, b, c) = _cones(x, corners)
    whole = a + b + c
    total = float(volume.sum())
    if not total > EQUAL * float(np.linalg.norm(np.ptp(x, axis=0))) ** 3:
        raise SceneError(f"the surface encloses no volume ({total:.3g} m^3): it is flat, or lies on itself")
    centre = np.einsum("t,ti->i", volume, whole) / (4.0 * total)
    second = np.zeros((3, 3))
    for part in (whole, a, b, c):
        second += np.einsum("t,ti,tj->ij", volume / 20.0, part, part)
    second -= total * np.outer(centre, centre)
    return Moments(total, centre + middle, 0.5 * (second + second.T))


def _cones(x: FloatArray, corners: IntArray) -> tuple[FloatArray, FloatArray]:
    """Volumes (t,) m^3 of the tetrahedra from the middle of the extent to each triangle, and its corners from there."""
    middle = 0.5 * (x.min(axis=0) + x.max(axis=0))
    abc = np.moveaxis(x[corners] - middle, 1, 0)
    return np.asarray(np.einsum("ti,ti->t", abc[0], np.cross(abc[1], abc[2])) / 6.0), abc


def whole_rows(triangles: ArrayLike) -> NDArray[Any]:
    """An array of them; empty for what is none, as rows of several lengths."""
    return np.asarray(triangles) if np.isfinite(numbers(triangles)).all() else np.empty((0, 0))


def _checked(points: ArrayLike, triangles: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Points, each place once, and the triangles that name them; none with two corners at one place."""
    x, rows = numbers(points), whole_rows(triangles)
    if x.ndim != 2 or x.shape[1] != 3 or not np.isfinite(x).all():
        raise SceneError(f"points of a surface must be finite numbers of shape (n, 3), got shape {x.shape}")
    if rows.ndim != 2 or rows.shape[1] != 3 or len(rows) == 0 or not np.issubdtype(rows.dtype, np.integer):
        raise SceneError(f"triangles must be whole numbers of shape (t, 3), t > 0, got {rows.dtype} {rows.shape}")
    if rows.min() < 0 or rows.max() >= len(x):
        raise SceneError(f"triangles must name points 0 to {len(x) - 1}, got {rows.min()} to {rows.max()}")
    places, place_of = np.unique(x, axis=0, return_inverse=True)
    corners = place_of.reshape(-1)[rows].astype(np.int64)
    flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    return places, corners[~flat]


def _pieces(x: FloatArray, corners: IntArray) -> IntArray:
    """The piece (t,) that each triangle belongs to; checks that every edge is passed once each way."""
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    low, high, sign = np.minimum(start, end), np.maximum(start, end), np.sign(end - start)
    key = low * len(x) + high
    edges, edge_of = np.unique(key, return_inverse=True)
    count = np.bincount(edge_of)
    open_edges = np.flatnonzero(count % 2)
    if len(open_edges):
        raise SceneError(
            f"the surface is open: {len(open_edges)} edges belong to an odd number of triangles, "
            f"{_named(x, edges[open_edges])}; close its holes"
        )
    turned = np.flatnonzero(np.bincount(edge_of, weights=sign) != 0)
    if len(turned):
        raise SceneError(
            f"the triangles do not agree which side is out: on {len(turned)} edges both pass the same way, "
            f"{_named(x, edges[turned])}; list the corners of all anticlockwise as seen from outside"
        )
    from scipy.sparse import coo_array  # on need: few scenes have surfaces
    from scipy.sparse.csgraph import connected_components

    triangle = np.repeat(np.arange(len(corners)), 3)
    graph = coo_array((np.ones(len(triangle)), (edge_of, triangle)), shape=(len(edges), len(corners))).tocsr()
    labels: IntArray = connected_components(graph.T @ graph, directed=False)[1].astype(np.int64)
    return labels


def _facing(x: FloatArray, corners: IntArray, piece: IntArray, volume: FloatArray) -> FloatArray:
    """1 or -1 by which each piece (p,) counts: what lies in an odd number of others is a cavity."""
    own = np.bincount(piece, weights=volume)
    sign = np.where(own < 0.0, -1.0, 1.0)
    if len(own) == 1:
        return sign
    for k in range(len(own)):
        inside = x[corners[piece == k][0, 0]]
        around = sum(_winding(x, corners[piece == other], inside) for other in range(len(own)) if other != k)
        if around % 2:
            sign[k] = -sign[k]
    return sign


def _winding(x: FloatArray, corners: IntArray, point: FloatArray) -> int:
    """0 or 1: whether a closed surface goes around a point, by the solid angles of its triangles."""
    a, b, c = np.moveaxis(x[corners] - point, 1, 0)
    la, lb, lc = (np.linalg.norm(part, axis=1) for part in (a, b, c))
    top = np.einsum("ti,ti->t", a, np.cross(b, c))
    dots = (np.einsum("ti,ti->t", *pair) for pair in ((a, b), (b, c), (c, a)))
    ab, bc, ca = dots
    angle = 2.0 * np.arctan2(top, la * lb * lc + ab * lc + bc * la + ca * lb)
    return round(abs(float(angle.sum())) / (4.0 * np.pi))


def _named(x: FloatArray, edges: IntArray) -> str:
    """The first few edges by their ends' places."""
    ends = [(x[edge // len(x)], x[edge % len(x)]) for edge in edges[:_SHOWN]]
    told = ", ".join(f"{_place(one)} to {_place(other)} m" for one, other in ends)
    more = f" and {len(edges) - _SHOWN} more" if len(edges) > _SHOWN else ""
    return f"{told}{more}"


def _place(p: FloatArray) -> str:
    return "(" + ", ".join(f"{value:g}" for value in p) + ")"
