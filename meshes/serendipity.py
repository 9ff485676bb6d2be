"""Hexahedra of 20 nodes, as other programs have them, completed to 27.

The middles of the faces and of the cell are placed where the map of 20 nodes takes them, so that the
shape of the cell stays as it is.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Points = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

# In VTK's order: the corners and the middles of the edges of each face, around.
_FACES = (
    ((0, 3, 7, 4), (11, 19, 15, 16)),
    ((1, 2, 6, 5), (9, 18, 13, 17)),
    ((0, 1, 5, 4), (8, 17, 12, 16)),
    ((3, 2, 6, 7), (10, 18, 14, 19)),
    ((0, 1, 2, 3), (8, 9, 10, 11)),
    ((4, 5, 6, 7), (12, 13, 14, 15)),
)


def complete(points: Points, cells: IntArray) -> tuple[Points, IntArray]:
    """Add the nodes that hexahedra of 20 nodes lack; other cells are returned as they are.

    The shape functions of the 20 nodes are -1/4 at the corners and 1/2 at the middles of the edges of
    a face in its middle, and -1/4 and 1/4 in the middle of the cell.

    Args:
        points: (n, 3).
        cells: (m, k) rows of points, in VTK's order.

    Returns:
        The points, the new ones after those that were there, and (m, 27) cells in VTK's order.
    """
    if cells.shape[1] != 20:
        return points, cells
    x = points[cells]
    middles = [
        0.5 * x[:, list(edges)].sum(axis=1) - 0.25 * x[:, list(corners)].sum(axis=1)
        for corners, edges in _FACES
    ]
    sides = [np.sort(cells[:, list(corners)], axis=1) for corners, _ in _FACES]
    _, first, which = np.unique(
        np.concatenate(sides), axis=0, return_index=True, return_inverse=True
    )
    of_faces = np.concatenate(middles)[first]
    centres = 0.25 * (x[:, 8:].sum(axis=1) - x[:, :8].sum(axis=1))
    face_rows = len(points) + which.reshape(len(_FACES), len(cells)).T
    centre_rows = len(points) + len(of_faces) + np.arange(len(cells))
    every = np.vstack((points, of_faces, centres))
    return every, np.column_stack((cells, face_rows, centre_rows))
