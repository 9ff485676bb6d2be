"""Two cubes of reference cells bent by a known map, and files of other programs that list them.

The order of a cell's nodes is written down from the manuals: Abaqus's and Nastran's solids number the
middles of edges alike in tetrahedra; in hexahedra Abaqus goes round the bottom, the top, then the
uprights, Nastran round the bottom, the uprights, then the top.
"""

import itertools
from dataclasses import dataclass

import numpy as np

TETRAHEDRON_EDGES = ("01", "12", "02", "03", "13", "23")
AROUND = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
BOTTOM, TOP, UPRIGHT = ("01", "12", "23", "30"), ("45", "56", "67", "74"), ("04", "15", "26", "37")
HEXAHEDRON_EDGES = {"abaqus": (*BOTTOM, *TOP, *UPRIGHT), "nastran": (*BOTTOM, *UPRIGHT, *TOP)}

# Abaqus's faces, by the numbers of vertices from 1.
FACES = {
    "tetrahedron": ("123", "142", "243", "341"),
    "hexahedron": ("1234", "5876", "1562", "2673", "3784", "4851"),
}


def bend(reference):
    """A map with terms that hexahedra of 20 nodes and, without the last, tetrahedra of 10 have."""
    x, y, z = np.asarray(reference, dtype=float).T
    return np.stack(
        (
            x + 0.1 * y + 0.05 * y * y - 0.04 * x * z,
            0.9 * y - 0.2 * z + 0.06 * x * x + 0.03 * z * z,
            1.1 * z + 0.1 * x - 0.05 * x * y + 0.04 * x * x,
        ),
        axis=1,
    )


def bend_cubically(reference):
    x, y, z = np.asarray(reference, dtype=float).T
    return bend(reference) + 0.05 * np.stack((x * y * y * z, x * x * z, y * y * x), axis=1)


def shear(reference):
    return np.asarray(reference) @ [[1.0, 0.1, 0.0], [0.0, 0.8, 0.2], [0.3, 0.0, 1.2]]


@dataclass(frozen=True)
class Lattice:
    """Nodes by their places in the reference, and cells as rows of them in a program's order."""

    cell: str
    reference: np.ndarray
    cells: np.ndarray
    map: object

    @property
    def points(self):
        return self.map(self.reference)

    def at(self, axis, place):
        """Rows of the nodes in a plane of the reference."""
        return np.flatnonzero(abs(self.reference[:, axis] - place) < 1e-9)

    def faces(self, axis, place):
        """(cell, number of the face from 1) of the faces in a plane of the reference."""
        inside = set(self.at(axis, place))
        return [
            (i, number)
            for i, cell in enumerate(self.cells)
            for number, face in enumerate(FACES[self.cell], start=1)
            if {cell[int(vertex) - 1] for vertex in face} <= inside
        ]


def lattice(cell, degree, *, program="abaqus", map=bend):
    """Two cubes along x; as tetrahedra six to each."""
    places, cells = {}, []
    for i in range(2):
        cube = np.array(AROUND, dtype=float) + np.array((i, 0, 0))
        if cell == "hexahedron":
            shapes, edges = [cube], HEXAHEDRON_EDGES[program]
        else:
            shapes, edges = [], TETRAHEDRON_EDGES
            for order in itertools.permutations(range(3)):
                corners = np.vstack((np.zeros(3), np.cumsum(np.eye(3)[list(order)], axis=0)))
                even = np.linalg.det(np.diff(corners, axis=0)) > 0
                shapes.append(corners[[0, 1, 2, 3] if even else [0, 2, 1, 3]] + (i, 0, 0))
        for corners in shapes:
            further = [corners[[int(a), int(b)]].mean(axis=0) for a, b in edges] if degree == 2 else []
            nodes = [tuple(x) for x in np.vstack((corners, *further))]
            cells.append([places.setdefault(x, len(places)) for x in nodes])
    return Lattice(cell, np.array(list(places)), np.array(cells), map)


def moments(map):
    """Volume, first and second moments of the bent cubes, by Gauss's rule over the reference."""
    x, w = np.polynomial.legendre.leggauss(8)
    t, w = (x + 1) / 2, w / 2
    grid = np.array(list(itertools.product(t, t, t)))
    weights = np.array([np.prod(x) for x in itertools.product(w, w, w)])
    found = np.zeros((4, 4))
    for i in range(2):
        at, h = grid + np.array((i, 0, 0)), 1e-3
        # exact for these polynomials, of degree 4 at most in each variable
        steps = [(map(at + h * e) - map(at - h * e)) / (2 * h) for e in np.eye(3)]
        wide = [(map(at + 2 * h * e) - map(at - 2 * h * e)) / (4 * h) for e in np.eye(3)]
        jacobian = np.stack([(4 * a - b) / 3 for a, b in zip(steps, wide, strict=True)], axis=1)
        fields = np.column_stack((np.ones(len(at)), map(at)))
        found += np.einsum("q,qi,qj->ij", weights * np.linalg.det(jacobian), fields, fields)
    return found


# Numbers with gaps, in no order.
def node_numbers(n):
    return 1000 - 7 * np.arange(n)


def element_numbers(n):
    return 5 + 3 * np.arange(n)


def rows_of(numbers, *, width=8):
    numbers = list(map(str, numbers))
    return ",\n".join(", ".join(numbers[i : i + width]) for i in range(0, len(numbers), width))


TYPES = {
    ("tetrahedron", 1): "C3D4",
    ("tetrahedron", 2): "C3D10",
    ("hexahedron", 1): "C3D8R",
    ("hexahedron", 2): "C3D20",
}
SHELLS = {("tetrahedron", 1): "S3", ("tetrahedron", 2): "STRI65", ("hexahedron", 1): "S4", ("hexahedron", 2): "S8R"}
CARDS = {"tetrahedron": "CTETRA", "hexahedron": "CHEXA"}
SHELL_CARDS = {("tetrahedron", 1): "CTRIA3", ("hexahedron", 1): "CQUAD4"}


def inp(part, degree):
    """An input file: two sets of cells, a surface at x = 0, nodes at x = 2, a corner, shells on y = 0."""
    nodes, elements = node_numbers(len(part.points)), element_numbers(len(part.cells))
    half = len(part.cells) // 2
    lines = ["** two cubes", "*Heading", " a title, with a comma", "*NODE, NSET=all_nodes"]
    text = [f"{n}, {x!r}, {y!r}, {z!r}" for n, (x, y, z) in zip(nodes, part.points.tolist(), strict=True)]
    cut = len(text) // 2
    lines += [*text[:cut], "** in two parts", "*Node", *text[cut:]]
    kind = TYPES[part.cell, degree]
    for name, chosen in (("", range(half)), (", ELSET=Right", range(half, 2 * half))):
        lines.append(f"*Element, type={kind.lower()}{name}")
        for i in chosen:
            lines.append(f"{elements[i]}, {rows_of(nodes[part.cells[i]])}")
    skin = 9000
    if degree == 1:
        lines.append(f"*ELEMENT, TYPE={SHELLS[part.cell, degree]}, ELSET=skin")
        for i, number in part.faces(1, 0.0):
            vertices = [part.cells[i][int(v) - 1] for v in FACES[part.cell][number - 1]]
            lines.append(f"{skin + len(lines)}, {rows_of(nodes[vertices])}")
    lines += ["*ELSET, ELSET=left, GENERATE", f"{elements[0]}, {elements[half - 1]}, 3"]
    for number in range(1, len(FACES[part.cell]) + 1):
        held = [elements[i] for i, face in part.faces(0, 0.0) if face == number]
        if held:
            lines += [f"*ELSET, ELSET=_foot_S{number}", rows_of(held)]
    lines.append("*SURFACE, NAME=foot, TYPE=ELEMENT")
    for number in sorted({face for _, face in part.faces(0, 0.0)}):
        lines.append(f"_foot_S{number}, S{number}")
    lines += ["*NSET, NSET=half_end", rows_of(nodes[part.at(0, 2.0)][::2])]
    lines += ["*NSET, NSET=end", "HALF_END,", rows_of(nodes[part.at(0, 2.0)][1::2])]
    corner = np.flatnonzero((part.reference == (2, 1, 1)).all(axis=1))
    lines += ["*NSET, NSET=corner", rows_of(nodes[corner]), "*MATERIAL, NAME=steel", "*ELASTIC", "2.1e11, 0.3"]
    return "\n".join(lines) + "\n"


def bdf(part, degree, *, fields="fixed"):
    """Bulk data: the left cube of property 3, the right of 4; with degree 1, shells of 8 on x = 0."""
    nodes, elements = node_numbers(len(part.points)), element_numbers(len(part.cells))
    lines = ["$ two cubes", "SOL 101", "CEND", "BEGIN BULK", "MAT1,1,2.1+11,,0.3,7850.", "PSOLID,3,1", "PSOLID,4,1"]
    for n, (x, y, z) in zip(nodes, part.points.tolist(), strict=True):
        if fields == "fixed":
            lines.append(f"GRID*   {n:<16d}{'':<16}{x:>16.9E}{y:>16.9E}{'*':<8}")
            lines.append(f"{'*':<8}{z:>16.9E}")
        else:
            lines.append(f"GRID,{n},,{x!r},{y!r},{z!r}")
    half = len(part.cells) // 2
    cards = [
        (CARDS[part.cell], elements[i], 3 if i < half else 4, nodes[cell]) for i, cell in enumerate(part.cells)
    ]
    if degree == 1:
        for k, (i, number) in enumerate(part.faces(0, 0.0)):
            vertices = [part.cells[i][int(v) - 1] for v in FACES[part.cell][number - 1]]
            cards.append((SHELL_CARDS[part.cell, 1], 9000 + k, 8, nodes[vertices]))
    for card, number, owner, held in cards:
        values = [str(number), str(owner), *map(str, held)]
        pieces = [values[:8], *(values[i : i + 8] for i in range(8, len(values), 8))]
        for k, piece in enumerate(pieces):
            head = card if k == 0 else "+"
            if fields == "fixed":
                lines.append("".join(f"{value:<8}" for value in [head, *piece]))
            else:
                lines.append(",".join([head, *piece]))
            if k + 1 < len(pieces):
                lines[-1] += "+" if fields == "fixed" else ",+"
    return "\n".join([*lines, "ENDDATA"]) + "\n"
