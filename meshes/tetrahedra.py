"""Solid cells of any kind cut into tetrahedra, neighbours alike.

A quadrilateral is cut from its lowest vertex, so that both cells at it agree, and a cell into the tetrahedra that its
lowest vertex spans with the triangles of all faces that it is not on (J. Dompierre, P. Labbé, M.-G. Vallet,
R. Camarero, How to subdivide pyramids, prisms, and hexahedra into tetrahedra, 8th International Meshing Roundtable,
1999).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flexmbd.meshes.cell_faces import CORNERS, FACES

Points = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# Vertices of the edges whose middles follow the vertices, in VTK's order.
EDGES = {
    "tetrahedron": ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)),
    "hexahedron": (
        (0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7),
    ),
    "prism": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "pyramid": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
}  # fmt: skip

# Where the middle of each face stands, if there is one.
_OF_FACES = {"hexahedron": (24, 25, 22, 21, 23, 20), "prism": (0, 0, 15, 16, 17), "pyramid": (13, 0, 0, 0, 0)}


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of one kind as rows of points.

    Attributes:
        cell: basix's name.
        rows: (n, k) in VTK's order; k is the number of vertices, or more with the middles of edges, then of faces.
        tags: (n,) of their groups.
        numbers: (n,) the file's.
    """

    cell: str
    rows: IntArray
    tags: npt.NDArray[np.int32]
    numbers: IntArray

    @property
    def corners(self) -> IntArray:
        """(n, vertices)."""
        return self.rows[:, : CORNERS[self.cell]]

    @property
    def is_curved(self) -> bool:
        """Whether the edges have middles."""
        return self.rows.shape[1] > CORNERS[self.cell]


def cut_cells(points: Points, blocks: Sequence[Cells]) -> tuple[Points, Cells]:
    """Tetrahedra of 4 nodes, or of 10 where any of the cells has middles of edges, in VTK's order.

    An edge that has no middle gets one halfway. The middle of a new edge is where the cell's own shape functions put
    it: of a face's diagonal in the face's middle, of a hexahedron's in its own.

    Returns:
        The points, new ones after those that were there, and the cells with the tags and numbers of those they are of.
    """
    parts = [_cut(block) for block in blocks]
    corners, tags, numbers = (np.concatenate([part[i] for part in parts]) for i in range(3))
    if any(block.is_curved for block in blocks):
        points, corners = _with_middles(points, blocks, corners)
    return points, Cells("tetrahedron", corners, tags.astype(np.int32), numbers)


def cut_faces(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Triangles (m, 3) of faces (n, 4) as cells are cut, and which face each is of."""
    triangle = rows[:, 3] < 0
    first, second = _halves(rows[~triangle])
    of = np.flatnonzero(~triangle)
    return np.concatenate((rows[triangle, :3], first, second)), np.concatenate((np.flatnonzero(triangle), of, of))


def _halves(quads: IntArray) -> tuple[IntArray, IntArray]:
    """The two triangles of quadrilaterals (n, 4), by the diagonal from the lowest vertex."""
    start = quads.argmin(axis=1)
    turned = np.take_along_axis(quads, (start[:, None] + np.arange(4)) % 4, axis=1)
    return turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]


def _cut(block: Cells) -> tuple[IntArray, npt.NDArray[np.int32], IntArray]:
    """Vertices, tags and numbers of the tetrahedra of cells of one kind."""
    if block.cell == "tetrahedron":
        return block.corners, block.tags, block.numbers
    corners = block.corners
    lowest = corners.min(axis=1)
    found, of = [], []
    for face in FACES[block.cell]:
        rows = corners[:, list(face)]
        away = np.flatnonzero((rows != lowest[:, None]).all(axis=1))
        for triangle in _halves(rows[away]) if len(face) == 4 else (rows[away],):
            found.append(np.column_stack((lowest[away], triangle)))
            of.append(away)
    which = np.concatenate(of)
    order = np.argsort(which, kind="stable")
    return np.concatenate(found)[order], block.tags[which[order]], block.numbers[which[order]]


def _with_middles(points: Points, blocks: Sequence[Cells], corners: IntArray) -> tuple[Points, IntArray]:
    """The middles of the edges of tetrahedra, those of the cells' own where these have some."""
    n = len(points)
    own_keys: list[IntArray] = []
    own_rows: list[IntArray] = []
    for block in blocks:
        edges = EDGES[block.cell]
        if block.is_curved:
            own_keys.append(np.concatenate([_key(block.rows[:, [a, b]], n) for a, b in edges]))
            k = CORNERS[block.cell]
            own_rows.append(block.rows[:, k : k + len(edges)].T.reshape(-1))
    known, at = np.unique(np.concatenate(own_keys), return_index=True)
    rows = np.concatenate(own_rows)[at]
    needed = np.unique(np.concatenate([_key(corners[:, [a, b]], n) for a, b in EDGES["tetrahedron"]]))
    new = needed[~np.isin(needed, known)]
    low, high = new // n, new % n
    places = (points[low] + points[high]) / 2
    for block in blocks:
        for keys, middles in _inner_middles(points, block, n):
            where = np.minimum(np.searchsorted(new, keys), len(new) - 1)
            inside = new[where] == keys if len(new) else np.zeros(len(keys), dtype=bool)
            places[where[inside]] = middles[inside]
    keys = np.concatenate((known, new))
    every = np.concatenate((rows, n + np.arange(len(new))))
    order = np.argsort(keys)
    keys, every = keys[order], every[order]
    middle = [every[np.searchsorted(keys, _key(corners[:, [a, b]], n))] for a, b in EDGES["tetrahedron"]]
    return np.vstack((points, places)), np.column_stack((corners, *middle))


def _inner_middles(points: Points, block: Cells, n: int) -> list[tuple[IntArray, Points]]:
    """Diagonals of faces and hexahedra as keys, and the places of their middles."""
    if not block.is_curved or block.cell == "tetrahedron":
        return []
    edges = {frozenset(edge): CORNERS[block.cell] + i for i, edge in enumerate(EDGES[block.cell])}
    own = block.rows.shape[1] > CORNERS[block.cell] + len(edges)
    found = []
    for face, column in zip(FACES[block.cell], _OF_FACES[block.cell], strict=True):
        if len(face) != 4:
            continue
        around = [edges[frozenset((face[i], face[(i + 1) % 4]))] for i in range(4)]
        middle = 0.5 * points[block.rows[:, around]].sum(axis=1) - 0.25 * points[block.rows[:, list(face)]].sum(axis=1)
        if own:
            middle = points[block.rows[:, column]]
        for a, b in ((face[0], face[2]), (face[1], face[3])):
            found.append((_key(block.rows[:, [a, b]], n), middle))
    if block.cell == "hexahedron":
        x = points[block.rows]
        middle = x[:, 26] if own else 0.25 * (x[:, 8:20].sum(axis=1) - x[:, :8].sum(axis=1))
        for a, b in ((0, 6), (1, 7), (2, 4), (3, 5)):
            found.append((_key(block.rows[:, [a, b]], n), middle))
    return found


def _key(edges: IntArray, n: int) -> IntArray:
    """A number for each edge (m, 2)."""
    return edges.min(axis=1) * n + edges.max(axis=1)
