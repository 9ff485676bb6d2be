"""Averages of the unknown over a group of facets, edges, vertices or cells.

The average motion of a group is the translation t and small rotation r about its centroid c that
minimise the integral of |u - t - r x (x - c)|^2 over the group; of vertices, the sum.  With the rigid
motions R = [1, -(x - c) x] it is (t, r) = G^-1 integral R^T u, G = integral R^T R.  Where the nodes lie
in one line, as those of a shell's straight edge or the point of a beam do, displacements leave r open
about that line; there it is the average of the unknown's own rotations.
"""

from __future__ import annotations

from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
import scipy.sparse
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.matrices.blocks import FloatArray, inner, symmetric

Indices = NDArray[np.int32]

#: Nodes are taken to lie in a line when they are thinner than this part of their length.
THIN = 1e-6


@dataclass(frozen=True, eq=False)
class Group:
    """A named group of entities of a mesh.

    Attributes:
        name: of the group.
        mesh: with the group.
        dim: dimension of the entities.
        entities: (k,) indices local to this rank; k may be zero.
        tag: of a group of facets; None for edges and vertices of lower dimension.
    """

    name: str
    mesh: TaggedMesh
    dim: int
    entities: Indices
    tag: int | None

    def centroid(self, space: fem.FunctionSpace) -> FloatArray:
        """(3,) m, by volume, area, length or number. Collective.

        Args:
            space: whose blocks are the displacement's nodes.
        """
        if self.tag is not None:
            return _facet_centroid(self.mesh, self.tag)
        if self.dim == self.mesh.dim:
            return _cell_centroid(self.mesh, self.entities)
        share = _weights(space, self.entities, self.dim).sum(axis=0)
        x = space.tabulate_dof_coordinates()
        integrals = self.mesh.comm.allreduce(np.append(share.sum(), share @ x))
        centroid: FloatArray = integrals[1:] / integrals[0]
        return centroid

    def integrals(self, space: fem.FunctionSpace, fields: FloatArray) -> FloatArray:
        """Integrals of fields times shape functions over the group. Collective.

        Args:
            space: Lagrange, blocked or scalar.
            fields: (local dofs of the space including ghosts, k).

        Returns:
            The same shape.
        """
        add = _facet_integrals if self.tag is not None else _lower_integrals
        if self.dim == self.mesh.dim:
            add = _cell_integrals
        results = np.empty_like(fields)
        total = fem.Function(space).x
        for i, column in enumerate(add(self, space, fields).T):
            total.array[:] = column
            total.scatter_reverse(la.InsertMode.add)
            total.scatter_forward()
            results[:, i] = total.array
        return results


def average_columns(group: Group, layout: DofLayout, *, centre: FloatArray) -> FloatArray:
    """C^T of the average (t, r) = C u of a group. Collective.

    Args:
        group: whose nodes together can carry a rotation.
        layout: of the unknown.
        centre: (3,) m, the group's centroid, whose motion is t.

    Returns:
        (local dofs including ghosts, 6); (t, r), along the mesh's axes, is the sum over the owned dofs
        of all ranks.
    """
    comm, owned = group.mesh.comm, slice(layout.n_owned)
    motions = layout.rigid_columns(centre, np.eye(3))
    spread = np.zeros_like(motions)
    for field in layout.fields:
        # a rank may hold none of the dofs
        if comm.allreduce(bool(layout.kinematic[field.dofs].any()), op=MPI.LOR):
            spread[field.dofs] = group.integrals(field.space, motions[field.dofs])
    rotations = spread.copy()
    rotations[layout.displacement_dofs] = 0.0
    spread -= rotations
    gram = symmetric(inner(comm, motions[owned], spread[owned]))
    values, vectors = np.linalg.eigh(gram[3:, 3:])
    open_axes = vectors[:, ~(values > THIN**2 * values[-1])]
    if open_axes.shape[1] > 0:
        # its sum over the displacements is zero: they have no say about these axes
        spread[:, 3:] -= spread[:, 3:] @ open_axes @ open_axes.T
        spread[:, 3:] += rotations[:, 3:] @ open_axes @ open_axes.T
        gram = symmetric(inner(comm, motions[owned], spread[owned]))
    columns: FloatArray = spread @ np.linalg.inv(gram)
    return columns


def _facet_centroid(mesh: TaggedMesh, tag: int) -> FloatArray:
    x = ufl.SpatialCoordinate(mesh.mesh)
    ds = ufl.Measure("ds", domain=mesh.mesh, subdomain_data=mesh.facet_tags)
    weight = fem.Constant(mesh.mesh, np.zeros(4))
    integrand = weight[0] + sum(weight[i + 1] * x[i] for i in range(3))
    degree = 3 * compat.geometry_degree(mesh.mesh)
    form = fem.form(integrand * ds(tag, metadata={"quadrature_degree": degree}))
    integrals = np.zeros(4)
    for i in range(4):
        weight.value[:] = np.eye(4)[i]
        integrals[i] = mesh.comm.allreduce(fem.assemble_scalar(form))
    centroid: FloatArray = integrals[1:] / integrals[0]
    return centroid


def _cell_centroid(mesh: TaggedMesh, cells: Indices) -> FloatArray:
    """(3,) m, by the measure of the cells. Collective."""
    domain = mesh.mesh
    inside, x, w = _inside(mesh, cells), ufl.SpatialCoordinate(domain), fem.Constant(domain, np.zeros(4))
    integrand = inside * (w[0] + sum(w[i + 1] * x[i] for i in range(3)))
    rule = {"quadrature_degree": 4 * compat.geometry_degree(domain)}
    form = fem.form(integrand * ufl.dx(metadata=rule))
    integrals = np.zeros(4)
    for i in range(4):
        w.value[:] = np.eye(4)[i]
        integrals[i] = mesh.comm.allreduce(fem.assemble_scalar(form))
    centroid: FloatArray = integrals[1:] / integrals[0]
    return centroid


def _cell_integrals(group: Group, space: fem.FunctionSpace, fields: FloatArray) -> FloatArray:
    """This rank's part of the integrals over cells."""
    field, domain = fem.Function(space), group.mesh.mesh
    degree = 2 * space.element.basix_element.degree + 3 * compat.geometry_degree(domain) - 3
    inside = _inside(group.mesh, group.entities)
    measure = ufl.dx(metadata={"quadrature_degree": degree})
    form = fem.form(inside * ufl.inner(field, ufl.TestFunction(space)) * measure)
    results = np.empty_like(fields)
    for i in range(fields.shape[1]):
        field.x.array[:] = fields[:, i]
        results[:, i] = fem.assemble_vector(form).array
    return results


def _inside(mesh: TaggedMesh, cells: Indices) -> fem.Function:
    """One in cells that this rank owns, zero in others."""
    found = fem.Function(fem.functionspace(mesh.mesh, ("DG", 0)))
    found.x.array[cells[cells < mesh.mesh.topology.index_map(mesh.dim).size_local]] = 1.0
    return found


def _facet_integrals(group: Group, space: fem.FunctionSpace, fields: FloatArray) -> FloatArray:
    """This rank's part of the integrals over boundary facets."""
    mesh = group.mesh
    field = fem.Function(space)
    ds = ufl.Measure("ds", domain=mesh.mesh, subdomain_data=mesh.facet_tags)
    degree = 2 * space.element.basix_element.degree + 2 * compat.geometry_degree(mesh.mesh) - 2
    measure = ds(group.tag, metadata={"quadrature_degree": degree})
    form = fem.form(ufl.inner(field, ufl.TestFunction(space)) * measure)
    results = np.empty_like(fields)
    for i in range(fields.shape[1]):
        field.x.array[:] = fields[:, i]
        results[:, i] = fem.assemble_vector(form).array
    return results


def _lower_integrals(group: Group, space: fem.FunctionSpace, fields: FloatArray) -> FloatArray:
    """This rank's part of the integrals over edges, or of the sums over vertices."""
    weights = _weights(space, group.entities, group.dim)
    return np.asarray(weights @ fields.reshape(weights.shape[1], -1)).reshape(fields.shape)


def _weights(
    space: fem.FunctionSpace, entities: Indices, dim: int
) -> scipy.sparse.csr_array:
    """(nodes, nodes) w with integral of f g = f^T w g for scalar fields, over owned entities."""
    count = len(space.tabulate_dof_coordinates())
    own = entities[entities < space.mesh.topology.index_map(dim).size_local]
    nodes = _entity_nodes(space, own, dim)
    values = np.ones((len(own), 1, 1)) if dim == 0 else _edge_masses(space, nodes)
    k = nodes.shape[1]
    rows, columns = np.repeat(nodes, k, axis=1), np.tile(nodes, (1, k))
    triplets = (values.ravel(), (rows.ravel(), columns.ravel()))
    return scipy.sparse.coo_array(triplets, shape=(count, count)).tocsr()


def _entity_nodes(space: fem.FunctionSpace, entities: Indices, dim: int) -> Indices:
    """(n, k) local nodes of vertices or edges, an edge's ends first."""
    topology = space.mesh.topology
    layout = space.dofmap.dof_layout
    topology.create_connectivity(dim, topology.dim)
    topology.create_connectivity(topology.dim, dim)
    to_cells = topology.connectivity(dim, topology.dim)
    to_entities = topology.connectivity(topology.dim, dim)
    rows = []
    for entity in entities:
        cell = to_cells.links(entity)[0]
        local = int(np.flatnonzero(to_entities.links(cell) == entity)[0])
        inside = layout.entity_dofs(dim, local)
        ends = [dof for dof in layout.entity_closure_dofs(dim, local) if dof not in inside]
        nodes = inside if dim == 0 else [*ends, *inside]
        rows.append(space.dofmap.cell_dofs(cell)[nodes])
    width = 1 if dim == 0 else space.element.basix_element.degree + 1
    return np.array(rows, dtype=np.int32).reshape(-1, width)


def _edge_masses(space: fem.FunctionSpace, nodes: Indices) -> FloatArray:
    """(n, k, k) integrals of the shape functions' products along edges of k = 2 or 3 nodes."""
    at, factor = np.polynomial.legendre.leggauss(4)
    if nodes.shape[1] == 2:
        shape = np.array([1.0 - at, 1.0 + at]) / 2.0
        slope = np.array([-np.ones(4), np.ones(4)]) / 2.0
    else:
        shape = np.array([at * (at - 1.0) / 2.0, at * (at + 1.0) / 2.0, 1.0 - at**2])
        slope = np.array([at - 0.5, at + 0.5, -2.0 * at])
    tangent = np.einsum("eki,kg->egi", space.tabulate_dof_coordinates()[nodes], slope)
    length = factor * np.linalg.norm(tangent, axis=2)
    return np.einsum("ag,bg,eg->eab", shape, shape, length)
