"""Matrices that implicit steps keep beside the one that they factor: see ``LoopMatrices`` and ``ShiftedMatrix``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.sparse.block_lu import (
    BlockMatrix,
    ComplexBlockMatrix,
    new_block_matrix,
    new_complex_block_matrix,
)
from flexmbd.multibody.kernels.sparse.block_pattern import BlockPattern
from flexmbd.multibody.kernels.tangent.sparse_matrix import no_sparse_matrix
from flexmbd.multibody.kernels.tangent.unknown_blocks import UnknownBlocks


@dataclass(frozen=True, eq=False)
class LoopMatrices(ArrayStruct):
    """What an implicit step needs besides of a sparse matrix with constraint rows; empty without these.

    tree: factors of the matrix without rows.  stiffness: the part by positions, not factored.
    rate_jacobian: (m, longest path) derivative of the rows' rates by positions, as ``TangentWork.rate_jacobian``.
    slopes: (m, 3) see ``put_rows``.  per_v: (1,) weight of the part by velocities.
    shifts: (m,) of positions, and shifted: (free,) what they move.  vectors: (3, unknowns) and row: (m,) scratch.
    """

    tree: BlockMatrix
    stiffness: BlockMatrix
    rate_jacobian: FloatArray
    slopes: FloatArray
    per_v: FloatArray
    shifts: FloatArray
    shifted: FloatArray
    vectors: FloatArray
    row: FloatArray


@dataclass(frozen=True, eq=False)
class ShiftedMatrix(ArrayStruct):
    """For matrices M + s D + s^2 K of any s: their parts, not factored, and the factors for a complex s."""

    stiffness: BlockMatrix
    damping: BlockMatrix
    mass: BlockMatrix
    factors: ComplexBlockMatrix


def new_shifted_matrix(pattern: BlockPattern) -> ShiftedMatrix:
    """Allocate for a pattern of a tree that is not cut: of what is cut the equations have ones whatever the weights."""
    stiffness, damping, mass = (new_block_matrix(pattern) for _ in range(3))
    return ShiftedMatrix(stiffness, damping, mass, new_complex_block_matrix(pattern))


@entry_kernel
def set_shift(parts, shift, matrix):
    """Set M + ``shift`` D + ``shift``^2 K up in a real or complex ``matrix``."""
    stiffness, damping, mass = parts.stiffness.values, parts.damping.values, parts.mass.values
    for k in range(mass.shape[0]):
        matrix.values[k] = mass[k] + shift * (damping[k] + shift * stiffness[k])


def new_loop_matrices(plan: Plan, found: tuple[UnknownBlocks, BlockPattern] | None) -> LoopMatrices:
    """Allocate those of a plan whose matrix is sparse, and has rows."""
    if found is None or len(plan.rows) == 0:
        none, nothing = no_sparse_matrix().matrix, np.zeros(0)
        slopes, vectors = np.zeros((0, 3)), np.zeros((3, 0))
        return LoopMatrices(none, none, np.zeros((0, 0)), slopes, np.zeros(1), nothing, nothing, vectors, nothing)
    blocks, pattern = found
    m = len(plan.rows)
    return LoopMatrices(
        tree=new_block_matrix(pattern),
        stiffness=new_block_matrix(pattern),
        rate_jacobian=np.zeros((m, blocks.longest_path)),
        slopes=np.zeros((m, 3)),
        per_v=np.zeros(1),
        shifts=np.zeros(m),
        shifted=np.zeros(len(plan.free)),
        vectors=np.zeros((3, pattern.unknowns)),
        row=np.zeros(m),
    )
