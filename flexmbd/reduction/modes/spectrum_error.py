"""How far the eigenvalues of a Craig-Bampton reduction are off, from above and closely.

In the coordinates of the static shapes X (the rigid motions among them) and of all fixed-interface modes
phi_j, a body that the reduction keeps whole has the condensed dynamic stiffness

    F(lam) = K_X - lam M_X - lam^2 sum_j p_j p_j^T / (lam_j - lam),      p_j = X^T M phi_j,

and a reduction to n modes drops the terms j > n.  Let k modes be known. Of the others is known what they are in
statics,

    S = sum_{j > k} p_j p_j^T / lam_j = X^T M A M X - sum_{j <= k} p_j p_j^T / lam_j,

with A the flexibility of the body with its interfaces fixed: one more solve (MacNeal's residual flexibility,
doi:10.1016/0045-7949(71)90031-9).  For lam < lam_{k+1} their sum is at most S / (1 - lam / lam_{k+1}): what it were
if all of them had the lowest frequency left.  That is again a body with few coordinates. It has no fewer
eigenvalues below any lam < lam_{k+1} than the unreduced one (Sylvester's law of inertia), so its eigenvalues are
lower bounds of the unreduced ones, while those of a reduction are upper bounds (Rayleigh and Ritz).

The ratio of the two bounds is the estimate: not below the true error, round-off apart, and above it by no more than
about 1 / (1 - lam / lam_{k+1}).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, symmetric
from flexmbd.continuum.matrices.eigen import TOLERANCE
from flexmbd.reduction.modes.eigensolver import ModeSearch
from flexmbd.reduction.static_shapes.statics import Statics

#: What the estimate is at least: eigenvalues are not known better.
FLOOR = TOLERANCE


@dataclass(frozen=True, eq=False)
class StaticPart:
    """The static shapes X of a body: six rigid motions about its frame, then s shapes of interfaces.

    Attributes:
        images: (owned dofs that move when all interfaces are fixed, 6 + s) M X.
        mass: (6 + s, 6 + s) X^T M X.
        stiffness: (s, s) X^T K X of the shapes.
        flexibility: (6 + s, 6 + s) X^T M A M X.
    """

    images: FloatArray
    mass: FloatArray
    stiffness: FloatArray
    flexibility: FloatArray


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Bounds of a body's eigenvalues by k fixed-interface modes; of one rank.

    Attributes:
        eigenvalues: (k,) of these modes, ascending, 1/s^2.
        next: the eigenvalue of the next mode, 1/s^2; infinite if there is none.
    """

    eigenvalues: FloatArray
    next: float
    # mass of rigid motions, shapes, modes, and what stands for the other modes, by the roots of the stiffness
    _mass: FloatArray
    _static: int

    def reduced(self, modes: int, *, held: bool) -> FloatArray:
        """Elastic eigenvalues of the body reduced to its static shapes and some modes.

        Args:
            modes: number of fixed-interface modes, at most k.
            held: the body is held at its frame rather than free.

        Returns:
            (s + modes,) ascending, 1/s^2.
        """
        n = 6 + self._static + modes
        return np.reciprocal(_flexibilities(self._mass[:n, :n], held=held))

    def lower_bounds(self, *, held: bool) -> FloatArray:
        """Lower bounds of the elastic eigenvalues of the unreduced body, ascending, 1/s^2."""
        bounds: FloatArray = np.minimum(np.reciprocal(_flexibilities(self._mass, held=held)), self.next)
        return bounds

    def errors(self, modes: int, count: int, *, held: bool) -> FloatArray:
        """Upper bounds of the relative errors of the lowest eigenvalues of a reduction.

        Args:
            modes: number of its fixed-interface modes, at most k.
            count: number of eigenvalues.
            held: as for `reduced`.

        Returns:
            (count,); infinite where the reduced body has no such eigenvalue.
        """
        above, below = self.reduced(modes, held=held)[:count], self.lower_bounds(held=held)[:count]
        errors = np.full(count, np.inf)
        known = min(len(above), len(below))
        errors[:known] = np.maximum(above[:known] / below[:known] - 1.0, 0.0) + FLOOR
        return errors


def static_part(statics: Statics) -> StaticPart:
    """Project the static shapes and their inertia forces. Collective."""
    model, mask = statics.model, statics.mask
    moving, forces = statics.moving
    shapes = np.asfortranarray(np.hstack([model.rigid_motions(statics.p, statics.R), moving]))
    images = multiply(model.M, shapes)
    inside = np.asfortranarray(images[mask])
    return StaticPart(
        images=inside,
        mass=symmetric(inner(model.comm, shapes, images)),
        stiffness=symmetric(inner(model.comm, moving, forces)),
        flexibility=symmetric(inner(model.comm, inside, statics.solve(inside))),
    )


def compute_spectrum(static: StaticPart, process: ModeSearch) -> Spectrum:
    """The bounds by the modes that have converged; at least one, or all there are. Collective."""
    k = len(process.eigenvalues) - (0 if process.exhausted else 1)
    eigenvalues = process.eigenvalues[:k]
    following = np.inf if process.exhausted else float(process.eigenvalues[k])
    p = process.products(static.images, k)
    return condensed(static, eigenvalues, p, following=following)


def condensed(static: StaticPart, eigenvalues: FloatArray, p: FloatArray, *, following: float) -> Spectrum:
    """The small body of the bounds; not collective.

    Args:
        static: its static shapes.
        eigenvalues: (k,) of the known fixed-interface modes, ascending, 1/s^2.
        p: (6 + s, k) X^T M phi of these.
        following: the next eigenvalue, 1/s^2; infinite if there is none.
    """
    s, k = len(static.stiffness), len(eigenvalues)
    # where the stiffness is one
    scale: FloatArray = np.eye(6 + s)
    scale[6:, 6:] = np.linalg.solve(np.linalg.cholesky(static.stiffness), np.eye(s)).T
    coupling = scale.T @ p / np.sqrt(eigenvalues)
    rest = _root(scale.T @ static.flexibility @ scale - coupling @ coupling.T)
    if not np.isfinite(following):
        rest = rest[:, :0]
    size = 6 + s + k + rest.shape[1]
    mass = np.zeros((size, size))
    mass[: 6 + s, : 6 + s] = scale.T @ static.mass @ scale
    mass[: 6 + s, 6 + s :] = np.hstack([coupling, rest])
    mass[6 + s :, : 6 + s] = mass[: 6 + s, 6 + s :].T
    own = np.concatenate([1.0 / eigenvalues, np.full(rest.shape[1], 1.0 / following)])
    mass[6 + s :, 6 + s :] = np.diag(own)
    return Spectrum(eigenvalues, following, mass, s)


def _flexibilities(mass: FloatArray, *, held: bool) -> FloatArray:
    """(n,) descending eigenvalues of a mass (6 + n, 6 + n) whose last n coordinates have stiffness one."""
    elastic = mass[6:, 6:]
    if not held:
        # the rest of each coordinate that has no momentum
        elastic = elastic - mass[6:, :6] @ np.linalg.solve(mass[:6, :6], mass[:6, 6:])
    return np.asarray(np.linalg.eigvalsh(symmetric(elastic))[::-1])


def _root(matrix: FloatArray) -> FloatArray:
    """B with B B^T = matrix, a semidefinite one but for round-off, which is taken as mass rather than left out."""
    values, vectors = np.linalg.eigh(symmetric(matrix))
    return np.asarray(vectors * np.sqrt(abs(values)))
