"""The state of a body with history as arrays over the whole body, in an order independent of the partition."""

from __future__ import annotations

from mpi4py import MPI

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum.finite_elements.nodes import dof_numbers, node_numbers
from flexmbd.continuum.history.held_fields import PortStates
from flexmbd.continuum.history.nonlinear_model import HistorySnapshot, NonlinearModel

FloatArray = NDArray[np.float64]


class BodyMemory:
    """Gathers and hands out a body's nodal and pointwise values. Constructing one is collective.

    Nodes go by their numbers in the mesh's input (`node_numbers`), cells by their places there, points by their order
    in the cell: so a body on other ranks, of the same mesh, can take over.

    Attributes:
        node_count: of nodes in the whole body.
    """

    def __init__(self, body: NonlinearModel) -> None:
        """Number nodes and cells."""
        self._body, self._comm = body, body.comm
        self._owned = body.layout.n_owned_nodes
        self._node, self._nodes_of, self.node_count = _places(body.comm, node_numbers(body), self._owned)
        topology = body.mesh.mesh.topology
        cells = topology.index_map(topology.dim)
        self._cells, self._all_cells = int(cells.size_local), int(cells.size_local + cells.num_ghosts)
        numbers = topology.original_cell_index
        self._cell, self._cells_of, self._cell_count = _places(body.comm, numbers, self._cells)
        if body.layout.has_further:
            further = body.layout.further_dofs
            self._n_further = int(np.count_nonzero(further < body.n_owned))
            numbers = dof_numbers(body, further)
            self._further, self._further_of, self._further_count = _places(body.comm, numbers, self._n_further)

    def gather_nodes(self, values: FloatArray) -> FloatArray:
        """Values (local nodes, m) as those of all nodes by number, the same on every rank. Collective."""
        return self._gather(self._nodes_of, values[: self._owned], self.node_count)

    def scatter_nodes(self, values: FloatArray) -> FloatArray:
        """Back to (local nodes including ghosts, m)."""
        return np.ascontiguousarray(values[self._node])

    def gather(self, snapshot: HistorySnapshot) -> dict[str, FloatArray]:
        """A snapshot as arrays of the whole body. Collective."""
        layout = self._body.layout
        arrays = {"displacement": self.gather_nodes(layout.displacements(snapshot.displacement))}
        if layout.has_further:
            further = snapshot.displacement[layout.further_dofs[: self._n_further]]
            arrays["further unknowns"] = self._gather(self._further_of, further, self._further_count)
        for k, history in enumerate(snapshot.history):
            if self._comm.allreduce(history.size, op=MPI.MAX):
                rows = history.reshape(self._all_cells, -1)[: self._cells]
                arrays[f"history {k}"] = self._gather(self._cells_of, rows, self._cell_count)
        if self._body.has_dissipation:
            arrays["viscous work"] = np.array(snapshot.viscous_work)
        if self._body.temperature is not None:
            arrays["temperature"] = self.gather_nodes(snapshot.temperature[:, None])
        if self._body.ports:
            arrays["ports"] = np.stack([snapshot.ports.efforts, snapshot.ports.flows, snapshot.ports.works])
        return arrays

    def scatter(self, arrays: dict[str, FloatArray]) -> HistorySnapshot:
        """This rank's part of a snapshot of the whole body."""
        histories = []
        for k, now in enumerate(self._body.snapshot().history):
            if f"history {k}" in arrays:
                now.reshape(self._all_cells, -1)[:] = arrays[f"history {k}"][self._cell]
            histories.append(now)
        layout = self._body.layout
        displacement = layout.at_dofs(self.scatter_nodes(arrays["displacement"]), owned=False)
        if layout.has_further:
            displacement[layout.further_dofs] = arrays["further unknowns"][self._further]
        warmth = self.scatter_nodes(arrays["temperature"])[:, 0] if "temperature" in arrays else np.zeros(0)
        ports = PortStates(*arrays["ports"]) if "ports" in arrays else PortStates.at_rest(0)
        return HistorySnapshot(displacement, tuple(histories), float(arrays.get("viscous work", 0.0)), warmth, ports)

    def _gather(self, places: list[NDArray[np.int64]], rows: FloatArray, count: int) -> FloatArray:
        """The rows of all ranks at the places of each rank's. Collective."""
        whole = np.empty((count, *rows.shape[1:]))
        for part, values in zip(places, self._comm.allgather(rows), strict=True):
            whole[part] = values
        return whole


def _places(
    comm: MPI.Comm, numbers: NDArray[np.integer], owned: int
) -> tuple[NDArray[np.int64], list[NDArray[np.int64]], int]:
    """Places of numbers, those of ghosts too, among all owned ones in ascending order. Collective.

    Returns:
        Of this rank's numbers; of each rank's owned ones; how many there are.
    """
    every = comm.allgather(numbers[:owned])
    known = np.unique(np.concatenate(every))
    return np.searchsorted(known, numbers), [np.searchsorted(known, one) for one in every], len(known)
