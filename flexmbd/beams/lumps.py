"""The lumps of a discrete element body: rigid pieces of beam on its nodes, and their mass integrals.

A node carries the near half of each of its elements. A point of a lump at r from its node moves by
t + theta x r (Anthonis & Ramon 2003, eq. 23-28), so that all its mass integrals follow from those of
{1, r} {1, r}.
"""

from __future__ import annotations

import enum

import numpy as np
from numpy.typing import NDArray

from flexmbd.beams.arc import Arc
from flexmbd.beams.castigliano import Section

FloatArray = NDArray[np.float64]


class Lumping(enum.Enum):
    """The lumping of mass at the nodes.

    Attributes:
        PIECES: the near halves of its elements as rigid bodies, with rotary inertia (eq. 28).
        POINTS: their mass alone, in the node. Rotations then follow from the displacements statically, and a
            moment on a node is answered without the part that would turn it alone.
    """

    PIECES = enum.auto()
    POINTS = enum.auto()


def half(arc: Arc, section: Section, group: str, *, near_start: bool) -> FloatArray:
    """(4, 4) integral of rho {1, r} {1, r} over half an element, r (m) from its end, kg, kg m, kg m^2.

    Args:
        arc: the element's axis.
        section: of the beam.
        group: of the beam, for messages.
        near_start: the half at its start, else that at its end.
    """
    s, weights = arc.quadrature(0.0, 0.5) if near_start else arc.quadrature(0.5, 1.0)
    from_end = arc.places(s)[0] - (arc.start if near_start else arc.end)
    moments = np.zeros((4, 4))
    for r, (_, y, z), weight in zip(from_end, arc.axes(s, section, group), weights, strict=True):
        across = section.Iz * np.outer(y, y) + section.Iy * np.outer(z, z)
        across += section.Iyz * (np.outer(y, z) + np.outer(z, y))
        fields = np.concatenate([[1.0], r])
        moments += section.rho * section.A * weight * np.outer(fields, fields)
        moments[1:, 1:] += section.rho * weight * across
    return moments


def point(moments: FloatArray) -> FloatArray:
    """The same mass with no extent, (4, 4)."""
    return np.diag([moments[0, 0], 0.0, 0.0, 0.0])


def fields_of(x: FloatArray, motions: FloatArray) -> FloatArray:
    """(n, 4, 4 + 3 m) the scalar fields {1, x, y, z, motions} on each lump by their coefficients in {1, r}.

    Args:
        x: (n, 3) m, the nodes.
        motions: (n, 6, m) displacement and small rotation of the nodes.
    """
    n, m = len(x), motions.shape[2]
    fields = np.zeros((n, 4, 4 + 3 * m))
    fields[:, 0, 0] = 1.0
    fields[:, 0, 1:4] = x
    fields[:, 1:, 1:4] = np.eye(3)
    # (theta x r)_a = sum_b turn[a, b] r_b
    turn = np.zeros((n, 3, 3, m))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        turn[:, a, b], turn[:, b, a] = -motions[:, 3 + c], motions[:, 3 + c]
    moving = np.empty((n, 4, m, 3))
    moving[:, 0] = motions[:, :3].swapaxes(1, 2)
    moving[:, 1:] = turn.transpose(0, 2, 3, 1)
    fields[:, :, 4:] = moving.reshape(n, 4, 3 * m)
    return fields


def gram(x: FloatArray, moments: FloatArray, motions: FloatArray) -> FloatArray:
    """(4 + 3 m, 4 + 3 m) mass integrals of {1, position, motions}, as `ReducedBody.gram`.

    Args:
        x: (n, 3) m, the nodes, from the body frame's origin.
        moments: (n, 4, 4) of the lumps.
        motions: (n, 6, m).
    """
    fields = fields_of(x, motions)
    weighted = moments @ fields
    size = fields.shape[2]
    total = fields.reshape(-1, size).T @ weighted.reshape(-1, size)
    symmetric: FloatArray = 0.5 * np.asarray(total + total.T, dtype=np.float64)
    return symmetric


def nodal_mass(moments: FloatArray) -> FloatArray:
    """(n, 6, 6) kg, kg m, kg m^2: mass matrices of the lumps by translation and rotation of their nodes."""
    n = len(moments)
    fields = fields_of(np.zeros((n, 3)), np.tile(np.eye(6), (n, 1, 1)))[:, :, 4:].reshape(n, 4, 6, 3)
    mass: FloatArray = np.einsum("niac,nij,njbc->nab", fields, moments, fields, optimize=True)
    return mass
