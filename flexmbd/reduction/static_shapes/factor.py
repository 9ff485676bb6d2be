"""Factors of the stiffness by MUMPS, none of which is begun that would not fit in memory."""

from __future__ import annotations

import os
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

from flexmbd.continuum.matrices.blocks import FloatArray, from_dense, to_dense
from flexmbd.errors import ReductionError

SINGULAR = (
    "it is singular: a part of the body is connected to no interface or not to the rest, or the nodes "
    "that are kept leave it free to move"
)

# Part of the available memory that a factor may take; modes and loads need some as well.
_SHARE = 0.7
# MUMPS: largest memory of a rank (MB); what is said when that or the guess from it is too small.
_LARGEST_MEMORY, _TOO_SMALL = 23, (-9, -19)
# MUMPS: its estimate of the memory (MB) that all ranks take together.
_ESTIMATE = 17
# MUMPS: whether ScaLAPACK factorises the root; number of negative pivots.
_ROOT, _NEGATIVE = 13, 12


class TooLargeError(ReductionError):
    """A factor does not fit in the memory that is available."""


class Factor:
    """The triangular factor of a symmetric matrix.

    Attributes:
        name: of the method, for the record's provenance.
    """

    name = "direct"

    def __init__(self, matrix: PETSc.Mat, *, definite: bool, limit: int | None = None) -> None:
        """Factorise. Collective.

        Args:
            matrix: symmetric, AIJ; marked as definite or not.
            definite: whether it is positive definite, which halves the work.
            limit: bytes that a rank may take; None: no limit.

        Raises:
            TooLargeError: on all ranks: the factor would need more than the limit; nothing of it is made.
            ReductionError: on all ranks: the matrix is singular, or there was not enough memory.
        """
        self._comm = matrix.comm
        self._empty = matrix.getSize()[0] == 0
        self._solver = PETSc.KSP().create(matrix.comm)
        if self._empty:
            return
        # without this PETSc asks for an unsymmetric or indefinite factor, of twice the work
        matrix.setOption(PETSc.Mat.Option.SPD, definite)
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self._solver.setOperators(matrix)
        self._solver.setType(PETSc.KSP.Type.PREONLY)
        pc = self._solver.getPC()
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
        pc.setFactorSetUpSolverType()
        if not definite:
            # all pivots are counted only where ScaLAPACK does not take over the last part
            pc.getFactorMatrix().setMumpsIcntl(_ROOT, 1)
        if limit is not None:
            pc.getFactorMatrix().setMumpsIcntl(_LARGEST_MEMORY, max(1, limit // 10**6))
        try:
            self._factorise(limit)
        except ReductionError:
            self.destroy()
            raise

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
        if failed == PETSc.PC.FailedReason.NOERROR:
            return
        factor = pc.getFactorMatrix()
        if limit is not None and factor.getMumpsInfog(1) in _TOO_SMALL:
            raise TooLargeError(
                f"the factor of the stiffness would take {factor.getMumpsInfog(_ESTIMATE)} MB, and "
                f"{limit * self._comm.size // 10**6} MB are there for it: take solver=Solver.ITERATIVE, a coarser mesh "
                "or more memory"
            )
        memory = failed == PETSc.PC.FailedReason.FACTOR_OUTMEMORY
        remedy = "take a coarser mesh or more memory" if memory else SINGULAR
        raise ReductionError(f"the stiffness of the interior could not be factorised: {remedy}")


def memory_limit(comm: MPI.Comm) -> int | None:
    """Bytes that a factor may take on each rank, the same on all; None where nothing is known. Collective."""
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    available, ranks = available_memory(), host.size
    host.Free()
    share = None if available is None else int(_SHARE * available / ranks)
    shares = [one for one in comm.allgather(share) if one is not None]
    return min(shares, default=None)


def available_memory() -> int | None:
    """Bytes of memory that this computer, or the container on it, has left; None where it does not say."""
    found = [_free_pages(), _cgroup_rest()]
    return min((one for one in found if one is not None), default=None)


def _free_pages() -> int | None:
    try:
        # what is taken by the cache of files can be had as well
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError, IndexError):
        pass
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError):
        return None


def _cgroup_rest() -> int | None:
    folder = Path("/sys/fs/cgroup")
    try:
        most, now = (int((folder / name).read_text()) for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):
        return None
    return max(most - now, 0)
