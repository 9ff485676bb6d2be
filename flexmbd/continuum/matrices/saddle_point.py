"""Unknowns for which an energy is stationary and not least, as pressures: how many negative eigenvalues they bring.

By Haynsworth's formula a symmetric matrix has the signs of a diagonal block and of what is left when that is
eliminated: inertia(A) = inertia(A_zz) + inertia(A_yy - A_yz A_zz^-1 A_zy). So neg(A) - neg(A_zz) counts those of the
other unknowns alone, whether the energy is least in z (enhanced strains), largest (pressures) or both. A row of A_zz
that is zero, a pressure's of an incompressible solid, is a multiplier's: it brings one negative eigenvalue and one that
is positive.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import ReductionError

# MUMPS: whether ScaLAPACK factorises the root, which counts no pivots; number of negative pivots.
_ROOT, _NEGATIVE = 13, 12


def principal_part(matrix: PETSc.Mat, mask: NDArray[np.bool_]) -> PETSc.Mat:
    """Some rows of a square matrix and the same columns. Collective.

    Args:
        matrix: AIJ.
        mask: (owned rows,).
    """
    first = matrix.getOwnershipRange()[0]
    rows = PETSc.IS().createGeneral((np.flatnonzero(mask) + first).astype(PETSc.IntType), comm=matrix.comm)
    part = matrix.createSubMatrix(rows, rows)
    rows.destroy()
    return part


def fill_empty_rows(matrix: PETSc.Mat, mask: NDArray[np.bool_]) -> None:
    """Give rows of a mask (owned rows,) that are zero, as of what follows by ties, a diagonal. Collective.

    It is positive, so that no signs are counted.
    """
    first = matrix.getOwnershipRange()[0]
    for row in (np.flatnonzero(mask) + first).astype(PETSc.IntType):
        matrix.setValue(row, row, 1.0)
    matrix.assemble()


def answer_alone(matrix: PETSc.Mat, mask: NDArray[np.bool_], forces: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """The unknowns z of a mask by forces on them where the others stay zero: A_zz^-1 f_z. Collective.

    Args:
        matrix: A, AIJ.
        mask: (owned rows,).
        forces: (owned rows,), of which those of the mask are read.

    Returns:
        (owned rows,), zero outside the mask; None where A_zz has rows that are zero, as a multiplier's.
    """
    block = principal_part(matrix, mask)
    solver = PETSc.KSP().create(matrix.comm)
    right, found = block.createVecs()
    try:
        if matrix.comm.tompi4py().allreduce(int((~_filled(block)).sum())):
            return None
        right.setArray(forces[mask])
        solver.setOperators(block)
        solver.setType(PETSc.KSP.Type.PREONLY)
        solver.getPC().setType(PETSc.PC.Type.LU)
        solver.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        solver.solve(right, found)
        answer = np.zeros(len(mask))
        answer[mask] = found.array_r
        return answer
    finally:
        for one in (block, solver, right, found):
            one.destroy()


def negative_directions(matrix: PETSc.Mat, mask: NDArray[np.bool_]) -> int:
    """Negative eigenvalues that a symmetric matrix owes to the unknowns z of a mask (owned rows,). Collective.

    Raises:
        ReductionError: on all ranks: A_zz is singular in other ways than by rows that are zero.
    """
    comm = matrix.comm.tompi4py()
    mine = np.flatnonzero(mask)
    if not comm.allreduce(len(mine)):
        return 0
    block = principal_part(matrix, mask)
    multipliers = ~_filled(block)
    number = int(comm.allreduce(int(multipliers.sum())))
    if number < block.getSize()[0]:
        rest = principal_part(block, ~multipliers)
        number += _negative_pivots(rest)
        rest.destroy()
    block.destroy()
    return number


def _filled(matrix: PETSc.Mat) -> NDArray[np.bool_]:
    """(owned rows,) which have an entry that is not zero."""
    begins, _, values = matrix.getValuesCSR()
    rows = np.repeat(np.arange(len(begins) - 1), np.diff(begins))
    return np.bincount(rows, weights=values != 0.0, minlength=len(begins) - 1) > 0


def _negative_pivots(matrix: PETSc.Mat) -> int:
    """Of a factor of a symmetric matrix, by Sylvester's law its negative eigenvalues. Collective."""
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    solver = PETSc.KSP().create(matrix.comm)
    try:
        solver.setOperators(matrix)
        solver.setType(PETSc.KSP.Type.PREONLY)
        pc = solver.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(_ROOT, 1)
        solver.setUp()
        if pc.getFailedReason() != PETSc.PC.FailedReason.NOERROR:
            raise ReductionError(
                "the stiffness of the unknowns without mass or rigid motion is singular by itself, so that the signs "
                "of the pivots count no eigenvalues; for modes take Truncation(..., complete=False)"
            )
        return int(pc.getFactorMatrix().getMumpsInfog(_NEGATIVE))
    finally:
        solver.destroy()
