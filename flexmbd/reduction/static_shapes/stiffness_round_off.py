"""What round-off does to a stiffness: bounds in proportion to what was added up, not to what came out.

The forces K u are sums of terms as large as |K| |u|, entry by entry, and each is known to a few units of its last
digit; where a body is thin, slender or nearly incompressible the sums are smaller than their terms by many orders.
No solution has a residual below that, and one whose residual is as small solves a stiffness with the same digits
(Oettli & Prager 1964, doi:10.1007/BF01386090; Skeel 1980, doi:10.2307/2006197).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import FloatArray, inner, multiply, total

#: Round-off is at most so many times its measure; healthy parts of all forms show up to twenty.
MARGIN = 100.0
#: Relative error by round-off from which on a result is worth nothing: two digits are left.
WORTHLESS = 1e-2

_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class StiffnessRoundOff:
    """The measure of round-off of one stiffness K; made by `round_off`.

    Attributes:
        root: (owned dofs,) with which forces are divided, and displacements multiplied, so that those of dofs of
            unlike units can be compared: the root of the diagonal of K, and of a like size where that is zero.
    """

    root: FloatArray
    _sizes: PETSc.Mat

    def forces(self, displacement: FloatArray) -> FloatArray:
        """That of K u: (owned dofs, k) eps |K| |u|, N. Collective."""
        return _EPSILON * multiply(self._sizes, np.asfortranarray(abs(displacement)))

    def work(self, left: FloatArray, right: FloatArray) -> FloatArray:
        """That of u^T K v: (j, k) eps |u|^T |K| |v|, J. Collective."""
        return inner(self._sizes.comm.tompi4py(), abs(left), self.forces(right))

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
        found, least = np.sqrt(total(self._sizes.comm.tompi4py(), np.sum(squares**2, axis=1)))
        # of nothing round-off is nothing
        ratio = np.divide(found, least, out=np.where(found > 0.0, np.inf, 0.0), where=least > 0.0)
        return float(ratio.max(initial=0.0))

    def distance(self, displacement: FloatArray, other: FloatArray) -> float:
        """Relative distance of displacements (owned dofs, k) from others, of the worst column. Collective."""
        squares = (np.stack([displacement - other, other]) * self.root[:, None]) ** 2
        apart, size = np.sqrt(total(self._sizes.comm.tompi4py(), squares.sum(axis=1)))
        return float((apart / size).max(initial=0.0))


@contextmanager
def round_off(stiffness: PETSc.Mat) -> Iterator[StiffnessRoundOff]:
    """The measure of round-off of a stiffness (AIJ), for a `with` block. Collective."""
    sizes = stiffness.duplicate()
    rows, columns, values = stiffness.getValuesCSR()
    sizes.setValuesCSR(rows, columns, abs(values))
    sizes.assemble()
    diagonal = sizes.getDiagonal()
    root: FloatArray = np.sqrt(diagonal.array_r)
    diagonal.destroy()
    try:
        # a pressure without compliance has none of its own
        of_others = np.divide(1.0, root, out=np.zeros_like(root), where=root > 0.0)[:, None]
        root = np.where(root > 0.0, root, multiply(sizes, of_others)[:, 0])
        yield StiffnessRoundOff(np.where(root > 0.0, root, 1.0), sizes)
    finally:
        sizes.destroy()
