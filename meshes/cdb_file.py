"""Meshes in Ansys' archives (.cdb), read by mapdl-archive in a process of its own.

Solids of 8 and 20 nodes are degenerate ones too: a wedge, pyramid or tetrahedron has some of its corners twice.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.errors import MeshError
from flexmbd.meshes.foreign_mesh import ElementBlock, ForeignMesh
from flexmbd.meshes.trial_read import arrays_of

IntArray = npt.NDArray[np.int64]

_SCRIPT = """
import mapdl_archive, numpy

def read(path):
    archive = mapdl_archive.Archive(path, parse_vtk=False)
    rows = archive.elem
    found = {
        "numbers": archive.nnum, "points": archive.nodes, "elements": archive.enum,
        "types": numpy.asarray(archive.ekey).reshape(-1, 2), "lengths": numpy.array([len(row) for row in rows]),
        "rows": numpy.concatenate([numpy.empty(0, dtype=numpy.int64), *rows]),
    }
    for what, sets in (("node", archive.node_components), ("element", archive.element_components)):
        found |= {f"{what} set {name}": numpy.asarray(held) for name, held in sets.items()}
    return found
"""

# Of Ansys' elements by their numbers.
_TETRAHEDRA = {285: "tetra", 72: "tetra", 92: "tetra10", 87: "tetra10", 187: "tetra10", 227: "tetra10", 291: "tetra10"}
_BRICKS = {5, 45, 64, 65, 70, 73, 164, 185, 190}
_LARGE_BRICKS = {90, 95, 96, 186, 226}
_FLAT = {28, 41, 43, 63, 93, 131, 132, 152, 154, 157, 170, 173, 174, 181, 182, 183, 200, 281}
_MASSLESS = {116, 151, 153, 169, 171, 172, 175, 176, 177, 178, 179, 184}  # contact, loads, couplings

# Before the nodes of an element: material, type, real constants, section, ..., number.
_HEADER = 10

# Of degenerate bricks of 20 nodes, by their cells: VTK's nodes in the order of the brick.
_WEDGE = [0, 1, 2, 4, 5, 6, 8, 9, 11, 12, 13, 15, 16, 17, 18]
_PYRAMID = [0, 1, 2, 3, 4, 8, 9, 10, 11, 16, 17, 18, 19]
_TETRAHEDRON = [0, 1, 2, 4, 8, 9, 11, 16, 17, 18]


def read_cdb(path: Path) -> ForeignMesh:
    """The mesh of an archive; not collective.

    Components are sets by their names; all solids of a material are the set "material 1", which gives way to them.

    Raises:
        MeshError: mapdl-archive is not there, or cannot read the file; an element is not known.
    """
    found = arrays_of(path, "mapdl_archive", _SCRIPT)
    types = {int(key): int(number) for key, number in found["types"]}
    ends = np.cumsum(found["lengths"])
    rows = np.split(found["rows"].astype(np.int64), ends[:-1]) if len(ends) else []
    held: dict[str, tuple[list[int], list[IntArray]]] = {}
    materials: dict[str, list[int]] = {}
    beside: dict[str, int] = {}
    for number, row in zip(map(int, found["elements"]), rows, strict=True):
        kind, nodes = _cell(types.get(int(row[1]), 0), row[_HEADER:], f"{path}: element {number}")
        if kind:
            numbers, every = held.setdefault(kind, ([], []))
            numbers.append(number)
            every.append(nodes)
            if nodes.size and not kind.startswith(("tri", "quad")):
                materials.setdefault(f"material {row[0]}", []).append(number)
        elif (element := types.get(int(row[1]), 0)) not in _MASSLESS:
            name = f"Ansys {element}"
            beside[name] = beside.get(name, 0) + 1
    sets, node_sets = (
        {name.removeprefix(head): x.astype(np.int64) for name, x in found.items() if name.startswith(head)}
        for head in ("element set ", "node set ")
    )
    of_material = {name: np.array(some, dtype=np.int64) for name, some in materials.items() if name not in sets}
    return ForeignMesh(
        path,
        found["numbers"].astype(np.int64),
        found["points"][:, :3].astype(np.float64),
        [
            ElementBlock(kind, np.array(numbers, dtype=np.int64), np.stack(every))
            for kind, (numbers, every) in held.items()
        ],
        sets | of_material,
        node_sets,
        helpers=tuple(of_material),
        beside=beside,
    )


def _cell(element: int, nodes: IntArray, where: str) -> tuple[str, IntArray]:
    """meshio's name of the kind and the nodes in VTK's order; no name for what is neither solid nor shell."""
    if element in _TETRAHEDRA:
        kind = _TETRAHEDRA[element]
        width = 10 if kind == "tetra10" else 4
        if len(nodes) == 8 and width == 4:  # written as a degenerate brick
            nodes = nodes[[0, 1, 2, 4]]
        return kind, _padded(nodes, width, where)
    if element in _BRICKS:
        return _brick(_padded(nodes, 8, where))
    if element in _LARGE_BRICKS:
        return _brick(_padded(nodes, 20, where))
    if element in _FLAT and len(nodes) >= 3:
        corners = nodes[:4]
        if len(corners) == 3 or corners[2] == corners[3]:
            return "triangle", corners[:3]
        return "quad", corners
    return "", nodes


def _padded(nodes: IntArray, width: int, where: str) -> IntArray:
    """The nodes of an element, 0 for middles that are not written."""
    corners = {4: 4, 8: 8, 10: 4, 20: 8}[width]
    if len(nodes) < corners or not nodes[:corners].all():
        raise MeshError(f"{where} has {np.count_nonzero(nodes)} nodes; its type needs {corners} at least")
    return np.concatenate((nodes, np.zeros(width, dtype=np.int64)))[:width]


def _brick(nodes: IntArray) -> tuple[str, IntArray]:
    corner: list[int] = list(map(int, nodes[:8]))
    curved = len(nodes) == 20
    is_folded = corner[2] == corner[3]
    if len(set(corner[4:])) == 1:
        if is_folded:
            return ("tetra10", nodes[_TETRAHEDRON]) if curved else ("tetra", nodes[_TETRAHEDRON[:4]])
        return ("pyramid13", nodes[_PYRAMID]) if curved else ("pyramid", nodes[_PYRAMID[:5]])
    if is_folded and corner[6] == corner[7]:
        return ("wedge15", nodes[_WEDGE]) if curved else ("wedge", nodes[_WEDGE[:6]])
    return ("hexahedron20", nodes) if curved else ("hexahedron", nodes)
