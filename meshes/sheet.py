"""The mid-surface of a plate, for shell formulations."""

from __future__ import annotations

from mpi4py import MPI

import gmsh

from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.meshes import session
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    require_cell,
    require_counts,
    require_degree,
    require_positive,
)


@checked_part
def sheet(
    length: float,
    width: float,
    *,
    divisions: tuple[int, int],
    cell: str = "quadrilateral",
    degree: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the rectangle [0, length] x [-width/2, width/2] of the plane z = 0 regularly. Collective.

    Facet groups, which are lines here: "x_min", "x_max", "y_min", "y_max"; vertex groups, the
    corners: "x_min y_min", "x_max y_min", "x_max y_max", "x_min y_max"; cell group "sheet".

    Args:
        length: along x, m.
        width: along y, m.
        divisions: number of equal intervals along x and y.
        cell: "quadrilateral", one in each rectangle of the grid, or "triangle", two in each.
        degree: degree of the geometry, 1 or 2.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(length=length, width=width)
        require_counts("divisions", divisions, number=2)
        require_cell(cell, known=("triangle", "quadrilateral"))
        require_degree(degree)

    check_arguments(comm, arguments, check)
    unit = session.working_unit(length, width)
    length, width = (x / unit for x in (length, width))

    def fill() -> None:
        ends = {"x_min": 0.0, "x_max": length, "y_min": -width / 2, "y_max": width / 2}
        around = [("x_min", "y_min"), ("x_max", "y_min"), ("x_max", "y_max"), ("x_min", "y_max")]
        points = [gmsh.model.geo.addPoint(ends[x], ends[y], 0.0) for x, y in around]
        lines = [gmsh.model.geo.addLine(points[i], points[(i + 1) % 4]) for i in range(4)]
        face = gmsh.model.geo.addPlaneSurface([gmsh.model.geo.addCurveLoop(lines)])
        gmsh.model.geo.synchronize()
        for i, corner in enumerate(around):
            gmsh.model.addPhysicalGroup(0, [points[i]], name=" ".join(corner))
            (name,) = set(corner) & set(around[(i + 1) % 4])
            gmsh.model.addPhysicalGroup(1, [lines[i]], name=name)
            gmsh.model.mesh.setTransfiniteCurve(lines[i], int(divisions[i % 2]) + 1)
        gmsh.model.addPhysicalGroup(2, [face], name="sheet")
        gmsh.model.mesh.setTransfiniteSurface(face)
        if cell == "quadrilateral":
            gmsh.model.mesh.setRecombine(2, face)
        session.mesh_model(degree=degree, dim=2)

    return session.tagged_mesh(comm, fill, dim=2, unit=unit)
