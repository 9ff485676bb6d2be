"""The boundary of a mesh of solid cells as flat triangles between its vertices, for pictures."""

from __future__ import annotations

import basix
import numpy as np
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.finite_elements.nodes import sorted_triangles
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.multibody.bodies.solid import Outline

IntArray = NDArray[np.int64]


def outline_of(mesh: TaggedMesh) -> Outline:
    """The boundary of a mesh of solid cells, the same on every rank. Collective.

    A quadrilateral is two triangles; of curved cells only the vertices count.
    """
    domain = mesh.mesh
    corners = _facet_triangles(mesh)
    nodes = np.unique(corners)
    numbers = np.asarray(domain.geometry.input_global_indices, dtype=np.int64)
    triangles = parallel.gather_rows(mesh.comm, numbers[corners])
    known = parallel.gather_rows(mesh.comm, numbers[nodes])
    places = parallel.gather_rows(mesh.comm, domain.geometry.x[nodes])

    def make() -> Outline:
        assert triangles is not None and known is not None and places is not None  # noqa: S101, PT018  (rank 0)
        used, first = np.unique(known, return_index=True)
        return Outline(places[first], sorted_triangles(np.searchsorted(used, triangles)), np.ones(3))

    return parallel.on_root(mesh.comm, make)


def _facet_triangles(mesh: TaggedMesh) -> IntArray:
    """(t, 3) local nodes of the mesh, anticlockwise seen from outside; this rank's only."""
    topology, x = mesh.mesh.topology, mesh.mesh.geometry.x
    topology.create_connectivity(2, 3)
    topology.create_connectivity(3, 2)
    facets = exterior_facet_indices(topology)
    to_cells, to_facets = topology.connectivity(2, 3), topology.connectivity(3, 2)
    vertices = basix.topology(basix.CellType[topology.cell_name()])[2]
    found: list[IntArray] = []
    cells = cell_nodes(mesh.mesh)
    for facet in facets:
        cell = to_cells.links(facet)[0]
        local = int(np.flatnonzero(to_facets.links(cell) == facet)[0])
        ring = vertices[local] if len(vertices[local]) == 3 else [vertices[local][k] for k in (0, 1, 3, 2)]
        corners = cells[cell][ring]
        a, b, c = x[corners[:3]]
        if np.cross(b - a, c - a) @ (a - x[cells[cell]].mean(axis=0)) < 0.0:
            corners = corners[::-1]
        found.extend(corners[[0, k, k + 1]] for k in range(1, len(corners) - 1))
    return np.array(found, dtype=np.int64).reshape(-1, 3)
