"""Stiffness, damping or mass of a machine of many bodies as a sparse matrix with the rows of its loops; solutions.

Unknowns are changes of the free coordinates and of the reactions, [K C^T; C 0].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan, Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.tree import modal_places, parents
from flexmbd.multibody.kernels.sparse.block_lu import (
    count_signs,
    factor_holding,
    factor_sparse,
    new_block_matrix,
    solve_sparse,
)
from flexmbd.multibody.kernels.sparse.block_pattern import BlockPattern
from flexmbd.multibody.kernels.sparse.index_lists import sums, within
from flexmbd.multibody.kernels.tangent.diagonal_blocks import one_block
from flexmbd.multibody.kernels.tangent.sparse_assembly import assemble_sparse, put_rows
from flexmbd.multibody.kernels.tangent.sparse_matrix import SparseMatrix, new_sparse_matrix, sparse_blocks
from flexmbd.multibody.kernels.tangent.tangent_layout import TangentWork, new_tangent_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LEAST_UNKNOWNS = 100  # below, dense matrices are solved in less time than a pattern is made
_DEEP = 8.0  # a tree is deep whose velocities are coupled with so large a share of all by carrying each other alone


@dataclass(frozen=True, eq=False)
class MatrixEntries:
    """The entries of K among the free velocities, and where they stand in the matrix's values.

    Attributes:
        row, column: (k,) velocities, row by row.
        place: (k,) in the values.
        mirrored: (k,) which of them lies across the diagonal.
        free: (n,) velocities that have a row.
        begin: (n,) where that begins.
    """

    row: IntArray
    column: IntArray
    place: IntArray
    mirrored: IntArray
    free: IntArray
    begin: IntArray

    def energies(self, values: FloatArray, size: FloatArray) -> FloatArray:
        """(nv,) J, all that a coordinate's row has in sizes (nv,)."""
        terms = np.abs(values) * size[self.row] * size[self.column]
        found = np.zeros(len(size))
        found[self.free] = np.add.reduceat(terms, self.begin)
        return found

    def nearby(self, energies: FloatArray) -> FloatArray:
        """(nv,) the largest of those that a coordinate may be coupled with."""
        found = energies.copy()
        found[self.free] = np.maximum.reduceat(energies[self.column], self.begin)
        return found

    def skewness(self, values: FloatArray, size: FloatArray, *, least: float) -> float:
        """The largest K_ij - K_ji over the coordinates' own stiffness.

        That counts as no less than a share ``least`` of the stiffness that it is coupled with.
        """
        energy = self.energies(values, size)
        energy = np.maximum(energy, least * self.nearby(energy))
        own = np.where(energy > 0.0, np.sqrt(energy) / size, 1.0)
        skew = np.abs(values - values[self.mirrored]) / (own[self.row] * own[self.column])
        return float(skew.max(initial=0.0))


@dataclass(frozen=True, eq=False)
class SparseStiffness:
    """A machine's matrix; its factors are those of the last state at which it was factored.

    Attributes:
        scene: compiled, without redundant rows.
        plan: of the scene, or with some of its forces.
        work: scratch; ``work.time`` holds the functions of time.
        sparse: pattern, values and factors.
        tangents: scratch.
        entries: of K.
    """

    scene: CompiledScene
    plan: Plan
    work: Work
    sparse: SparseMatrix
    tangents: TangentWork
    entries: MatrixEntries

    def force(self, x: FloatArray, multipliers: FloatArray) -> FloatArray:
        """(nv,) what is out of balance at rest at x (nx,) with reactions (m,)."""
        rest, force = np.zeros(self.scene.nv), np.zeros(self.scene.nv)
        residual(self.plan, self.work, x, rest, rest, multipliers, force)
        self.scene.refuse_failed(self.work)
        return force

    def assemble(self, x: FloatArray, multipliers: FloatArray) -> None:
        """Set the matrix up at x, after ``force`` there."""
        rest = np.zeros(self.scene.nv)
        self.assemble_at(x, rest, rest, multipliers, weights=(1.0, 0.0, 0.0))

    def assemble_at(
        self,
        x: FloatArray,
        v: FloatArray,
        a: FloatArray,
        multipliers: FloatArray,
        *,
        weights: tuple[float, float, float],
    ) -> None:
        """Set up the derivatives by x, v and a, each times its weight, after ``residual`` there."""
        plan, sparse, values = self.plan, self.sparse, self.sparse.matrix.values
        assemble_sparse(plan, self.work, self.tangents, sparse.to, x, v, a, multipliers, *weights, values)
        if len(plan.rows):
            slopes = np.tile((1.0, 0.0, 0.0), (len(plan.rows), 1))
            put_rows(plan, self.tangents, sparse.to, self.tangents.jacobian, slopes, 1.0, values)

    def stiffen(self, added: FloatArray) -> None:
        """Add (nv,) to the diagonal of K that was assembled."""
        own = self.entries.row == self.entries.column
        self.sparse.matrix.values[self.entries.place[own]] += added[self.entries.row[own]]

    def factor(self, terms: FloatArray) -> bool:
        """Factor what was assembled, what nothing resists being held; False if rows have no pivots.

        ``terms``: (nv,) what diagonal entries may be the sum of, beside which smaller ones are round-off.
        """
        free = self.scene.plan.free
        self.sparse.matrix.terms[: len(free)] = terms[free]
        factor_holding(self.sparse.pattern, self.sparse.matrix)
        return not self.sparse.matrix.held[len(self.scene.plan.free) :].any()

    def solve(self, force: FloatArray, gaps: FloatArray | float = 0.0) -> tuple[FloatArray, FloatArray]:
        """(nv,) change of the configuration and (m,) of the reactions that a force (nv,) and gaps (m,) make."""
        plan, right = self.scene.plan, self.sparse.rhs
        n, m = len(plan.free), len(plan.rows)
        right[0, :n], right[0, n : n + m], right[0, n + m :] = force[plan.free], gaps, 0.0
        solve_sparse(self.sparse.pattern, self.sparse.matrix, right)
        change = np.zeros(self.scene.nv)
        change[plan.free] = right[0, :n]
        return change, right[0, n : n + m].copy()

    def reactions(self, x: FloatArray) -> FloatArray | None:
        """(m,) that leave least out of balance at x, in the norm of M^-1; None where some motion moves no mass."""
        m = len(self.scene.plan.rows)
        if not m:
            return np.zeros(0)
        force = self.force(x, np.zeros(m))
        rest = np.zeros(self.scene.nv)
        self.assemble_at(x, rest, rest, np.zeros(m), weights=(0.0, 0.0, 1.0))
        self.sparse.matrix.terms[:] = 0.0
        if not factor_sparse(self.sparse.pattern, self.sparse.matrix):
            return None
        return -self.solve(force)[1]

    def beside(self) -> SparseStiffness:
        """The same with values and factors of its own."""
        other = self.sparse.replace(matrix=new_block_matrix(self.sparse.pattern))
        return replace(self, sparse=other)

    def held(self) -> FloatArray:
        """(nv,) stiffness that holds coordinates of motions that nothing resists; zeros of all others."""
        held = np.zeros(self.scene.nv)
        held[self.scene.plan.free] = self.sparse.matrix.held[: len(self.scene.plan.free)]
        return held

    @property
    def least_pivot(self) -> float:
        """Of the factors, over the terms that it is the sum of."""
        return float(self.sparse.matrix.least[0])

    def negative(self) -> int | None:
        """How many motions that the rows allow have a negative stiffness, if it is symmetric; None if not known."""
        negative, exchanged = count_signs(self.sparse.pattern, self.sparse.matrix)
        return None if exchanged else negative - len(self.scene.plan.rows)

    def values(self) -> FloatArray:
        """(k,) K of ``entries``, before it is factored."""
        return self.sparse.matrix.values[self.entries.place]


def sparse_stiffness(
    scene: CompiledScene, work: Work, plan: Plan | None = None, *, sizes: FloatArray | None = None
) -> SparseStiffness | None:
    """Of a machine for which it takes less than a dense one; None of others.

    Args:
        scene: without redundant rows.
        work: scratch of its plan; ``work.time`` holds the functions of time.
        plan: with some of the scene's forces; by default with all.
        sizes: (2, nv) of places and rates, by shares of which users' laws are differenced; by default of places alone.
    """
    plan = scene.plan if plan is None else plan
    n = len(plan.free) + len(plan.rows)
    if n < _LEAST_UNKNOWNS or _carrying(plan) > n**2 / _DEEP:
        return None
    found = sparse_blocks(plan, np.array([n]), cuts=False)
    if found is None:
        return None
    blocks, pattern = found
    if sizes is None:
        sizes = np.stack([coordinate_sizes(scene), np.zeros(scene.nv)])
    tangents = new_tangent_work(plan, scene.nv, sizes=sizes, blocks=blocks, side_by_side=one_block(plan))
    matrix = new_sparse_matrix(plan, blocks, pattern)
    return SparseStiffness(scene, plan, work, matrix, tangents, _entries(plan, pattern))


def _carrying(plan: Plan) -> float:
    """How many pairs of velocities there are of which one carries the other."""
    own = list(map(int, plan.tree[:, at.JOINT_SIZE]))
    for place in modal_places(plan):
        own[place.row] += place.v.stop - place.v.start
    path, total = list[int](), 0.0
    for size, parent in zip(own, map(int, parents(plan)), strict=True):
        path.append(size + (path[parent] if parent >= 0 else 0))
        total += size * path[-1]
    return total


def _entries(plan: Plan, pattern: BlockPattern) -> MatrixEntries:
    """Those of the free velocities, which are the first unknowns."""
    blocks = int(np.searchsorted(pattern.first[:-1], len(plan.free)))
    size, block = np.diff(pattern.first), np.repeat(np.arange(len(pattern.first) - 1), np.diff(pattern.entry_at))
    own = np.flatnonzero((block < blocks) & (pattern.column < blocks))
    i, j = block[own], pattern.column[own]  # pairs of blocks, ascending
    size, heights, widths = size[:blocks], size[i], size[j]
    before = np.cumsum(widths) - widths
    ahead = before - before[np.searchsorted(i, np.arange(blocks))][i]  # columns of the same rows
    length = np.bincount(i, widths, blocks).astype(np.int64)  # of a row
    first = sums(size * length)[:-1]
    across = np.searchsorted(i * blocks + j, j * blocks + i)
    of = np.repeat(np.arange(len(own)), heights * widths)
    r, c = np.divmod(within(heights * widths), widths[of])
    number = (first[i] + ahead)[of] + r * length[i][of] + c
    row, column, place, mirrored = np.empty((4, len(of)), np.int64)
    row[number], column[number] = pattern.first[i][of] + r, pattern.first[j][of] + c
    place[number] = pattern.offset[own][of] + r * pattern.stride[own][of] + c
    mirrored[number] = (first[j] + ahead[across])[of] + c * length[j][of] + r
    begin = np.repeat(first, size) + within(size) * np.repeat(length, size)
    return MatrixEntries(plan.free[row], plan.free[column], place, mirrored, plan.free, begin)
