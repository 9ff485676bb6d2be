"""Where points are before a surface of facets that moves: the nearest place on it, and the depth behind it."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.surface_patch import SurfacePatch, surface_facets
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.errors import SceneError
from flexmbd.round_off import SIX_DIGITS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# By which part of a triangle a point may be beside it that is measured by its plane all the same.
_BESIDE = 0.1


@dataclass(frozen=True, eq=False)
class NearFacets:
    """Points and the nearest place on a surface.

    Attributes:
        points: (n,) which of the points that were asked for.
        depth: (n,) m, behind the surface; negative before it.
        normal: (n, 3) unit vectors out of the surface, towards or away from the points.
        nodes: (n, 4) the surface's nodes that the place hangs on, by their rows.
        weights: (n, 4) by how much of each; their sum is 1.
        gradients: (n, 4, 3) 1/m, of the weights by the point.
        bends: (n, 3, 3) projections to the directions in which the normal goes with the point, turning about a place on
            an edge or a corner that is as far as the depth; zero inside of triangles.
        triangle: (n,) that the place is on, of the mesh.
        off: (n, 3) which corners of the triangle the place does not hang on, as it is on an edge or a corner and nearer
            to the point than the plane's; none of what is measured by the plane.
        beside: (n,) whether the points are beyond the rim, by at most half a facet: before or behind its plane.
    """

    points: IntArray
    depth: FloatArray
    normal: FloatArray
    nodes: IntArray
    weights: FloatArray
    gradients: FloatArray
    bends: FloatArray
    triangle: IntArray
    off: NDArray[np.bool_]
    beside: NDArray[np.bool_]

    def some(self, mask: NDArray[np.bool_]) -> NearFacets:
        """Those of a mask (n,)."""
        return NearFacets(*(getattr(self, part.name)[mask] for part in fields(self)))

    def and_others(self, others: NearFacets) -> NearFacets:
        """These, and others."""
        pairs = ((getattr(one, part.name) for one in (self, others)) for part in fields(self))
        return NearFacets(*(np.concatenate([*pair]) for pair in pairs))


class FacetMesh:
    """Facets between points that move.

    A quadrilateral is four triangles about its middle.

    Attributes:
        facets: (f, 3 or 4) rows of the points at the corners, which go round against the clock as seen from outside.
        count: of the points.
    """

    def __init__(self, facets: IntArray, count: int) -> None:
        """Find the triangles."""
        self.facets, self.count = facets, count
        self._triangles()

    def _triangles(self) -> None:
        """Triangles by rows of nodes and middles, and which of their edges and corners are on the rim."""
        f, width, k = self.facets, self.facets.shape[1], self.count
        sides = np.stack([f, np.roll(f, -1, axis=1)], axis=2)
        edges, inverse, count = np.unique(
            np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True, return_counts=True
        )
        rim = (count[inverse.reshape(-1)] == 1).reshape(len(f), width)
        on_rim = np.zeros(k + len(f), dtype=bool)
        on_rim[edges[count == 1].ravel()] = True
        if width == 3:
            self._corner = f
            self._rim_side = rim[:, [1, 2, 0]]  # opposite to each corner
            self._facet = np.arange(len(f))
        else:
            middle = np.repeat(k + np.arange(len(f)), 4)
            self._corner = np.column_stack([sides.reshape(-1, 2), middle])
            none = np.zeros(len(middle), dtype=bool)
            self._rim_side = np.column_stack([none, none, rim.reshape(-1)])
            self._facet = np.repeat(np.arange(len(f)), 4)
        self._rim_corner = on_rim[self._corner]

    def find(self, points: FloatArray, surface: FloatArray, *, margin: float = 0.0) -> NearFacets:
        """Which points (n, 3) m are behind facets, or less than a margin (m) before them.

        Args:
            points: (n, 3) m.
            surface: (k, 3) m, places of the surface's nodes.
            margin: m.
        """
        corners = self._corners(surface)
        centre = corners.mean(axis=1)
        reach = 1.5 * float(np.sqrt(((corners - centre[:, None]) ** 2).sum(axis=2).max())) + margin
        some = _within(points, surface, reach)
        if not len(some):
            return _nothing()
        those = _within(centre, points[some], reach)
        pairs = cKDTree(centre[those]).query_ball_point(points[some], reach)
        count = np.array([len(one) for one in pairs], dtype=np.int64)
        some, pairs, count = some[count > 0], [sorted(one) for one in pairs if one], count[count > 0]
        if not len(some):
            return _nothing()
        triangle = those[np.concatenate(pairs).astype(np.int64)]
        return self._nearest(points, some, count, triangle, corners, margin=margin)

    def before(self, points: FloatArray, rows: IntArray, triangle: IntArray, surface: FloatArray) -> NearFacets:
        """Where some points are before the planes of given triangles, of those that are above these or little beside.

        Args:
            points: (n, 3) m.
            rows: (k,) which of them.
            triangle: (k,) the triangles.
            surface: as of `find`.
        """
        abc = self._corners(surface)[triangle]
        share = _closest(points[rows], abc)[0]
        kept = share.min(axis=1, initial=1.0) > -_BESIDE
        rows, triangle, abc, share = rows[kept], triangle[kept], abc[kept], share[kept]
        area = np.cross(abc[:, 1] - abc[:, 0], abc[:, 2] - abc[:, 0])
        unit = area / np.sqrt((area**2).sum(axis=1))[:, None]
        depth = -np.einsum("na,na->n", points[rows] - abc[:, 0], unit)
        slopes = _share_slopes(abc, unit, np.zeros(share.shape, dtype=bool))[0]
        nodes, weights = self._weights(triangle, share)
        gradients = np.stack([self._weights(triangle, slopes[:, :, k])[1] for k in range(3)], axis=2)
        flat, no = np.zeros((len(rows), 3, 3)), np.zeros(len(rows), dtype=bool)
        none = np.zeros((len(rows), 3), dtype=bool)
        return NearFacets(rows, depth, unit, nodes, weights, gradients, flat, triangle, none, no)

    def _corners(self, surface: FloatArray) -> FloatArray:
        """(t, 3, 3) m, of the triangles."""
        x = surface
        if self.facets.shape[1] == 4:
            x = np.vstack([surface, surface[self.facets].mean(axis=1)])
        return np.asarray(x[self._corner])

    def _nearest(
        self, points: FloatArray, some: IntArray, count: IntArray, triangle: IntArray, corners: FloatArray, *,
        margin: float,
    ) -> NearFacets:
        """Of some points the nearest of ``count`` triangles each."""
        first = np.cumsum(count) - count
        p, abc = np.repeat(points[some], count, axis=0), corners[triangle]
        below, share = _closest(p, abc)
        away = p - np.einsum("nk,nka->na", share, abc)
        square = (away**2).sum(axis=1)
        area = np.cross(abc[:, 1] - abc[:, 0], abc[:, 2] - abc[:, 0])
        size = np.sqrt((area**2).sum(axis=1))
        unit = area / size[:, None]
        least = np.minimum.reduceat(square, first)
        # triangles that share the nearest place have all a say in which side is out
        tied = square <= np.repeat(least, count) + SIX_DIGITS**2 * size
        normal = np.add.reduceat(np.where(tied[:, None], unit, 0.0), first)
        best = first + np.array([int(np.argmin(part)) for part in np.split(square, first[1:])])
        side = (away[best] * normal).sum(axis=1)
        far = np.sqrt(least)
        depth = -np.sign(side) * far
        sharp = far > SIX_DIGITS * np.sqrt(size[best])
        towards = (np.sign(side) / np.where(sharp, far, 1.0))[:, None] * away[best]
        n = np.where(sharp[:, None], towards, unit[best])
        across = away[best] - (away[best] * unit[best]).sum(axis=1)[:, None] * unit[best]
        beyond = np.sqrt((across**2).sum(axis=1))
        zero = share[best] == 0.0
        single, double = zero.sum(axis=1) == 1, zero.sum(axis=1) == 2
        chosen, length = triangle[best], np.sqrt(size[best])
        on_rim = (single & (zero & self._rim_side[chosen]).any(axis=1)) | (
            double & (~zero & self._rim_corner[chosen]).any(axis=1)
        )
        beside = on_rim & (beyond > SIX_DIGITS * length)
        depth = np.where(beside, -(away[best] * unit[best]).sum(axis=1), depth)
        n = np.where(beside[:, None], unit[best], n)
        keep = (depth > -margin) & (~beside | (beyond < 0.5 * length))
        # what is beside acts on the facet as a plate that goes on, so that forces have no moment
        share = np.where(beside[:, None], below[best], share[best])
        nodes, weights = self._weights(chosen[keep], share[keep])
        bends = np.where((sharp & ~beside & zero.any(axis=1))[keep], 1.0, 0.0)[:, None, None] * np.eye(3)
        slopes, along = _share_slopes(abc[best][keep], unit[best][keep], zero[keep] & ~beside[keep, None])
        bends -= (bends @ n[keep, :, None]) * n[keep, None, :] + (bends @ along[:, :, None]) * along[:, None, :]
        gradients = np.stack([self._weights(chosen[keep], slopes[:, :, k])[1] for k in range(3)], axis=2)
        off = (zero & (sharp & ~beside)[:, None])[keep]
        place = nodes, weights, gradients, bends, chosen[keep], off, beside[keep]
        return NearFacets(some[keep], depth[keep], n[keep], *place)

    def spread(self, triangle: IntArray) -> FloatArray:
        """(n, 3, 4) by how much of their facet's nodes, as of `NearFacets.nodes`, corners of triangles are made."""
        return np.stack([self._weights(triangle, np.tile(unit, (len(triangle), 1)))[1] for unit in np.eye(3)], axis=1)

    def _weights(self, triangle: IntArray, share: FloatArray) -> tuple[IntArray, FloatArray]:
        """Nodes (n, 4) and weights of places that are shares (n, 3) of the triangles' corners."""
        if self.facets.shape[1] == 3:
            nodes = self._corner[triangle]
            return np.column_stack([nodes, nodes[:, 0]]), np.column_stack([share, np.zeros(len(share))])
        nodes = self.facets[self._facet[triangle]]
        weights = np.repeat(share[:, 2:] / 4.0, 4, axis=1)
        for k in range(2):
            weights += share[:, k, None] * (nodes == self._corner[triangle, k, None])
        return nodes, weights


class FacetSurface(FacetMesh):
    """A group of a body's facets, the whole of it on every rank. Constructing one is collective.

    Attributes:
        number: (k,) the nodes on it, by their numbers in the mesh's input, ascending.
        own: (k,) this rank's owned node of each, -1 of another rank's.
    """

    def __init__(self, body: NonlinearModel, surface: str) -> None:
        """Gather the facets.

        Raises:
            SceneError: on all ranks: its facets have nodes beside their corners.
        """
        patch, numbers = SurfacePatch(body, surface_facets(body, surface)), node_numbers(body)
        width = patch.nodes.shape[1]
        if width not in (3, 4):
            raise SceneError(
                f"surface {surface!r}: facets that nodes touch have corners alone; take elements of degree 1"
            )
        # corners go round, seen from outside against the clock
        order = np.arange(3) if width == 3 else np.array([0, 1, 3, 2])
        corners = patch.nodes[:, order]
        corners[patch.sense < 0.0] = corners[patch.sense < 0.0][:, ::-1]
        facets = np.concatenate(body.comm.allgather(numbers[corners])).astype(np.int64)
        facets = facets[np.lexsort(np.sort(facets, axis=1).T)]  # whatever the ranks
        self.number: IntArray = np.unique(facets)
        owned = numbers[: body.layout.n_owned_nodes]
        at = np.searchsorted(self.number, owned)
        mine = self.number[np.minimum(at, len(self.number) - 1)] == owned
        self.own: IntArray = np.full(len(self.number), -1, dtype=np.int64)
        self.own[at[mine]] = np.flatnonzero(mine)
        super().__init__(np.searchsorted(self.number, facets), len(self.number))


def check_facets(body: NonlinearModel, surface: str, *, what: str) -> None:
    """Refuse surfaces that are no facets.

    Raises:
        SceneError: they are the edges of a plane body.
    """
    if body.mesh.dim < 3:
        raise SceneError(
            f"{what}: surface {surface!r} is of edges of a plane body, which have no plane of their own; let its nodes "
            "touch facets of a solid, or shapes, or take a layer of solid cells"
        )


def check_same_ranks(first: NonlinearModel, second: NonlinearModel, *, what: str) -> None:
    """Refuse two bodies on unlike sets of ranks. Collective over the first one's.

    Raises:
        SceneError: on all ranks of the first.
    """
    error = None
    if first.comm.size != second.comm.size:
        error = SceneError(f"{what}: both bodies must be spread over the same ranks")
    parallel.raise_collectively(first.comm, error)


def _within(points: FloatArray, others: FloatArray, reach: float) -> IntArray:
    """Which points (n, 3) m are less than a reach (m) outside of the box around others (k, 3) m."""
    low, high = others.min(axis=0) - reach, others.max(axis=0) + reach
    return np.flatnonzero(((points > low) & (points < high)).all(axis=1))


def _nothing() -> NearFacets:
    none = np.zeros(0, dtype=np.int64)
    nodes, weights, normals = np.zeros((0, 4), dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 3))
    off, beside = np.zeros((0, 3), dtype=bool), np.zeros(0, dtype=bool)
    place = nodes, weights, np.zeros((0, 4, 3)), np.zeros((0, 3, 3)), none, off, beside
    return NearFacets(none, np.zeros(0), normals, *place)


def _share_slopes(abc: FloatArray, unit: FloatArray, zero: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """(n, 3, 3) 1/m, of the shares of corners by the point; (n, 3) unit vectors along edges, or 0.

    Args:
        abc: (n, 3, 3) m, corners.
        unit: (n, 3) normals.
        zero: (n, 3) which shares stay zero: one where the place is on an edge, two on a corner.
    """
    opposite = np.roll(abc, -2, axis=1) - np.roll(abc, -1, axis=1)
    area = np.einsum("na,na->n", np.cross(opposite[:, 1], opposite[:, 2]), unit)
    slopes = np.cross((unit / area[:, None])[:, None], opposite)
    count = zero.sum(axis=1)
    edge = np.flatnonzero(count == 1)
    k = zero[edge].argmax(axis=1)
    along = np.zeros_like(unit)
    vector = opposite[edge, k]
    square = (vector**2).sum(axis=1)[:, None]
    along[edge] = vector / np.sqrt(square)
    slopes[count > 0] = 0.0
    slopes[edge, (k + 1) % 3], slopes[edge, (k + 2) % 3] = -vector / square, vector / square
    return slopes, along


def _closest(p: FloatArray, abc: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(n, 3) shares of the corners abc (n, 3, 3) of the places of planes, and of their triangles, nearest to p (n, 3).

    (Ericson 2005, Real-Time Collision Detection, section 5.1.5.)
    """
    a, b, c = abc[:, 0], abc[:, 1], abc[:, 2]
    ab, ac, bc = b - a, c - a, c - b

    def dot(u: FloatArray, v: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("ij,ij->i", u, v))

    d1, d2 = dot(ab, p - a), dot(ac, p - a)
    d3, d4 = dot(ab, p - b), dot(ac, p - b)
    d5, d6 = dot(ab, p - c), dot(ac, p - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    out = np.stack([va, vb, vc], axis=1) / (va + vb + vc)[:, None]
    below = out.copy()

    def on_edge(where: NDArray[np.bool_], i: int, j: int, t: FloatArray) -> None:
        out[where] = 0.0
        out[where, i], out[where, j] = 1.0 - t[where], t[where]

    on_edge((vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0), 0, 1, d1 / dot(ab, ab))
    on_edge((vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0), 0, 2, d2 / dot(ac, ac))
    on_edge((va <= 0.0) & (d4 - d3 >= 0.0) & (d5 - d6 >= 0.0), 1, 2, (d4 - d3) / dot(bc, bc))
    for k, inside in enumerate(((d1 <= 0.0) & (d2 <= 0.0), (d3 >= 0.0) & (d4 <= d3), (d6 >= 0.0) & (d5 <= d6))):
        out[inside] = np.eye(3)[k]
    return below, out
