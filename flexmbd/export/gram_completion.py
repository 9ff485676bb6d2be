"""The Gram matrix of a body of which only the mass matrix at rest is known.

A mass matrix (6 + n, 6 + n) of rigid motion and modes holds the integrals of phi and of x cross phi, and the sums over
the components of phi_i phi_j; of large motions more is asked: the symmetric part of the integrals of x_a phi_b, and
phi_i,a phi_j,b component by component.  These are chosen so that every mode is the rigid motion that has its linear
and angular momentum (of all fields with these momenta the one of least kinetic energy) and a rest, which has no
momentum, is not correlated with the position, and has no preferred direction: a third of its kinetic energy along each
axis.  The rest's energies are the Schur complement of the mass matrix after the rigid motion, so the Gram matrix is
positive semidefinite wherever the mass matrix is, and gives that back exactly.
"""

from __future__ import annotations

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.record.groups import FloatArray
from flexmbd.round_off import EQUAL, SIX_DIGITS


def completed_gram(mass: FloatArray, *, levers: FloatArray | None = None) -> FloatArray:
    """A Gram matrix with a given mass matrix at rest.

    Args:
        mass: (6 + n, 6 + n) symmetric; translation (m) and rotation (rad) of B in B's axes, then q.
        levers: (3, n, 3) integrals of x_a phi_b, where they are known: a mode is then the linear field that has them,
            and its rest.

    Returns:
        (4 + 3 n, 4 + 3 n), as in `flexmbd.record.reduced_body.ReducedBody`; positive semidefinite.

    Raises:
        ExportError: the mass matrix is not that of a mass distribution.
    """
    n = len(mass) - 6
    m, com, inertia = rigid_body(mass)
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    linear = mass[:3, 6:]
    angular = mass[3:6, 6:] - np.cross(com, linear.T).T
    if levers is None:
        spin = np.linalg.pinv(inertia, rcond=EQUAL, hermitian=True) @ angular
        turns = np.array([_skew(w) for w in spin.T]).reshape(n, 3, 3)
    else:
        central = levers - np.einsum("a,bi->aib", com, linear)
        turns = np.einsum("ac,cib->iba", np.linalg.pinv(second, rcond=EQUAL, hermitian=True), central)
    moved = np.einsum("iab,bc,jac->ij", turns, second, turns)
    rest = mass[6:, 6:] - linear.T @ linear / m - moved
    scale = np.sqrt(abs(np.diag(mass)[6:]))
    if n and not np.linalg.eigvalsh(rest / np.outer(scale, scale))[0] > -SIX_DIGITS:
        raise ExportError("its mass matrix is not positive definite: some motion has a negative kinetic energy")
    gram = np.zeros((4 + 3 * n, 4 + 3 * n))
    gram[0, 0] = m
    gram[0, 1:4] = m * com
    gram[0, 4:] = linear.T.ravel()
    gram[1:4, 1:4] = second
    gram[1:4, 4:] = np.einsum("ab,icb->aic", second, turns).reshape(3, 3 * n)
    rigid = np.einsum("iab,bc,jdc->iajd", turns, second, turns)
    spread = np.einsum("ij,ad->iajd", rest / 3.0, np.eye(3))
    gram[4:, 4:] = (rigid + spread).reshape(3 * n, 3 * n)
    gram[1:, 1:] += np.outer(gram[0, 1:], gram[0, 1:]) / m
    whole: FloatArray = np.triu(gram) + np.triu(gram, 1).T
    return whole


def rigid_body(mass: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Mass (kg), centre of mass (3,) from the origin (m) and inertia (3, 3) about it (kg m^2) of a mass matrix.

    Raises:
        ExportError: its rigid part is not that of a rigid body.
    """
    m = float(np.trace(mass[:3, :3]) / 3.0)
    if not (np.isfinite(mass).all() and m > 0.0):
        raise ExportError(f"its mass is {m:.3g} kg; a body's is positive")
    static = 0.5 * (mass[:3, 3:6] - mass[:3, 3:6].T)
    com = np.array([static[1, 2], static[2, 0], static[0, 1]]) / m
    inertia = mass[3:6, 3:6] + m * _skew(com) @ _skew(com)
    inertia = 0.5 * (inertia + inertia.T)
    size = np.sqrt(max(float(np.trace(mass[3:6, 3:6])) / m, 0.0))
    off = abs(mass[:3, :3] - m * np.eye(3)).max() / m
    turned = abs(mass[:3, 3:6] + m * _skew(com)).max() / (m * size) if size > 0.0 else 0.0
    if not max(off, turned) <= SIX_DIGITS:
        raise ExportError(
            f"its mass matrix is not that of a free body: for rigid motions it is off by {max(off, turned):.1e}; "
            "check the interfaces' positions, their order, and that no mass is left out on supported dofs"
        )
    # eigenvalues of the second moments of mass: one negative means a moment of inertia above the two others together
    least = np.linalg.eigvalsh(0.5 * np.trace(inertia) * np.eye(3) - inertia)[0]
    if not least >= -SIX_DIGITS * float(np.trace(inertia)):
        raise ExportError(
            "its moments of inertia are those of no mass distribution: one is larger than the two others together"
        )
    return m, com, inertia


def _skew(a: FloatArray) -> FloatArray:
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
