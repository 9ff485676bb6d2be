"""The logarithm of a pose: the screw motion that leads from one section to another, and how it changes with the pose.

Sonneville, Cardona & Bruels 2014 (Geometrically exact beam finite element formulated on the special Euclidean group,
doi:10.1016/j.cma.2013.10.008).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

# Square of the angle (rad^2) below which a series is taken: e is a difference of near numbers there.
_SMALL = 0.05


def pose_logarithm(d: FloatArray, R: FloatArray) -> FloatArray:
    """(..., 6) (J^-1 d, theta), m and rad, of frames G in F: d (..., 3) m from F to G and R (..., 3, 3) = R_FG."""
    theta = _rotation_vector(R)
    e, _ = _coefficient(np.sum(theta**2, axis=-1))
    once = np.cross(theta, d)
    return np.concatenate([d - 0.5 * once + e[..., None] * np.cross(theta, once), theta], axis=-1)


def logarithm_change(d: FloatArray, R: FloatArray) -> FloatArray:
    """(6, 6) change of ``pose_logarithm`` with a displacement of G and a small rotation of G, both in F's axes.

    Args:
        d: (3,) m.
        R: (3, 3).
    """
    theta = _rotation_vector(R)
    e, slope = _coefficient(theta @ theta)
    turn = _skew(theta)
    inverse = np.eye(3) - 0.5 * turn + e * turn @ turn
    once = np.asarray(np.cross(theta, d), dtype=np.float64)
    twice = np.asarray(np.cross(theta, once), dtype=np.float64)
    by_theta = 0.5 * _skew(d) - e * (_skew(once) + turn @ _skew(d)) + 2.0 * slope * np.outer(twice, theta)
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = inverse
    change[:3, 3:] = by_theta @ inverse
    return change


def _rotation_vector(R: FloatArray) -> FloatArray:
    """(..., 3) rad, of (..., 3, 3)."""
    from scipy.spatial.transform import Rotation  # on need: few scenes have beams

    vectors: FloatArray = Rotation.from_matrix(R.reshape(-1, 3, 3)).as_rotvec()
    return vectors.reshape(R.shape[:-1])


def _skew(v: FloatArray) -> FloatArray:
    """[v] (3, 3), the matrix of the cross product."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _coefficient(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(e, de/dx) with J^-1 = I - [v] / 2 + e [v]^2, x = |v|^2."""
    near = np.minimum(x, _SMALL)
    far = np.maximum(x, _SMALL)
    e = np.polyval([691 / 1307674368000, 1 / 47900160, 1 / 1209600, 1 / 30240, 1 / 720, 1 / 12], near)
    slope = np.polyval([5 * 691 / 1307674368000, 4 / 47900160, 3 / 1209600, 2 / 30240, 1 / 720], near)
    half = 0.5 * np.sqrt(far)
    e_far = (1.0 - half / np.tan(half)) / far
    slope_far = (0.125 - 1.5 * e_far + 0.5 * far * e_far**2) / far
    return np.where(x < _SMALL, e, e_far), np.where(x < _SMALL, slope, slope_far)
