"""Averages of a displacement over a group of facets, edges or vertices.

The average motion of a group is the translation t and small rotation r about its centroid c that
minimise the integral of |u - t - r x (x - c)|^2 over the group; of vertices, the sum.  With the rigid
motions R = [1, -(x - c) x] it is (t, r) = G^-1 integral R^T u, G = integral R^T R.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse
import ufl
from dolfinx import fem, la
from numpy.typing import NDArray

from flexmbd.continuum import compat
from flexmbd.continuum.blocks import FloatArray, inner, symmetric
from flexmbd.continuum.tagged_mesh import TaggedMesh

Indices = NDArray[np.int32]


def facet_centroid(mesh: TaggedMesh, tag: int) -> FloatArray:
    """Centroid (3,) m, by area, of the boundary facets of a group. Collective."""
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


def point_weights(space: fem.FunctionSpace, entities: Indices, dim: int) -> scipy.sparse.csr_array:
    """Weights of the nodes of a group of edges or vertices; not collective.

    Args:
        space: a blocked Lagrange space of degree 1 or 2.
        entities: of the mesh, as indices local to this rank.
        dim: 1 for edges, 0 for vertices, which weigh one each.

    Returns:
        (local nodes, local nodes) w with integral of f g = f^T w g for scalar fields on the nodes,
        summed over the entities that this rank owns.
    """
    count = len(space.tabulate_dof_coordinates())
    topology = space.mesh.topology
    own = entities[entities < topology.index_map(dim).size_local]
    nodes = _entity_nodes(space, own, dim)
    values = np.ones((len(own), 1, 1)) if dim == 0 else _edge_masses(space, nodes)
    k = nodes.shape[1]
    rows, columns = np.repeat(nodes, k, axis=1), np.tile(nodes, (1, k))
    triplets = (values.ravel(), (rows.ravel(), columns.ravel()))
    return scipy.sparse.coo_array(triplets, shape=(count, count)).tocsr()


def weighted_centroid(space: fem.FunctionSpace, weights: scipy.sparse.csr_array) -> FloatArray:
    """Centroid (3,) m of a group by its `point_weights`. Collective."""
    share = weights.sum(axis=0)
    x = space.tabulate_dof_coordinates()
    integrals = space.mesh.comm.allreduce(np.append(share.sum(), share @ x))
    centroid: FloatArray = integrals[1:] / integrals[0]
    return centroid


def facet_average(
    space: fem.FunctionSpace, mesh: TaggedMesh, tag: int, *, centre: FloatArray
) -> FloatArray:
    """The average's rows for a group of boundary facets. Collective.

    Args:
        space: a blocked Lagrange space on the mesh.
        mesh: with the group.
        tag: of the group.
        centre: (3,) m, the point whose motion is t.

    Returns:
        (local nodes including ghosts, 3, 6) a with (t, r)_j = sum_kc a_kcj u_kc over the owned nodes
        of all ranks.
    """
    field = fem.Function(space)
    v = ufl.TestFunction(space)
    ds = ufl.Measure("ds", domain=mesh.mesh, subdomain_data=mesh.facet_tags)
    degree = 2 * space.element.basix_element.degree + 2 * compat.geometry_degree(mesh.mesh) - 2
    form = fem.form(ufl.inner(field, v) * ds(tag, metadata={"quadrature_degree": degree}))
    motions = _motions(space, centre)
    spread = np.empty_like(motions)
    for i in range(6):
        field.x.array[:] = motions[:, :, i].reshape(-1)
        vector = fem.assemble_vector(form)
        spread[:, :, i] = _summed(space, vector.array).reshape(-1, 3)
    return _divided(space, motions, spread)


def point_average(
    space: fem.FunctionSpace, weights: scipy.sparse.csr_array, *, centre: FloatArray
) -> FloatArray:
    """The average's rows for a group with `point_weights`; see `facet_average`. Collective."""
    motions = _motions(space, centre)
    spread = np.empty_like(motions)
    for i in range(6):
        vector = weights @ motions[:, :, i]
        spread[:, :, i] = _summed(space, vector.reshape(-1)).reshape(-1, 3)
    return _divided(space, motions, spread)


def _motions(space: fem.FunctionSpace, centre: FloatArray) -> FloatArray:
    """(local nodes, 3, 6) unit rigid motions about a point."""
    arm = space.tabulate_dof_coordinates() - centre
    motions = np.zeros((len(arm), 3, 6))
    motions[:, :, :3] = np.eye(3)
    for axis in range(3):
        motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
    return motions


def _divided(space: fem.FunctionSpace, motions: FloatArray, spread: FloatArray) -> FloatArray:
    """spread G^-1 with G = motions^T spread, so that the average of a rigid motion is that motion."""
    owned = space.dofmap.index_map.size_local
    gram = inner(space.mesh.comm, motions[:owned].reshape(-1, 6), spread[:owned].reshape(-1, 6))
    average: FloatArray = spread @ np.linalg.inv(symmetric(gram))
    return average


def _summed(space: fem.FunctionSpace, values: FloatArray) -> FloatArray:
    """Contributions of all ranks summed at each dof, ghosts included. Collective."""
    vector = fem.Function(space).x
    vector.array[:] = values
    vector.scatter_reverse(la.InsertMode.add)
    vector.scatter_forward()
    total: FloatArray = vector.array
    return total


def _entity_nodes(space: fem.FunctionSpace, entities: Indices, dim: int) -> Indices:
    """(n, k) local nodes of entities, ends first."""
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
        closure = layout.entity_closure_dofs(dim, local)
        ends = [dof for dof in closure if dof not in inside] if dim > 0 else []
        rows.append(space.dofmap.cell_dofs(cell)[[*ends, *inside]])
    width = {0: 1, 1: space.element.basix_element.degree + 1}[dim]
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
