"""The unknowns of one body, or of several that touch, as one vector, and the factor of their tangent."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Protocol

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.history.displacement_newton import LinearConstraints
from flexmbd.continuum.history.tangent_solver import LinearSolver, TangentSolver, is_symmetric
from flexmbd.continuum.interior.condensed_part import CondensedPart
from flexmbd.continuum.matrices.blocks import from_dense, to_dense

FloatArray = NDArray[np.float64]


class JoinedUnknowns:
    """The owned dofs of bodies, one body's after the other's on each rank.

    Attributes:
        slices: of each body.
        prescribed: dofs that move with rigid frames, or never.
        size: of this rank's part.
    """

    def __init__(self, parts: Sequence[CondensedPart]) -> None:
        """Of these bodies."""
        ends = np.cumsum([0, *(part.body.n_owned for part in parts)])
        self.slices = [slice(int(first), int(last)) for first, last in pairwise(ends)]
        self.size = int(ends[-1])
        self.prescribed = np.concatenate(
            [first + part.prescribed.astype(np.int64) for first, part in zip(ends[:-1], parts, strict=True)]
        )

    def split(self, values: FloatArray) -> list[FloatArray]:
        """Each body's rows."""
        return [values[mine] for mine in self.slices]

    def constraints(self, found: Sequence[LinearConstraints | None]) -> LinearConstraints | None:
        """Those of each body as one."""
        if all(one is None for one in found):
            return None
        columns = np.zeros((self.size, sum(len(one.gap) for one in found if one is not None)))
        first, gaps = 0, []
        for mine, one in zip(self.slices, found, strict=True):
            if one is not None:
                last = first + len(one.gap)
                columns[mine, first:last] = one.columns
                gaps.append(one.gap)
                first = last
        return LinearConstraints(columns, np.concatenate(gaps))


class JoinedFactor(Protocol):
    """A factor of the tangent of all bodies."""

    def take(self, matrices: Sequence[PETSc.Mat], coupling: PETSc.Mat | None) -> None:
        """Factor the bodies' tangents, which change, and what their contacts add. Collective."""

    def solve_block(self, block: FloatArray) -> FloatArray:
        """The inverse times a block (owned dofs, k), zero at prescribed dofs, whose rows are not read. Collective."""

    def solve_factored(self, load: FloatArray) -> FloatArray:
        """As `solve_block`, for one load (owned dofs,). Collective."""

    def discard(self) -> None:
        """Forget it."""


class OwnFactor:
    """That of one body."""

    def __init__(self, part: CondensedPart, solver: LinearSolver) -> None:
        """Nothing is computed yet."""
        self._linear = TangentSolver(part.body, part.prescribed, solver)
        self.solve_block, self.solve_factored = self._linear.solve_block, self._linear.solve_factored

    def take(self, matrices: Sequence[PETSc.Mat], coupling: PETSc.Mat | None) -> None:
        """See `JoinedFactor`."""
        (matrix,) = matrices
        self._linear.constrain(matrix)
        self._linear.renew_preconditioner()
        self._linear.set_operator(matrix)

    def discard(self) -> None:
        """See `JoinedFactor`."""
        self._linear.discard_preconditioner()


class CoupledFactor:
    """That of several bodies that touch: which dofs are coupled changes with the contacts."""

    def __init__(self, parts: Sequence[CondensedPart], unknowns: JoinedUnknowns) -> None:
        """Nothing is computed yet."""
        self._comm, self._unknowns = parts[0].body.comm, unknowns
        self._ksp: PETSc.KSP = PETSc.KSP()  # no handle before the first
        self._matrix: PETSc.Mat = PETSc.Mat()

    def take(self, matrices: Sequence[PETSc.Mat], coupling: PETSc.Mat | None) -> None:
        """See `JoinedFactor`."""
        self.discard()
        rows = [[matrix if i == k else None for i in range(len(matrices))] for k, matrix in enumerate(matrices)]
        matrix = PETSc.Mat().createNest(rows, comm=self._comm).convert("aij")  # in place
        if coupling is not None:
            matrix.axpy(1.0, coupling, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        first = matrix.getOwnershipRange()[0]
        matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        matrix.zeroRowsColumns((self._unknowns.prescribed + first).astype(PETSc.IntType), diag=1.0)
        symmetric = is_symmetric(matrix)
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, symmetric)
        ksp = PETSc.KSP().create(self._comm)
        ksp.setType(PETSc.KSP.Type.PREONLY)
        ksp.setOperators(matrix)
        ksp.getPC().setType(PETSc.PC.Type.CHOLESKY if symmetric else PETSc.PC.Type.LU)
        ksp.getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        ksp.setUp()
        self._ksp, self._matrix = ksp, matrix

    def solve_block(self, block: FloatArray) -> FloatArray:
        """See `JoinedFactor`."""
        free = block.copy()
        free[self._unknowns.prescribed] = 0.0
        right = to_dense(self._comm, free)
        left = right.duplicate()
        self._ksp.getPC().getFactorMatrix().matSolve(right, left)
        solution = from_dense(left)
        left.destroy()
        right.destroy()
        return solution

    def solve_factored(self, load: FloatArray) -> FloatArray:
        """See `JoinedFactor`."""
        return self.solve_block(load[:, None])[:, 0]

    def discard(self) -> None:
        """See `JoinedFactor`."""
        if self._ksp.handle:
            self._ksp.destroy()
            self._matrix.destroy()
