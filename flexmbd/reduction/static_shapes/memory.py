"""Memory: the share of this computer's that a rank may take, and the needs of a reduction."""

from __future__ import annotations

import ctypes

from mpi4py import MPI
from petsc4py import PETSc

from flexmbd.continuum.finite_elements.linear_model import LinearModel
from flexmbd.files.memory import available_memory

# Part of the memory that is left which a reduction may take; MUMPS keeps to what it is given.
_SHARE = 0.9
# Bytes of a number, and of an entry of a sparse matrix with its column.
_NUMBER, _ENTRY = 8, 12
# Vectors of the eigensolver: so many for each mode, and at its beginning.
_BASIS, _BEGINNING = 3, 60
# Copies of the block of all static shapes, responses and modes that exist at once when they are projected: the shapes,
# their forces, the modes with ghosts, the fields of the Gram matrix, and what products copy.
_COPIES = 6
# Memory of the levels of multigrid, and of the blocks that its iteration takes, over that of the matrix.
_HIERARCHY = 3.0


def workspace(model: LinearModel, *, shapes: int, modes: int) -> int:
    """Bytes on all ranks that a reduction needs beside the inverse of the stiffness. Collective.

    Args:
        model: assembled: K and M are there.
        shapes: number of static shapes and of responses to loads.
        modes: number of fixed-interface modes.
    """
    dofs = int(model.K.getSize()[0])
    # the interior's K, of which the factor is made, goes before the blocks come; its M stays
    matrices = stored(model.M)
    basis, projection = _BASIS * modes + min(_BEGINNING, dofs), _COPIES * (shapes + modes)
    return matrices + _NUMBER * dofs * max(basis, projection)


def multigrid_memory(model: LinearModel) -> int:
    """Bytes on all ranks of multigrid for the stiffness. Collective."""
    return int(_HIERARCHY * stored(model.K))


def stored(matrix: PETSc.Mat) -> int:
    """Bytes of a sparse matrix on all ranks. Collective."""
    return _ENTRY * int(matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)["nz_used"])


def memory_limit(comm: MPI.Comm) -> int | None:
    """Bytes that a reduction may take on each rank, the same on all; None where nothing is known. Collective."""
    _trim()
    host = comm.Split_type(MPI.COMM_TYPE_SHARED)
    available, ranks = available_memory(), host.size
    host.Free()
    share = None if available is None else int(_SHARE * available / ranks)
    shares = [one for one in comm.allgather(share) if one is not None]
    return min(shares, default=None)


def _trim() -> None:
    """Give back what was freed: of the pattern of a matrix, small pieces that glibc keeps, a third of an assembly."""
    try:
        ctypes.CDLL(None).malloc_trim(0)
    except (AttributeError, OSError):
        pass  # another C library, which has no such function
