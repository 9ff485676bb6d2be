"""Eigenvalues of a body's tangent stiffness next to zero, from the factor at hand; their signs by its inertia.

With S = B^1/2 K^-1 B^1/2 of the stiffness K and the weights B, the largest eigenvalues in size of S belong to the
smallest of K phi = lambda B phi (SLEPc's Krylov-Schur; no matrix but the factor is needed).
"""

from __future__ import annotations

from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.tangent_solver import TangentSolver
from flexmbd.errors import ConvergenceError

FloatArray = NDArray[np.float64]

_TOLERANCE = 1e-10


class _Inverse:
    """S as PETSc's shell matrix knows it."""

    def __init__(self, solver: TangentSolver, root: FloatArray) -> None:
        self._solver, self._root = solver, root

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self._root * self._solver.solve_factored(self._root * x.array_r)


def smallest_eigenvalues(
    solver: TangentSolver, weights: FloatArray, count: int, *, symmetric: bool
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Those next to zero. Collective.

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
    comm, n = solver.comm, len(weights)
    root = np.sqrt(weights)
    shell = PETSc.Mat().createPython(((n, None), (n, None)), _Inverse(solver, root), comm=comm)
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
    start.array[:] = root * np.cos(1.0 + 0.7 * (first + np.arange(n)) ** 1.1)
    eps.setInitialSpace(start)
    try:
        eps.solve()
        if eps.getConverged() < count:
            raise ConvergenceError("eigenvalues of the tangent stiffness were not found")
        values, columns, real = np.zeros(count, dtype=complex), np.zeros((n, count)), shell.createVecRight()
        for k in range(count):
            values[k] = 1.0 / eps.getEigenpair(k, real)
            # phi = K^-1 B^1/2 y over its own size: zero nowhere but at given dofs
            columns[:, k] = solver.solve_factored(root * real.array_r)
    finally:
        eps.destroy()
        shell.destroy()
    return values, columns
