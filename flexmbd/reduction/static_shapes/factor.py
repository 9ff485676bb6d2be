"""Factors of the stiffness by MUMPS, none of which is begun that would not fit in memory."""

from __future__ import annotations

from petsc4py import PETSc

from flexmbd.continuum.matrices.blocks import FloatArray, from_dense, to_dense
from flexmbd.errors import ReductionError

SINGULAR = (
    "it is singular: a part of the body is connected to no interface or not to the rest, or the nodes "
    "that are kept leave it free to move"
)

# MUMPS: largest memory of a rank (MB); what is said when that or the guess from it is too small.
_LARGEST_MEMORY, _TOO_SMALL = 23, (-9, -19)
# MUMPS: its estimates of the memory (MB) that all ranks take together, without and with compression.
_ESTIMATE, _COMPRESSED_ESTIMATE = 17, 37
# MUMPS: whether blocks of the factor are compressed, and to which relative error.
_COMPRESSION, _TOLERANCE = 35, 7
# MUMPS: which part of the factor's entries it expects to be left (per mille), by which it judges the memory. On blocks
# of 80 000 to 317 000 dofs 0.77 to 0.58 were left at 1e-4, which falls with the power 0.2 of the dofs.
_EXPECTED, _LEFT, _DOFS, _FALL = 38, 650, 317e3, 0.2
# MUMPS reserves all the memory that it is allowed, touched or not, and a process that reserves more than the computer
# has cannot fork. So it is first allowed what the factor of a compact solid takes, twice: so many numbers for each
# power 4/3 of the dofs, beside some bytes of its own.
_COMPACT, _OWN = 64.0, 10**7
# MUMPS: operations of a factor, by its estimate.
_OPERATIONS = 1
# MUMPS: whether ScaLAPACK factorises the root; number of negative pivots.
_ROOT, _NEGATIVE = 13, 12


class TooLargeError(ReductionError):
    """A factor does not fit in the memory that is available."""


class Factor:
    """The triangular factor of a symmetric matrix, or a compressed one, which inverts it nearly.

    Attributes:
        name: of the method, for the record's provenance.
        memory: bytes that all ranks take together, by MUMPS's estimate.
    """

    name = "direct"

    def __init__(
        self, matrix: PETSc.Mat, *, definite: bool, limit: int | None = None, tolerance: float = 0.0
    ) -> None:
        """Factorise. Collective.

        Args:
            matrix: symmetric, AIJ; marked as definite or not.
            definite: whether it is positive definite, which halves the work.
            limit: bytes that a rank may take; None: no limit.
            tolerance: relative error to which blocks of the factor are brought to low rank (Amestoy et al. 2015,
                doi:10.1137/120903476); 0: they are not.

        Raises:
            TooLargeError: on all ranks: the factor would need more than the limit; nothing of it is made.
            ReductionError: on all ranks: the matrix is singular, or there was not enough memory.
        """
        self._comm = matrix.comm
        self._compressed = tolerance > 0.0
        self.memory = 0
        self._empty = matrix.getSize()[0] == 0
        self._solver = PETSc.KSP()
        if self._empty:
            return
        # without this PETSc asks for an unsymmetric or indefinite factor, of twice the work
        matrix.setOption(PETSc.Mat.Option.SPD, definite)
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        for allowed in _allowances(matrix.getSize()[0], limit):
            self._prepare(matrix, definite=definite, allowed=allowed, tolerance=tolerance)
            try:
                return self._factorise(allowed)
            except ReductionError as reason:
                self.destroy()
                if allowed == limit or not isinstance(reason, TooLargeError):
                    raise

    def _prepare(self, matrix: PETSc.Mat, *, definite: bool, allowed: int | None, tolerance: float) -> None:
        """Tell MUMPS what is wanted, with so many bytes for a rank. Collective."""
        self._solver = PETSc.KSP().create(matrix.comm)
        self._solver.setOperators(matrix)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        pc = self._solver.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        if not definite:
            # all pivots are counted only where ScaLAPACK does not take over the last part
            factor.setMumpsIcntl(_ROOT, 1)
        if self._compressed:
            factor.setMumpsIcntl(_COMPRESSION, 2)
            factor.setMumpsCntl(_TOLERANCE, tolerance)
            left = _LEFT * (max(matrix.getSize()[0], 1) / _DOFS) ** -_FALL
            factor.setMumpsIcntl(_EXPECTED, int(min(left, 1000)))
        if allowed is not None:
            factor.setMumpsIcntl(_LARGEST_MEMORY, max(1, allowed // 10**6))

    def solve(self, block: FloatArray) -> FloatArray:
        """The inverse times a block (rows of this rank, k), all columns at once. Collective."""
        if self._empty or block.shape[1] == 0:
            return block.copy(order="F")
        right = to_dense(self._comm, block)
        left = right.duplicate()
        self._solver.matSolve(right, left)
        solution = from_dense(left)
        left.destroy()
        right.destroy()
        return solution

    def refine(self, block: FloatArray) -> FloatArray:
        """The same as `solve`. Collective."""
        return self.solve(block)

    def approximate(self, block: FloatArray) -> FloatArray:
        """The same as `solve`. Collective."""
        return self.solve(block)

    @property
    def negative_pivots(self) -> int:
        """How many negative eigenvalues the matrix has; of one that was not said to be definite."""
        return 0 if self._empty else int(self._solver.getPC().getFactorMatrix().getMumpsInfog(_NEGATIVE))

    def destroy(self) -> None:
        """Give the memory back, which on several ranks nothing else does. Collective."""
        self._solver.destroy()

    def _factorise(self, limit: int | None) -> None:
        pc = self._solver.getPC()
        try:
            self._solver.setUp()
            failed = pc.getFailedReason()
        except PETSc.Error as error:
            raise ReductionError(
                f"the stiffness of the interior could not be factorised (PETSc error {error.ierr}); "
                "take a coarser mesh or more memory"
            ) from error
        factor = pc.getFactorMatrix()
        megabytes = factor.getMumpsInfog(_COMPRESSED_ESTIMATE if self._compressed else _ESTIMATE)
        self.memory = 10**6 * megabytes
        if failed == PETSc.PC.FailedReason.NOERROR:
            return
        if limit is not None and factor.getMumpsInfog(1) in _TOO_SMALL:
            others = "solver=Solver.ITERATIVE" if self._compressed else "solver=Solver.COMPRESSED or Solver.ITERATIVE"
            raise TooLargeError(
                f"the factor of the stiffness would take {megabytes} MB, and "
                f"{max(limit, 0) * self._comm.size // 10**6} MB are available: take {others}, a coarser mesh or more "
                "memory"
            )
        memory = failed == PETSc.PC.FailedReason.FACTOR_OUTMEMORY
        remedy = "take a coarser mesh or more memory" if memory else SINGULAR
        raise ReductionError(f"the stiffness of the interior could not be factorised: {remedy}")


def _allowances(dofs: int, limit: int | None) -> list[int | None]:
    """Bytes that MUMPS may reserve on a rank, one after the other until they do; None: no limit."""
    usual = int(8 * _COMPACT * dofs ** (4 / 3)) + _OWN
    return [limit] if limit is None or limit <= usual else [usual, limit]


def operations(matrix: PETSc.Mat) -> float:
    """Operations that the factor of a positive definite matrix (AIJ) takes, by an analysis of its pattern. Collective.

    MUMPS is kept from going on by a memory that is too small; after that PETSc makes no factor of the same analysis.
    """
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    solver = PETSc.KSP().create(matrix.comm)
    try:
        solver.setOperators(matrix)
        solver.setType(PETSc.KSP.Type.PREONLY)
        pc = solver.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        pc.setFactorSetUpSolverType()
        pc.getFactorMatrix().setMumpsIcntl(_LARGEST_MEMORY, 1)
        solver.setUp()
        return float(pc.getFactorMatrix().getMumpsRinfog(_OPERATIONS))
    finally:
        solver.destroy()
