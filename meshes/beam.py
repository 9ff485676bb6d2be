"""A straight beam of rectangular section along x."""

from __future__ import annotations

import math

from mpi4py import MPI

import gmsh

from flexmbd.continuum.tagged_mesh import TaggedMesh
from flexmbd.meshes import session
from flexmbd.meshes.block import faces, make_regular
from flexmbd.meshes.dimension import require_cell, require_degree, require_positive


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
        MeshError: on all ranks; a size, the cell or the degree is out of range.
    """
    require_positive(length=length, width=width, height=height, h=h)
    require_cell(cell)
    require_degree(degree)

    def fill() -> None:
        box = gmsh.model.occ.addBox(0.0, -width / 2, -height / 2, length, width, height)
        gmsh.model.occ.synchronize()
        face = faces(box)
        sides = [face[name] for name in ("y_min", "y_max", "z_min", "z_max")]
        gmsh.model.addPhysicalGroup(2, [face["x_min"]], name="start")
        gmsh.model.addPhysicalGroup(2, [face["x_max"]], name="end")
        gmsh.model.addPhysicalGroup(2, sides, name="side")
        gmsh.model.addPhysicalGroup(3, [box], name="beam")
        if cell == "tetrahedron":
            session.generate(h=h, degree=degree)
        else:
            nx, ny, nz = (math.ceil(size / h * (1 - 1e-12)) for size in (length, width, height))
            make_regular(box, (nx, ny, nz), recombine=True)
            session.mesh_model(degree=degree)

    return session.tagged_mesh(comm, fill)
