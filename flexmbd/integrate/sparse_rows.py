"""What integrators ask of a sparse matrix with constraint rows, and of its factors."""

from __future__ import annotations

import numpy as np

from flexmbd.integrate import state as st
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel


@deferred_kernel()
def tell_worthless(plan, state, tw, to, matrix):
    """Name a coordinate whose pivot was worthless, or one that moves the frames of a row whose pivot was."""
    nu, unknown = plan.free.shape[0], matrix.worthless[0]
    if 0 <= unknown < nu:
        state.counts[st.WORST] = plan.free[unknown]
    for s in range(to.row_first.shape[0] - 1):
        first = to.row_first[s]
        if first <= unknown - nu < to.row_first[s + 1]:
            for j in range(tw.row_count[first]):
                if tw.row_unknown[first, j] < to.starts[0]:
                    state.counts[st.WORST] = tw.row_unknown[first, j]


@kernel
def least_row_pivot(plan, pattern, matrix, longest):
    """The smallest pivot of the rows over the largest lengths (m,) that they had, which are updated."""
    nu, m, values = plan.free.shape[0], plan.rows.shape[0], matrix.values
    least = 1.0
    for front in range(pattern.stack_at.shape[0]):
        first, p = pattern.pivots[front], pattern.pivots[front + 1] - pattern.pivots[front]
        width = p + pattern.at[front + 1] - pattern.at[front]
        for k in range(p):
            i = pattern.unknown[first + k] - nu
            if 0 <= i < m:
                pivot = abs(values[pattern.values_at[front] + k * width + k])
                longest[i] = max(longest[i], np.sqrt(pivot))
                least = min(least, pivot / longest[i] ** 2)
    return least
