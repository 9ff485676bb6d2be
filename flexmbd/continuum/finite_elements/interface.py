"""Interfaces: named groups of facets, edges, vertices or cells that are tied to six-dof frames.

The nodes of a RIGID interface move as its formulation's rigid motion about the interface's origin
(RBE2); six numbers, three translations and three small rotations, replace all their degrees of
freedom.  Those of an AVERAGED one stay free, and the frame moves as their L2 average (RBE3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from mpi4py import MPI

import numpy as np
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.finite_elements.averaging import THIN, Group, average_columns
from flexmbd.continuum.finite_elements.nodal_group import NodalInterface
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.coupling import Coupling
from flexmbd.errors import InterfaceError
from flexmbd.given import checked
from flexmbd.round_off import SEVEN_DIGITS

FloatArray = NDArray[np.float64]



@checked("name", "coupling", error=InterfaceError)
@dataclass(frozen=True, eq=False)
class Interface:
    """A group of the mesh that is tied to a frame, as a user asks for it.

    Attributes:
        name: the group of facets, edges, vertices or cells of the mesh, and the name of the frame. Cells are a
            rigid part of the body, with the mass that their formulation gives them; averaged, they lend the frame
            their mean motion, as of a frame at the centre of mass of a homogeneous body that flies.
        origin: (3,) m, the frame's origin in the mesh's axes; default: the centroid of the facets
            by area, of the edges by length, of the vertices by number, of cells by volume.
        axes: (3, 3), the rotation whose columns are the frame's axes in the mesh's; default: the
            mesh's axes.
        coupling: how the nodes and the frame move together.

    Raises:
        InterfaceError: the origin or the axes are not numbers of that shape, the axes not
            orthonormal and right-handed, or the coupling is none.
    """

    name: str
    origin: ArrayLike | None = None
    axes: ArrayLike | None = None
    coupling: Coupling = Coupling.RIGID

    def __post_init__(self) -> None:
        for item, shape in (("origin", (3,)), ("axes", (3, 3))):
            value = getattr(self, item)
            if value is not None and not _is_finite(value, shape):
                raise InterfaceError(
                    f"interface {self.name!r}: {item} must be finite numbers of shape {shape}, "
                    f"got {value!r}"
                )
        if self.axes is not None:
            r = np.asarray(self.axes, dtype=float)
            if abs(r.T @ r - np.eye(3)).max() > SEVEN_DIGITS or np.linalg.det(r) < 0.0:
                raise InterfaceError(
                    f"interface {self.name!r}: the columns of axes must be orthonormal and "
                    f"right-handed, got {r.tolist()}"
                )
        if not isinstance(self.coupling, Coupling):
            raise InterfaceError(
                f"interface {self.name!r}: coupling must be Coupling.RIGID or Coupling.AVERAGED, "
                f"got {self.coupling!r}"
            )


@dataclass(frozen=True, eq=False)
class RigidInterface:
    """A rigid interface found on a mesh.

    Attributes:
        name: of the group.
        p: (3,) m, the frame's origin I in the mesh's axes.
        R: (3, 3) rotation taking I's axes to the mesh's.
        nodes: (k,) the nodes of the group, as blocks of the space local to this rank, ghosts
            included; k may be zero.
        dofs: (m,) the local dofs it binds, ghosts included: displacements, and rotations where the
            formulation has them, but no pressures.
    """

    name: str
    p: FloatArray
    R: FloatArray
    nodes: NDArray[np.int32]
    dofs: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class AveragedInterface:
    """An averaged interface found on a mesh.

    Attributes:
        name: as in `RigidInterface`, and so are p, R and nodes.
        p: (3,) m.
        R: (3, 3).
        nodes: (k,).
        dofs: (m,) the local dofs it averages, ghosts included.
        average: (m, 6), C^T on `dofs`: the frame's translation (m) and small rotation (rad), along
            the mesh's axes, are (t, r) = C u, summed over the owned dofs of all ranks; a force and a
            moment on the frame are the nodal forces C^T (force, moment).
    """

    name: str
    p: FloatArray
    R: FloatArray
    nodes: NDArray[np.int32]
    dofs: NDArray[np.int32]
    average: FloatArray


#: An interface found on a mesh.
FoundInterface = RigidInterface | AveragedInterface


def find_interfaces(
    interfaces: Sequence[Interface], *, mesh: TaggedMesh, layout: DofLayout, is_plane: bool = False
) -> tuple[FoundInterface, ...]:
    """Find the nodes and frames of interfaces on a mesh. Collective.

    Args:
        interfaces: the same on all ranks.
        mesh: the mesh with the groups.
        layout: where the displacement, and what else the unknown holds, lies in its space.
        is_plane: whether the body moves in its plane alone, where a straight line of nodes carries a frame.

    Raises:
        InterfaceError: on all ranks: an unknown group, an empty one or one with facets inside the
            part, with nodes that carry no rotation, two rigid interfaces that share nodes, or an
            averaged one whose nodes are all bound by rigid ones.
    """
    _check_names(interfaces, mesh)
    found = tuple(_find(interface, mesh=mesh, layout=layout, is_plane=is_plane) for interface in interfaces)
    _check_shared(found, mesh.comm)
    return found


def _is_finite(value: ArrayLike, shape: tuple[int, ...]) -> bool:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return array.shape == shape and bool(np.isfinite(array).all())


def _check_names(interfaces: Sequence[Interface], mesh: TaggedMesh) -> None:
    for interface in interfaces:
        if isinstance(interface, NodalInterface):
            raise InterfaceError(
                f"nodal interfaces, as {interface.name!r}, are for reductions of a ContinuumModel; a body with history "
                f"has frames: write Interface({interface.name!r})"
            )
        if not isinstance(interface, Interface):
            raise InterfaceError(f"write Interface({interface!r}) rather than {interface!r}")
    names = [interface.name for interface in interfaces]
    groups = {**mesh.facet_groups, **mesh.edge_groups, **mesh.vertex_groups, **mesh.cell_groups}
    there = ", ".join(repr(name) for name in sorted(groups)) or "none"
    for name in names:
        if name not in groups:
            raise InterfaceError(
                f"interface {name!r}: the mesh has no such group of facets, edges, vertices or cells; it has: {there}"
            )
        if names.count(name) > 1:
            raise InterfaceError(f"interface {name!r} is given twice; give each group once")


def _check_shared(found: Sequence[FoundInterface], comm: MPI.Comm) -> None:
    """Refuse frames that cannot move one without the other. Collective."""
    rigid = [one for one in found if isinstance(one, RigidInterface)]
    for one, other in combinations(rigid, 2):
        if comm.allreduce(len(np.intersect1d(one.nodes, other.nodes))) > 0:
            raise InterfaceError(
                f"interfaces {one.name!r} and {other.name!r} share nodes: two rigid frames cannot "
                "hold the same node; take groups that do not touch, or make one Coupling.AVERAGED"
            )
    bound = np.concatenate([np.empty(0, np.int32), *(one.nodes for one in rigid)])
    for averaged in found:
        if not isinstance(averaged, AveragedInterface):
            continue
        if comm.allreduce(len(np.setdiff1d(averaged.nodes, bound))) == 0:
            raise InterfaceError(
                f"interface {averaged.name!r} averages only nodes that rigid interfaces bind, so its "
                "frame cannot move by itself; leave it out, or take a larger group"
            )


def _find(interface: Interface, *, mesh: TaggedMesh, layout: DofLayout, is_plane: bool) -> FoundInterface:
    group = mesh_group(interface.name, mesh)
    _check_entities(group)
    # collective: they tell nodes to ranks that hold none of the entities
    nodes = layout.nodes_on(group.dim, group.entities)
    dofs = layout.kinematic_dofs_on(group.dim, group.entities)
    _check_spread(group, layout, nodes, dofs, is_plane=is_plane)
    p, R = interface.origin, interface.axes
    origin = group.centroid(layout.node_space) if p is None else np.array(p, dtype=float)
    axes = np.eye(3) if R is None else _nearest_rotation(R)
    if interface.coupling is Coupling.RIGID:
        return RigidInterface(group.name, origin, axes, nodes, dofs)
    centre = group.centroid(layout.node_space)
    average = average_columns(group, layout, centre=centre)[dofs] @ _moved(centre, origin)
    return AveragedInterface(group.name, origin, axes, nodes, dofs, average)


def _moved(start: FloatArray, end: FloatArray) -> FloatArray:
    """(6, 6) X with (t, r)_end = (t, r)_start X for rows of a rigid motion at two points."""
    x = np.eye(6)
    # t_end = t_start + r x (end - start)
    x[3:, :3] = np.cross(np.eye(3), end - start)
    return x


def mesh_group(name: str, mesh: TaggedMesh) -> Group:
    """The entities of a named group: facets, edges, vertices or cells; the first kind that has the name."""
    if name in mesh.facet_groups:
        dim = mesh.dim - 1
        # points inside a line are where beams join, and carry a frame as well as its ends
        tag = mesh.facet_groups[name] if dim > 0 else None
        group = Group(name, mesh, dim, mesh.facets(name), tag)
    elif name in mesh.edge_groups:
        group = Group(name, mesh, 1, mesh.edges(name), None)
    elif name in mesh.vertex_groups:
        group = Group(name, mesh, 0, mesh.vertices(name), None)
    else:
        group = Group(name, mesh, mesh.dim, mesh.cells(name), None)
    mesh.mesh.topology.create_connectivity(group.dim, mesh.dim)
    return group


def _nearest_rotation(axes: ArrayLike) -> FloatArray:
    left, _, right = np.linalg.svd(np.asarray(axes, dtype=float))
    return left @ right


_KINDS = {0: "vertices", 1: "edges", 2: "facets", 3: "cells"}


def _check_entities(group: Group) -> None:
    """Refuse an empty group, or facets that are not on the boundary. Collective."""
    mesh, kind = group.mesh, _KINDS[group.dim]
    topology = mesh.mesh.topology
    own = group.entities[group.entities < topology.index_map(group.dim).size_local]
    if mesh.comm.allreduce(len(own)) == 0:
        raise InterfaceError(
            f"interface {group.name!r} has no {kind}; tag those of a surface of the part"
        )
    if group.tag is None:
        return
    inside = mesh.comm.allreduce(len(np.setdiff1d(own, exterior_facet_indices(topology))))
    if inside > 0:
        raise InterfaceError(
            f"interface {group.name!r} has {inside} {kind} inside the part; tag only those of its "
            "surface"
        )


def _check_spread(
    group: Group, layout: DofLayout, nodes: NDArray[np.int32], dofs: NDArray[np.int32], *, is_plane: bool
) -> None:
    """Refuse nodes that cannot carry a rotation: some leaves them at rest. Collective."""
    comm = group.mesh.comm
    x = layout.node_x[nodes[nodes < layout.n_owned_nodes]]
    count = comm.allreduce(len(x))
    mean = comm.allreduce(x.sum(axis=0)) / max(count, 1)
    rotations = layout.rigid_columns(mean, np.eye(3))[dofs[dofs < layout.n_owned], 3:]
    small, middle, large = np.linalg.eigvalsh(comm.allreduce(rotations.T @ rotations))
    if is_plane:
        if count < 2 or not middle > THIN**2 * large:
            raise InterfaceError(
                f"interface {group.name!r} has {count} nodes, and a frame of a plane body needs two that are apart; "
                "take an edge of the sheet"
            )
        return
    if not small > THIN**2 * large:
        remedy = {
            0: "a point of a solid carries no rotation: take a group of three vertices or more, or facets",
            1: "a straight line of a solid carries no rotation about itself: take a curved one, or facets",
            2: "take a larger group of facets",
            3: "take a larger group of cells",
        }
        raise InterfaceError(
            f"interface {group.name!r} has {count} nodes, and a frame of six dofs needs three that are "
            f"not in one line; {remedy[group.dim]}"
        )
