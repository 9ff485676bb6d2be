"""Round-off of a body's internal forces, by the diagonal of its tangent: below it no residual falls.

A displacement u has the round-off of its size, and so a strain of its gradient; a law in F = 1 + grad u has besides the
round-off of 1, which is that of a displacement of a cell's shortest edge.  Where loads are small the second is larger
than they are by far, mostly across thin walls, where it moves nothing.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.elastic_sums import cell_edges
from flexmbd.continuum.history.nonlinear_model import NonlinearModel
from flexmbd.round_off import EPSILON

FloatArray = NDArray[np.float64]

_LAST_PLACES = 4.0  # units in the last place of rounded numbers


class NoiseForces(NamedTuple):
    """2-norms of forces on free dofs, N.

    Attributes:
        of_displacement: of the round-off of displacements.
        of_gradient: of the round-off of F, of laws that see it.
    """

    of_displacement: float
    of_gradient: float


class ResidualNoise:
    """That of one body. Constructing one is not collective."""

    def __init__(self, body: NonlinearModel, free: NDArray[np.intp]) -> None:
        """``free``: owned dofs that are not prescribed."""
        self._body, self._free = body, free

    def of(self, matrix: PETSc.Mat, increment: FloatArray) -> NoiseForces:
        """At an increment (local dofs including ghosts,) m, by the tangent there. Collective."""
        body, n = self._body, self._body.n_owned
        diagonal = matrix.getDiagonal().array_r
        moved = diagonal * (body.displacement[:n] + increment[:n])
        sizes = [_LAST_PLACES * EPSILON * body.norm(part[self._free]) for part in (moved, diagonal * self._edges)]
        return NoiseForces(*sizes)

    @cached_property
    def _edges(self) -> FloatArray:
        """(owned dofs,) m, the shortest edge of the cells at a dof; zero of surfaces, lines, further unknowns."""
        body, found = self._body, np.zeros(self._body.layout.n_local)
        edges = cell_edges(body.mesh)
        if body.layout.has_further or not len(edges):
            return found[: body.n_owned]
        shortest = np.linalg.norm(edges, axis=2).min(axis=1)
        nodes = body.space.dofmap.list[: len(edges)]
        least = np.full(int(nodes.max()) + 1, np.inf)
        np.minimum.at(least, nodes, shortest[:, None])
        met = np.flatnonzero(np.isfinite(least))
        found[body.displacement_dofs[met]] = least[met, None]
        return found[: body.n_owned]
