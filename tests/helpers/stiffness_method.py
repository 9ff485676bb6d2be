"""Frames of beams by the stiffness method, an oracle: Hermite's elements with shear, in closed form.

Przemieniecki 1968, Theory of Matrix Structural Analysis, eq. 5.116 and 11.28. Nothing of flexmbd is used.
"""

from __future__ import annotations

import numpy as np


def axes_of(along, orientation):
    """(3, 3) rows: tangent, y, z."""
    t = along / np.linalg.norm(along)
    y = np.asarray(orientation, float) - np.dot(orientation, t) * t
    y /= np.linalg.norm(y)
    return np.stack([t, y, np.cross(t, y)])


def local_stiffness(p, length, *, shear=True):
    """(12, 12) of a beam along x whose y and z are principal axes: u, v, w, turns, of both ends."""
    g = p.E / (2 * (1 + p.nu))
    k = np.zeros((12, 12))
    for dofs, stiffness in (((0, 6), p.E * p.A), ((3, 9), g * p.J)):
        k[np.ix_(dofs, dofs)] += stiffness / length * np.array([[1, -1], [-1, 1]])
    for dofs, second, factor, sign in (((1, 5, 7, 11), p.Iz, p.ky, 1), ((2, 4, 8, 10), p.Iy, p.kz, -1)):
        phi = 12 * p.E * second / (factor * g * p.A * length**2) if shear else 0.0
        s = sign * length
        block = np.array(
            [
                [12, 6 * s, -12, 6 * s],
                [6 * s, (4 + phi) * s**2, -6 * s, (2 - phi) * s**2],
                [-12, -6 * s, 12, -6 * s],
                [6 * s, (2 - phi) * s**2, -6 * s, (4 + phi) * s**2],
            ]
        )
        k[np.ix_(dofs, dofs)] += p.E * second / (length**3 * (1 + phi)) * block
    return k


def local_mass(p, length):
    """(12, 12) consistent with Hermite's polynomials, without rotary inertia in bending."""
    m = np.zeros((12, 12))
    line = p.rho * p.A * length
    for dofs, size in (((0, 6), line), ((3, 9), p.rho * (p.Iy + p.Iz) * length)):
        m[np.ix_(dofs, dofs)] += size / 6 * np.array([[2, 1], [1, 2]])
    for dofs, sign in (((1, 5, 7, 11), 1), ((2, 4, 8, 10), -1)):
        s = sign * length
        m[np.ix_(dofs, dofs)] += (
            line
            / 420
            * np.array(
                [
                    [156, 22 * s, 54, -13 * s],
                    [22 * s, 4 * s**2, 13 * s, -3 * s**2],
                    [54, 13 * s, 156, -22 * s],
                    [-13 * s, -3 * s**2, -22 * s, 4 * s**2],
                ]
            )
        )
    return m


def assembled(x, elements, sections, local):
    """(6 n, 6 n) of nodes x (n, 3), elements (m, 2) and their sections; local(section, length) in beam axes."""
    whole = np.zeros((6 * len(x),) * 2)
    for (a, b), p in zip(elements, sections, strict=True):
        along = np.asarray(x[b]) - np.asarray(x[a])
        turn = np.kron(np.eye(4), axes_of(along, p.orientation))
        rows = np.r_[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]
        whole[np.ix_(rows, rows)] += turn.T @ local(p, np.linalg.norm(along)) @ turn
    return whole
