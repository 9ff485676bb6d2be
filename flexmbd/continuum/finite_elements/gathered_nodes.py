"""Values on the nodes of a mesh that is spread over the ranks: averages over the cells, in one order on all of them."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.discretisation import Discretisation
from flexmbd.continuum.finite_elements.nodes import boundary_triangles, node_numbers, sorted_triangles

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def von_mises(sigma: FloatArray) -> FloatArray:
    """(k,) von Mises stresses of tensors (k, 9)."""
    deviator = sigma - sigma[:, [0, 4, 8]].mean(axis=1, keepdims=True) * np.eye(3).ravel()
    return np.sqrt(1.5) * np.linalg.norm(deviator, axis=1)


class GatheredNodes:
    """The displacement nodes of all ranks, by `node_numbers`. Constructing one is collective.

    Attributes:
        n_cells: cells that this rank owns.
        n_cells_here: those that it knows, ghosts included.
        per_cell: nodes of a cell.
        places: (n_cells * nodes of a cell,) local node of each node of these cells.
        number: (k,) node numbers, ascending; this and the rest the same on every rank.
        x: (k, 3) m, in the mesh's axes.
        triangle: (t, 3) the boundary as rows of `x`.
    """

    def __init__(self, model: Discretisation, x: FloatArray) -> None:
        """Collect the nodes; `x` (local nodes, 3) m are their places."""
        self._comm = model.comm
        topology = model.mesh.mesh.topology
        cell_map = topology.index_map(topology.dim)
        self.n_cells = int(cell_map.size_local)
        self.n_cells_here = int(cell_map.size_local + cell_map.num_ghosts)
        cells = model.layout.node_space.dofmap.list[: self.n_cells]
        self.per_cell = cells.shape[1]
        self.places = cells.ravel()
        numbers = node_numbers(model)
        self.number = self._union(np.unique(numbers))
        self._row = np.searchsorted(self.number, numbers[self.places])
        ones, columns = np.ones(len(self._row)), np.arange(len(self._row))
        shape = (len(self.number), len(self._row))
        self._sum = scipy.sparse.csr_array((ones, (self._row, columns)), shape=shape)
        self._count = self._total(self._sum.sum(axis=1))
        self.x = self.average(x[self.places])
        self.triangle = self._boundary(numbers[boundary_triangles(model)])

    def rows(self, cell: int) -> IntArray:
        """(nodes of a cell,) rows of the nodes of a cell that this rank owns; not collective."""
        return self._row.reshape(self.n_cells, self.per_cell)[cell]

    def average(self, values: FloatArray) -> FloatArray:
        """Average over the cells at each node, (k, m), of values (len(places), m). Collective."""
        return self._total(self._sum @ values) / self._count[:, None]

    def largest(self, values: FloatArray) -> tuple[float, int]:
        """The largest of values (len(places),) and the row of its node. Collective."""
        k = int(values.argmax()) if len(values) else -1
        mine = (float(values[k]), -int(self._row[k])) if len(values) else (-np.inf, 0)
        value, row = max(self._comm.allgather(mine))
        return value, -row

    def _total(self, values: FloatArray) -> FloatArray:
        """Sum over the ranks, made by one of them so that it is the same on all."""
        if self._comm.size == 1:
            return values
        total = self._comm.reduce(values, root=0)
        return np.asarray(self._comm.bcast(total, root=0))

    def _union(self, numbers: IntArray) -> IntArray:
        return np.unique(np.concatenate(self._comm.allgather(numbers)))

    def _boundary(self, triangles: IntArray) -> IntArray:
        """The boundary of all ranks, from this rank's triangles of node numbers."""
        gathered = np.concatenate(self._comm.allgather(triangles))
        return np.searchsorted(self.number, sorted_triangles(gathered))
