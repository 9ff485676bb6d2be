"""Nodal interfaces: groups of the mesh whose nodes all keep their own displacements in a reduction.

These are the boundary (retained) dofs of Guyan's and Craig and Bampton's papers, for those who couple a reduced
part with other finite element models node by node. They carry no frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.finite_elements.held_surface import HeldSurface
from flexmbd.continuum.finite_elements.interface import AveragedInterface, FoundInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodal_group import NodalGroup, NodalInterface
from flexmbd.continuum.finite_elements.nodal_ties import NodalTies
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import InterfaceError

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RetainedNodes:
    """The nodes of all nodal interfaces of a model, the same on every rank but for `local`.

    Attributes:
        node: (k,) their numbers (`node_numbers`), ascending.
        x: (k, 3) m, in the mesh's axes.
        interface: (k,) number of the nodal interface, in the order that was asked for.
        local: (k,) the local node of those that this rank owns, else -1.
    """

    node: NDArray[np.int64]
    x: FloatArray
    interface: NDArray[np.int64]
    local: NDArray[np.int64]


def find_nodal_groups(
    interfaces: Sequence[NodalInterface],
    *,
    mesh: TaggedMesh,
    layout: DofLayout,
    frames: Sequence[FoundInterface],
    supports: Sequence[HeldSurface],
    ties: NodalTies | None = None,
) -> tuple[NodalGroup, ...]:
    """Find the nodes of nodal interfaces. Collective.

    Args:
        interfaces: the same on all ranks.
        mesh: the mesh with the groups.
        layout: of the unknown.
        frames: the interfaces with frames.
        supports: of the part.
        ties: of the part, whose followers keep no dofs.

    Raises:
        InterfaceError: on all ranks: ranks that were given different ones; an unknown group, an empty one or one given
            twice; nodes that another interface or a support has too; averaged interfaces beside them; a formulation
            with rotations or pressures.
    """
    parallel.check_same(mesh.comm, InterfaceError, nodal_interfaces=list(interfaces))
    if not interfaces:
        return ()
    if mesh.comm.allreduce(layout.n_local - layout.displacement_dofs.size, op=MPI.MAX) > 0:
        raise InterfaceError(
            "nodal interfaces are for formulations of the displacement alone, without rotations or pressures; "
            "take Interface(...)"
        )
    for one in frames:
        if isinstance(one, AveragedInterface):
            raise InterfaceError(
                f"interface {one.name!r} is averaged, and beside nodal interfaces all frames must be rigid: take "
                "Coupling.RIGID"
            )
    found: list[NodalGroup] = []
    for interface in interfaces:
        taken = [(one.name, one.nodes) for one in (*frames, *found)] + [(one.text, one.nodes) for one in supports]
        if ties is not None:
            taken.append(("the following side of a weld", ties.followers.astype(np.int32)))
        found.append(_find(interface, taken, mesh=mesh, layout=layout))
    return tuple(found)


def _find(
    interface: NodalInterface,
    taken: Sequence[tuple[str, NDArray[np.int32]]],
    *,
    mesh: TaggedMesh,
    layout: DofLayout,
) -> NodalGroup:
    name = interface.name
    if name in mesh.facet_groups:
        dim, entities = mesh.dim - 1, mesh.facets(name)
    elif name in mesh.edge_groups:
        dim, entities = 1, mesh.edges(name)
    elif name in mesh.vertex_groups:
        dim, entities = 0, mesh.vertices(name)
    else:
        there = ", ".join(map(repr, sorted({**mesh.facet_groups, **mesh.edge_groups, **mesh.vertex_groups}))) or "none"
        raise InterfaceError(
            f"nodal interface {name!r}: the mesh has no such group of facets, edges or vertices; it has: {there}"
        )
    mesh.mesh.topology.create_connectivity(dim, mesh.dim)
    nodes = layout.nodes_on(dim, entities)
    if mesh.comm.allreduce(len(nodes)) == 0:
        raise InterfaceError(f"nodal interface {name!r} is empty; tag a surface of the part")
    for other, theirs in taken:
        if other == name:
            raise InterfaceError(f"interface {name!r} is given twice; give each group once")
        if mesh.comm.allreduce(len(np.intersect1d(nodes, theirs))) > 0:
            raise InterfaceError(
                f"nodal interface {name!r} shares nodes with {other}: each node has its dofs from one of them alone; "
                "take groups that do not touch, or one group of both"
            )
    return NodalGroup(name, nodes)


def retained_nodes(model: LinearModel, names: Sequence[str] | None = None) -> RetainedNodes:
    """The nodes of a model's nodal interfaces, of all or of those of some names, by number. Collective."""
    groups = {group.name: group.nodes for group in model.nodal}
    owned = [groups[name][groups[name] < model.n_owned_nodes] for name in (groups if names is None else names)]
    numbers = node_numbers(model)
    mine = np.concatenate([np.empty(0, np.int32), *owned]).astype(np.int64)
    parts = model.comm.allgather(
        (numbers[mine], model.node_x[mine], np.repeat(np.arange(len(owned)), [len(part) for part in owned]))
    )
    node, x, interface = (np.concatenate(part) for part in zip(*parts, strict=True))
    order = np.argsort(node)
    local = np.full(len(node), -1, dtype=np.int64)
    local[np.searchsorted(node[order], numbers[mine])] = mine
    return RetainedNodes(node[order].astype(np.int64), x[order], interface[order].astype(np.int64), local)


def retained_dofs(model: LinearModel) -> NDArray[np.bool_]:
    """(owned dofs,) whether a nodal interface keeps a dof; not collective."""
    kept = np.zeros(model.n_owned, dtype=bool)
    for group in model.nodal:
        kept[model.displacement_dofs[group.nodes[group.nodes < model.n_owned_nodes]]] = True
    return kept
