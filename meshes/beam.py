"""A straight beam of rectangular section along x."""

from __future__ import annotations

from mpi4py import MPI

import gmsh

from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.meshes import session
from flexmbd.meshes.block import faces, fill_box
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    intervals,
    require_cell,
    require_degree,
    require_memory,
    require_positive,
)


@checked_part
def beam(
    length: float,
    width: float,
    height: float,
    *,
    h: float,
    cell: str = "tetrahedron",
    degree: int = 2,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the box [0, length] x [-width/2, width/2] x [-height/2, height/2] by cell size. Collective.

    Facet groups: "start" (x = 0), "end" (x = length), "side" (the four others); cell group "beam".

    Args:
        length: along x, m.
        width: along y, m.
        height: along z, m.
        h: size of the cells, m.
        cell: "tetrahedron", in a free mesh, or "hexahedron", in a regular grid of edges up to h.
        degree: degree of the geometry, 1 or 2.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(length=length, width=width, height=height, h=h)
        require_memory(h, length, width, height)
        require_cell(cell)
        require_degree(degree)

    check_arguments(comm, arguments, check)
    unit = session.working_unit(length, width, height)
    length, width, height, h = (x / unit for x in (length, width, height, h))

    def fill() -> None:
        if cell == "tetrahedron":
            box = gmsh.model.occ.addBox(0.0, -width / 2, -height / 2, length, width, height)
            gmsh.model.occ.synchronize()
            gmsh.model.addPhysicalGroup(3, [box], name="beam")
        else:
            grid = (intervals(length, h), intervals(width, h), intervals(height, h))
            fill_box((length, width, height), divisions=grid, layers=("beam",), recombine=True)
        face = faces()
        sides = [tag for name in ("y_min", "y_max", "z_min", "z_max") for tag in face[name]]
        gmsh.model.addPhysicalGroup(2, face["x_min"], name="start")
        gmsh.model.addPhysicalGroup(2, face["x_max"], name="end")
        gmsh.model.addPhysicalGroup(2, sides, name="side")
        if cell == "tetrahedron":
            session.generate(h=h, degree=degree)
        else:
            session.mesh_model(degree=degree)

    return session.tagged_mesh(comm, fill, unit=unit)
