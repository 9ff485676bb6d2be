"""How the face of an interface turns with a finite affine motion, in numpy: for the reduction and for tests."""

from __future__ import annotations

import numpy as np

from flexmbd.record.groups import FloatArray


def turned_face(gradient: FloatArray, slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rotation of a face, and its variation.

    With I + A = R U, the polar decomposition, R^T dR = [w] fulfils (tr(U) 1 - U) w = 2 ax(R^T dA), ax being the axial
    vector of the skew part.

    Args:
        gradient: (3, 3) I + A.
        slopes: (3, 3, n) dA per coordinate.

    Returns:
        R (3, 3); (3, n) small rotation, in the same axes as A, per coordinate.
    """
    left, _, right = np.linalg.svd(gradient)
    R = left @ right
    U = R.T @ gradient
    back = np.einsum("ba,bcn->acn", R, slopes)
    axial = np.stack([back[2, 1] - back[1, 2], back[0, 2] - back[2, 0], back[1, 0] - back[0, 1]])
    return R, R @ np.linalg.solve(np.trace(U) * np.eye(3) - U, axial)
