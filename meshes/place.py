"""Groups of facets by their place: on a plane, on a cylinder, in a box, or where a function says."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from mpi4py import MPI

import dolfinx.mesh
import numpy as np
import numpy.typing as npt

from flexmbd.continuum import parallel
from flexmbd.continuum.grid.predicate import Predicate, locate_groups
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.given import numbers
from flexmbd.meshes.dimension import check_arguments, checked_part

Points = npt.NDArray[np.float64]
Triple: TypeAlias = tuple[float, float, float]

# Of the mesh's size: how far off a plane or cylinder a vertex may lie. Files of eight columns have five digits.
_OFF = 2e-5


@dataclass(frozen=True)
class OnPlane:
    """Facets on a plane.

    Attributes:
        point: on it, m.
        normal: of any length.
        within: how far off it a vertex may lie, m; None for 2e-5 of the mesh's diagonal.

    Raises:
        MeshError: a point or direction is no three numbers, a length not positive.
    """

    point: Triple
    normal: Triple
    within: float | None = None

    def __post_init__(self) -> None:
        _vector("OnPlane: point", self.point)
        _direction("OnPlane: normal", self.normal)
        _length("OnPlane: within", self.within)


@dataclass(frozen=True)
class OnCylinder:
    """Facets on a cylinder, but none that are normal to its axis.

    Attributes:
        point: on the axis, m.
        axis: of any length.
        radius: m.
        within: how far off it a vertex may lie, m; None for 2e-5 of the mesh's diagonal.

    Raises:
        MeshError: a point or direction is no three numbers, a length not positive.
    """

    point: Triple
    axis: Triple
    radius: float
    within: float | None = None

    def __post_init__(self) -> None:
        _vector("OnCylinder: point", self.point)
        _direction("OnCylinder: axis", self.axis)
        _length("OnCylinder: radius", np.nan if self.radius is None else self.radius)
        _length("OnCylinder: within", self.within)


@dataclass(frozen=True)
class InBox:
    """Facets of the boundary all of whose vertices lie in a box, its sides among them.

    Attributes:
        low: the lowest x, y, z, m; -inf for no bound.
        high: the highest; inf for no bound.

    Raises:
        MeshError: a corner is no three numbers, or the low one lies above the high one.
    """

    low: Triple
    high: Triple

    def __post_init__(self) -> None:
        low, high = _vector("InBox: low", self.low, bounded=False), _vector("InBox: high", self.high, bounded=False)
        if not (low <= high).all():
            raise MeshError(f"InBox: its low corner {self.low} lies above its high one {self.high}")


#: A place, or a function of points (3, n) in m that says of each whether it is in the group (n,).
Place: TypeAlias = OnPlane | OnCylinder | InBox | Callable[[Points], npt.NDArray[np.bool_]]


@checked_part
def with_facet_groups(part: TaggedMesh, groups: Mapping[str, Place]) -> TaggedMesh:
    """The same mesh with more groups of facets of its boundary, by their places. Collective.

    A facet belongs to a place if all of its vertices do. A group that a place lies in whole, as "surface" of a part
    from STEP, keeps its other facets.

    Args:
        part: the mesh.
        groups: places by the names of the groups, the same on all ranks; lengths in m.

    Raises:
        MeshError: on all ranks; a group is empty or its function fails, it shares some of its facets with another
            one, has the name of one that is there, or a place is none.
    """
    check_arguments(part.comm, {"groups": groups}, lambda: check_places("groups", groups))
    return with_places(part, groups, shared="cut")


def check_places(what: str, places: object) -> None:
    """Refuse what is no mapping of names to places; not collective.

    Raises:
        MeshError: names it.
    """
    if not isinstance(places, Mapping):
        raise MeshError(f'{what} must be a dictionary of places, as {{"foot": OnPlane(...)}}, got {places!r:.80}')
    for name, place in places.items():
        if not isinstance(name, str) or not name:
            raise MeshError(f"{what} has the name {name!r}; names are texts")
        if not isinstance(place, OnPlane | OnCylinder | InBox) and not callable(place):
            raise MeshError(
                f"{what}[{name!r}] must be OnPlane, OnCylinder, InBox or a function of points, got {place!r:.80}"
            )


def with_places(
    part: TaggedMesh, places: Mapping[str, Place], *, shared: Literal["drop", "cut", "refuse"]
) -> TaggedMesh:
    """The mesh with groups by their places. Collective.

    Args:
        part: the mesh.
        places: by the names of the groups.
        shared: what becomes of groups that share facets with them: "drop" takes none of these; "cut" leaves them
            what is not in the places that lie in them whole, and refuses others; "refuse" refuses them.

    Raises:
        MeshError: on all ranks.
    """
    if not places:
        return part
    mesh, dim = part.mesh, part.dim - 1
    off = _OFF * _diagonal(mesh)
    found = locate_groups(mesh, dim, {name: _predicate(place, off) for name, place in places.items()}, kind="facet")
    for name, place in places.items():
        if isinstance(place, OnCylinder):
            found[name] = _along(mesh, dim, found[name], place, off)
    empty = [name for name, facets in found.items() if mesh.comm.allreduce(len(facets)) == 0]
    named = set(places) & set(part.facet_groups)
    faults = [f"facet group {name!r}: no facet lies along the axis" for name in empty]
    faults += [f"there is a facet group {name!r} already; choose another name" for name in sorted(named)]
    kept = {name: part.facet_tags.find(tag) for name, tag in part.facet_groups.items()}
    taken = np.concatenate(list(found.values()))
    counts = {name: mesh.comm.allreduce(len(np.intersect1d(facets, taken))) for name, facets in kept.items()}
    if shared == "drop":
        kept = {name: facets for name, facets in kept.items() if counts[name] == 0}
    elif shared == "cut" and not faults:
        inside = [np.isin(place, held) for held in kept.values() for place in found.values()]
        crossing = [one.any() and not one.all() for one in inside]
        if not mesh.comm.allreduce(any(crossing), op=MPI.LOR):
            kept = {name: np.setdiff1d(facets, taken) for name, facets in kept.items()}
            kept = {name: facets for name, facets in kept.items() if mesh.comm.allreduce(len(facets)) > 0}
            counts = {}
    if shared != "drop":
        faults += [f"{n} of these facets are in the group {name!r} already" for name, n in counts.items() if n > 0]
    parallel.raise_collectively(mesh.comm, MeshError("; ".join(faults)) if faults else None)
    every = kept | found
    indices = np.concatenate(list(every.values())).astype(np.int32)
    values = np.repeat(np.arange(1, len(every) + 1, dtype=np.int32), [len(facets) for facets in every.values()])
    order = np.argsort(indices)
    tags = dolfinx.mesh.meshtags(mesh, dim, indices[order], values[order])
    return TaggedMesh(
        mesh, tags, {name: tag for tag, name in enumerate(every, start=1)}, part.cell_tags, part.cell_groups,
        part.edge_groups, part.vertex_groups, part.in_pieces,
    )  # fmt: skip


def _vector(what: str, value: object, *, bounded: bool = True) -> Points:
    found = numbers(value)
    if found.shape != (3,) or np.isnan(found).any() or (bounded and not np.isfinite(found).all()):
        raise MeshError(f"{what} must be three numbers, got {value!r:.80}")
    return found


def _direction(what: str, value: object) -> None:
    if not np.linalg.norm(_vector(what, value)) > 0.0:
        raise MeshError(f"{what}: a direction must have a length, got {value!r}")


def _length(what: str, value: object) -> None:
    if value is not None and (numbers(value).shape != () or not 0.0 < float(numbers(value)) < np.inf):
        raise MeshError(f"{what} must be a positive length in m, got {value!r:.80}")


def _diagonal(mesh: dolfinx.mesh.Mesh) -> float:
    """Of the box around the mesh, m. Collective."""
    x = mesh.geometry.x
    low, high = x.min(axis=0, initial=np.inf), x.max(axis=0, initial=-np.inf)
    mesh.comm.Allreduce(MPI.IN_PLACE, low, op=MPI.MIN)
    mesh.comm.Allreduce(MPI.IN_PLACE, high, op=MPI.MAX)
    return float(np.linalg.norm(high - low))


def _predicate(place: Place, off: float) -> Predicate:
    if isinstance(place, OnPlane):
        normal, origin = _unit(place.normal), np.array(place.point, dtype=float)
        within = place.within or off
        return lambda x: np.asarray(abs(normal @ (x - origin[:, None])) <= within)
    if isinstance(place, OnCylinder):
        axis, origin = _unit(place.axis), np.array(place.point, dtype=float)
        radius, near = place.radius, place.within or off
        return lambda x: abs(np.linalg.norm(np.cross(axis, (x.T - origin)), axis=1) - radius) <= near
    if isinstance(place, InBox):
        low, high = np.array(place.low, dtype=float)[:, None], np.array(place.high, dtype=float)[:, None]
        return lambda x: np.asarray(((x >= low) & (x <= high)).all(axis=0))
    return place


def _unit(direction: Triple) -> Points:
    found = np.array(direction, dtype=float)
    unit: Points = found / np.linalg.norm(found)
    return unit


def _along(
    mesh: dolfinx.mesh.Mesh, dim: int, facets: npt.NDArray[np.int32], place: OnCylinder, off: float
) -> npt.NDArray[np.int32]:
    """The facets that go along the axis: those of an end, with all vertices on its rim, are not on the cylinder."""
    mesh.topology.create_connectivity(dim, mesh.topology.dim)
    mesh.topology.create_connectivity(mesh.topology.dim, dim)
    if len(facets) == 0:  # which DOLFINx does not take
        return facets
    nodes = dolfinx.mesh.entities_to_geometry(mesh, dim, facets)
    along = mesh.geometry.x[nodes] @ _unit(place.axis)
    return facets[np.ptp(along.reshape(len(facets), -1), axis=1) > 2.0 * (place.within or off)]
