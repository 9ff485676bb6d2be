"""What a record means, worked out from its fields alone."""

from __future__ import annotations

import numpy as np


def cross(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def motions(body):
    """(6 b, 6 + n) displacement and rotation of every interface in B's axes, by (B, q)."""
    rows = []
    for frame in body.interfaces:
        rigid = np.block([[np.eye(3), -cross(frame.p_BI_B)], [np.zeros((3, 3)), np.eye(3)]])
        rows.append(np.hstack([rigid, frame.modes]))
    return np.vstack(rows)


def dynamic_stiffness(body, omega):
    """(6 b, 6 b) forces on the interfaces for unit harmonic motions of them, in B's axes."""
    k = np.zeros((6 + body.n_modes, 6 + body.n_modes))
    k[6:, 6:] = np.diag(body.stiffness)
    j = motions(body)
    return np.linalg.inv(j @ np.linalg.solve(k - omega**2 * body.mass_matrix(), j.T))


def relative(found, expected):
    """Largest difference of two matrices of mixed units, by the roots of the diagonal."""
    size = np.sqrt(abs(np.diag(expected)))
    return (abs(found - expected) / np.outer(size, size)).max()
