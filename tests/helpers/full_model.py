"""The unreduced model as plain matrices, and what follows from them by other means than the product's."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from flexmbd.continuum import ContinuumModel
from flexmbd.continuum.finite_elements.nodes import node_numbers


def gather(matrix):
    """A PETSc matrix as one scipy matrix on every rank. Collective."""
    comm = matrix.comm.tompi4py()
    indptr, indices, data = matrix.getValuesCSR()
    rows = np.repeat(np.arange(*matrix.getOwnershipRange()), np.diff(indptr))
    parts = [np.concatenate(comm.allgather(part)) for part in (data, rows, indices)]
    return scipy.sparse.coo_array((parts[0], (parts[1], parts[2])), matrix.getSize()).tocsr()


@dataclass(frozen=True)
class FullModel:
    """Stiffness and mass by the numbers of the nodes, the same on every rank; collective to make.

    K, M: (3 n, 3 n); x: (n, 3) in the order of the numbers.
    """

    model: ContinuumModel

    def __post_init__(self):
        # on all ranks at once, since gathering is collective
        _ = self.K, self.M, self.x

    @cached_property
    def _numbers(self):
        owned = node_numbers(self.model)[: self.model.n_owned // 3]
        return np.concatenate(self.model.comm.allgather(owned))

    @cached_property
    def _order(self):
        return (3 * np.argsort(self._numbers)[:, None] + np.arange(3)).reshape(-1)

    @cached_property
    def K(self):
        return gather(self.model.K)[self._order][:, self._order]

    @cached_property
    def M(self):
        return gather(self.model.M)[self._order][:, self._order]

    @cached_property
    def x(self):
        owned = self.model.space.tabulate_dof_coordinates()[: self.model.n_owned // 3]
        return np.concatenate(self.model.comm.allgather(owned))[np.argsort(self._numbers)]

    def rigid(self, origin):
        """(3 n, 6) unit rigid motions about a point, in the mesh's axes."""
        arm = self.x - origin
        motions = np.zeros((len(self.x), 3, 6))
        motions[:, :, :3] = np.eye(3)
        for axis in range(3):
            motions[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arm)
        return motions.reshape(-1, 6)

    def bound(self, frames):
        """(3 n, 6 b + free) from the interfaces' motions and the free dofs to all dofs.

        frames: for each interface which nodes it binds (n,) and its origin.
        """
        taken = np.zeros(len(self.x), dtype=bool)
        columns = []
        for nodes, origin in frames:
            taken |= nodes
            columns.append(np.repeat(nodes, 3)[:, None] * self.rigid(origin))
        free = scipy.sparse.eye_array(len(self.x) * 3, format="csc")[:, ~np.repeat(taken, 3)]
        return scipy.sparse.hstack(
            [scipy.sparse.csc_array(np.hstack([np.zeros((3 * len(self.x), 0)), *columns])), free]
        ).tocsc()

    def frequencies(self, transformation, count):
        """Lowest elastic frequencies, Hz, of the model in other coordinates (3 n, m), dense."""
        k = (transformation.T @ self.K @ transformation).toarray()
        m = (transformation.T @ self.M @ transformation).toarray()
        eigenvalues = scipy.linalg.eigh(k, m, eigvals_only=True)
        elastic = eigenvalues[eigenvalues > 1e-7 * eigenvalues[6]]
        return np.sqrt(elastic[:count]) / (2 * np.pi)
