"""Facets of a body's surface: nodal forces of pressures and tractions, and their derivatives.

With the places x of the displacement's nodes a facet is x(xi, eta) = sum of N_i x_i, and its area vector
a = x_xi x x_eta.  A pressure p gives node i the force -p times the integral of N_i a, whatever the facet's shape; its
derivative is exact (Bonet & Wood 2008, eq. 8.22, before integration by parts).
"""

from __future__ import annotations

import basix
import numpy as np
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.errors import MeshError

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int32]

# Of a difference of a traction that turns with the surface, relative to the facet's size.
_STEP = 1e-5


class SurfacePatch:
    """Facets of a solid's surface that this rank integrates. Constructing one is collective.

    Attributes:
        nodes: (f, n) local nodes of each facet, ghosts included, its corners first.
        sense: (f,) 1 where the area vector by the first corners, x1 - x0 by x2 - x0, points outwards, else -1.
    """

    def __init__(self, body: Discretisation, facets: Indices) -> None:
        """Of those of some facets (k,), local to this rank, whose cells it owns (`surface_facets`)."""
        topology = body.mesh.mesh.topology
        topology.create_connectivity(2, 3)
        topology.create_connectivity(3, 2)
        to_cells, to_facets = topology.connectivity(2, 3), topology.connectivity(3, 2)
        owned = topology.index_map(3).size_local
        cells = np.array([to_cells.links(facet)[0] for facet in facets], dtype=np.int32)
        facets, cells = facets[cells < owned], cells[cells < owned]
        place = [int(np.flatnonzero(to_facets.links(c) == f)[0]) for f, c in zip(facets, cells, strict=True)]
        layout, dofmap = body.layout.node_space.dofmap.dof_layout, body.layout.node_space.dofmap.list
        closures = [layout.entity_closure_dofs(2, k) for k in range(len(basix.topology(_cell(body))[2]))]
        width = len(closures[0])
        self.nodes: Indices = np.array(
            [dofmap[c][closures[k]] for c, k in zip(cells, place, strict=True)], dtype=np.int32
        ).reshape(-1, width)
        tables = [_shape_functions(body, k, closures[k]) for k in range(len(closures))]
        chosen = np.array(place, dtype=np.int64)
        # (f, q, n) values and slopes, (q,) weights
        self._N, self._N1, self._N2 = (np.array([t[i] for t in tables])[chosen] for i in range(3))
        self._weights: FloatArray = tables[0][3]
        self._X: FloatArray = body.layout.node_x[self.nodes]
        centres = np.array([body.layout.node_x[dofmap[c]].mean(axis=0) for c in cells]).reshape(-1, 3)
        area = self._areas(self._X)
        outwards = np.einsum("fqi,fi->f", area, self._X.mean(axis=1) - centres)
        self.sense: FloatArray = np.where(outwards > 0.0, 1.0, -1.0)
        self._size: FloatArray = np.linalg.norm(area, axis=2)

    def pressure(self, x: FloatArray) -> FloatArray:
        """(f, n, 3) N, nodal forces of 1 Pa at nodes' places x (local nodes, 3) m."""
        area = self._areas(x[self.nodes]) * self.sense[:, None, None]
        return -np.einsum("q,fqn,fqi->fni", self._weights, self._N, area)

    def pressure_slopes(self, x: FloatArray) -> FloatArray:
        """(f, n, 3, n, 3) N/m, derivative of ``pressure`` by the facet's own nodes' places."""
        places = x[self.nodes]
        first, second = (np.einsum("fqn,fni->fqi", slope, places) for slope in (self._N1, self._N2))
        # d(x1 x x2) = -x2 x dx1 + x1 x dx2
        matrices = np.einsum("fqm,fqij->fqmij", self._N2, _crossing(first))
        matrices -= np.einsum("fqm,fqij->fqmij", self._N1, _crossing(second))
        return -np.einsum("f,q,fqn,fqmij->fnimj", self.sense, self._weights, self._N, matrices)

    def traction(self, traction: FloatArray, x: FloatArray | None = None) -> FloatArray:
        """(f, n, 3) N, nodal forces of a traction (3,) by undeformed area, turned with the surface where x is given."""
        force: FloatArray = np.broadcast_to(traction, (*self._size.shape, 3))
        if x is not None:
            force = self._rotations(x[self.nodes]) @ traction
        return np.einsum("q,fqn,fq,fqi->fni", self._weights, self._N, self._size, force)

    def traction_slopes(self, traction: FloatArray, x: FloatArray) -> FloatArray:
        """(f, n, 3, n, 3) N/m, derivative of ``traction`` that turns, by differences of the fourth order."""
        places = x[self.nodes]
        count = places.shape[1]
        size = _STEP * np.ptp(places, axis=1).max(axis=1)[:, None, None]
        slopes = np.zeros((*places.shape, count, 3))
        for m in range(count):
            for j in range(3):
                unit = np.zeros((1, count, 3))
                unit[0, m, j] = 1.0
                for shift, weight in ((1.0, 8.0), (-1.0, -8.0), (2.0, -1.0), (-2.0, 1.0)):
                    turned = self._rotations(places + shift * size * unit) @ traction
                    slopes[:, :, :, m, j] += weight / 12.0 * np.einsum(
                        "q,fqn,fq,fqi->fni", self._weights, self._N, self._size, turned
                    )
        return slopes / size[:, :, :, None, None]

    def _areas(self, places: FloatArray) -> FloatArray:
        """(f, q, 3) x_xi x x_eta for nodes of the facets (f, n, 3)."""
        first, second = (np.einsum("fqn,fni->fqi", slope, places) for slope in (self._N1, self._N2))
        return np.cross(first, second)

    def _rotations(self, places: FloatArray) -> FloatArray:
        """(f, q, 3, 3) rotations of the surface from the undeformed one."""
        left, _, right = np.linalg.svd(self._triads(places) @ np.linalg.inv(self._triads(self._X)))
        return left @ right

    def _triads(self, places: FloatArray) -> FloatArray:
        """(f, q, 3, 3) tangents and unit normal as columns."""
        first, second = (np.einsum("fqn,fni->fqi", slope, places) for slope in (self._N1, self._N2))
        normal = np.cross(first, second)
        return np.stack([first, second, normal / np.linalg.norm(normal, axis=2, keepdims=True)], axis=3)


def surface_facets(body: Discretisation, name: str, *, what: str = "load") -> Indices:
    """Facets (k,), local to this rank, of a group that lies on the surface. Collective.

    Args:
        body: on the mesh.
        name: of the group.
        what: it is for, in messages.

    Raises:
        MeshError: on all ranks: the cells are not solid; no such group, no facet in it, or facets inside the part.
    """
    topology, groups = body.mesh.mesh.topology, body.mesh.facet_groups
    if body.mesh.dim < 3:
        raise MeshError(
            f"{what} on {name!r}: the facets of the mesh are edges, and those of solid cells alone are taken; mesh "
            "the body with solid cells, or load its nodes (ForceAtNodes)"
        )
    if name not in groups:
        there = ", ".join(repr(known) for known in sorted(groups)) or "none"
        raise MeshError(f"{what} on {name!r}: the mesh has no such group of facets; it has: {there}")
    facets = body.mesh.facets(name)
    topology.create_connectivity(2, 3)
    outer = exterior_facet_indices(topology)
    own = facets[facets < topology.index_map(2).size_local]
    inside, count = body.comm.allreduce(np.array([len(np.setdiff1d(own, outer)), len(own)]))
    if inside or not count:
        found = f"{inside} facets inside the part" if inside else "no facets"
        raise MeshError(f"{what} on {name!r}: the group has {found}; tag facets of the surface")
    return facets


def _cell(body: Discretisation) -> basix.CellType:
    return basix.CellType[body.mesh.mesh.topology.cell_name()]


def _shape_functions(
    body: Discretisation, facet: int, closure: list[int]
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """(q, n) values and slopes of the shape functions of a facet's nodes along the facet; (q,) weights."""
    cell = _cell(body)
    corners = basix.geometry(cell)[basix.topology(cell)[2][facet]]
    kind = basix.CellType.triangle if len(corners) == 3 else basix.CellType.quadrilateral
    element = body.layout.node_space.element.basix_element
    # N a is of degree 3 k on triangles, and as high in each direction on quadrilaterals
    points, weights = basix.make_quadrature(kind, 3 * element.degree)
    edges = corners[1:3] - corners[0]
    table = element.tabulate(1, corners[0] + points @ edges)[:, :, closure, 0]
    slopes = np.einsum("ai,iqn->aqn", edges, table[1:])
    return np.asarray(table[0]), slopes[0], slopes[1], np.asarray(weights)


def _crossing(vectors: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices of the products v x."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)
