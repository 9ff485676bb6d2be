"""What a body with history remembers as arrays over the whole body, in an order that no partition changes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.nodes import node_numbers
from flexmbd.continuum.updated_lagrangian import Snapshot, UpdatedLagrangian

FloatArray = NDArray[np.float64]


class BodyMemory:
    """Gathers and hands out a body's nodal and pointwise values. Constructing one is collective."""

    def __init__(self, body: UpdatedLagrangian) -> None:
        """Number nodes and cells."""
        self._body, self._comm = body, body.comm
        self._node = node_numbers(body)  # type: ignore[arg-type]
        self._owned = body.layout.n_owned_nodes
        topology = body.mesh.mesh.topology
        self._cells = topology.index_map(topology.dim).size_local
        self._cell = np.asarray(topology.original_cell_index[: self._cells])

    def gather_nodes(self, values: FloatArray) -> FloatArray:
        """Of (local nodes including ghosts, m) those of all nodes by number, the same on every rank. Collective."""
        return self._gather(self._node[: self._owned], values[: self._owned])

    def scatter_nodes(self, values: FloatArray) -> FloatArray:
        """Back to (local nodes including ghosts, m)."""
        return np.ascontiguousarray(values[self._node])

    def gather(self, snapshot: Snapshot) -> dict[str, FloatArray]:
        """A snapshot as arrays of the whole body. Collective."""
        arrays = {"displacement": self.gather_nodes(snapshot.displacement.reshape(-1, 3))}
        for k, history in enumerate(snapshot.history):
            if history.size:
                rows = history.reshape(self._all_cells, -1)[: self._cells]
                arrays[f"history {k}"] = self._gather(self._cell, rows)
        return arrays

    def scatter(self, arrays: dict[str, FloatArray]) -> Snapshot:
        """This rank's part of a snapshot of the whole body."""
        histories = []
        for k, now in enumerate(self._body.snapshot().history):
            if now.size:
                rows = now.reshape(self._all_cells, -1)
                rows[: self._cells] = arrays[f"history {k}"][self._cell]
            histories.append(now)
        return Snapshot(self.scatter_nodes(arrays["displacement"]).reshape(-1), tuple(histories))

    @property
    def _all_cells(self) -> int:
        """Cells of this rank, ghosts included."""
        topology = self._body.mesh.mesh.topology
        cells = topology.index_map(topology.dim)
        return int(cells.size_local + cells.num_ghosts)

    def _gather(self, numbers: NDArray[np.integer], rows: FloatArray) -> FloatArray:
        if self._comm.size == 1:
            gathered = np.empty_like(rows)
            gathered[numbers] = rows
            return gathered
        parts = self._comm.allgather((numbers, rows))
        count = sum(len(part) for part, _ in parts)
        whole = np.empty((count, rows.shape[1]))
        for part, values in parts:
            whole[part] = values
        return whole
