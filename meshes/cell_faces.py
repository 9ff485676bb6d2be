"""Faces of solid cells by their vertices in VTK's order, and the faces of a whole mesh by number."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

IntArray = npt.NDArray[np.int64]

#: By basix's name of the cell, the vertices of each face, around; in the order of S1, S2, ... of Abaqus and CalculiX.
FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "tetrahedron": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    "prism": ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "pyramid": ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}

#: Vertices of each cell.
CORNERS = {"tetrahedron": 4, "hexahedron": 8, "prism": 6, "pyramid": 5, "triangle": 3, "quadrilateral": 4}


def padded(rows: IntArray) -> IntArray:
    """Rows of four vertices: -1 is the fourth of triangles."""
    if rows.shape[1] == 4:
        return rows
    return np.column_stack((rows, np.full(len(rows), -1, dtype=np.int64)))


def faces_of(cell: str, corners: IntArray) -> IntArray:
    """All faces of cells of one kind, (faces of a cell, cells, 4), -1 for the fourth vertex of triangles.

    Args:
        cell: basix's name.
        corners: (n, k) vertices of the cells, in VTK's order.
    """
    return np.stack([padded(corners[:, list(face)]) for face in FACES[cell]])


class FaceTable:
    """The faces of a mesh, each once, by numbers from 0.

    Attributes:
        rows: (n, 4) vertices of each, around.
        is_outer: (n,) whether it is of one cell only.
        of_cells: (faces of all cells,) which face each is, in the order given.
    """

    def __init__(self, every: Sequence[IntArray], n: int) -> None:
        """Args: faces of all cells, as `faces_of` gives them; how many vertices there are."""
        self._n = n + 1
        rows = np.concatenate([faces.reshape(-1, 4) for faces in every])
        low, high = self._halves(rows)
        self._low, self._high = np.unique(low), np.unique(high)
        key = np.searchsorted(self._low, low) * len(self._high) + np.searchsorted(self._high, high)
        self._keys, first, inverse, count = np.unique(
            key, return_index=True, return_inverse=True, return_counts=True
        )
        self.of_cells = inverse.reshape(-1)
        self.rows = rows[first]
        self.is_outer = count == 1

    def numbers(self, rows: IntArray) -> IntArray:
        """Which faces rows of four vertices are; -1 for those that are none."""
        found = np.full(len(rows), -1, dtype=np.int64)
        if len(rows) == 0:
            return found
        low, high = self._halves(rows)
        a, b = (np.minimum(np.searchsorted(held, key), len(held) - 1) for held, key in
                ((self._low, low), (self._high, high)))  # fmt: skip
        key = a * len(self._high) + b
        at = np.minimum(np.searchsorted(self._keys, key), len(self._keys) - 1)
        there = (self._low[a] == low) & (self._high[b] == high) & (self._keys[at] == key)
        found[there] = at[there]
        return found

    def _halves(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        a, b, c, d = np.sort(rows, axis=1).T
        return (a + 1) * self._n + b, c * self._n + d
