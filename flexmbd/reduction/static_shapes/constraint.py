"""Averages of the displacement that are held at given values, by multipliers.

With the flexibility A = K_II^-1 of a body that rigid interfaces hold, u = A (f + C^T lam) and
C u = q give S lam = q - C A f, S = C A C^T.  A body that nothing holds has the elastic flexibility A
(`flexmbd.reduction.static_shapes.statics`) and its rigid motions R besides, u = A (f + C^T lam) + R a, and the
equilibrium R^T (f + C^T lam) = 0 determines a.  (The same algebra as Farhat & Roux 1991 have for
floating subdomains, doi:10.1002/nme.1620320604.)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from mpi4py import MPI

import numpy as np

from flexmbd.continuum.matrices.blocks import FloatArray, inner, symmetric
from flexmbd.errors import ReductionError
from flexmbd.reduction.static_shapes.factor import SINGULAR
from flexmbd.round_off import WORTHLESS_PIVOT


@dataclass(frozen=True, eq=False)
class Constraint:
    """Averages C u of a body, and the response to forces on them.

    Attributes:
        comm: the ranks that the rows are spread over.
        columns: (rows, c) C^T.
        rigid: (rows, 6) rigid motions of a body that nothing holds, or (rows, 0).
        responses: (rows, c + 6 or c + 0) A C^T and R.
        inverse: of the small system for lam and a.
    """

    comm: MPI.Comm
    columns: FloatArray
    rigid: FloatArray
    responses: FloatArray
    inverse: FloatArray

    def multipliers(self, averages: FloatArray, *, resultant: FloatArray | None = None) -> FloatArray:
        """lam and a, one below the other, (c + 6 or c + 0, k); not collective.

        Args:
            averages: (c, k) q - C A f, what the averages lack.
            resultant: (6, k) R^T f of the loads on a body that nothing holds; default: none.
        """
        lacks = np.zeros((len(self.inverse), averages.shape[1]))
        lacks[: len(averages)] = averages
        if resultant is not None:
            lacks[len(averages) :] = -resultant
        small: FloatArray = self.inverse @ lacks
        return small

    def held(self, displacement: FloatArray, loads: FloatArray) -> FloatArray:
        """The response to loads f (rows, k), from A f, with all averages at zero. Collective."""
        lacks = -inner(self.comm, self.columns, displacement)
        resultant = inner(self.comm, self.rigid, loads) if self.rigid.shape[1] > 0 else None
        small = self.multipliers(lacks, resultant=resultant)
        return np.asfortranarray(displacement + self.responses @ small)

    def energies(self, reactions: FloatArray) -> FloatArray:
        """(k,) twice the strain energies that reactions C^T lam (rows, k) would cause, averages free. Collective."""
        c = self.columns.shape[1]
        gram = inner(self.comm, self.columns, self.columns)
        lam = np.linalg.solve(gram, inner(self.comm, self.columns, reactions))
        flexibility = symmetric(inner(self.comm, self.columns, self.responses[:, :c]))
        return np.asarray(np.einsum("ck,cd,dk->k", lam, flexibility, lam))


def constrain(
    comm: MPI.Comm,
    flexibility: Callable[[FloatArray], FloatArray],
    columns: FloatArray,
    *,
    rigid: FloatArray,
    names: Sequence[str],
) -> Constraint:
    """Work out the response to forces on the averages. Collective.

    Args:
        comm: the ranks that the rows are spread over.
        flexibility: A times a block (rows, k).
        columns: (rows, c) C^T, full rank.
        rigid: (rows, 6) rigid motions of a body that nothing holds, or (rows, 0).
        names: of the interfaces with averages, for messages.

    Raises:
        ReductionError: on all ranks: the averages depend on each other.
    """
    c, r = columns.shape[1], rigid.shape[1]
    gram = inner(comm, columns, columns)
    # with a regular stiffness the averages depend on each other where their rows do, and nowhere else
    if not np.linalg.eigvalsh(_scaled(gram)[0])[0] > WORTHLESS_PIVOT:
        raise ReductionError(
            f"the averages of the interfaces {', '.join(map(repr, names))} depend on each other or on "
            "the rigid interfaces, so their frames cannot move alone; take groups that overlap less"
        )
    flexible = flexibility(columns)
    system = np.zeros((c + r, c + r))
    system[:c, :c] = symmetric(inner(comm, columns, flexible))
    system[:c, c:] = inner(comm, columns, rigid)
    system[c:, :c] = system[:c, c:].T
    scaled, scale = _scaled(system)
    if not np.isfinite(scaled).all():
        raise ReductionError(f"the body has no stiffness against the motions of the averaged interfaces: {SINGULAR}")
    inverse = symmetric(np.asarray(np.linalg.inv(scaled))) * np.outer(scale, scale)
    return Constraint(comm, columns, rigid, np.hstack([flexible, rigid]), inverse)


def _scaled(system: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A symmetric matrix, and what its rows and columns are scaled by: to a unit diagonal, or to unit columns."""
    diagonal = np.diag(system)
    scale = np.ones(len(system))
    scale[diagonal > 0.0] = 1.0 / np.sqrt(diagonal[diagonal > 0.0])
    sizes = np.linalg.norm(scale[:, None] * system, axis=0)
    others = (diagonal <= 0.0) & (sizes > 0.0)
    scale[others] = 1.0 / sizes[others]
    return system * np.outer(scale, scale), scale
