"""Interfaces: named groups of facets that move as rigid six-dof frames (RBE2).

The nodes of an interface move as its formulation's rigid motion about the interface's origin; six
numbers, three translations and three small rotations, replace all their degrees of freedom.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.mesh import exterior_facet_indices
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum.tagged_mesh import TaggedMesh
from flexmbd.errors import InterfaceError

FloatArray = NDArray[np.float64]

# Nodes are taken to lie in a line when they are thinner than this part of their length.
_THIN = 1e-6
# Largest entry of R^T R - 1 in axes given by a person, who may write seven digits.
_ORTHONORMAL = 1e-6


@dataclass(frozen=True, eq=False)
class Interface:
    """What a user asks for: a group of facets that moves as a rigid frame.

    Attributes:
        name: the facet group of the mesh, and the name of the frame.
        origin: (3,) m, the frame's origin in the mesh's axes; default: the centroid of the facets
            by area.
        axes: (3, 3), the rotation whose columns are the frame's axes in the mesh's; default: the
            mesh's axes.

    Raises:
        InterfaceError: the origin or the axes are not numbers of that shape, or the axes not
            orthonormal and right-handed.
    """

    name: str
    origin: ArrayLike | None = None
    axes: ArrayLike | None = None

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
            if abs(r.T @ r - np.eye(3)).max() > _ORTHONORMAL or np.linalg.det(r) < 0.0:
                raise InterfaceError(
                    f"interface {self.name!r}: the columns of axes must be orthonormal and "
                    f"right-handed, got {r.tolist()}"
                )


@dataclass(frozen=True, eq=False)
class RigidInterface:
    """An interface found on a mesh.

    Attributes:
        name: of the facet group.
        p: (3,) m, the frame's origin I in the mesh's axes.
        R: (3, 3) rotation taking I's axes to the mesh's.
        nodes: (k,) the nodes it binds, as blocks of the space local to this rank, ghosts
            included; k may be zero.
        dofs: (m,) the local dofs it binds, ghosts included.
    """

    name: str
    p: FloatArray
    R: FloatArray
    nodes: NDArray[np.int32]
    dofs: NDArray[np.int32]


def find_interfaces(
    interfaces: Sequence[Interface], *, mesh: TaggedMesh, space: fem.FunctionSpace
) -> tuple[RigidInterface, ...]:
    """Find the nodes and frames of interfaces on a mesh. Collective.

    Args:
        interfaces: the same on all ranks.
        mesh: the mesh with the groups.
        space: a blocked Lagrange space on it.

    Raises:
        InterfaceError: on all ranks: an unknown group, a group without facets or with facets inside
            the part, with fewer than three nodes or all in one line, or two interfaces that share
            nodes.
    """
    _check_names(interfaces, mesh)
    found = tuple(_find(interface, mesh=mesh, space=space) for interface in interfaces)
    for one, other in combinations(found, 2):
        shared = mesh.comm.allreduce(len(np.intersect1d(one.nodes, other.nodes)))
        if shared > 0:
            raise InterfaceError(
                f"interfaces {one.name!r} and {other.name!r} share nodes: two rigid frames cannot "
                "hold the same node; take facets that do not touch"
            )
    return found


def _is_finite(value: ArrayLike, shape: tuple[int, ...]) -> bool:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return array.shape == shape and bool(np.isfinite(array).all())


def _check_names(interfaces: Sequence[Interface], mesh: TaggedMesh) -> None:
    for interface in interfaces:
        if not isinstance(interface, Interface):
            raise InterfaceError(f"write Interface({interface!r}) rather than {interface!r}")
    names = [interface.name for interface in interfaces]
    there = ", ".join(repr(name) for name in sorted(mesh.facet_groups)) or "none"
    for name in names:
        if name not in mesh.facet_groups:
            raise InterfaceError(
                f"interface {name!r}: the mesh has no such facet group; it has: {there}"
            )
        if names.count(name) > 1:
            raise InterfaceError(f"interface {name!r} is given twice; give each group once")


def _find(interface: Interface, *, mesh: TaggedMesh, space: fem.FunctionSpace) -> RigidInterface:
    facets = mesh.facets(interface.name)
    _check_boundary(interface.name, mesh, facets)
    # collective: it tells nodes to ranks that hold none of the facets
    nodes = fem.locate_dofs_topological(space, mesh.mesh.topology.dim - 1, facets)
    owned = nodes[nodes < space.dofmap.index_map.size_local]
    _check_spread(interface.name, mesh.comm, space.tabulate_dof_coordinates()[owned])
    if interface.origin is None:
        origin = _centroid(mesh, mesh.facet_groups[interface.name])
    else:
        origin = np.array(interface.origin, dtype=float)
    axes = np.eye(3) if interface.axes is None else _nearest_rotation(interface.axes)
    dofs = (3 * nodes[:, None] + np.arange(3, dtype=np.int32)).reshape(-1)
    return RigidInterface(interface.name, origin, axes, nodes, dofs)


def _nearest_rotation(axes: ArrayLike) -> FloatArray:
    left, _, right = np.linalg.svd(np.asarray(axes, dtype=float))
    return left @ right


def _centroid(mesh: TaggedMesh, tag: int) -> FloatArray:
    """Centroid by area of the boundary facets of a group. Collective."""
    x = ufl.SpatialCoordinate(mesh.mesh)
    ds = ufl.Measure("ds", domain=mesh.mesh, subdomain_data=mesh.facet_tags)
    weight = fem.Constant(mesh.mesh, np.zeros(4))
    integrand = weight[0] + sum(weight[i + 1] * x[i] for i in range(3))
    degree = 3 * mesh.mesh.geometry.cmap.degree
    form = fem.form(integrand * ds(tag, metadata={"quadrature_degree": degree}))
    integrals = np.zeros(4)
    for i in range(4):
        weight.value[:] = np.eye(4)[i]
        integrals[i] = mesh.comm.allreduce(fem.assemble_scalar(form))
    centroid: FloatArray = integrals[1:] / integrals[0]
    return centroid


def _check_boundary(name: str, mesh: TaggedMesh, facets: NDArray[np.int32]) -> None:
    """Refuse a group without facets, or with some that are not on the boundary. Collective."""
    topology = mesh.mesh.topology
    topology.create_connectivity(2, 3)
    own = facets[facets < topology.index_map(2).size_local]
    inside = mesh.comm.allreduce(len(np.setdiff1d(own, exterior_facet_indices(topology))))
    if mesh.comm.allreduce(len(own)) == 0:
        raise InterfaceError(
            f"interface {name!r} has no facets; tag those of a surface of the part"
        )
    if inside > 0:
        raise InterfaceError(
            f"interface {name!r} has {inside} facets inside the part; tag only those of its surface"
        )


def _check_spread(name: str, comm: MPI.Comm, points: FloatArray) -> None:
    """Refuse nodes that cannot carry a rotation. Collective."""
    count = comm.allreduce(len(points))
    mean = comm.allreduce(points.sum(axis=0)) / max(count, 1)
    spread = comm.allreduce((points - mean).T @ (points - mean))
    thin, long = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[1:], 0.0))
    if count < 3 or not thin > _THIN * long:
        raise InterfaceError(
            f"interface {name!r} has {count} nodes, and a rigid frame needs three that are not in "
            "one line; take a larger group of facets"
        )
