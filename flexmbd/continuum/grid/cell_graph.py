"""Neighbouring cells of a mesh and their connected pieces: plain arrays, on one rank."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import basix
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

# A piece with fewer cells than this part of the largest one of its kind is a fragment; of tetrahedra also one
# with fewer than two bricks have.
_FRAGMENT, _TETRAHEDRA = 0.02, 12


def entity_table(cell: str, dim: int) -> IntArray:
    """(number, v) vertices of a cell's entities of one dimension, as its nodes."""
    return np.array(basix.topology(basix.CellType[cell])[dim], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Pairs of cells that share a facet.

    Attributes:
        a: (f,) cells.
        b: (f,) their neighbours.
        facets: (f, v) vertices of the facets as rows of points, in basix's order of an entity's vertices.
    """

    a: IntArray
    b: IntArray
    facets: IntArray

    def take(self, which: NDArray[np.bool_]) -> Neighbours:
        """Some of the pairs."""
        return Neighbours(self.a[which], self.b[which], self.facets[which])


def neighbours(cells: IntArray, cell: str, dim: int) -> Neighbours:
    """All pairs of cells (m, k) of dimension `dim` that share a facet."""
    table = entity_table(cell, dim - 1)
    every = cells[:, table].reshape(-1, table.shape[1])
    sorted_rows = np.sort(every, axis=1)
    order = np.lexsort(sorted_rows.T[::-1])
    ordered = sorted_rows[order]
    first = np.flatnonzero((ordered[1:] == ordered[:-1]).all(axis=1))
    one, other = order[first], order[first + 1]
    return Neighbours(one // len(table), other // len(table), every[one])


def owners(rows: IntArray, cells: IntArray, table: IntArray) -> tuple[IntArray, IntArray]:
    """Cells that have given entities.

    Args:
        rows: (e, v) vertices of entities, in any order.
        cells: (m, k).
        table: of `entity_table`.

    Returns:
        (p,) rows and (p,) cells; an entity that several cells share is there several times.
    """
    every = np.sort(cells[:, table].reshape(-1, table.shape[1]), axis=1)
    likely = np.flatnonzero(np.isin(every, rows).all(axis=1))
    sorted_rows = np.sort(rows, axis=1)
    unique, inverse = np.unique(np.vstack([sorted_rows, every[likely]]), axis=0, return_inverse=True)
    inverse = inverse.reshape(-1)
    row_of = np.full(len(unique), -1, dtype=np.int64)
    row_of[inverse[: len(rows)]] = np.arange(len(rows))
    found = row_of[inverse[len(rows) :]]
    return found[found >= 0], likely[found >= 0] // len(table)


def pieces_of(labels: IntArray, pairs: Neighbours) -> tuple[int, IntArray]:
    """Number of the connected pieces of cells with one label, and the piece of each cell."""
    same = labels[pairs.a] == labels[pairs.b]
    return components(pairs.a[same], pairs.b[same], len(labels))


def components(a: IntArray, b: IntArray, n: int) -> tuple[int, IntArray]:
    """Connected components of a graph of n nodes: their number, and the component of each node."""
    graph = coo_array((np.ones(len(a), dtype=np.int8), (a, b)), shape=(n, n))
    count, component = connected_components(graph, directed=False)
    return int(count), component.astype(np.int64)


def merge_fragments(labels: IntArray, pairs: Neighbours, cell: str) -> IntArray:
    """Labels after the few cells that hang on a cut alone went to the neighbour they share most facets with.

    A plane through a free mesh leaves such cells.
    """
    while True:
        count, piece = pieces_of(labels, pairs)
        sizes = np.bincount(piece, minlength=count)
        label = np.zeros(count, dtype=np.int64)
        label[piece] = labels
        largest = np.zeros(labels.max() + 1, dtype=np.int64)
        np.maximum.at(largest, label, sizes)
        least = np.maximum(_FRAGMENT * largest[label], _TETRAHEDRA if cell == "tetrahedron" else 0)
        fragments = (sizes < least) & (sizes < largest[label])
        # over each facet between a fragment and another piece, from the one's piece to the other's label
        left, right = piece[pairs.a], piece[pairs.b]
        ways = np.concatenate([np.column_stack([left, right]), np.column_stack([right, left])])
        ways = ways[fragments[ways[:, 0]] & ~fragments[ways[:, 1]]]
        if len(ways) == 0:
            return labels
        shared = np.zeros((count, len(largest)), dtype=np.int64)
        np.add.at(shared, (ways[:, 0], label[ways[:, 1]]), 1)
        moved = shared.any(axis=1)
        label[moved] = shared[moved].argmax(axis=1)
        labels = label[piece]


def patches(facets: IntArray) -> list[IntArray]:
    """Facets (f, v) connected by a vertex, as numbers of facets, in the order of the lowest."""
    _, vertex = np.unique(facets, return_inverse=True)
    n, width = facets.shape
    facet = np.repeat(np.arange(n), width)
    _, part = components(facet, n + vertex.reshape(-1), n + int(vertex.max()) + 1)
    of_facets = part[:n]
    _, first = np.unique(of_facets, return_index=True)
    return [np.flatnonzero(of_facets == of_facets[i]) for i in np.sort(first)]


def area_and_centre(facets: IntArray, points: FloatArray) -> tuple[float, FloatArray]:
    """Area (m^2; of edges length, of points number) of facets and its centre (3,), as of plane ones."""
    x = points[facets]
    match facets.shape[1]:
        case 1:
            area = np.ones(len(facets))
        case 2:
            area = np.linalg.norm(x[:, 1] - x[:, 0], axis=1)
        case 3:
            area = np.linalg.norm(np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), axis=1) / 2.0
        case _:
            # basix lists a quadrilateral row by row: 0 and 3 are opposite
            area = np.linalg.norm(np.cross(x[:, 3] - x[:, 0], x[:, 2] - x[:, 1]), axis=1) / 2.0
    return float(area.sum()), area @ x.mean(axis=1) / area.sum()


def along_part(middles: Sequence[FloatArray]) -> list[int]:
    """Order of points (3,) along the axis on which they lie widest apart."""
    x = np.array(middles)
    axis = int(np.ptp(x, axis=0).argmax())
    return [int(i) for i in np.argsort(x[:, axis], kind="stable")]
