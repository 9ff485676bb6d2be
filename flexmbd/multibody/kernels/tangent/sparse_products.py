"""Products with parts of a sparse matrix: rows times motions, reactions on bodies, a stiffness times a motion.

Vectors (unknowns,) hold free velocities, multipliers and the unknowns of cut bodies, which follow from the others by
their own equations.  They may be complex, and so may a matrix.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.tangent.sparse_elements import row_of
from flexmbd.multibody.kernels.tangent.unknown_blocks import CUT, MOTION


@kernel
def _line(pattern, values, block, row, vector):
    """Row ``row`` of a block times a vector."""
    total = 0.0
    for q in range(pattern.entry_at[block], pattern.entry_at[block + 1]):
        j = pattern.column[q]
        place = pattern.offset[q] + row * pattern.stride[q]
        begin = pattern.first[j]
        for c in range(pattern.first[j + 1] - begin):
            total += values[place + c] * vector[begin + c]
    return total


@kernel
def _cuts(pattern, to):
    """The number of cut bodies, where their unknowns begin in a vector, and their blocks."""
    count = (to.starts[2] - to.starts[1]) // CUT
    return count, pattern.unknown.shape[0] - CUT * count, pattern.first.shape[0] - 1 - count


@deferred_kernel()
def add_motions(pattern, values, to, vector):
    """Put the motions of cut bodies that the rest of a vector causes into it, and zeros as their wrenches.

    By ``values`` of a matrix that is not factored: from the ground outwards.
    """
    count, begin, first = _cuts(pattern, to)
    for k in range(begin, vector.shape[0]):
        vector[k] = 0.0
    for q in range(count):
        for r in range(MOTION):
            vector[begin + CUT * q + r] -= _line(pattern, values, first + q, r, vector)


@deferred_kernel()
def multiply(pattern, values, to, vector, out):
    """Write a matrix without rows, not factored, times free velocities into ``out`` (free,).

    Multipliers in ``vector`` must be zero; unknowns of cut bodies are written there.
    """
    add_motions(pattern, values, to, vector)
    count, begin, first = _cuts(pattern, to)
    for q in range(count - 1, -1, -1):
        for r in range(MOTION, CUT):
            vector[begin + CUT * q + r] -= _line(pattern, values, first + q, r, vector)
    block = 0
    while block < first and pattern.first[block] < out.shape[0]:
        for r in range(pattern.first[block + 1] - pattern.first[block]):
            out[pattern.first[block] + r] = _line(pattern, values, block, r, vector)
        block += 1


@kernel
def multiply_rows(tw, to, slopes, vector, out):
    """Write rows, ``slopes`` as ``tw.jacobian``, times a vector with the motions of cut bodies into ``out`` (m,)."""
    for s in range(to.row_first.shape[0] - 1):
        first = to.row_first[s]
        for i in range(first, to.row_first[s + 1]):
            total = 0.0
            for j in range(tw.row_count[first]):
                total += slopes[i, j] * vector[to.number[tw.row_unknown[first, j]]]
            out[i] = total


@kernel
def put_reactions(tw, to, reactions, out):
    """Write what reactions (m,) make of the right-hand side ``out`` (unknowns,): C^T times them, and on cut bodies."""
    for k in range(out.shape[0]):
        out[k] = 0.0
    for s in range(to.row_first.shape[0] - 1):
        first = to.row_first[s]
        for j in range(tw.row_count[first]):
            r, sign = row_of(to, tw.row_unknown[first, j])
            if r >= 0:
                total = 0.0
                for i in range(first, to.row_first[s + 1]):
                    total += tw.jacobian[i, j] * reactions[i]
                out[to.number[r]] += sign * total
