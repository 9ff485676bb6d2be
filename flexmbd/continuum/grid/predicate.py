"""Groups of entities chosen by functions of points."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations

from mpi4py import MPI

import dolfinx.mesh
import numpy as np
import numpy.typing as npt

from flexmbd.continuum import parallel
from flexmbd.errors import MeshError

Points = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]
Predicate = Callable[[Points], npt.NDArray[np.bool_]]

# The kinds of groups: whether they may share entities, and what an entity is called.
_KINDS = {
    "facet": (False, "boundary facet"),
    "cell": (False, "cell"),
    "edge": (True, "edge"),
    "vertex": (True, "vertex"),
}


def locate_groups(
    mesh: dolfinx.mesh.Mesh, dim: int, predicates: Mapping[str, Predicate], *, kind: str
) -> dict[str, Indices]:
    """The entities of this rank in each group: all of their vertices are in the group. Collective.

    Args:
        mesh: the mesh.
        dim: of the entities.
        predicates: by the name of the group, the same names on all ranks, functions of points (3, n)
            that say which are in it (n,).
        kind: "facet", of the boundary alone, "cell", "edge" or "vertex".

    Raises:
        MeshError: on all ranks; a function raises, if on one rank only, or returns something else; a
            group is empty; or two that may not do so share entities.
    """
    locate = dolfinx.mesh.locate_entities
    if kind == "facet":
        locate = dolfinx.mesh.locate_entities_boundary
    faults: list[MeshError] = []
    found = {
        name: locate(mesh, dim, _guarded(predicate, faults, f"{kind} group {name!r}"))
        for name, predicate in predicates.items()
    }
    parallel.raise_collectively(mesh.comm, faults[0] if faults else None)
    _check(mesh.comm, kind, found)
    return found


def _guarded(predicate: Predicate, faults: list[MeshError], group: str) -> Predicate:
    """A predicate that keeps its errors for later, so that no rank stops alone."""

    def guarded(x: Points) -> npt.NDArray[np.bool_]:
        nowhere = np.zeros(x.shape[1], dtype=bool)
        try:
            inside = np.asarray(predicate(x))
        except Exception as error:  # noqa: BLE001  (whatever a person's function raises)
            faults.append(MeshError(f"{group}: its function raised {type(error).__name__}: {error}"))
            return nowhere
        if inside.shape != nowhere.shape or inside.dtype != np.bool_:
            faults.append(
                MeshError(
                    f"{group}: its function of points (3, n) must return n truth values, got "
                    f"{inside.dtype} {inside.shape} for n = {x.shape[1]}"
                )
            )
            return nowhere
        return inside

    return guarded


def _check(comm: MPI.Comm, kind: str, found: Mapping[str, Indices]) -> None:
    """Refuse groups without an entity on any rank, and groups that share one where they may not."""
    overlaps, called = _KINDS[kind]
    faults = []
    for name, entities in found.items():
        if comm.allreduce(len(entities)) == 0:
            faults.append(f"{kind} group {name!r}: no {called} lies in it; check its predicate")
    for name, other in combinations(found, 2):
        if not overlaps and len(np.intersect1d(found[name], found[other])) > 0:
            faults.append(f"{kind} groups {name!r} and {other!r} share {kind}s")
    error = MeshError("; ".join(faults)) if faults else None
    parallel.raise_collectively(comm, error)
