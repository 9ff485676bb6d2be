"""Where the camera stands: one place for a whole film, chosen from the extents of the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection.

    Attributes:
        focus: (3,) m, what stands in the middle of the picture.
        towards: (3,) unit vector from the focus to the camera.
        up: (3,) unit vector.
        half_height: m, half of what the picture's height shows.
        distance: m, from the focus to the camera.
    """

    focus: FloatArray
    towards: FloatArray
    up: FloatArray
    half_height: float
    distance: float


def viewing_axes(
    places: FloatArray, gravity: ArrayLike, view: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Choose (towards, up) for a motion that visits ``places`` (k, 3).

    A motion in a plane of two coordinate axes is seen along its normal, one in space from a
    corner.  Gravity points downwards; without it y points up in the x-y plane, and else z does.
    A unit vector ``view`` (3,) is taken as ``towards``.
    """
    g = np.asarray(gravity, dtype=np.float64)
    if view is not None:
        return view, _upwards(view, g)
    extent = np.ptp(places, axis=0)
    flat = extent <= 0.02 * extent.max()
    # where a motion along a line leaves a choice: gravity is the last direction to look along
    normal = next((k for k in sorted((2, 1, 0), key=lambda k: abs(g[k])) if flat[k]), None)
    up = -g
    if normal is not None:
        up[normal] = 0.0
    if not up.any():
        up = np.eye(3)[1 if normal == 2 else 2]
    if normal is None:
        towards = _corner(up)
    else:
        towards = np.eye(3)[normal] * (-1.0 if normal == 1 else 1.0)  # x, or else y, to the right
    up = up - towards * (up @ towards)
    return towards, up / np.linalg.norm(up)


def _upwards(towards: FloatArray, gravity: FloatArray) -> FloatArray:
    """Against gravity, or z or y, as seen from ``towards``: the first of them that is not looked along."""
    for up in (-gravity, np.eye(3)[2], np.eye(3)[1]):
        across = up - towards * (up @ towards)
        size = float(np.linalg.norm(across))
        if size > 1e-6 * float(np.linalg.norm(up)) > 0.0:
            break
    return np.asarray(across / size)


def _corner(up: FloatArray) -> FloatArray:
    """A direction from which all three axes are seen, ``up`` more or less upwards."""
    k = int(np.argmax(np.abs(up)))
    towards = np.zeros(3)
    towards[k] = 0.5 * np.sign(up[k])
    towards[(k + 1) % 3] = 0.45
    towards[(k + 2) % 3] = -0.75 if k == 2 else 0.75
    return towards / np.linalg.norm(towards)


def frame_all(
    points: FloatArray,
    towards: FloatArray,
    up: FloatArray,
    *,
    aspect: float,
    above: float,
    below: float,
) -> Camera:
    """Place a camera that sees all ``points`` (k, 3).

    Args:
        points: m, in the inertial frame.
        towards: unit vector from the scene to the camera.
        up: unit vector.
        aspect: width of the picture over its height.
        above: share of the picture's height left free above the points.
        below: the same below.
    """
    axes = np.array([np.cross(up, towards), up, towards])
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = 0.5 * (high - low)
    half_height = max(half[1] / (1.0 - above - below), half[0] / (0.94 * aspect), 1e-9)
    middle = 0.5 * (low + high)
    middle[1] += (above - below) * half_height
    distance = 2.0 * half_height + 2.0 * half[2]
    return Camera(axes.T @ middle, towards, up, float(half_height), float(distance))


def oblique(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(towards, up): along the thinnest axis, from a little above and aside."""
    thin, middle, long = np.eye(3)[np.argsort(np.ptp(x, axis=0), kind="stable")]
    thin = np.cross(long, middle)  # right-handed: right, up, towards
    towards = thin + 0.35 * middle - 0.25 * long
    towards /= np.linalg.norm(towards)
    up = middle - towards * (middle @ towards)
    return towards, up / np.linalg.norm(up)
