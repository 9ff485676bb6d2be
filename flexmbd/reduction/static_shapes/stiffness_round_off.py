"""Round-off of a stiffness: bounds in proportion to the terms of each sum, not to the sum.

The forces K u are sums of terms as large as |K| |u|, entry by entry, and each is known to a few units of its last
digit; where a body is thin, slender or nearly incompressible the sums are smaller than their terms by many orders.
No solution has a residual below that, and one whose residual is as small solves a stiffness with the same digits
(Oettli & Prager 1964, doi:10.1007/BF01386090; Skeel 1980, doi:10.2307/2006197).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, total

#: Round-off is at most so many times its measure; healthy parts of all forms show up to twenty.
MARGIN = 100.0
#: Relative error by round-off from which on a result is worth nothing: two digits are left.
WORTHLESS = 1e-2

# Entries of a rank that are copied at once.
_SLICE = 16 * 10**6

_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class StiffnessRoundOff:
    """The measure of round-off of one stiffness K; made by `round_off`.

    Attributes:
        root: (owned dofs,) with which forces are divided, and displacements multiplied, so that those of dofs of
            unlike units can be compared: the root of the diagonal of K, and of a like size where that is zero.
    """

    root: FloatArray
    _sizes: _Sizes

    def forces(self, displacement: FloatArray) -> FloatArray:
        """That of K u: (owned dofs, k) eps |K| |u|, N. Collective."""
        return _EPSILON * self._sizes.multiply(np.asfortranarray(abs(displacement)))

    def work(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """That of u^T K v: (j, k) eps |u|^T |K| |v|, J. Collective."""
        return inner(self._sizes.comm, abs(left), self.forces(right))

    def excess(
        self,
        residual: FloatArray,
        displacement: FloatArray,
        *,
        rows: NDArray[np.bool_] | None = None,
        load: FloatArray | None = None,
    ) -> float:
        """How many times its measure of round-off the residual of K u - f is, in the worst column. Collective.

        Args:
            residual: (owned dofs, k), N.
            displacement: (owned dofs, k), u.
            rows: (owned dofs,) that are looked at; default: all.
            load: (owned dofs, k), f; default: none.
        """
        expected = self.forces(displacement)
        if load is not None:
            expected += _EPSILON * abs(load)
        squares = np.stack([residual, expected]) / self.root[:, None]
        if rows is not None:
            squares = squares[:, rows]
        found, least = np.sqrt(total(self._sizes.comm, np.sum(squares**2, axis=1)))
        # of nothing round-off is nothing
        ratio = np.divide(found, least, out=np.where(found > 0.0, np.inf, 0.0), where=least > 0.0)
        return float(ratio.max(initial=0.0))

    def distance(self, displacement: FloatArray, other: FloatArray) -> float:
        """Relative distance of displacements (owned dofs, k) from others, of the worst column. Collective."""
        squares = (np.stack([displacement - other, other]) * self.root[:, None]) ** 2
        apart, size = np.sqrt(total(self._sizes.comm, squares.sum(axis=1)))
        return float((apart / size).max(initial=0.0))


class _Sizes:
    """|K|, entry by entry: a copy of K where that is small, else made slice by slice of its rows in each product."""

    def __init__(self, stiffness: PETSc.Mat) -> None:
        """Find the slices. Collective."""
        self.comm = stiffness.comm.tompi4py()
        self._stiffness = stiffness
        most = self.comm.allreduce(int(stiffness.getInfo()["nz_used"]), op=MPI.MAX)
        first, end = stiffness.getOwnershipRange()
        number = max(1, -(-most // _SLICE))
        self._edges = np.linspace(first, end, number + 1).astype(PETSc.IntType)
        self._whole = _absolute(stiffness.copy()) if number == 1 else None

    def multiply(self, block: FloatArray) -> FloatArray:
        """|K| times a block (rows of this rank, k). Collective."""
        if self._whole is not None:
            return multiply(self._whole, block)
        parts = []
        first, end = self._stiffness.getOwnershipRangeColumn()
        columns = PETSc.IS().createStride(end - first, first=first, step=1, comm=self.comm)
        for start, stop in zip(self._edges[:-1], self._edges[1:], strict=True):
            rows = PETSc.IS().createStride(int(stop - start), first=int(start), step=1, comm=self.comm)
            part = _absolute(self._stiffness.createSubMatrix(rows, columns))
            parts.append(multiply(part, block))
            part.destroy()
            rows.destroy()
        columns.destroy()
        return np.asfortranarray(np.vstack(parts))

    def destroy(self) -> None:
        """Collective."""
        if self._whole is not None:
            self._whole.destroy()


def _absolute(matrix: PETSc.Mat) -> PETSc.Mat:
    """The same matrix with the sizes of its entries. Collective."""
    rows, columns, values = matrix.getValuesCSR()
    matrix.setValuesCSR(rows, columns, abs(values))
    matrix.assemble()
    return matrix


@contextmanager
def round_off(stiffness: PETSc.Mat) -> Iterator[StiffnessRoundOff]:
    """The measure of round-off of a stiffness (AIJ), for a `with` block. Collective."""
    sizes = _Sizes(stiffness)
    diagonal = stiffness.getDiagonal()
    root: FloatArray = np.sqrt(abs(diagonal.array_r))
    diagonal.destroy()
    try:
        # a pressure without compliance has none of its own
        of_others = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0.0)[:, None]
        root = np.where(root > 0.0, root, sizes.multiply(of_others)[:, 0])
        yield StiffnessRoundOff(np.where(root > 0.0, root, 1.0), sizes)
    finally:
        sizes.destroy()
