"""The inverse of a stiffness of quadratic or higher elements: conjugate gradients, by the degrees' multigrid."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.continuum.matrices.blocks import FloatArray
from flexmbd.continuum.matrices.eigen import BlockOperator
from flexmbd.reduction.static_shapes.conjugate_gradients import ConjugateGradients
from flexmbd.reduction.static_shapes.degree_multigrid import DegreeLevel, degree_multigrid
from flexmbd.reduction.static_shapes.stiffness_round_off import round_off


class DegreeInverse:
    """K_II^-1 by conjugate gradients with a cycle over the degrees of the elements.

    Attributes:
        name: of the method, for the record's provenance.
    """

    name = "conjugate gradients, multigrid of the degrees"

    def __init__(self, stiffness: PETSc.Mat, level: DegreeLevel, mask: NDArray[np.bool_]) -> None:
        """Put together what is there already; not collective.

        Args:
            stiffness: K over all dofs.
            level: of the highest degree.
            mask: (rows of this rank,) whether a dof is not held.
        """
        self._stiffness, self._level, self._mask = stiffness, level, mask
        comm = stiffness.comm.tompi4py()
        self._iteration = ConjugateGradients(level.product, level.cycle, self._noise, comm=comm)

    def solve(self, block: FloatArray) -> FloatArray:
        """K_II^-1 times a block (rows of the mask, k). Collective.

        Raises:
            ConvergenceError: on all ranks: a column does not converge.
        """
        return self._on_all(self._iteration.solve, block)

    def refine(self, block: FloatArray) -> FloatArray:
        """As in `Inverse`."""
        return self._on_all(self._iteration.refine, block)

    def is_quick(self) -> bool:
        """Whether it converges within some 45 iterations, which it does but where cells are thin. Collective."""
        rng = np.random.default_rng(self._iteration.comm.rank)
        return self._iteration.is_quick(np.where(self._mask, rng.normal(size=len(self._mask)), 0.0)[:, None])

    def approximate(self, block: FloatArray) -> FloatArray:
        """One multigrid cycle in the place of K_II^-1. Collective."""
        return self._on_all(self._level.cycle, block)

    def _on_all(self, operator: BlockOperator, block: FloatArray) -> FloatArray:
        whole = np.zeros((len(self._mask), block.shape[1]), order="F")
        whole[self._mask] = block
        return np.asfortranarray(operator(whole)[self._mask])

    def _noise(self, block: FloatArray) -> FloatArray:
        """(rows of this rank, k) sizes of the round-off of K times a block. Collective."""
        with round_off(self._stiffness) as measure:
            return np.where(self._mask[:, None], measure.forces(block), 0.0)


@contextmanager
def by_degrees(stiffness: PETSc.Mat, mask: NDArray[np.bool_], *, layout: DofLayout) -> Iterator[DegreeInverse]:
    """K_II^-1 for a `with` block, by the degrees of the elements. Collective; arguments as of `degree_multigrid`."""
    with degree_multigrid(stiffness, mask, layout=layout) as level:
        yield DegreeInverse(stiffness, level, mask)
