"""Lattices of cells as Ansys' archives and Salome's MED files, for tests of what reads them."""

import meshio
import numpy as np

KINDS = {("tetrahedron", 1): "tetra", ("tetrahedron", 2): "tetra10", ("hexahedron", 1): "hexahedron",
         ("hexahedron", 2): "hexahedron20"}  # fmt: skip


def cdb(points, cells, *, types, components=""):
    """An archive: points (n, 3), cells as lists of rows, each with Ansys' number of its element and its material."""
    lines = ["/COM, a comment", "/PREP7"]
    number = {element: i for i, element in enumerate(sorted({element for element, _, _ in types}), start=1)}
    lines += [f"ET,{i:9d},{element}" for element, i in number.items()]
    lines += [f"NBLOCK,6,SOLID,{len(points):10d},{len(points):10d}", "(3i9,6e21.13e3)"]
    lines += [f"{i:9d}{0:9d}{0:9d}" + "".join(f"{v:21.13E}" for v in x) for i, x in enumerate(points, start=1)]
    lines += ["N,R5.3,LOC,       -1,", f"EBLOCK,19,SOLID,{len(cells):10d},{len(cells):10d}", "(19i9)"]
    for i, (cell, (element, material, _)) in enumerate(zip(cells, types, strict=True), start=1):
        nodes = [row + 1 if row >= 0 else 0 for row in cell]
        fields = [material, number[element], 1, 1, 0, 0, 0, 0, len(nodes), 0, i, *nodes[:8]]
        lines.append("".join(f"{v:9d}" for v in fields))
        lines += ["".join(f"{v:9d}" for v in nodes[at : at + 19]) for at in range(8, len(nodes), 19)]
    lines += ["       -1", *components.splitlines(), "FINISH", ""]
    return "\n".join(lines)


def component(name, kind, rows):
    """A CMBLOCK of nodes or elements."""
    numbers = [row + 1 for row in rows]
    lines = [f"CMBLOCK,{name:<8s},{kind:<4s},{len(numbers):8d}", "(8i10)"]
    lines += ["".join(f"{v:10d}" for v in numbers[at : at + 8]) for at in range(0, len(numbers), 8)]
    return "\n".join(lines) + "\n"


def write_med(path, points, blocks, cell_groups, point_groups):
    """A MED file: blocks (kind, cells, family of each), names of the groups of families."""
    families = np.zeros(len(points), dtype=int)
    for family, rows in point_groups["rows"].items():
        families[rows] = family
    mesh = meshio.Mesh(
        points,
        [(kind, cells) for kind, cells, _ in blocks],
        point_data={"point_tags": families},
        cell_data={"cell_tags": [np.asarray(held) for _, _, held in blocks]},
    )
    mesh.cell_tags, mesh.point_tags = cell_groups, point_groups["names"]
    meshio.write(path, mesh, file_format="med")
