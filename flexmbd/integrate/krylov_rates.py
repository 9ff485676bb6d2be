"""Vibrations of a machine of many bodies that its start excites, by Krylov's spaces of its sparse matrices.

M^-1 K applied again and again to what the start lacks of the equilibrium spans a space in which the fast vibrations
that it excites come out first, each with its share, and (K + s M)^-1 M one with the slow ones (Lanczos 1950; Parlett
1998, The Symmetric Eigenvalue Problem, chapters 12 and 13).  Loops hold what is spanned: M^-1 is that of [M C^T; C 0].
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.integrate.motions import Motions
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.sparse.block_lu import factor_sparse
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.multibody.plan.sparse_stiffness import SparseStiffness, sparse_stiffness
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.round_off import SQUARED

FloatArray = NDArray[np.float64]

_FOLLOWED = 20  # applications of each operator to the start's accelerations, and to its velocities
_AT_RANDOM = 30  # of M^-1 K and of M^-1 D to motions at random: the fastest ones


def krylov_motions(start: Start, plan: Plan, work: Work, *, rate: float) -> Motions | None:
    """Those of a machine with the forces of a plan; None where it has no sparse matrix, or none that can be inverted.

    ``work``: of the plan, ``work.time`` up to date.  ``rate``: 1/s, of the machine's motion; slower vibrations count
    for nothing.
    """
    scene = start.scene
    sizes = np.stack([coordinate_sizes(scene), np.zeros(scene.nv)])
    matrix = None if scene.state_mask.any() else sparse_stiffness(scene, work, plan, sizes=sizes)
    if matrix is None:
        return None
    stiffness, mass = (_product(start, matrix, weights) for weights in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    free = plan.free
    inertia = mass.diagonal()[free]
    squares = np.divide(np.abs(stiffness.diagonal()[free]), inertia, out=np.zeros(len(free)), where=inertia > 0.0)
    sizes[1] = sizes[0] * (float(np.sqrt(squares.max(initial=0.0))) or 1.0)
    damping = _product(start, matrix, (0.0, 1.0, 0.0))
    random = np.random.default_rng(0)
    forces = [mass @ start.a, mass @ start.v]
    noise = random.standard_normal((2, scene.nv))
    by_mass = matrix.beside()
    if not _factored(start, by_mass, (0.0, 0.0, 1.0)):
        return None
    space = _Space(mass, by_mass)
    for operator, first, count in (
        *((stiffness, force, _FOLLOWED) for force in forces),
        (stiffness, noise[0], _AT_RANDOM),
        (damping, noise[1], _AT_RANDOM),
    ):
        space.follow(by_mass, operator, first, count)
    if rate > 0.0 and _factored(start, matrix, (1.0, 0.0, rate * rate)):
        for force in forces:
            space.follow(matrix, mass, force, _FOLLOWED)
    basis = space.basis()
    squares, turned = np.linalg.eigh(basis.T @ (stiffness @ basis))
    shapes = basis @ turned
    pushes, runs = (shapes.T @ (mass @ one) for one in (start.a, start.v))
    return Motions(squares, shapes[free], shapes.T @ (damping @ shapes), pushes, runs)


def _product(start: Start, matrix: SparseStiffness, weights: tuple[float, float, float]) -> scipy.sparse.csr_matrix:
    """(nv, nv) symmetric part of the derivatives by x, v and a at the start, each times its weight."""
    state = start.x, start.v, start.a, start.multipliers
    residual(matrix.plan, matrix.work, *state, np.zeros(len(start.v)))
    matrix.assemble_at(*state, weights=weights)
    values, entries, nv = matrix.values(), matrix.entries, len(start.v)
    symmetric = 0.5 * (values + values[entries.mirrored])
    return scipy.sparse.csr_matrix((symmetric, (entries.row, entries.column)), shape=(nv, nv))


def _factored(start: Start, matrix: SparseStiffness, weights: tuple[float, float, float]) -> bool:
    """Factor such a sum; whether all pivots are good."""
    _product(start, matrix, weights)
    matrix.sparse.matrix.terms[:] = 0.0
    return factor_sparse(matrix.sparse.pattern, matrix.sparse.matrix)


class _Space:
    """A basis, orthonormal by the kinetic energy."""

    def __init__(self, mass: scipy.sparse.csr_matrix, by_mass: SparseStiffness) -> None:
        self._mass, self._by_mass = mass, by_mass
        self._vectors, self._momenta = list[FloatArray](), list[FloatArray]()

    def follow(
        self, factors: SparseStiffness, operator: scipy.sparse.csr_matrix, force: FloatArray, count: int
    ) -> None:
        """Join the motion that a force makes by some factors, and that by an operator's force on it, again and again.

        Until it makes nothing new.
        """
        for _ in range(count):
            vector = self._rest(factors.solve(force)[0])
            if vector is None:
                return
            self._vectors.append(vector)
            self._momenta.append(self._mass @ vector)
            force = operator @ vector

    def basis(self) -> FloatArray:
        """(nv, k)."""
        return np.stack(self._vectors, axis=1) if self._vectors else np.zeros((self._mass.shape[0], 0))

    def _rest(self, vector: FloatArray) -> FloatArray | None:
        """What of a motion is not spanned, of length one; None where that is round-off."""
        whole = float(vector @ (self._mass @ vector))
        for turn in range(2):
            for known, momentum in zip(self._vectors, self._momenta, strict=True):
                vector = vector - known * float(momentum @ vector)
            if turn == 0:  # what is left may be so little that round-off of the loops counts
                vector = self._by_mass.solve(self._mass @ vector)[0]
        left = float(vector @ (self._mass @ vector))
        return vector / np.sqrt(left) if left > SQUARED**2 * whole > 0.0 else None
