"""Rigid motions among the modes of a file: taken out, since the frame of the body has them; they tell its inertia."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.record.groups import FloatArray

# Of the largest eigenvalue: no stiffness. Of the motion: what a rigid one may leave.
_NO_STIFFNESS, _RIGID = 1e-12, 1e-5


@dataclass(frozen=True, eq=False)
class SplitModes:
    """Modes of a free body in two parts.

    Attributes:
        elastic: (n, n - 6) combinations of the modes, in which the mass is the unit matrix, and which have no momentum.
        mass: (6, 6) of the rigid motions about the origin: translations (m), rotations (rad).
    """

    elastic: FloatArray
    mass: FloatArray


def split_modes(
    stiffness: FloatArray, mass: FloatArray, *, x: FloatArray, shapes: FloatArray
) -> SplitModes | None:
    """Take six rigid motions out of a file's modes; None: there are none among them.

    Args:
        stiffness: (n, n) group 10.
        mass: (n, n) group 9.
        x: (k, 3) m, nodes.
        shapes: (k, 6, n) displacements and rotations of the nodes by the modes.

    Raises:
        ExportError: there are others than six; the nodes do not tell them, or move otherwise; the mass is not positive
            definite.
    """
    import scipy.linalg

    size = 1.0 / np.sqrt(np.diag(mass).clip(min=np.finfo(float).tiny))
    grid = np.outer(size, size)
    try:
        values, vectors = scipy.linalg.eigh(
            0.5 * (stiffness + stiffness.T) * grid, 0.5 * (mass + mass.T) * grid
        )
    except np.linalg.LinAlgError as error:
        raise ExportError("the reduced mass is not positive definite: its modes depend on each other") from error
    rigid = abs(values) <= _NO_STIFFNESS * values[-1]
    if not rigid.any():
        return None
    vectors = size[:, None] * vectors
    if np.count_nonzero(rigid) != 6:
        raise ExportError(
            "the reduced stiffness is not positive definite: among its modes are rigid motions, which the frame of the "
            f"body has already, {np.count_nonzero(rigid)} of six: leave them out"
        )
    moved = shapes @ vectors[:, rigid]
    # rigid motion of each node by a translation and a rotation about the origin
    motions = np.zeros((len(x), 6, 6))
    motions[:, :3, :3] = motions[:, 3:, 3:] = np.eye(3)
    motions[:, :3, 3:] = np.cross(np.eye(3), x[:, None, :]).swapaxes(1, 2)
    turns = bool(shapes[:, 3:].any())
    rows = slice(None) if turns else slice(3)
    A, b = motions[:, rows].reshape(-1, 6), moved[:, rows].reshape(-1, 6)
    # lengths and angles in the scale of the nodes' distances
    length = float(np.sqrt((x - x.mean(axis=0)).reshape(-1) @ (x - x.mean(axis=0)).reshape(-1) / len(x))) or 1.0
    weight = np.tile([1.0] * 3 + [length] * 3 if turns else [1.0] * 3, len(x))[:, None]
    scale = np.array([1.0] * 3 + [1.0 / length] * 3)
    found, _, rank, _ = np.linalg.lstsq(weight * A * scale, weight * b, rcond=1e-9)
    left = abs(weight * (A * scale @ found - b)).max() / abs(weight * b).max()
    if rank < 6 or not left <= _RIGID:
        raise ExportError(
            "among its modes are six without stiffness, which the nodes do not show as rigid motions: they leave "
            f"{left:.1e} of them; leave these modes out, or keep three nodes that are not on a line"
        )
    unit = vectors[:, rigid] @ np.linalg.inv(scale[:, None] * found)
    return SplitModes(vectors[:, ~rigid], unit.T @ mass @ unit)
