"""Modes of a reduced body that is free or held at interfaces, and the damping that they define.

The coordinates q are displacements against the body frame B. What B's own motion adds is eliminated: of a free body
the deformation has no momentum, of one that is held at an interface it leaves that at rest. With the motion
T q of B and the modes that belongs to q then,

    S = T^T M T,    K psi = omega^2 S psi,    D = sum_i 2 zeta_i / omega_i^3 (K psi_i) (K psi_i)^T.

K and so D are blind to rigid motions, and D takes the same power of the same motion in every choice of B.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.record.groups import FloatArray, InterfaceFrame
from flexmbd.round_off import EQUAL, WORTHLESS_PIVOT, of_solver


@dataclass(frozen=True, eq=False)
class HeldModes:
    """The m modes of a body of n modal coordinates, the lowest frequency first.

    Attributes:
        period: (m,) s, 1 / omega; zero where a deformation has no mass.
        work: (n, m) 1/s, K psi / omega, psi of unit modal mass.
        shape: (n, m) s, psi / omega.
    """

    period: FloatArray
    work: FloatArray
    shape: FloatArray

    @property
    def frequencies(self) -> FloatArray:
        """(m,) Hz."""
        with np.errstate(divide="ignore"):
            return np.asarray(0.5 / np.pi / self.period)

    def damping(self, ratios: FloatArray) -> FloatArray:
        """(n, n) 1/s, D_qq by which each mode has its ratio of (m,), or all have the same."""
        return (self.work * (2.0 * ratios * self.period)) @ self.work.T

    def mass(self) -> FloatArray:
        """(n, n) mass of the deformation alone: q^T S q where nothing but one interface is held."""
        return (self.work * self.period**2) @ self.work.T

    def ratios(self, damping: FloatArray) -> FloatArray:
        """(m,) damping ratios of the modes by a D_qq (n, n), its coupling of them left out."""
        power = np.einsum("im,ij,jm->m", self.shape, damping, self.shape)
        found: FloatArray = np.divide(power, 2.0 * self.period, out=np.zeros(len(power)), where=self.period > 0.0)
        return found


def held_modes(
    gram: FloatArray,
    stiffness: FloatArray,
    held: Sequence[InterfaceFrame] = (),
    *,
    rigid: FloatArray | None = None,
) -> HeldModes:
    """The modes of a body, by the arrays of its record.

    Args:
        gram: (4 + 3 n, 4 + 3 n) mass integrals.
        stiffness: (n,) 1/s^2.
        held: the interfaces that do not move; none: the body is free.
        rigid: (6, r) the motions of B in which a free body is free; all.
    """
    mass, n = mass_matrix(gram), len(stiffness)
    mass[6:, 6:] = np.eye(n)  # as machines take it: without the round-off of the integrals
    if held:
        first = interface_motion(held[0])
        motion = np.vstack([-np.linalg.solve(first[:, :6], first[:, 6:]), np.eye(n)])
    else:
        motion = free_motion(mass, rigid)
    own = motion.T @ mass @ motion
    root = np.sqrt(stiffness)
    rows = np.vstack([np.zeros((0, n)), *(interface_motion(one) @ motion for one in held[1:])])
    among = null_space(rows / root)
    square, vectors = np.linalg.eigh(among.T @ (own / np.outer(root, root)) @ among)
    square[square < of_solver(n) * square.max(initial=0.0)] = 0.0  # what is no mass but round-off
    shapes = among @ vectors[:, ::-1]
    return HeldModes(np.sqrt(square[::-1]), root[:, None] * shapes, shapes / root[:, None])


def free_motion(mass: FloatArray, rigid: FloatArray | None = None) -> FloatArray:
    """(6 + n, n) motion of a free body's B, and modal coordinates, per unit of these: without momentum.

    Args:
        mass: (6 + n, 6 + n) of B and the modal coordinates.
        rigid: (6, r) the motions of B in which it is free; all.
    """
    motions = np.eye(6) if rigid is None else rigid
    inverse = _inverse(motions.T @ mass[:6, :6] @ motions)
    return np.vstack([-motions @ inverse @ motions.T @ mass[:6, 6:], np.eye(len(mass) - 6)])


def held_frequencies(mass: FloatArray, stiffness: FloatArray, rows: FloatArray) -> FloatArray:
    """Ascending natural frequencies (Hz) of a body of which some motions are held.

    Rigid motions that are free go with the deformations so that they have no momentum, where they have inertia; a bar
    has none about its axis.

    Args:
        mass: (6 + n, 6 + n) of B and the modal coordinates.
        stiffness: (n,) 1/s^2.
        rows: (m, 6 + n) what is zero of B's motion and the modal coordinates.
    """
    root = np.concatenate([np.ones(6), np.sqrt(stiffness)])  # so that deformations are of like energies
    weighed = mass / np.outer(root, root)
    free = null_space(rows / root)
    rigid = null_space(rows[:, :6]) if len(rows) else np.eye(6)
    rigid = np.vstack([rigid, np.zeros((len(stiffness), rigid.shape[1]))])
    left, sizes, _ = np.linalg.svd(free - rigid @ (rigid.T @ free), full_matrices=False)
    shapes = left[:, sizes > 0.5]  # each is 0 or 1: the rigid motions are among the free ones
    shapes -= rigid @ _inverse(rigid.T @ weighed @ rigid) @ rigid.T @ weighed @ shapes
    inverse = np.linalg.inv(np.linalg.cholesky(shapes[6:].T @ shapes[6:]))
    square, vectors = np.linalg.eigh(inverse @ (shapes.T @ weighed @ shapes) @ inverse.T)
    # what is below is no mass but round-off
    moving = square > of_solver(len(mass)) * square.max(initial=0.0)
    shapes = shapes @ inverse.T @ vectors[:, moving]
    # Rayleigh quotients: the solver's eigenvalues have an error relative to the largest one
    quotients = np.einsum("ij,ij->j", shapes[6:], shapes[6:]) / np.einsum("ij,ij->j", shapes, weighed @ shapes)
    return np.asarray(np.sqrt(np.sort(quotients)) / (2.0 * np.pi))


def mass_matrix(gram: FloatArray) -> FloatArray:
    """(6 + n, 6 + n) of the undeformed body: `ReducedBody.mass_matrix`."""
    n = (len(gram) - 4) // 3
    m = np.zeros((6 + n, 6 + n))
    m[:3, :3] = gram[0, 0] * np.eye(3)
    m[:3, 3:6] = -cross_matrix(gram[0, 1:4])
    second = gram[1:4, 1:4]
    m[3:6, 3:6] = np.trace(second) * np.eye(3) - second
    m[:3, 6:] = gram[0, 4:].reshape(n, 3).T
    x_phi = gram[1:4, 4:].reshape(3, n, 3)
    m[3, 6:] = x_phi[1, :, 2] - x_phi[2, :, 1]
    m[4, 6:] = x_phi[2, :, 0] - x_phi[0, :, 2]
    m[5, 6:] = x_phi[0, :, 1] - x_phi[1, :, 0]
    m[3:6, :3] = m[:3, 3:6].T
    m[6:, :6] = m[:6, 6:].T
    m[6:, 6:] = modal_mass(gram)
    return m


def modal_mass(gram: FloatArray) -> FloatArray:
    """(n, n) M_qq."""
    n = (len(gram) - 4) // 3
    return np.einsum("iaja->ij", gram[4:, 4:].reshape(n, 3, n, 3))


def interface_motion(frame: InterfaceFrame) -> FloatArray:
    """(6, 6 + n) motion of an interface in its own axes per (translation, rotation of B, q)."""
    motion = np.zeros((6, 6 + frame.modes.shape[1]))
    motion[:3, :3] = motion[3:, 3:6] = np.eye(3)
    motion[:3, 3:6] = -cross_matrix(frame.p_BI_B)
    motion[:, 6:] = frame.modes
    motion[:3] = frame.R_BI.T @ motion[:3]
    motion[3:] = frame.R_BI.T @ motion[3:]
    return motion


def null_space(rows: FloatArray) -> FloatArray:
    """Orthonormal basis of the vectors that every row annihilates."""
    sizes = np.linalg.norm(rows, axis=1)
    rows = rows[sizes > 0.0] / sizes[sizes > 0.0, None]
    if len(rows) == 0:
        return np.eye(rows.shape[1])
    _, s, vt = np.linalg.svd(rows)
    rank = int(np.sum(s > WORTHLESS_PIVOT * s[0]))
    return vt[rank:].T


def cross_matrix(v: FloatArray) -> FloatArray:
    """Return [v]x with [v]x w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _inverse(inertia: FloatArray) -> FloatArray:
    """Of a rigid body's inertia (r, r), with nothing for motions that have none and so no momentum with the modes."""
    size = np.sqrt(np.diag(inertia))
    size[size == 0.0] = 1.0
    values, vectors = np.linalg.eigh(inertia / np.outer(size, size))
    there = values > EQUAL
    part = vectors[:, there] / size[:, None]
    return (part / values[there]) @ part.T
