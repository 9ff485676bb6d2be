"""A box with a regular grid of cells."""

from __future__ import annotations

import numbers

from mpi4py import MPI

import gmsh

from flexmbd.continuum.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.meshes import session
from flexmbd.meshes.dimension import require_cell, require_degree, require_positive

_AXES = "xyz"


def block(
    length: float,
    width: float,
    height: float,
    *,
    divisions: tuple[int, int, int],
    cell: str = "hexahedron",
    degree: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the box [0, length] x [-width/2, width/2] x [-height/2, height/2] regularly. Collective.

    Facet groups: "x_min", "x_max", "y_min", "y_max", "z_min", "z_max"; cell group "block".

    Args:
        length: along x, m.
        width: along y, m.
        height: along z, m.
        divisions: number of equal intervals along x, y and z.
        cell: "hexahedron", one in each box of the grid, or "tetrahedron", six in each.
        degree: degree of the geometry, 1 or 2.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; a size, a division, the cell or the degree is out of range.
    """
    require_positive(length=length, width=width, height=height)
    require_degree(degree)
    if len(divisions) != 3 or not all(isinstance(n, numbers.Integral) and n > 0 for n in divisions):
        raise MeshError(f"divisions must be three positive whole numbers, got {divisions!r}")
    require_cell(cell)

    def fill() -> None:
        box = gmsh.model.occ.addBox(0.0, -width / 2, -height / 2, length, width, height)
        gmsh.model.occ.synchronize()
        for name, face in faces(box).items():
            gmsh.model.addPhysicalGroup(2, [face], name=name)
        gmsh.model.addPhysicalGroup(3, [box], name="block")
        make_regular(box, divisions, recombine=cell == "hexahedron")
        session.mesh_model(degree=degree)

    return session.tagged_mesh(comm, fill)


def faces(box: int) -> dict[str, int]:
    """Surfaces of an axis-parallel box by the names of `block`; on rank 0, inside a session."""
    centre = gmsh.model.occ.getCenterOfMass(3, box)
    named = {}
    for _, face in gmsh.model.getBoundary([(3, box)], oriented=False):
        offset = [
            a - b for a, b in zip(gmsh.model.occ.getCenterOfMass(2, face), centre, strict=True)
        ]
        axis = max(range(3), key=lambda i: abs(offset[i]))
        named[f"{_AXES[axis]}_{'min' if offset[axis] < 0 else 'max'}"] = face
    return named


def make_regular(box: int, divisions: tuple[int, int, int], *, recombine: bool) -> None:
    """Prescribe a regular grid on an axis-parallel box; on rank 0, inside a session.

    Args:
        box: gmsh's tag of the volume.
        divisions: number of equal intervals along x, y and z.
        recombine: hexahedra rather than tetrahedra.
    """
    for _, edge in gmsh.model.getEntities(1):
        low, high = gmsh.model.getBoundingBox(1, edge)[:3], gmsh.model.getBoundingBox(1, edge)[3:]
        axis = max(range(3), key=lambda i: high[i] - low[i])
        gmsh.model.mesh.setTransfiniteCurve(edge, int(divisions[axis]) + 1)
    for _, face in gmsh.model.getEntities(2):
        gmsh.model.mesh.setTransfiniteSurface(face)
        if recombine:
            gmsh.model.mesh.setRecombine(2, face)
    gmsh.model.mesh.setTransfiniteVolume(box)
