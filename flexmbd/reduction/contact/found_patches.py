"""Contact patches found on a mesh: which facets they have, their places, and the nodal forces of unit loads on them.

A unit load is a force of 1 N, spread evenly over the facets of a patch along one axis of it. What does work on it is
the mean displacement of the patch along that axis. The loads of neighbouring patches add up to an even traction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.interface import RigidInterface
from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.continuum.finite_elements.nodes import node_numbers
from flexmbd.continuum.finite_elements.surface_patch import SurfacePatch, surface_facets
from flexmbd.continuum.grid.predicate import locate_groups
from flexmbd.continuum.matrices.blocks import FloatArray, total
from flexmbd.errors import ReductionError
from flexmbd.reduction.contact.clusters import clusters, sides
from flexmbd.reduction.contact.patch import Patch
from flexmbd.round_off import SAME_PLACE

IntArray = NDArray[np.int64]

# Of the area of a patch, its mean normal's length: a patch that is turned further is no face of a contact.
_FLAT = 0.5


@dataclass(frozen=True, eq=False)
class FoundPatches:
    """Contact patches on a mesh: p of them, numbered surface by surface, the same on every rank but for `weights`.

    Attributes:
        model: the body.
        asked: the surfaces.
        surface: (p,) which of these each patch is of.
        x: (p, 3) m, centroids in the mesh's axes.
        axes: (p, 3, 3) columns: mean outward normal, two tangents, in the mesh's axes.
        area: (p,) m^2.
        facet: (f, 3 or 4) numbers of the facets' corners (`node_numbers`), counter-clockwise seen from outside.
        patch: (f,) the patch of each facet.
        weights: (p, owned nodes) of this rank: integral of a node's shape function over a patch, over its area.
    """

    model: LinearModel
    asked: tuple[Patch, ...]
    surface: IntArray
    x: FloatArray
    axes: FloatArray
    area: FloatArray
    facet: IntArray
    patch: IntArray
    weights: scipy.sparse.csr_array

    def forces(self, loads: FloatArray) -> FloatArray:
        """(owned dofs, k) N, nodal forces of loads (3 p, k) along the patches' axes; not collective."""
        along = np.einsum("pab,pbk->apk", self.axes, loads.reshape(len(self.area), 3, -1))
        forces = np.zeros((self.model.n_owned, loads.shape[1]), order="F")
        for dofs, part in zip(self._dofs, along, strict=True):
            forces[dofs] = self.weights.T @ part
        return forces

    def means(self, displacement: FloatArray) -> FloatArray:
        """(3 p, k) m, mean displacements along the patches' axes, of (owned dofs, k): forces^T of it. Collective."""
        along = np.array([self.weights @ displacement[dofs] for dofs in self._dofs])
        turned = np.einsum("pab,apk->pbk", self.axes, along)
        return total(self.model.comm, turned.reshape(3 * len(self.area), -1))

    @property
    def _dofs(self) -> NDArray[np.int32]:
        """(3, owned nodes)."""
        return self.model.displacement_dofs[: self.model.n_owned_nodes].T


class _Facets(NamedTuple):
    """Facets of a surface, the same on every rank, in an order that no partition changes."""

    nodes: IntArray
    weights: FloatArray
    vector: FloatArray
    x: FloatArray
    corners: IntArray


def find_patches(model: LinearModel, patches: Sequence[Patch]) -> FoundPatches | None:
    """The contact patches of surfaces, or None of none. Collective.

    Raises:
        ReductionError: on all ranks: two of one name; a mesh that is no solid, a loaded state; surfaces that share
            facets, or nodes with a rigid or nodal interface; patches that are smaller than a facet, or turned too far.
        MeshError: on all ranks: no such group, no facets, or facets inside the part.
    """
    if not patches:
        return None
    _check(model, patches)
    numbers = node_numbers(model)
    found = [_facets(model, one, numbers) for one in patches]
    _refuse_shared(model, patches, found, numbers)
    surface, x, axes, area, patch, row, first = [], [], [], [], [], [], 0
    for i, (one, facets) in enumerate(zip(patches, found, strict=True)):
        count, which = _divided(one, facets)
        sums = scipy.sparse.csr_array((np.ones(len(which)), (which, np.arange(len(which)))), (count, len(which)))
        size = sums @ facets.weights.sum(axis=1)
        normal = (sums @ facets.vector) / size[:, None]
        surface.append(np.full(count, i, dtype=np.int64))
        x.append((sums @ (facets.weights.sum(axis=1)[:, None] * facets.x)) / size[:, None])
        axes.append(_axes(one, normal, x[-1]))
        area.append(size)
        patch.append(first + which)
        row.append(np.repeat(patch[-1], facets.nodes.shape[1]))
        first += count
    shares = np.concatenate([facets.weights.ravel() for facets in found])
    nodes = np.concatenate([facets.nodes.ravel() for facets in found])
    return FoundPatches(
        model=model,
        asked=tuple(patches),
        surface=np.concatenate(surface),
        x=np.concatenate(x),
        axes=np.concatenate(axes),
        area=np.concatenate(area),
        facet=np.concatenate([facets.corners for facets in found]),
        patch=np.concatenate(patch),
        weights=_weights(numbers[: model.n_owned_nodes], np.concatenate(row), nodes, shares, np.concatenate(area)),
    )


def _check(model: LinearModel, patches: Sequence[Patch]) -> None:
    names = [one.name for one in patches]
    for name in names:
        if names.count(name) > 1:
            raise ReductionError(f"two contact patches are called {name!r}; give each surface its own name")
    if model.mesh.dim != 3:
        raise ReductionError(f"contact patches, as {names[0]!r}, are on facets of solids, and this mesh has none")
    if model.state is not None:
        raise ReductionError(
            f"contact patches, as {names[0]!r}, are of a body at rest, and this one is about a loaded state; reduce "
            "the model that `prestressed` was given"
        )


def _facets(model: LinearModel, patch: Patch, numbers: IntArray) -> _Facets:
    """The facets of a surface. Collective."""
    if callable(patch.facets):
        local = locate_groups(model.mesh.mesh, 2, {patch.name: patch.facets}, kind="facet")[patch.name]
    else:
        local = surface_facets(model, patch.facets or patch.name, what=f"contact patch {patch.name!r}")
    part = SurfacePatch(model, local)
    places = model.node_x
    # nodal forces of 1 N/m^2 along x are integrals of the shape functions; of 1 Pa, of these times the normal
    weights = part.traction(np.array([1.0, 0.0, 0.0]))[:, :, 0]
    vector = -part.pressure(places).sum(axis=1)
    centre = np.einsum("fn,fni->fi", weights, places[part.nodes]) / weights.sum(axis=1)[:, None]
    corners = _outwards(places, part.nodes, vector)
    parts = model.comm.allgather((numbers[part.nodes], weights, vector, centre, numbers[corners]))
    nodes, *rest = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    order = np.lexsort(np.sort(nodes, axis=1).T[::-1])
    return _Facets(nodes[order], *(rows[order] for rows in rest))


def _outwards(x: FloatArray, nodes: NDArray[np.int32], vector: FloatArray) -> NDArray[np.int32]:
    """(f, 3 or 4) corners of facets, counter-clockwise seen from outside."""
    triangles = nodes.shape[1] in (3, 6)
    # basix lists quadrilaterals row by row
    ring = nodes[:, [0, 1, 2]] if triangles else nodes[:, [0, 1, 3, 2]]
    normal = np.cross(x[ring[:, 1]] - x[ring[:, 0]], x[ring[:, 2]] - x[ring[:, 0]])
    inwards = np.einsum("fi,fi->f", normal, vector) < 0.0
    ring[inwards] = ring[inwards][:, ::-1]
    return ring


def _refuse_shared(
    model: LinearModel, patches: Sequence[Patch], found: Sequence[_Facets], numbers: IntArray
) -> None:
    """Refuse surfaces that share facets, or nodes with interfaces that bind or keep them. Collective."""
    rows = [{row.tobytes() for row in np.sort(facets.nodes, axis=1)} for facets in found]
    for (one, mine), (other, theirs) in combinations(zip(patches, rows, strict=True), 2):
        if mine & theirs:
            raise ReductionError(
                f"contact patches {one.name!r} and {other.name!r} overlap: they share {len(mine & theirs)} facets; "
                "give each facet to one of them"
            )
    rigid = [(one.name, one.nodes) for one in model.interfaces if isinstance(one, RigidInterface)]
    kept = [(one.name, one.nodes) for one in model.nodal]
    bound = [(f"the interface {name!r}", nodes) for name, nodes in (*rigid, *kept)]
    if model.ties is not None:
        bound.append(("the following side of a weld", model.ties.followers.astype(np.int32)))
    for name, nodes in bound:
        held = np.unique(np.concatenate(model.comm.allgather(numbers[nodes])))
        for one, facets in zip(patches, found, strict=True):
            shared = np.isin(np.unique(facets.nodes), held).sum()
            if shared:
                raise ReductionError(
                    f"contact patch {one.name!r} shares {shared} nodes with {name}, which "
                    "moves them as its own: leave out the facets at its edge (facets=..., a function of points)"
                )


def _divided(patch: Patch, facets: _Facets) -> tuple[int, IntArray]:
    """The number of patches of a surface, and the patch of each facet."""
    area = facets.weights.sum(axis=1)
    largest, wanted = float(area.max()), patch.size * patch.size
    if largest * (1.0 - SAME_PLACE) > wanted:
        raise ReductionError(
            f"contact patch {patch.name!r}: patches of {patch.size:.4g} m are finer than the mesh, which has a facet "
            f"of {largest**0.5:.4g} m squared; give a size of {2.0 * largest**0.5:.2g} m or more, or refine the mesh"
        )
    normal = facets.vector / np.linalg.norm(facets.vector, axis=1)[:, None]
    # a normal that turns about is as far as a patch's size
    places = np.hstack([facets.x, min(patch.size, float(np.ptp(facets.x, axis=0).max())) * normal])
    found, first = np.zeros(len(area), dtype=np.int64), 0
    for side in sides(facets.corners, normal, facets.x):
        count = min(max(1, round(float(area[side].sum()) / wanted)), len(side))
        found[side] = first + clusters(places[side], area[side], count=count)
        first += count
    return first, found


def _axes(patch: Patch, normal: FloatArray, x: FloatArray) -> FloatArray:
    """(p, 3, 3) normal and tangents as columns, of mean normals (p, 3) that are shorter the more a patch is bent."""
    length = np.linalg.norm(normal, axis=1)
    if not length.min() > _FLAT:
        raise ReductionError(
            f"contact patch {patch.name!r}: the patch at {x[length.argmin()].tolist()} m is bent so far that its mean "
            f"normal has {length.min():.2f} of its area, at least {_FLAT} is wanted; give a smaller size"
        )
    normal = normal / length[:, None]
    # the first tangent lies along the mesh's axis that is most across the normal, of two alike the first
    axis = np.round(abs(normal) / SAME_PLACE).argmin(axis=1)
    first = np.eye(3)[axis] - normal[np.arange(len(axis)), axis][:, None] * normal
    first /= np.linalg.norm(first, axis=1)[:, None]
    return np.stack([normal, first, np.cross(normal, first)], axis=2)


def _weights(
    owned: IntArray, patch: IntArray, nodes: IntArray, shares: FloatArray, area: FloatArray
) -> scipy.sparse.csr_array:
    """(p, owned nodes) from integrals of shape functions by patch and node number."""
    order = np.argsort(owned)
    place = np.searchsorted(owned[order], nodes)
    here = np.zeros(len(nodes), dtype=bool)
    inside = place < len(owned)
    here[inside] = owned[order[place[inside]]] == nodes[inside]
    columns = order[place[here]]
    return scipy.sparse.csr_array((shares[here] / area[patch[here]], (patch[here], columns)), (len(area), len(owned)))
