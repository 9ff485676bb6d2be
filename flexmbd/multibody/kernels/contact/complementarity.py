"""Contact as a linear complementarity: forces f >= 0 at gaps b + C f >= 0, of each pair one zero.

C is symmetric and positive, so there is one answer, and it is continuous in b.  It is found by Newton's method on the
set of what touches, with pivots of single ones where that comes no nearer (block principal pivoting: Judice & Pires
1994, doi:10.1016/0305-0548(94)90106-6).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.lanes import LANES, lanes, padded, put_lanes
from flexmbd.multibody.kernels.contact.cholesky import backward, factor, forward
from flexmbd.round_off import EQUAL

# Newton steps without a smaller number of wrong ones, after which single ones are changed; and steps for each.
_PATIENCE, _FIRST_STEPS, _STEPS = 3, 100, 20


@kernel
def _factor_touching(C, order, count, factors, place):
    """The factor of C in the rows ``order`` (count); whether there is one."""
    N = padded(count)
    for first in range(0, count, LANES):
        last = min(first + LANES, count)
        follow = last - first == LANES and order[last - 1] - order[first] == LANES - 1
        column = int(order[first])
        for i in range(last):
            row = C[int(order[i])]
            if follow:
                put_lanes(factors, place + N * i + first, lanes(row, column))
            else:
                for j in range(max(i, first), last):
                    factors[place + N * i + j] = row[int(order[j])]
    return factor(factors, place, count)


@kernel
def _largest(a, count):
    """The largest magnitude."""
    found = 0.0
    for i in range(count):
        found = max(found, abs(a[i]))
    return found


@kernel
def _close_gaps(C, b, m, f, left, inside, order, factors, place):
    """Write the forces that close the gaps of what is ``inside``, and the others' gaps; how many, or -1."""
    count = 0
    for i in range(m):
        if inside[i] != 0.0:
            order[count] = i
            count += 1
    if not _factor_touching(C, order, count, factors, place):
        return -1
    for i in range(count):
        left[i] = -b[int(order[i])]
    for i in range(count, padded(count)):
        left[i] = 0.0
    forward(factors, place, count, left)
    backward(factors, place, count, left)
    for i in range(m):
        f[i] = 0.0
    for i in range(count):
        f[int(order[i])] = left[i]
    for i in range(m):
        gap = 0.0
        if inside[i] == 0.0:
            gap = b[i]
            if gap < math.inf:
                for k in range(count):
                    p = int(order[k])
                    gap += C[min(i, p), max(i, p)] * f[p]
        left[i] = gap
    return count


@kernel
def solve_complementary(C, b, m, f, left, inside, order, factors, place):
    """Write forces f (m,) and what is left of the gaps; how many touch, the first of ``order``.

    -1 without an answer.  C (m, m), its upper triangle, b (m,): see the module; where b is infinite nothing touches,
    and C is not looked at.  ``left`` has room for `padded` m; ``inside``, ``order`` (m,) are scratch; C's factor in the
    rows that touch is left in ``factors`` from ``place``, see ``cholesky``.
    """
    size = 0.0
    for i in range(m):
        inside[i] = 1.0 if b[i] < 0.0 else 0.0
        size = max(size, -b[i])
    fewest, patience = m + 1, _PATIENCE
    for _ in range(_FIRST_STEPS + _STEPS * m):
        count = _close_gaps(C, b, m, f, left, inside, order, factors, place)
        if count < 0:
            return -1
        most, wrong, last = _largest(f, m), 0, -1
        for i in range(m):
            if f[i] < -EQUAL * most or left[i] < -EQUAL * size:
                wrong, last = wrong + 1, i
        if wrong == 0:
            for i in range(m):
                f[i] = max(f[i], 0.0)
                left[i] = max(left[i], 0.0)
            return count
        single = False
        if wrong < fewest:
            fewest, patience = wrong, _PATIENCE
        elif patience > 0:
            patience -= 1
        else:
            single = True
        for i in range(m):
            if (f[i] < -EQUAL * most or left[i] < -EQUAL * size) and (i == last or not single):
                inside[i] = 1.0 - inside[i]
    return -1


@entry_kernel
def complementary_forces(C, b, f, left, scratch, factors):
    """``solve_complementary`` of C (m, m), b (m,); whether there is an answer.

    With P = `padded_size` of m: ``left`` (P,), ``scratch`` (2, P), ``factors`` (P^2,).
    """
    return solve_complementary(C, b, b.shape[0], f, left, scratch[0], scratch[1], factors, 0) >= 0
