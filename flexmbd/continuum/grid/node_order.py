"""How the nodes of a cell are listed: by us, by VTK, by gmsh, and by basix, which DOLFINx goes by."""

from __future__ import annotations

import enum

import dolfinx.cpp
import dolfinx.mesh
import numpy as np
import numpy.typing as npt

from flexmbd.errors import MeshError


class NodeOrder(enum.Enum):
    """How the nodes of one cell are listed in an array of cells.

    LEXICOGRAPHIC: tetrahedra: four vertices, then the middles of the edges 01, 02, 03, 12, 13, 23;
        triangles: of 01, 02, 12. Hexahedra: x fastest, z slowest, so that vertex i + 2 j + 4 k lies
        at (i, j, k); quadrilaterals without z.
    VTK: tetrahedra: middles of 01, 12, 02, 03, 13, 23; triangles: of 01, 12, 02. Hexahedra: around
        the bottom face, then around the top face; then VTK's own order of the further nodes.
        Quadrilaterals: around.
    GMSH: tetrahedra: middles of 01, 12, 02, 03, 23, 13. Triangles, quadrilaterals and the vertices
        of hexahedra as in VTK; then gmsh's own order of a hexahedron's further nodes.
    """

    LEXICOGRAPHIC = enum.auto()
    VTK = enum.auto()
    GMSH = enum.auto()


#: How many nodes cells of each kind and degree have.
NODES = {
    ("tetrahedron", 1): 4,
    ("tetrahedron", 2): 10,
    ("hexahedron", 1): 8,
    ("hexahedron", 2): 27,
    ("triangle", 1): 3,
    ("triangle", 2): 6,
    ("quadrilateral", 1): 4,
    ("quadrilateral", 2): 9,
    ("interval", 1): 2,
    ("interval", 2): 3,
}

# basix lists a tetrahedron's edges as 23, 13, 12, 03, 02, 01, a triangle's as 12, 02, 01, and the
# vertices of the others x fastest: entry i says where its node i stands in the lexicographic list.
_FROM_LEXICOGRAPHIC = {
    ("tetrahedron", 1): (0, 1, 2, 3),
    ("tetrahedron", 2): (0, 1, 2, 3, 9, 8, 7, 6, 5, 4),
    ("hexahedron", 1): (0, 1, 2, 3, 4, 5, 6, 7),
    ("triangle", 1): (0, 1, 2),
    ("triangle", 2): (0, 1, 2, 5, 4, 3),
    ("quadrilateral", 1): (0, 1, 2, 3),
    ("interval", 1): (0, 1),
    ("interval", 2): (0, 1, 2),
}


def node_permutation(cell: str, degree: int, order: NodeOrder) -> npt.NDArray[np.intp]:
    """Where each of basix's nodes stands in a cell listed in the given order.

    Raises:
        MeshError: this kind of cell is not known in that order.
    """
    if order is NodeOrder.LEXICOGRAPHIC:
        if (cell, degree) not in _FROM_LEXICOGRAPHIC:
            raise MeshError(
                f"{cell} of degree {degree} needs order=NodeOrder.VTK or NodeOrder.GMSH"
            )
        return np.array(_FROM_LEXICOGRAPHIC[cell, degree])
    tables = dolfinx.cpp.io
    table = tables.perm_vtk if order is NodeOrder.VTK else tables.perm_gmsh
    return np.asarray(table(dolfinx.mesh.to_type(cell), NODES[cell, degree]), dtype=np.intp)
