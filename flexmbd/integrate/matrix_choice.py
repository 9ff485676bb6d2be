"""How an implicit method's matrix is factored: by the tree's recursion, as a sparse matrix, or as a dense one.

The recursion over articulated bodies serves trees of rigid bodies whose forces act across single joints or from the
ground.  It is elimination from the leaves to the root by 6 x 9 answers; a sparse matrix with every eighth body of a
chain cut takes six times as long to factor and twice as long to solve with, at 300 links as at 3000.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.arrays import IntArray, Plan
from flexmbd.multibody.kernels.elements.table import couple_all
from flexmbd.multibody.kernels.sparse.block_pattern import BlockPattern
from flexmbd.multibody.kernels.tangent.diagonal_blocks import DiagonalBlocks, diagonal_blocks, unknown_bounds
from flexmbd.multibody.kernels.tangent.sparse_matrix import (
    SparseMatrix,
    factor_cost,
    new_sparse_matrix,
    no_sparse_matrix,
    sparse_blocks,
)
from flexmbd.multibody.kernels.tangent.tangent_layout import FloatArray, TangentWork, new_tangent_work
from flexmbd.multibody.kernels.tangent.tree_recursion import TreeRecursion, new_tree_recursion, recursion_cost
from flexmbd.multibody.kernels.tangent.unknown_blocks import UnknownBlocks

_JOINED = ": a force may join any two of its coordinates"

@dataclass(frozen=True, eq=False)
class MatrixChoice:
    """What is chosen for a plan.

    Attributes:
        side_by_side: the diagonal blocks of a dense matrix.
        recursion: with arrays where it is chosen, else empty.
        sparse: blocks and pattern where a sparse matrix is chosen.
    """

    plan: Plan
    side_by_side: DiagonalBlocks
    recursion: TreeRecursion
    sparse: tuple[UnknownBlocks, BlockPattern] | None

    @property
    def recurs(self) -> bool:
        """Whether the recursion is chosen."""
        return len(self.recursion.number) > 0

    @property
    def bounds(self) -> IntArray:
        """(c + 1,) of the blocks of a dense matrix with two unknowns of each row."""
        return unknown_bounds(self.side_by_side, 2)

    @property
    def orders(self) -> FloatArray:
        """(k,) orders of dense matrices, one unknown for each row, of which factors take as many operations."""
        if self.recurs or self.sparse is not None:
            cost = recursion_cost(self.plan) if self.sparse is None else factor_cost(self.sparse[1])
            return np.array([(1.5 * cost) ** (1.0 / 3.0)])
        return np.diff(unknown_bounds(self.side_by_side, 1)).astype(float)

    def new_sparse(self) -> SparseMatrix:
        """Allocate the sparse matrix; an empty one where it is not chosen."""
        return no_sparse_matrix() if self.sparse is None else new_sparse_matrix(self.plan, *self.sparse)

    def new_tangent(self, nv: int, sizes: FloatArray) -> TangentWork:
        """Allocate the tangent's scratch, see ``new_tangent_work``."""
        blocks = self.sparse[0] if self.sparse else None
        return new_tangent_work(self.plan, nv, sizes=sizes, blocks=blocks, side_by_side=self.side_by_side)

    def text(self) -> str:
        """What is chosen, in words."""
        if self.recurs:
            return "by the recursion over the tree, joint by joint"
        sizes = np.diff(self.bounds)
        if self.sparse is None:
            return dense_text(self.plan, sizes)
        found, pattern = self.sparse
        cut = f", {len(found.cuts)} bodies of the tree cut" if found.cuts else ""
        return (
            f"sparse, {pattern.unknowns} unknowns in {len(found.first)} blocks{cut}: {pattern.fill} numbers and "
            f"{pattern.operations:.2g} operations a factorisation, for {(sizes.astype(float) ** 2).sum():.2g} and "
            f"{2.0 / 3.0 * (sizes.astype(float) ** 3).sum():.2g} if dense ({_in_blocks(sizes)})"
        )


def dense_text(plan: Plan, sizes: IntArray) -> str:
    """A dense matrix of diagonal blocks of these sizes, in words."""
    return f"dense, {_in_blocks(sizes)}{_JOINED if couple_all(plan).any() else ''}"


def _in_blocks(sizes: IntArray) -> str:
    most = int(sizes.max(initial=0))
    many = f"{len(sizes)} blocks of up to " if len(sizes) > 1 else ""
    return f"{many}{most} unknown{'' if most == 1 else 's'}"


def choose_matrix(plan: Plan, *, dense: bool = False) -> MatrixChoice:
    """That of generalized-alpha and of Radau IIA: by counted operations; ``dense``: nothing else."""
    side_by_side = diagonal_blocks(plan)
    free = np.diff(side_by_side.free)
    recursion = new_tree_recursion(plan, free[:0] if dense else free)
    found = None
    if not dense and len(recursion.number) == 0:
        found = sparse_blocks(plan, np.diff(unknown_bounds(side_by_side, 2)))
    return MatrixChoice(plan, side_by_side, recursion, found)


def alpha_matrix(plan: Plan, *, dense: bool = False) -> MatrixChoice:
    """That of generalized-alpha."""
    return choose_matrix(plan, dense=dense)


def momentum_matrix(plan: Plan) -> MatrixChoice:
    """That of the energy-momentum method, sparse of trees of rigid bodies without prescribed motions alone.

    It takes masses at two places from each other, of which no body may be cut.
    """
    side_by_side, found = diagonal_blocks(plan), None
    if not (len(plan.rows) or len(plan.flex) or len(plan.driven)):
        found = sparse_blocks(plan, np.diff(unknown_bounds(side_by_side, 1)), cuts=False)
    return MatrixChoice(plan, side_by_side, new_tree_recursion(plan, side_by_side.free[:0]), found)


def radau_matrix(plan: Plan) -> MatrixChoice:
    """That of Radau IIA."""
    return choose_matrix(plan)
