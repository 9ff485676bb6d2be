"""A frame of straight and curved lines in space, for beam formulations: a boom, a truss, a ring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mpi4py import MPI

import numpy as np

from flexmbd.beams.frame_mesh import Beam, FrameMesh, Point, mesh_frame
from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.meshes.dimension import check_arguments, checked_part, require_degree


@checked_part
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
        MeshError: on all ranks; as `flexmbd.beams.frame_mesh.mesh_frame`, or an argument is out of range or not
            the same on all ranks, or a frame with branches is to be spread over ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_degree(degree)
        mesh_frame(points, beams, divisions=divisions)

    check_arguments(comm, arguments, check)
    return spread(comm, from_root(comm, lambda: _input(mesh_frame(points, beams, divisions=divisions), degree)))


def _input(mesh: FrameMesh, degree: int) -> MeshInput:
    n, m = len(mesh.x), len(mesh.elements)
    curved = degree == 2
    points = np.arange(mesh.points)
    return MeshInput(
        cell="interval",
        degree=degree,
        points=np.vstack([mesh.x, mesh.middles]) if curved else mesh.x,
        cells=np.hstack([mesh.elements, n + np.arange(m)[:, None]]) if curved else mesh.elements,
        cell_tags=(mesh.group + 1).astype(np.int32),
        cell_groups={name: i + 1 for i, name in enumerate(mesh.groups)},
        facets=points[:, None],
        facet_tags=(points + 1).astype(np.int32),
        facet_groups={name: i + 1 for i, name in enumerate(mesh.names[: mesh.points])},
    )
