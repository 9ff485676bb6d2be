"""Volumes, areas and extents of a tagged mesh, over all its ranks."""

import basix
import dolfinx
import numpy as np
import ufl
from dolfinx import fem

from flexmbd.continuum.compat import cell_nodes

# Exact for degree-2 tetrahedra and hexahedra, up to the square root in a curved facet's area.
DEGREE = 6


def volume(tagged):
    return total(tagged, 1.0 * ufl.dx(domain=tagged.mesh, degree=DEGREE))


def area(tagged, name):
    ds = ufl.Measure(
        "ds",
        domain=tagged.mesh,
        subdomain_data=tagged.facet_tags,
        metadata={"quadrature_degree": DEGREE},
    )
    return total(tagged, 1.0 * ds(tagged.facet_groups[name]))


def total(tagged, form):
    return tagged.comm.allreduce(fem.assemble_scalar(fem.form(form)))


def moments(tagged, *, degree=12):
    """Integrals of f_i f_j over the cells, with f = (1, x, y, z), (4, 4); by default exact for all cells."""
    element = tagged.mesh.ufl_domain().ufl_coordinate_element().basix_element
    points, weights = basix.make_quadrature(element.cell_type, degree)
    table = element.tabulate(1, points)[..., 0]
    nodes = cell_nodes(tagged.mesh)[: tagged.mesh.topology.index_map(3).size_local]
    found = np.zeros((4, 4))
    for some in np.array_split(tagged.mesh.geometry.x[nodes], max(1, len(nodes) // 1000)):
        x = np.einsum("qk,cki->cqi", table[0], some)
        scale = weights * abs(np.linalg.det(np.einsum("dqk,cki->cqdi", table[1:], some)))
        fields = np.concatenate((np.ones((*x.shape[:2], 1)), x), axis=2)
        found += np.einsum("cq,cqi,cqj->ij", scale, fields, fields, optimize=True)
    return tagged.comm.allreduce(found)


def n_cells(tagged):
    return tagged.mesh.topology.index_map(tagged.dim).size_global


def n_nodes(tagged):
    return tagged.mesh.geometry.index_map().size_global


def nodes_of(tagged, name):
    """Coordinates of all nodes, mid-side nodes too, of a facet group's facets on this rank."""
    return nodes_of_entities(tagged, tagged.dim - 1, tagged.facets(name))


def nodes_of_entities(tagged, dim, entities):
    """Coordinates of all nodes of entities of this rank."""
    tagged.mesh.topology.create_connectivity(dim, tagged.dim)
    if len(entities) == 0:
        # DOLFINx 0.9 divides by zero where there are none
        return np.empty((0, 3))
    nodes = dolfinx.mesh.entities_to_geometry(tagged.mesh, dim, entities)
    return tagged.mesh.geometry.x[np.unique(nodes)]


def n_owned(tagged, dim, entities):
    """Number of entities on all ranks, of which each gives those it holds."""
    owned = tagged.mesh.topology.index_map(dim).size_local
    return tagged.comm.allreduce(int(np.count_nonzero(entities < owned)))


def extents(tagged):
    """Lowest and highest coordinates, (2, 3)."""
    x = np.concatenate(tagged.comm.allgather(tagged.mesh.geometry.x))
    return np.array([x.min(axis=0), x.max(axis=0)])
