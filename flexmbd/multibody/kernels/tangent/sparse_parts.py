"""Matrices that implicit steps keep beside the one that they factor: see ``LoopMatrices`` and ``ShiftedMatrix``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.sparse.block_lu import (
    BlockMatrix,
    ComplexBlockMatrix,
    new_block_matrix,
    new_complex_block_matrix,
)
from flexmbd.multibody.kernels.sparse.block_pattern import BlockPattern
from flexmbd.multibody.kernels.tangent.sparse_matrix import is_augmented, no_sparse_matrix
from flexmbd.multibody.kernels.tangent.unknown_blocks import UnknownBlocks

ComplexArray = NDArray[np.complex128]

# Rows of ShiftedMatrix.parts: what no weight multiplies, and the derivatives by positions, velocities, accelerations.
CONSTANT, STIFFNESS, DAMPING, MASS, N_PARTS = range(5)


@dataclass(frozen=True, eq=False)
class LoopMatrices(ArrayStruct):
    """What an implicit step needs besides of a sparse matrix with constraint rows; empty without these.

    tree: factors of the matrix without rows.  across: of that in which all rows hold, where an augmented Lagrangian
    lets some yield.  stiffness: (fill,) the part by positions.
    jacobian, rate_jacobian: (m, longest path) of the rows and, by positions, of their rates, as those of
    ``TangentWork``, but by the turns of balls within the step.  spins: (nv,) 1 where the velocities of a ball begin;
    whole: (fill,) the matrix, of which rate_jacobian is then; both (0,) without balls.
    slopes: (m, 3) see ``put_rows``.  per_v: (1,) weight of the part by velocities.
    shifts: (m,) of positions, and shifted: (free,) what they move.  vectors: (3, unknowns) and row: (m,) scratch.
    """

    tree: BlockMatrix
    across: BlockMatrix
    stiffness: FloatArray
    jacobian: FloatArray
    rate_jacobian: FloatArray
    spins: IntArray
    whole: FloatArray
    slopes: FloatArray
    per_v: FloatArray
    shifts: FloatArray
    shifted: FloatArray
    vectors: FloatArray
    row: FloatArray


@dataclass(frozen=True, eq=False)
class ShiftedMatrix(ArrayStruct):
    """For matrices M + s D + s^2 K of any s, with constraint rows: their parts, and factors of several.

    parts: (N_PARTS, fill), not factored.  What no weight multiplies is rows, and what unknowns of cut bodies, which are
    weighted already, do among themselves and to others.
    factors: of a complex s.  tree: of a real one, without rows.  end: of M with rows.  All are empty where they are not
    needed, as what follows is without rows.
    jacobian, rate_jacobian: (m, longest path) of the rows where the parts were taken, and of their rates by positions.
    slopes: (m, 3) see ``put_rows``.  least_pivot: (1,) of the rows of ``end``.
    product, complex_product: (fill,) a sum of the parts; unknown, complex_unknown: (1, unknowns), moved, complex_moved:
    (unknowns,), row, complex_row: (m,) scratch.
    """

    parts: FloatArray
    factors: ComplexBlockMatrix
    tree: BlockMatrix
    end: BlockMatrix
    jacobian: FloatArray
    rate_jacobian: FloatArray
    slopes: FloatArray
    least_pivot: FloatArray
    product: FloatArray
    complex_product: ComplexArray
    unknown: FloatArray
    complex_unknown: ComplexArray
    moved: FloatArray
    complex_moved: ComplexArray
    row: FloatArray
    complex_row: ComplexArray


def new_shifted_matrix(plan: Plan, found: tuple[UnknownBlocks, BlockPattern] | None) -> ShiftedMatrix:
    """Allocate those of a plan whose matrix is sparse; empty ones of others."""
    none = no_sparse_matrix()
    pattern, longest = (none.pattern, 0) if found is None else (found[1], found[0].longest_path)
    m = 0 if found is None else len(plan.rows)
    n, zeros = pattern.unknowns, np.zeros
    return ShiftedMatrix(
        parts=zeros((N_PARTS, pattern.fill)),
        factors=new_complex_block_matrix(pattern),
        tree=new_block_matrix(pattern) if m else none.matrix,
        end=new_block_matrix(pattern) if m else none.matrix,
        jacobian=zeros((m, longest)),
        rate_jacobian=zeros((m, longest)),
        slopes=zeros((m, 3)),
        least_pivot=np.ones(1),
        product=zeros(pattern.fill),
        complex_product=zeros(pattern.fill if m else 0, np.complex128),
        unknown=zeros((1, n)),
        complex_unknown=zeros((1, n), np.complex128),
        moved=zeros(n),
        complex_moved=zeros(n if m else 0, np.complex128),
        row=zeros(m),
        complex_row=zeros(m, np.complex128),
    )


@entry_kernel
def combine(parts, per_x, per_v, per_a, values):
    """Set the matrix of these weights up in real or complex ``values``."""
    for k in range(values.shape[0]):
        moved = per_x * parts[STIFFNESS, k] + per_v * parts[DAMPING, k]
        values[k] = parts[CONSTANT, k] + moved + per_a * parts[MASS, k]


def new_loop_matrices(plan: Plan, found: tuple[UnknownBlocks, BlockPattern] | None) -> LoopMatrices:
    """Allocate those of a plan whose matrix is sparse, and has rows."""
    if found is None or len(plan.rows) == 0:
        none, nothing, two = no_sparse_matrix().matrix, np.zeros(0), np.zeros((0, 0))
        return LoopMatrices(
            tree=none,
            across=none,
            stiffness=nothing,
            jacobian=two,
            rate_jacobian=two,
            spins=np.zeros(0, np.int64),
            whole=nothing,
            slopes=two,
            per_v=np.zeros(1),
            shifts=nothing,
            shifted=nothing,
            vectors=two,
            row=nothing,
        )
    blocks, pattern = found
    m = len(plan.rows)
    balls = plan.tree[plan.tree[:, at.JOINT_TURN] == kinds.TURN_BALL]
    spins = np.zeros(len(plan.free) + len(plan.driven) if len(balls) else 0, np.int64)
    spins[balls[:, at.JOINT_V] + balls[:, at.JOINT_ADDS]] = 1
    return LoopMatrices(
        tree=new_block_matrix(pattern),
        across=new_block_matrix(pattern) if is_augmented(plan) else no_sparse_matrix().matrix,
        stiffness=np.zeros(pattern.fill),
        jacobian=np.zeros((m, blocks.longest_path)),
        rate_jacobian=np.zeros((m, blocks.longest_path)),
        spins=spins,
        whole=np.zeros(pattern.fill if len(balls) else 0),
        slopes=np.zeros((m, 3)),
        per_v=np.zeros(1),
        shifts=np.zeros(m),
        shifted=np.zeros(len(plan.free)),
        vectors=np.zeros((3, pattern.unknowns)),
        row=np.zeros(m),
    )
