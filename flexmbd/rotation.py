"""Rotation matrices and quaternions for users' input and output; numpy only.

Quaternions are unit, scalar first, multiplied Hamilton's way.  ``R_AB`` takes B's axes to A's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers
from flexmbd.round_off import TEN_DIGITS

FloatArray = NDArray[np.float64]

#: Rotations that bring the z axis onto a named axis, cyclically.
_NAMED = {
    "x": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "y": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "z": np.eye(3),
}

Axis = str | tuple[float, float, float]


def z_onto(axis: Axis) -> FloatArray:
    """Return a (3, 3) rotation whose third column is ``axis``.

    Args:
        axis: "x", "y", "z" or a vector of any length but zero.

    Raises:
        SceneError: the axis is not one of these.
    """
    if isinstance(axis, str):
        if axis not in _NAMED:
            raise SceneError(f"axis {axis!r} is not known; use 'x', 'y', 'z' or a vector (3,)")
        return _NAMED[axis]
    vector = numbers(axis)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0.0):
        raise SceneError(f"axis {axis!r} has no direction; give three numbers, not all zero")
    z = vector / length
    helper = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(helper, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def from_quaternion(q: ArrayLike) -> FloatArray:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def to_quaternion(R: ArrayLike) -> FloatArray:
    """Unit quaternions (..., 4) with non-negative scalar part of rotation matrices (..., 3, 3)."""
    m = np.asarray(R, dtype=np.float64)
    # the eigenvector of the largest eigenvalue: well conditioned for every angle; eigh reads the lower triangle
    k = np.zeros((*m.shape[:-2], 4, 4))
    k[..., 0, 0] = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    k[..., 1, 0] = m[..., 2, 1] - m[..., 1, 2]
    k[..., 1, 1] = m[..., 0, 0] - m[..., 1, 1] - m[..., 2, 2]
    k[..., 2, 0] = m[..., 0, 2] - m[..., 2, 0]
    k[..., 2, 1] = m[..., 0, 1] + m[..., 1, 0]
    k[..., 2, 2] = m[..., 1, 1] - m[..., 0, 0] - m[..., 2, 2]
    k[..., 3, 0] = m[..., 1, 0] - m[..., 0, 1]
    k[..., 3, 1] = m[..., 0, 2] + m[..., 2, 0]
    k[..., 3, 2] = m[..., 1, 2] + m[..., 2, 1]
    k[..., 3, 3] = m[..., 2, 2] - m[..., 0, 0] - m[..., 1, 1]
    q = np.linalg.eigh(k)[1][..., :, -1]
    return np.where(q[..., :1] >= 0.0, q, -q)


def check_rotation(R: ArrayLike, what: str) -> FloatArray:
    """Return ``R`` as a (3, 3) array.

    Raises:
        SceneError: it is not a proper rotation to 1e-9; ``what`` names it in the message.
    """
    m = numbers(R)
    if m.shape != (3, 3) or not np.isfinite(m).all():
        raise SceneError(f"{what}: expected a finite rotation matrix (3, 3), got {m.shape}")
    error = float(np.abs(m.T @ m - np.eye(3)).max())
    if error > TEN_DIGITS or np.linalg.det(m) < 0.0:
        raise SceneError(
            f"{what}: not a rotation (|R^T R - 1| = {error:.1e}, det = {np.linalg.det(m):.3f}); "
            "orthonormalise it, right-handed"
        )
    return m
