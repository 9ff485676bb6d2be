"""Nodes that follow others, u_a = sum of w_i u_i, taken out of a body's equations.

With the followers' displacements as those of the nodes that lead, u = T z, forces are T^T f and matrices T^T A T: no
penalty and no multiplier.  The weights are values of shape functions, of those of the cell behind a facet where a weld
made them: they sum to one and give back the follower's place, so that also finite rotations cost nothing, and forces
that are handed on have the same resultant and the same moment, wherever the nodes have gone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from flexmbd.continuum.contract.dof_layout import DofLayout
from flexmbd.errors import FlexmbdError
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class NodalTies:
    """Followers and leaders of a body whose unknown is the displacement alone; each rank knows all weights.

    Attributes:
        comm: of the body.
        layout: of its unknown.
        numbers: (s,) of the nodes that follow (`node_numbers`), ascending.
        places: (s, 3) m, of these in the undeformed body.
        weights: (s, m) w.
        followers: (k,) local nodes, ghosts included, that follow; ascending.
        rows: (k,) of these in the weights.
        leaders: (l,) local nodes, ghosts included, that lead.
        columns: (l,) of these in the weights.
    """

    comm: MPI.Comm
    layout: DofLayout
    numbers: IntArray
    places: FloatArray
    weights: csr_array
    followers: IntArray
    rows: IntArray
    leaders: IntArray
    columns: IntArray

    @property
    def own(self) -> IntArray:
        """(j,) owned nodes that follow."""
        return self._follow[0]

    @cached_property
    def dofs(self) -> NDArray[np.int32]:
        """(3 j,) owned dofs that follow, ascending."""
        return np.sort(self.layout.displacement_dofs[self.own].reshape(-1))

    def complete(self, nodal: FloatArray) -> FloatArray:
        """Give followers among nodes (owned, or local ones with ghosts, ...) their values; it is changed. Collective.

        Returns:
            The same array.
        """
        led = self._gathered(nodal, *self._lead, self.weights.shape[1])
        values = np.asarray(self.weights @ led).reshape(len(self.numbers), *nodal.shape[1:])
        nodes, rows = self._follow if len(nodal) == self.layout.n_owned_nodes else (self.followers, self.rows)
        nodal[nodes] = values[rows]
        return nodal

    def condense(self, nodal: FloatArray) -> FloatArray:
        """Hand forces (owned nodes, ...) on followers on to those that lead; it is changed. Collective.

        Returns:
            The same array, zero at followers.
        """
        nodes, rows = self._follow
        passed = np.asarray(self._handed_on @ self._gathered(nodal, nodes, rows, len(self.numbers)))
        nodal[nodes] = 0.0
        lead, columns = self._lead
        nodal[lead] += passed.reshape(self.weights.shape[1], *nodal.shape[1:])[columns]
        return nodal

    def complete_dofs(self, values: FloatArray) -> FloatArray:
        """As `complete`, of dofs (owned, or local ones with ghosts, ...). Collective."""
        self.complete(_by_node(values))
        return values

    def condense_dofs(self, values: FloatArray) -> FloatArray:
        """As `condense`, of owned dofs (owned dofs, ...). Collective."""
        self.condense(_by_node(values))
        return values

    def condensed(self, matrix: PETSc.Mat, *, keeps_diagonal: bool, into: PETSc.Mat | None = None) -> PETSc.Mat:
        """T^T A T, over all dofs: rows and columns of followers are zero but for the diagonal. Collective.

        Args:
            matrix: A, over all dofs.
            keeps_diagonal: whether followers have A's own diagonal, by which no factor is singular; else zero.
            into: what an earlier call made of a matrix of the same pattern, to be filled anew.

        Returns:
            A new matrix, or ``into``; its pattern holds that of A.
        """
        reduced = matrix.ptap(self._change) if into is None else matrix.ptap(self._change, result=into)
        diagonal = matrix.getDiagonal()
        rows = (self.dofs + matrix.getOwnershipRange()[0]).astype(PETSc.IntType)
        reduced.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        reduced.zeroRowsColumns(rows, diag=0.0)
        if keeps_diagonal:
            for row, value in zip(rows, diagonal.array_r[self.dofs], strict=True):
                reduced.setValue(row, row, value)
        reduced.assemble()
        diagonal.destroy()
        reduced.setOption(PETSc.Mat.Option.SYMMETRIC, bool(matrix.isSymmetricKnown()[1]))
        return reduced

    def refuse_held(self, held: NDArray[np.bool_], *, by: str, kind: type[FlexmbdError]) -> None:
        """Refuse what holds a follower without all nodes that lead it. Collective.

        Args:
            held: (owned nodes, 3) which components are given.
            by: what holds, for the message.
            kind: of the error.

        Raises:
            FlexmbdError: on all ranks: of that kind, names the node and its place.
        """
        given = held.astype(float)
        led = self._gathered(given, *self._lead, self.weights.shape[1])
        follow = self._gathered(given, *self._follow, len(self.numbers))
        open_share = np.asarray(abs(self.weights) @ (1.0 - led)).reshape(-1, 3)
        wrong = np.flatnonzero(((follow > 0.0) & (open_share > EQUAL)).any(axis=1))
        if len(wrong):
            raise kind(
                f"{by} hold node {self.numbers[wrong[0]]} at {told_place(self.places[wrong[0]])} m, which follows "
                "others by a weld, and not all of those that it follows: hold these too, or end the weld before it"
            )

    @cached_property
    def _handed_on(self) -> csr_array:
        """(m, s) the weights, transposed."""
        return csr_array(self.weights.T)

    @cached_property
    def _lead(self) -> tuple[IntArray, IntArray]:
        """Owned nodes that lead, and their columns."""
        own = self.leaders < self.layout.n_owned_nodes
        return self.leaders[own], self.columns[own]

    @cached_property
    def _follow(self) -> tuple[IntArray, IntArray]:
        """Owned nodes that follow, and their rows."""
        own = self.followers < self.layout.n_owned_nodes
        return self.followers[own], self.rows[own]

    def _gathered(self, nodal: FloatArray, nodes: IntArray, rows: IntArray, count: int) -> FloatArray:
        """(count, ...) the values of owned nodes at their rows, on all ranks. Collective."""
        width = int(np.prod(nodal.shape[1:], dtype=int))
        found = np.zeros((count, width))
        found[rows] = nodal[nodes].reshape(len(nodes), width)
        if self.comm.size > 1:
            self.comm.Allreduce(MPI.IN_PLACE, found)  # each row is of one rank
        return found

    @cached_property
    def _change(self) -> PETSc.Mat:
        """Followers' values less what they follow, as unknowns: unity, and the weights in rows of followers."""
        layout = self.layout
        blocks, n = layout.space.dofmap.index_map, layout.n_owned
        first = 3 * blocks.local_range[0]
        mine, columns_of = self._lead
        every = self.comm.allgather((columns_of, first + 3 * mine))
        leads = np.zeros(self.weights.shape[1], dtype=np.int64)
        for columns, dofs in every:
            leads[columns] = dofs
        width = int(np.diff(self.weights.indptr).max(initial=0)) + 1
        change = PETSc.Mat().createAIJ(((n, None), (n, None)), nnz=width, bsize=3, comm=self.comm)
        for row in range(first, first + n):
            change.setValue(row, row, 1.0)
        for node, row in zip(*self._follow, strict=True):
            part = slice(*self.weights.indptr[row : row + 2])
            for k in range(3):
                columns = (leads[self.weights.indices[part]] + k).astype(PETSc.IntType)
                change.setValues([first + 3 * int(node) + k], columns, self.weights.data[part])
        change.assemble()
        return change


@dataclass(frozen=True, eq=False)
class Tie:
    """A node that follows others, the same on all ranks.

    Attributes:
        weld: what makes it, as text.
        node: its number.
        place: (3,) m.
        leaders: (n,) numbers of those that it follows.
        weights: (n,) by how much of each.
    """

    weld: str
    node: int
    place: FloatArray
    leaders: IntArray
    weights: FloatArray


def resolved(ties: Sequence[Tie]) -> csr_array:
    """Weights (s, all leaders) of ties (s,), of which some lead others, by nodes that follow none.

    A chain of ties, at the end of which is a node that follows none, is one tie.

    Returns:
        (s, highest number + 1), by the numbers of the nodes.

    Raises:
        ValueError: its argument is the place in the list of one in a circle.
    """
    count = 1 + max(int(max(tie.leaders.max(), tie.node)) for tie in ties)
    rows = np.repeat(np.arange(len(ties)), [len(tie.leaders) for tie in ties])
    columns = np.concatenate([tie.leaders for tie in ties])
    values = np.concatenate([tie.weights for tie in ties])
    weights: Any = csr_array((values, (rows, columns)), shape=(len(ties), count))
    nodes = np.array([tie.node for tie in ties])
    place = np.full(count, -1)
    place[nodes] = np.arange(len(ties))
    for _ in range(len(ties) + 1):
        led = np.flatnonzero((place[weights.indices] >= 0) & (weights.data != 0.0))
        if not len(led):
            return csr_array(weights)
        of = np.repeat(np.arange(len(ties)), np.diff(weights.indptr))[led]
        through = place[weights.indices[led]]
        if (through == of).any():
            raise ValueError(int(of[through == of][0]))
        chosen = csr_array((weights.data[led], (of, through)), shape=(len(ties), len(ties)))
        weights.data[led] = 0.0
        weights.eliminate_zeros()
        weights = csr_array(weights + chosen @ csr_array((values, (rows, columns)), shape=(len(ties), count)))
    raise ValueError(int(of[0]))


def bound_ties(
    ties: Sequence[Tie], *, comm: MPI.Comm, layout: DofLayout, numbers: IntArray, kind: type[FlexmbdError]
) -> NodalTies | None:
    """Ties on the nodes of the ranks; None of none. Collective.

    Args:
        ties: the same on all ranks, of each node one at most.
        comm: of the body.
        layout: of its unknown.
        numbers: (local nodes including ghosts,) of its nodes.
        kind: of the error.

    Raises:
        FlexmbdError: on all ranks: of that kind: ties that go round in a circle.
    """
    if not ties:
        return None
    ties = sorted(ties, key=lambda tie: tie.node)
    try:
        weights = resolved(ties)
    except ValueError as circle:
        tie = ties[circle.args[0]]
        raise kind(
            f"{tie.weld}: node {tie.node} at {told_place(tie.place)} m follows, through other ties, itself; turn one "
            "of the welds around, so that its other side follows"
        ) from None
    known = np.unique(weights.indices)
    follows = np.array([tie.node for tie in ties])
    weights = csr_array(weights[:, known])
    followers, leaders = np.flatnonzero(np.isin(numbers, follows)), np.flatnonzero(np.isin(numbers, known))
    return NodalTies(
        comm, layout, follows, np.array([tie.place for tie in ties]), weights,
        followers, np.searchsorted(follows, numbers[followers]), leaders, np.searchsorted(known, numbers[leaders]),
    )  # fmt: skip


def _by_node(values: FloatArray) -> FloatArray:
    """A view (nodes, 3, ...) of dofs, all of them displacements."""
    return values.reshape(len(values) // 3, 3, *values.shape[1:])


def told_place(x: FloatArray) -> list[float]:
    """A place with four digits, for messages."""
    return [float(f"{c:.4g}") for c in x]


