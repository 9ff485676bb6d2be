"""The inverse of a stiffness by a factor whose blocks are of low rank, and a few conjugate gradients.

A factor of a bulky body couples parts that lie far apart; such couplings are smooth, and to any tolerance their blocks
have a low rank (Amestoy et al. 2015, doi:10.1137/120903476; MUMPS makes them).  At 200 000 dofs and 1e-4 the factor has
0.63 of the entries and takes 0.29 of the operations; the shares fall as the dofs grow. Some six conjugate gradients
bring the digits back.
"""

from __future__ import annotations

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.matrices.blocks import FloatArray, multiply
from flexmbd.reduction.static_shapes.conjugate_gradients import ConjugateGradients
from flexmbd.reduction.static_shapes.factor import Factor
from flexmbd.reduction.static_shapes.stiffness_round_off import round_off

#: Relative error to which blocks of the factor are compressed.
TOLERANCE = 1e-4


class CompressedInverse:
    """K_II^-1 by conjugate gradients that a compressed factor preconditions.

    Attributes:
        name: of the method, for the record's provenance.
        memory: bytes of the factor on all ranks, by MUMPS's estimate.
    """

    name = "compressed factor, conjugate gradients"

    def __init__(self, stiffness: PETSc.Mat, mask: NDArray[np.bool_], factor: Factor) -> None:
        """Put together what is there already; not collective.

        Args:
            stiffness: K over all dofs, which spares a copy of its interior.
            mask: (rows of this rank,) the dofs that are not held.
            factor: of K_II, compressed.
        """
        self._stiffness, self._mask, self._factor = stiffness, mask, factor
        self.memory = factor.memory
        comm = stiffness.comm.tompi4py()
        self._iteration = ConjugateGradients(self._product, factor.solve, self._noise, comm=comm)

    def solve(self, block: FloatArray) -> FloatArray:
        """K_II^-1 times a block (rows of the mask, k). Collective.

        Raises:
            ConvergenceError: on all ranks: a column does not converge.
        """
        return self._iteration.solve(block)

    def refine(self, block: FloatArray) -> FloatArray:
        """As in `Inverse`."""
        return self._iteration.refine(block)

    def approximate(self, block: FloatArray) -> FloatArray:
        """The compressed factor alone in the place of K_II^-1. Collective."""
        return self._factor.solve(block)

    def destroy(self) -> None:
        """Give the memory back. Collective."""
        self._factor.destroy()

    def _product(self, block: FloatArray) -> FloatArray:
        return np.asfortranarray(multiply(self._stiffness, self._on_all(block))[self._mask])

    def _noise(self, block: FloatArray) -> FloatArray:
        with round_off(self._stiffness) as measure:
            return measure.forces(self._on_all(block))[self._mask]

    def _on_all(self, block: FloatArray) -> FloatArray:
        whole = np.zeros((len(self._mask), block.shape[1]), order="F")
        whole[self._mask] = block
        return whole
