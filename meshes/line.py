"""A straight line, for beam formulations."""

from __future__ import annotations

from mpi4py import MPI

import gmsh

from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.meshes import session
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    require_count,
    require_degree,
    require_positive,
)


@checked_part
def line(
    length: float,
    *,
    divisions: int,
    degree: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the x axis from 0 to `length` with equal cells, in space. Collective.

    Facet groups, which are points here: "start" (x = 0), "end" (x = length); cell group "line".

    Args:
        length: m.
        divisions: number of cells.
        degree: degree of the geometry, 1 or 2.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(length=length)
        require_count("divisions", divisions)
        require_degree(degree)

    check_arguments(comm, arguments, check)
    unit = session.working_unit(length)
    length /= unit

    def fill() -> None:
        ends = [gmsh.model.geo.addPoint(x, 0.0, 0.0) for x in (0.0, length)]
        axis = gmsh.model.geo.addLine(*ends)
        gmsh.model.geo.synchronize()
        for name, end in zip(("start", "end"), ends, strict=True):
            gmsh.model.addPhysicalGroup(0, [end], name=name)
        gmsh.model.addPhysicalGroup(1, [axis], name="line")
        gmsh.model.mesh.setTransfiniteCurve(axis, int(divisions) + 1)
        session.mesh_model(degree=degree, dim=1)

    return session.tagged_mesh(comm, fill, dim=1, unit=unit)
