"""Whether the third edges of cells lie across their layer, as formulations of thin walls take them to do."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexmbd.continuum import parallel
from flexmbd.continuum.contract.entries import is_layered
from flexmbd.continuum.finite_elements.cell_group import CellGroup
from flexmbd.continuum.finite_elements.elastic_sums import cell_edges
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import LockingWarning, warn

# A cell that is this many times as thick as it is long in its layer is no cell of a wall.
_THICK = 2.0


def tell_layers(mesh: TaggedMesh, groups: Sequence[CellGroup]) -> None:
    """Say on rank 0 where third edges are no thickness. Collective.

    Warns:
        LockingWarning: of formulations of layered cells (`LAYERED`), some of which are thicker than they are long.
    """
    layered = [group for group in groups if is_layered(group.formulation)]
    if not layered:
        return
    lengths = np.linalg.norm(cell_edges(mesh), axis=2)
    here = np.concatenate([group.cells[group.cells < len(lengths)] for group in layered])
    thick = lengths[here, 2] > _THICK * lengths[here, :2].min(axis=1)
    count, total = mesh.comm.allreduce(np.array([np.count_nonzero(thick), len(here)]))
    if not count:
        return
    text = (
        f"{layered[0].form_name} takes the third edges of its cells for the thickness of a wall, and in {count} of "
        f"{total} cells they are more than {_THICK:g} times as long as another edge: it locks there as bricks "
        "do. Make the mesh by meshes.wall(surface, thickness), or list the corners of each brick so that the first "
        "four lie on one face of the wall"
    )
    parallel.on_root(mesh.comm, lambda: warn(text, LockingWarning))
