"""A mesh as rank 0 lists it with its groups, to be made anew: moved, or beside others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy.typing as npt

from flexmbd.continuum import parallel
from flexmbd.continuum.grid.mesh_blocks import BELOW, mesh_blocks, numbered
from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh


@dataclass(frozen=True, eq=False)
class ListedPart:
    """A mesh; what is not a group's name or tag is there on rank 0 alone.

    Attributes:
        cell: basix's name of the cells.
        degree: of the geometry.
        groups: by kind ("facet", "edge", "vertex", "cell") the tags of its groups by their names.
        arrays: of `mesh_blocks`, by their names.
    """

    cell: str
    degree: int
    groups: dict[str, dict[str, int]]
    arrays: dict[str, npt.NDArray[Any]]

    @classmethod
    def of(cls, part: TaggedMesh, degree: int) -> ListedPart:
        """A mesh of that degree. Collective."""
        whole = ("points", "cells", "cell_tags")
        arrays: dict[str, Any] = {
            key: parallel.gather_rows(part.comm, block) if key in whole else block for key, block in mesh_blocks(part)
        }
        groups = {
            "facet": dict(part.facet_groups), "cell": dict(part.cell_groups),
            "edge": numbered(part.edge_groups), "vertex": numbered(part.vertex_groups),
        }  # fmt: skip
        return cls(part.mesh.topology.cell_name(), degree, groups, arrays)

    def to_input(self, points: npt.NDArray[Any]) -> MeshInput:
        """The mesh with points (n, 3) m in the place of its own; on rank 0."""
        a, named = self.arrays, {}
        for key in ("edges", "vertices"):
            tags = self.groups[BELOW[key]]
            named[key] = {name: a[key][a[f"{BELOW[key]}_tags"] == tag] for name, tag in tags.items()}
        return MeshInput(
            self.cell, self.degree, points, a["cells"], a["cell_tags"], self.groups["cell"], a["facets"],
            a["facet_tags"], self.groups["facet"], named["edges"], named["vertices"],
        )  # fmt: skip
