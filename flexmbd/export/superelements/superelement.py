"""A reduced body as a superelement: positions, stiffness, mass and damping (P, K, M, D) of its interfaces.

The coordinates are the absolute small motions of the interface frames, each Tx Ty Tz Rx Ry Rz along the axes of B,
then the amplitudes of fixed-interface modes.  They are the six motions of B and the n coordinates q, in another basis
(Craig & Bampton 1968, doi:10.2514/3.4741).

With z = sqrt(k) q the strain energy is |z|^2 / 2, and the interfaces' motions relative to the first are g = C z.  Let
C^T = Q L, L triangular.  Of all deformations with the motions g the one of least energy is z = Q L^-T g, so the
stiffness is (L L^T)^-1, and what is orthogonal to Q are the deformations with all interfaces fixed.  No names of
coordinates are needed for that, so it works for any body whose modes move its interfaces independently.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import InterfaceFrame, ReducedBody

# Smallest singular value of the interfaces' relative motions, each row of unit length: a real part is far above it.
_DEPENDENT = 1e-10


@dataclass(frozen=True, eq=False)
class Superelement:
    """A free linear elastic body by its interfaces.

    Attributes:
        names: of the b interfaces.
        p: (b, 3) m, their positions in the common axes.
        R: (b, 3, 3) rotations from their axes to the common ones; the coordinates do not depend on them.
        K: (6 b + m, 6 b + m) stiffness: N/m, N, N m, and 1/s^2 for the modes.
        M: (6 b + m, 6 b + m) mass: kg, kg m, kg m^2, and 1 for the modes.
        D: (6 b + m, 6 b + m) damping.
        frame: the interface that carries the body frame, or None where that floats.
    """

    names: tuple[str, ...]
    p: FloatArray
    R: FloatArray
    K: FloatArray
    M: FloatArray
    D: FloatArray
    frame: str | None

    @property
    def n_modes(self) -> int:
        """Number of fixed-interface modes m."""
        return len(self.K) - 6 * len(self.names)

    def rigid_motions(self, origin: FloatArray) -> FloatArray:
        """(6 b + m, 6) coordinates of the rigid motions about a point (3,): translations (m), rotations (rad)."""
        motions = np.zeros((len(self.K), 6))
        motions[: 6 * len(self.p)] = np.vstack([rigid_motion(p - origin) for p in self.p])
        return motions


def rigid_motion(p: FloatArray) -> FloatArray:
    """(6, 6) motion of a frame at p (3,) per translation (m) and rotation (rad) of the body about the origin."""
    x, y, z = p
    motion = np.eye(6)
    motion[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return motion


def superelement(body: ReducedBody, *, interfaces: Sequence[str] | None = None) -> Superelement:
    """The superelement of a reduced body, in B's axes, with B's origin as theirs.

    Args:
        body: with at least one interface.
        interfaces: names of those that become boundary dofs, the others are left free; all, in the record's order,
            by default.

    Returns:
        K is zero between interfaces and modes and for rigid motions; the modes' mass is the identity.

    Raises:
        ExportError: there is no interface, or the modes do not move the interfaces independently.
        InterfaceError: the body has no interface of such a name.
    """
    frames = body.interfaces if interfaces is None else tuple(body.interface(name) for name in interfaces)
    if not frames:
        raise ExportError("the body has no interface frame, and a superelement is made of those: name one at least")
    weight = 1.0 / np.sqrt(body.stiffness)
    relative, C = _relative_motions(frames, weight)
    q_of_g, inside, factor = _split(C, frames)
    # motion of B that goes with each deformation while the first interface rests
    back = np.linalg.inv(rigid_motion(frames[0].p_BI_B))
    carried = -back @ frames[0].modes
    mass = body.mass_matrix()
    modes = _fixed_interface_modes(weight[:, None] * inside, carried, mass)
    n_boundary = relative.shape[1]
    q = np.hstack([weight[:, None] * (q_of_g @ relative), modes])
    rigid = carried @ q
    rigid[:, :6] += back
    motion = np.vstack([rigid, q])
    static = factor @ relative
    K = np.zeros((q.shape[1], q.shape[1]))
    K[:n_boundary, :n_boundary] = static.T @ static
    inner = np.arange(n_boundary, len(K))
    K[inner, inner] = np.einsum("ij,i,ij->j", modes, body.stiffness, modes)
    M = motion.T @ mass @ motion
    signs = np.ones(len(K))
    signs[inner] = _signs(M[:n_boundary, n_boundary:])
    flip = np.outer(signs, signs)
    return Superelement(
        names=tuple(frame.name for frame in frames),
        p=np.array([frame.p_BI_B for frame in frames]),
        R=np.array([frame.R_BI for frame in frames]),
        K=K,
        M=_symmetric(flip * M),
        D=_symmetric(flip * (q.T @ body.damping @ q)),
        frame=body.frame if body.frame in [frame.name for frame in frames] else None,
    )


def _relative_motions(frames: Sequence[InterfaceFrame], weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Motions relative to the first frame: (6 (b - 1), 6 b) of the coordinates, and C (6 (b - 1), n) of z."""
    first, others = frames[0], frames[1:]
    relative = np.zeros((6 * len(others), 6 * len(frames)))
    C = np.zeros((6 * len(others), len(weight)))
    for i, frame in enumerate(others):
        rows = slice(6 * i, 6 * i + 6)
        carry = rigid_motion(frame.p_BI_B - first.p_BI_B)
        relative[rows, :6] = -carry
        relative[rows, 6 * i + 6 : 6 * i + 12] = np.eye(6)
        C[rows] = (frame.modes - carry @ first.modes) * weight
    return relative, C


def _split(C: FloatArray, frames: Sequence[InterfaceFrame]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n, 6 (b - 1)) z of least energy per g, (n, m) z with all interfaces fixed, and F with F^T F the stiffness."""
    n_static, n = C.shape
    size = np.linalg.norm(C, axis=1)
    scaled = C / np.where(size > 0.0, size, 1.0)[:, None]
    if n_static > n or (n_static and np.linalg.svd(scaled, compute_uv=False)[-1] <= _DEPENDENT):
        names = ", ".join(frame.name for frame in frames)
        raise ExportError(
            f"the body's {n} modes do not move its interfaces ({names}) independently of each other, six dofs each, "
            "so it has no superelement: reduce it by craig_bampton or guyan, or name fewer interfaces"
        )
    Q, upper = np.linalg.qr(scaled.T, mode="complete")
    factor = np.linalg.inv(upper[:n_static].T) / size
    return Q[:, :n_static] @ factor, Q[:, n_static:], factor


def _fixed_interface_modes(inside: FloatArray, carried: FloatArray, mass: FloatArray) -> FloatArray:
    """(n, m) modes of unit mass, frequencies ascending, from deformations of unit stiffness."""
    motion = np.vstack([carried @ inside, inside])
    values, vectors = np.linalg.eigh(_symmetric(motion.T @ mass @ motion))
    modes: FloatArray = inside @ (vectors / np.sqrt(values))[:, ::-1]
    return modes


def _signs(coupling: FloatArray) -> FloatArray:
    """Signs of the modes that make the first large entry of each one's coupling (6 b, m) to the interfaces positive."""
    large = abs(coupling) > 0.5 * abs(coupling).max(axis=0)
    first = coupling[np.argmax(large, axis=0), np.arange(coupling.shape[1])]
    signs: FloatArray = np.where(first < 0.0, -1.0, 1.0)
    return signs


def _symmetric(matrix: FloatArray) -> FloatArray:
    half: FloatArray = 0.5 * (matrix + matrix.T)
    return half
