"""A frame of straight and curved lines in space, for beam formulations: a boom, a truss, a ring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np

from flexmbd.beams.layout import Beam, Layout, Point, lay_out
from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.meshes.dimension import check_arguments, require_degree


def frame(
    points: Mapping[str, Point],
    beams: Mapping[str, Sequence[Beam]],
    *,
    divisions: int | Mapping[str, int],
    degree: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh a frame of beams between named points, in space. Collective.

    Beams join stiffly where they share a point. Facet groups, which are points here: every one of
    `points`, inside the frame too; cell groups: those of `beams`. A cell's first node is nearer its
    beam's start.

    Args:
        points: by name, (3,) m.
        beams: by the name of a cell group, beams ("start", "end"), straight, or ("start", (x, y, z),
            "end"), an arc of a circle through that place.
        divisions: cells of equal length a beam; one number, or one by group.
        degree: degree of the geometry, 1 or 2; arcs are true to their shape with 2 alone.
        comm: the communicator of the mesh; one rank where more than two beams meet in a point.

    Raises:
        MeshError: on all ranks; as `flexmbd.beams.layout.lay_out`, or an argument is out of range or not
            the same on all ranks, or a frame with branches is to be spread over ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_degree(degree)
        lay_out(points, beams, divisions=divisions)

    check_arguments(comm, arguments, check)
    return spread(comm, from_root(comm, lambda: _input(lay_out(points, beams, divisions=divisions), degree)))


def _input(layout: Layout, degree: int) -> MeshInput:
    n, m = len(layout.x), len(layout.elements)
    curved = degree == 2
    points = np.arange(layout.points)
    return MeshInput(
        cell="interval",
        degree=degree,
        points=np.vstack([layout.x, layout.middles]) if curved else layout.x,
        cells=np.hstack([layout.elements, n + np.arange(m)[:, None]]) if curved else layout.elements,
        cell_tags=(layout.group + 1).astype(np.int32),
        cell_groups={name: i + 1 for i, name in enumerate(layout.groups)},
        facets=points[:, None],
        facet_tags=(points + 1).astype(np.int32),
        facet_groups={name: i + 1 for i, name in enumerate(layout.names[: layout.points])},
    )
