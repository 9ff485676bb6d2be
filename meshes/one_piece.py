"""The pieces that the solids of a file fall into, of which one is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from flexmbd.errors import MeshError
from flexmbd.meshes.cell_faces import FACES, FaceTable, faces_of
from flexmbd.meshes.tetrahedra import Cells

# Pieces that a message describes.
_NAMED = 4


def one_piece(
    path: Path, points: npt.NDArray[np.float64], blocks: Sequence[Cells], piece: int | None
) -> list[Cells]:
    """The cells of one of the pieces that share no facet, large ones first; not collective.

    Args:
        path: of the file, for messages.
        points: (n, 3), m.
        blocks: all cells.
        piece: from 1; None where there is only one.

    Raises:
        MeshError: there are several and none was asked for, or not so many.
    """
    labels = _labels(blocks, len(points))
    sizes = np.bincount(labels)
    order = np.argsort(-sizes, kind="stable")
    if piece is None and len(sizes) == 1:
        return list(blocks)
    if piece is None or piece > len(sizes):
        middles = np.concatenate([points[one.corners].mean(axis=1) for one in blocks])
        places = []
        for k in order[:_NAMED]:
            middle = [float(f"{x:.4g}") for x in middles[labels == k].mean(axis=0)]
            places.append(f"{sizes[k]} cells around {middle} m")
        more = ", ..." if len(sizes) > _NAMED else ""
        asked = "" if piece is None else f"piece is {piece}, and "
        raise MeshError(
            f"{path}: {asked}the mesh falls into {len(sizes)} pieces that share no facet: {', '.join(places)}{more}; "
            "take one of them with piece=1, ..., or join them where the mesh was made"
        )
    mask = np.split(labels == order[piece - 1], np.cumsum([len(one.rows) for one in blocks])[:-1])
    kept = [
        replace(one, rows=one.rows[held], tags=one.tags[held], numbers=one.numbers[held])
        for one, held in zip(blocks, mask, strict=True)
    ]
    return [one for one in kept if len(one.rows) > 0]


def _labels(blocks: Sequence[Cells], n: int) -> npt.NDArray[np.int64]:
    """The piece of each cell, all blocks' one after another."""
    table = FaceTable([faces_of(one.cell, one.corners) for one in blocks], n)
    starts = np.cumsum([0, *(len(one.rows) for one in blocks)])
    cells = np.concatenate(
        [np.tile(np.arange(start, start + len(one.rows)), len(FACES[one.cell]))
         for start, one in zip(starts, blocks, strict=False)]
    )  # fmt: skip
    order = np.argsort(table.of_cells, kind="stable")
    faces, cells = table.of_cells[order], cells[order]
    same = faces[1:] == faces[:-1]
    total = int(starts[-1])
    one, other = cells[:-1][same], cells[1:][same]
    links = coo_array((np.ones(len(one), dtype=np.int8), (one, other)), (total, total))
    labels: npt.NDArray[np.int64] = connected_components(links, directed=False)[1].astype(np.int64)
    return labels
