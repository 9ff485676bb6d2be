"""Columns of a sparse matrix by the turns of balls within a step, in place of small turns of the state itself."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import left_jacobian_transposed, load3, scale3, store3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.physics.joints import spin_of


@kernel
def _turn(turn, row, k):
    """Turn three entries of a row from k."""
    store3(row, k, left_jacobian_transposed(turn, load3(row, k)))


@kernel
def _entry(pattern, block, column):
    """Offset and stride of a block in a column of blocks, which the pattern has."""
    q = pattern.entry_at[block]
    while pattern.column[q] != column:
        q += 1
    return pattern.offset[q], pattern.stride[q]


@deferred_kernel()
def turn_block_columns(plan, pattern, to, move, values):
    """As ``residual_tangent.turn_columns``, of all rows of a sparse matrix."""
    for i in range(plan.tree.shape[0]):
        o = spin_of(plan.tree[i])
        if o < 0 or to.block[o] < 0:
            continue
        turn, block = scale3(-1.0, load3(move, o)), to.block[o]
        for q in range(pattern.entry_at[block], pattern.entry_at[block + 1]):
            other = pattern.column[q]
            offset, stride = _entry(pattern, other, block)
            for r in range(pattern.first[other + 1] - pattern.first[other]):
                _turn(turn, values, offset + r * stride + to.number[o] - pattern.first[block])


@deferred_kernel()
def turn_path_columns(tw, to, spins, move, rows):
    """As ``residual_tangent.turn_row_columns``, of ``rows`` as ``tw.jacobian``; ``spins`` (nv,): 1 where one begins."""
    for s in range(to.row_first.shape[0] - 1):
        first = to.row_first[s]
        for j in range(tw.row_count[first]):
            o = tw.row_unknown[first, j]
            if o < spins.shape[0] and spins[o] == 1:
                turn = scale3(-1.0, load3(move, o))
                for i in range(first, to.row_first[s + 1]):
                    _turn(turn, rows[i], j)
