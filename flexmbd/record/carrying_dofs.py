"""Six dofs of a body's nodes that tell its rigid motion; numpy alone, for reductions and exports."""

from __future__ import annotations

import numpy as np

from flexmbd.record.groups import FloatArray, IntArray

#: Relative size below which a rigid motion leaves nodes at rest; found from squares, whose rounding is that of 1e-8.
AT_REST = 1e-6
# Relative difference of squares below which two dofs are equally good: far above round-off, by which the nodes of a
# symmetric mesh differ, and which is another on each processor and number of ranks.
_EQUAL = 1e-6


def carrying_dofs(x: FloatArray) -> IntArray | None:
    """Six of the 3 k displacements of nodes, far apart, in which any two rigid motions differ.

    Args:
        x: (k, 3) m, the nodes.

    Returns:
        (6,) ascending, 3 node + axis; of equally good ones the first. None where the nodes lie in one line.
    """
    arms = x - x.mean(axis=0)
    turns = np.stack([np.cross(axis, arms) for axis in np.eye(3)], axis=2)
    reach = float(abs(arms).max()) or 1.0
    rows = np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), turns / reach], axis=2).reshape(-1, 6)
    chosen, sizes = independent_rows(rows)
    if len(chosen) < 6 or not sizes[-1] > AT_REST:
        return None
    return np.sort(chosen)


def independent_rows(rows: FloatArray) -> tuple[IntArray, FloatArray]:
    """Rows that are far from depending on each other: each is the largest of what the former leave of all.

    That is a QR factorisation with pivots, in which the first of equally large rows is taken, whatever round-off says.

    Args:
        rows: (n, m).

    Returns:
        (at most m,) indices in the order of their choice, and the sizes of what was left of each, descending.
    """
    left = np.array(rows, dtype=np.float64)
    chosen, sizes = [], []
    for _ in range(min(rows.shape)):
        squares = np.einsum("ij,ij->i", left, left)
        first = int(np.argmax(squares >= (1.0 - _EQUAL) * squares.max()))
        size = float(np.sqrt(squares[first]))
        if size == 0.0:
            break
        direction = left[first] / size
        left -= np.outer(left @ direction, direction)
        chosen.append(first)
        sizes.append(size)
    return np.array(chosen, dtype=np.int64), np.array(sizes)
