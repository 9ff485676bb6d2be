"""Where points lie on a surface of facets, by shape functions of the cells behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import basix
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexmbd.continuum import compat
from flexmbd.continuum.finite_elements.discrete_forms import DiscreteForms
from flexmbd.continuum.finite_elements.surface_patch import surface_facets
from flexmbd.round_off import EQUAL, SAME_PLACE, SEVEN_DIGITS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Of a point: gap (m), numbers of the facet's nodes, size (m), nodes of the cell by number, and their weights.
_Place: TypeAlias = tuple[float, tuple[int, ...], float, IntArray, FloatArray]


@dataclass(frozen=True, eq=False)
class FoundPlaces:
    """Of n points, the same on all ranks.

    Attributes:
        gaps: (n,) m, from the nearest facet; inf where none was found.
        sizes: (n,) m, of that facet: the root of its area.
        nodes: of each point the numbers of the nodes by which it moves.
        weights: of each point their weights: they sum to one, and give the point's place.
    """

    gaps: FloatArray
    sizes: FloatArray
    nodes: list[IntArray]
    weights: list[FloatArray]


def find_places(forms: DiscreteForms, facets: str, x: FloatArray, numbers: IntArray) -> FoundPlaces:
    """Find the nearest facet to each point, and its place in the cell behind that. Collective.

    Args:
        forms: on the mesh.
        facets: the group of facets.
        x: (n, 3) m, points, the same on all ranks.
        numbers: (local nodes including ghosts,) of the displacement's nodes.

    Raises:
        MeshError: on all ranks: facets that are not on the surface.
    """
    surface = _Surface(forms, facets, numbers)
    own = [surface.nearest(point) for point in x]
    every = forms.comm.allgather(own)
    none: _Place = (np.inf, (), 1.0, np.zeros(0, np.int64), np.zeros(0))
    best = [_first([place for place in several if place is not None]) or none for several in zip(*every, strict=True)]
    gaps, sizes = np.array([place[0] for place in best]), np.array([place[2] for place in best])
    return FoundPlaces(gaps, sizes, [place[3] for place in best], [place[4] for place in best])


def _first(places: list[_Place]) -> _Place | None:
    """The nearest; of several in round-off that of the lowest numbers, whatever the partition."""
    if not places:
        return None
    near = min(place[0] for place in places)
    return min((place for place in places if place[0] <= near + SAME_PLACE * place[2]), key=lambda place: place[1])


class _Surface:
    """Facets of a group whose cells this rank owns. Constructing one is collective."""

    def __init__(self, forms: DiscreteForms, facets: str, numbers: IntArray) -> None:
        domain = forms.mesh.mesh
        topology = domain.topology
        given = surface_facets(forms, facets, what="weld to facets")
        topology.create_connectivity(3, 2)
        to_cells, to_facets = topology.connectivity(2, 3), topology.connectivity(3, 2)
        self._kind = basix.CellType[topology.cell_name()]
        self._corners: FloatArray = basix.geometry(self._kind)
        table = basix.topology(self._kind)[2]
        nodes, x = compat.cell_nodes(domain), domain.geometry.x
        self._map, self._element = compat.coordinate_map(domain), forms.layout.node_space.element.basix_element
        self._cells, self._sides = [], []
        for facet in given:
            cell = int(to_cells.links(facet)[0])
            if cell < topology.index_map(3).size_local:
                self._cells.append(cell)
                self._sides.append(table[int(np.flatnonzero(to_facets.links(cell) == facet)[0])])
        self._geometry = [x[nodes[cell]] for cell in self._cells]
        self._dofs = [forms.layout.node_space.dofmap.cell_dofs(cell) for cell in self._cells]
        self._numbers, self._node_x = numbers, forms.layout.node_x
        # basix lists the vertices of a cell first
        corners = np.array([one[side] for one, side in zip(self._geometry, self._sides, strict=True)])
        self._keys = [tuple(sorted(numbers[d[s]].tolist())) for d, s in zip(self._dofs, self._sides, strict=True)]
        self._middles = corners.mean(axis=1) if len(corners) else np.zeros((0, 3))
        self._tree = cKDTree(self._middles)
        self._reach = float(np.linalg.norm(corners - self._middles[:, None], axis=2).max()) if len(corners) else 0.0
        # curved facets go on beyond the plane of their corners
        self._reach *= 1.5 if compat.geometry_degree(domain) > 1 else 1.0
        self._sizes = [_size(one) for one in corners]

    def nearest(self, point: FloatArray) -> _Place | None:
        """Of one point (3,) m the nearest facet of this rank; None where there is none."""
        if not self._cells:
            return None
        # the middle of the nearest facet is no further than that of any, by its reach
        near = float(self._tree.query(point)[0])
        some = self._tree.query_ball_point(point, (near + self._reach) * (1.0 + SEVEN_DIGITS))
        places = [place for place in (self._place(k, point) for k in sorted(some)) if place is not None]
        return _first(places)

    def _place(self, k: int, point: FloatArray) -> _Place | None:
        """Of a point (3,) m by the k-th facet; None where the cell cannot be continued to it."""
        try:
            reference = self._map.pull_back(point[None], self._geometry[k])[0]
        except RuntimeError:  # far outside a distorted cell Newton's method finds nothing
            return None
        on = self._onto_facet(reference, self._sides[k])
        dofs = self._dofs[k]
        weights, nearby = self._element.tabulate(0, np.stack([reference, on]))[0, :, :, 0]
        gap = np.linalg.norm(nearby @ self._node_x[dofs] - point)
        found = weights @ self._node_x[dofs]
        if not np.linalg.norm(found - point) <= SEVEN_DIGITS * self._sizes[k]:
            return None
        weights[abs(weights) <= EQUAL] = 0.0
        kept = weights != 0.0
        return float(gap), self._keys[k], self._sizes[k], self._numbers[dofs[kept]], weights[kept]

    def _onto_facet(self, reference: FloatArray, side: list[int]) -> FloatArray:
        """The place on a facet nearest to a place (3,), in the coordinates of the reference cell."""
        corners = self._corners[side]
        origin, along = corners[0], corners[1:3] - corners[0]
        if len(side) == 4:  # a cube's facet, along two axes
            return np.asarray(origin + np.clip((reference - origin) @ along.T, 0.0, 1.0) @ along)
        # barycentric: what the other corner has goes to no one
        shares = np.clip(np.linalg.lstsq(along.T, reference - origin, rcond=None)[0], 0.0, None)
        return np.asarray(origin + (shares / max(1.0, shares.sum())) @ along)


def _size(corners: FloatArray) -> float:
    """m, the root of a facet's area, of its corners (3 or 4, 3) as basix lists them."""
    halves = [corners[:3]] if len(corners) == 3 else [corners[:3], corners[1:]]
    area = sum(0.5 * np.linalg.norm(np.cross(one[1] - one[0], one[2] - one[0])) for one in halves)
    return float(np.sqrt(area))
