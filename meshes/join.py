"""Several meshes as one, whose parts welds of a model join."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mpi4py import MPI

import numpy as np
import numpy.typing as npt

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import geometry_degree
from flexmbd.continuum.grid.mesh_blocks import BELOW
from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.errors import MeshError
from flexmbd.meshes.dimension import checked_part
from flexmbd.meshes.listed_part import ListedPart


@checked_part
def join(parts: Mapping[str, TaggedMesh]) -> TaggedMesh:
    """Several meshes as one, for parts that are welded (`flexmbd.continuum.Weld`). Collective.

    Nodes stay as they are, and parts share none: what lies on one place is not merged. Groups of a part "web" are
    called "web.top" and so on, cells of a part without groups of cells "web". Nodes and cells are numbered part by
    part.

    Args:
        parts: by their names, two or more; of solid cells of one kind and degree, on one communicator.

    Raises:
        MeshError: on all ranks; fewer than two parts, cells that are no solids or not of one kind and degree, other
            ranks, names of two groups that would be the same.
    """
    fault = _fault(parts)
    comm = next((part.comm for part in parts.values()), MPI.COMM_WORLD)
    parallel.check_same(comm, MeshError, parts=list(parts))
    parallel.raise_collectively(comm, MeshError(fault) if fault else None)
    listed = {name: ListedPart.of(part, geometry_degree(part.mesh)) for name, part in parts.items()}
    return spread(comm, from_root(comm, lambda: _together(listed)), in_pieces=True)


def _fault(parts: Mapping[str, TaggedMesh]) -> str:
    if len(parts) < 2:
        return f'join takes two meshes or more by names, as join({{"web": web, "flange": flange}}), got {len(parts)}'
    kinds = {}
    for name, part in parts.items():
        if not name:
            return "join: a part has no name; names are texts that are not empty"
        if part.dim != 3:
            kind = part.mesh.topology.cell_name()
            return f"join: the cells of {name!r} are {kind}s; solids alone are welded (meshes.wall)"
        kinds[name] = part.mesh.topology.cell_name(), geometry_degree(part.mesh)
    names = list(kinds)
    for name in names[1:]:
        if kinds[name] != kinds[names[0]]:
            one, other = (f"{key!r} has {kinds[key][0]}s of degree {kinds[key][1]}" for key in (names[0], name))
            return f"join: {one}, {other}; cells of one mesh are of one kind and degree"
        if parts[name].comm.size != parts[names[0]].comm.size:
            return f"join: {names[0]!r} and {name!r} are spread over other ranks; make both with the same comm"
    owner: dict[str, str] = {}
    for name, part in parts.items():
        for group in sorted({*part.facet_groups, *part.cell_groups, *part.edge_groups, *part.vertex_groups}):
            first = owner.setdefault(f"{name}.{group}", name)
            if first != name:
                return f"join: two groups would be '{name}.{group}', of part {first!r} and of part {name!r}; rename one"
    return ""


def _together(parts: Mapping[str, ListedPart]) -> MeshInput:
    """All parts one after the other."""
    rows: dict[str, list[npt.NDArray[Any]]] = {"points": [], "cells": [], "cell": [], "facets": [], "facet": []}
    tags: dict[str, dict[str, int]] = {"cell": {}, "facet": {}}
    below: dict[str, dict[str, npt.NDArray[Any]]] = {"edges": {}, "vertices": {}}
    start = 0
    for part, one in parts.items():
        a = one.arrays
        for key, more in (("points", 0), ("cells", start), ("facets", start)):
            rows[key].append(a[key] + more)
        for kind in ("cell", "facet"):
            old = a[f"{kind}_tags"]
            renamed = np.zeros_like(old)
            for group, tag in one.groups[kind].items():
                renamed[old == tag] = tags[kind].setdefault(f"{part}.{group}", len(tags[kind]) + 1)
            if kind == "cell" and not one.groups[kind]:
                renamed[:] = tags[kind].setdefault(part, len(tags[kind]) + 1)
            rows[kind].append(renamed)
        for key, found in below.items():
            for group, tag in one.groups[BELOW[key]].items():
                found[f"{part}.{group}"] = a[key][a[f"{BELOW[key]}_tags"] == tag] + start
        start += len(a["points"])
    first = next(iter(parts.values()))
    joined = {key: np.concatenate(several) for key, several in rows.items()}
    return MeshInput(
        first.cell, first.degree, joined["points"], joined["cells"], joined["cell"].astype(np.int32), tags["cell"],
        joined["facets"], joined["facet"].astype(np.int32), tags["facet"], below["edges"], below["vertices"],
    )  # fmt: skip
