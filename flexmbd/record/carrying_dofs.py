"""Six dofs of a body's nodes that tell its rigid motion; numpy and scipy alone, for reductions and exports."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from flexmbd.record.groups import FloatArray, IntArray

# Relative size below which a rigid motion leaves nodes at rest.
_AT_REST = 1e-6


def carrying_dofs(x: FloatArray) -> IntArray | None:
    """Six of the 3 k displacements of nodes, far apart, in which any two rigid motions differ; pivots of a QR.

    Args:
        x: (k, 3) m, the nodes.

    Returns:
        (6,) ascending, 3 node + axis; None where the nodes lie in one line.
    """
    arms = x - x.mean(axis=0)
    turns = np.stack([np.cross(axis, arms) for axis in np.eye(3)], axis=2)
    reach = float(abs(arms).max()) or 1.0
    rows = np.concatenate([np.tile(np.eye(3), (len(x), 1, 1)), turns / reach], axis=2).reshape(-1, 6)
    upper, order = scipy.linalg.qr(rows.T, mode="r", pivoting=True)
    if len(rows) < 6 or not abs(upper[5, 5]) > _AT_REST:
        return None
    return np.sort(order[:6]).astype(np.int64)
