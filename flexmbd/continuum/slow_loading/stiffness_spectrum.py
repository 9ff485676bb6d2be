"""Eigenvalues of a body's tangent stiffness next to zero, from the factor at hand.

With S = B^1/2 K^-1 B^1/2 of the stiffness K and the weights B, the largest eigenvalues in size of S belong to the
smallest of K phi = lambda B phi (SLEPc's Krylov-Schur; no matrix but the factor is needed).
"""

from __future__ import annotations

from dataclasses import dataclass

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.tangent_solver import TangentSolver
from flexmbd.errors import ConvergenceError

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-10


@dataclass(frozen=True, eq=False)
class NearZero:
    """The eigenvalues of a tangent stiffness next to zero.

    Attributes:
        values: (count,) by size.
        modes: (owned dofs, count) real parts of their eigenvectors.
        round_off: what a factor leaves of one that is zero.
    """

    values: NDArray[np.complex128]
    modes: FloatArray
    round_off: float


class _Inverse:
    """B^1/2 K^-1 B^1/2 as PETSc's shell matrix knows it."""

    def __init__(self, solver: TangentSolver, root: FloatArray) -> None:
        self._solver, self._root = solver, root

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self._root * self._solver.solve_factored(self._root * x.array_r)


class _InverseTimes:
    """K^-1 M as PETSc's shell matrix knows it."""

    def __init__(self, solver: TangentSolver, inertia: PETSc.Mat) -> None:
        self._solver, self._inertia, self._force = solver, inertia, inertia.createVecLeft()

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._inertia.mult(x, self._force)
        y.array[:] = self._solver.solve_factored(self._force.array_r)


def smallest_eigenvalues(
    solver: TangentSolver, weights: FloatArray, count: int, *, symmetric: bool
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Those of K phi = lambda B phi next to zero. Collective.

    Args:
        solver: that holds the factor.
        weights: (owned dofs,) B; zero at dofs that do not count.
        count: how many.
        symmetric: whether the stiffness is.

    Returns:
        (count,) by size, and (owned dofs, count) the real parts of their eigenvectors.

    Raises:
        ConvergenceError: on all ranks: they were not found.
    """
    root = np.sqrt(weights)
    values, columns = _largest(solver, _Inverse(solver, root), root, count, symmetric=symmetric)
    # phi = K^-1 B^1/2 y over its own size: zero nowhere but at given dofs
    modes = np.stack([solver.solve_factored(root * column) for column in columns.T], axis=1)
    return 1.0 / values, modes


def smallest_vibrations(
    solver: TangentSolver, inertia: PETSc.Mat, count: int
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Those of K phi = w^2 M phi next to zero, of a stiffness without a potential. Collective.

    Motions are exp(s t), s^2 = - w^2: where w^2 is complex they flutter, and a pair of such values stands for two that
    grow and two that decay.

    Args:
        solver: that holds the factor.
        inertia: M, kg.
        count: how many.

    Returns:
        As `smallest_eigenvalues`; 1/s^2.

    Raises:
        ConvergenceError: on all ranks: they were not found.
    """
    begin: FloatArray = np.sqrt(np.maximum(inertia.getDiagonal().array_r, 0.0))
    values, columns = _largest(solver, _InverseTimes(solver, inertia), begin, count, symmetric=False)
    return 1.0 / values, columns


def _largest(
    solver: TangentSolver, operator: _Inverse | _InverseTimes, sizes: FloatArray, count: int, *, symmetric: bool
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Eigenvalues of an operator, the largest in size, and the real parts of its eigenvectors; the start by sizes."""
    comm, n = solver.comm, len(sizes)
    shell = PETSc.Mat().createPython(((n, None), (n, None)), operator, comm=comm)
    shell.setUp()
    eps = SLEPc.EPS().create(comm)
    eps.setOperators(shell)
    eps.setProblemType(SLEPc.EPS.ProblemType.HEP if symmetric else SLEPc.EPS.ProblemType.NHEP)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    eps.setDimensions(count)
    eps.setTolerances(_TOLERANCE, 200)
    start = shell.createVecRight()
    first = start.getOwnershipRange()[0]
    # the same on any number of ranks, and along no mode of a symmetric body
    start.array[:] = sizes * np.cos(1.0 + 0.7 * (first + np.arange(n)) ** 1.1)
    eps.setInitialSpace(start)
    try:
        eps.solve()
        if eps.getConverged() < count:
            raise ConvergenceError("eigenvalues of the tangent stiffness were not found")
        values, columns, real = np.zeros(count, dtype=complex), np.zeros((n, count)), shell.createVecRight()
        for k in range(count):
            values[k] = eps.getEigenpair(k, real)
            columns[:, k] = real.array_r
    finally:
        eps.destroy()
        shell.destroy()
    return values, columns
