"""A thin rectangular plate as a solid."""

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
    require_count,
    require_degree,
    require_memory,
    require_positive,
)


@checked_part
def plate(
    length: float,
    width: float,
    thickness: float,
    *,
    h: float,
    through: int = 1,
    cell: str = "hexahedron",
    degree: int = 2,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the plate [0, length] x [-width/2, width/2] x [-thickness/2, thickness/2]. Collective.

    The cells stand in a regular grid, so that they may be flat where a free mesh would refine. For
    its mid-surface see `sheet`.

    Facet groups: the edges "x_min", "x_max", "y_min", "y_max", the faces "z_min", "z_max"; cell
    group "plate".

    Args:
        length: along x, m.
        width: along y, m.
        thickness: along z, m.
        h: longest edge of the cells along x and y, m.
        through: number of cells through the thickness.
        cell: "hexahedron", one in each box of the grid, or "tetrahedron", six in each.
        degree: degree of the geometry, 1 or 2.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(length=length, width=width, thickness=thickness, h=h)
        require_memory(h, length, width)
        require_count("through", through)
        require_cell(cell)
        require_degree(degree)

    check_arguments(comm, arguments, check)
    unit = session.working_unit(length, width, thickness)
    length, width, thickness, h = (x / unit for x in (length, width, thickness, h))

    def fill() -> None:
        fill_box(
            (length, width, thickness),
            divisions=(intervals(length, h), intervals(width, h), through),
            layers=("plate",),
            recombine=cell == "hexahedron",
        )
        for name, tags in faces().items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        session.mesh_model(degree=degree)

    return session.tagged_mesh(comm, fill, unit=unit)
