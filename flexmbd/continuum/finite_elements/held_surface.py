"""Facets that cannot leave a plane: symmetry planes of a part of which a half or a quarter is meshed, and rollers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.given import checked, numbers

FloatArray = NDArray[np.float64]

# Of the mesh's extent, how far facets of a plane may be from it; of a direction, what counts as along an axis.
_FLAT, _ALONG = 1e-7, 1e-9


@checked(error=MeshError)
@dataclass(frozen=True, eq=False)
class SymmetryPlane:
    """A plane of symmetry that the mesh ends at: its nodes keep in it, and interfaces that it cuts move symmetrically.

    Attributes:
        facets: the mesh's facet group, flat.
        normal: (3,) of the plane, along an axis of the mesh, of either sign.
    """

    facets: str
    normal: ArrayLike

    def __repr__(self) -> str:
        return f"symmetry plane {self.facets!r} with normal {_text(self.normal)}"


@checked(error=MeshError)
@dataclass(frozen=True, eq=False)
class Roller:
    """Facets whose nodes do not move along one direction, and freely across it.

    Attributes:
        facets: the mesh's facet group.
        direction: (3,) along an axis of the mesh.
    """

    facets: str
    direction: ArrayLike

    def __repr__(self) -> str:
        return f"roller {self.facets!r} along {_text(self.direction)}"


SurfaceSupport = SymmetryPlane | Roller
"""What holds facets of a part."""


@dataclass(frozen=True, eq=False)
class HeldSurface:
    """A support found on a mesh.

    Attributes:
        nodes: (k,) of the group, local to this rank, ghosts included.
        axis: of the mesh, along which they are held.
        symmetric: whether the part goes on beyond, as its mirror image.
        text: the support in words, for messages.
    """

    nodes: NDArray[np.int32]
    axis: int
    symmetric: bool
    text: str


def find_supports(
    supports: Sequence[SurfaceSupport], *, mesh: TaggedMesh, layout: DofLayout
) -> tuple[HeldSurface, ...]:
    """Find the nodes of supports on a mesh. Collective.

    Args:
        supports: the same on all ranks.
        mesh: the mesh with the groups.
        layout: of the unknown.

    Raises:
        MeshError: on all ranks: something that is no support, an unknown or empty group, a direction along no axis of
            the mesh, facets that do not lie in the plane, or a formulation with rotations.
    """
    if isinstance(supports, SurfaceSupport) or not isinstance(supports, Sequence):
        raise MeshError(f"supports must be a list, as supports=[SymmetryPlane(...)]; got {supports!r:.100}")
    parallel.check_same(mesh.comm, MeshError, supports=list(map(repr, supports)))
    if supports and mesh.comm.allreduce(layout.n_local - layout.displacement_dofs.size, op=MPI.MAX) > 0:
        raise MeshError("supports are for formulations of the displacement alone, without rotations or pressures")
    return tuple(_find(one, mesh=mesh, layout=layout) for one in supports)


def _find(support: SurfaceSupport, *, mesh: TaggedMesh, layout: DofLayout) -> HeldSurface:
    if not isinstance(support, SurfaceSupport):
        raise MeshError(f"a support must be a SymmetryPlane or a Roller, got {support!r:.100}")
    symmetric = isinstance(support, SymmetryPlane)
    direction = numbers(support.normal if isinstance(support, SymmetryPlane) else support.direction)
    axis = -1
    if direction.shape == (3,) and np.isfinite(direction).all() and direction.any():
        sizes = abs(direction) / np.linalg.norm(direction)
        axis = int(sizes.argmax()) if np.sort(sizes)[1] <= _ALONG else -1
    if axis < 0:
        raise MeshError(
            f"{support!r}: the direction must be along an axis of the mesh, as (1, 0, 0); turn the mesh so that it is"
        )
    dim = mesh.dim - 1
    nodes = layout.nodes_on(dim, mesh.facets(support.facets))
    if mesh.comm.allreduce(len(nodes)) == 0:
        raise MeshError(f"{support!r}: the group has no facets")
    if symmetric:
        x, every = layout.node_x[nodes, axis], layout.node_x
        low = mesh.comm.allreduce(float(x.min(initial=np.inf)), op=MPI.MIN)
        high = mesh.comm.allreduce(float(x.max(initial=-np.inf)), op=MPI.MAX)
        extents = np.array([mesh.comm.allreduce(float(part.max(initial=-np.inf)), op=MPI.MAX) for part in every.T])
        extents -= [mesh.comm.allreduce(float(part.min(initial=np.inf)), op=MPI.MIN) for part in every.T]
        if not high - low <= _FLAT * float(extents.max()):
            raise MeshError(
                f"{support!r}: its facets do not lie in a plane of that normal: they reach from {'xyz'[axis]} = "
                f"{low:g} m to {high:g} m; give the normal of the facets, or a group that is flat"
            )
    return HeldSurface(nodes, axis, symmetric, repr(support))


def held_dofs(supports: Sequence[HeldSurface], *, layout: DofLayout) -> NDArray[np.bool_]:
    """(owned dofs,) whether a support holds a dof."""
    held = np.zeros(layout.n_owned, dtype=bool)
    for one in supports:
        dofs = layout.displacement_dofs[one.nodes, one.axis]
        held[dofs[dofs < layout.n_owned]] = True
    return held


def _text(direction: ArrayLike) -> str:
    found = numbers(direction)
    return f"({', '.join(f'{part:g}' for part in found)})" if found.ndim == 1 else repr(direction)
