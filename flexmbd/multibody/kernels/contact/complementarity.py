"""Contact as a linear complementarity: forces f >= 0 at gaps b + C f >= 0, of each pair one zero.

C is symmetric and positive, so there is one answer, and it is continuous in b.  It is found by Newton's method on the
set of what touches, with pivots of single ones where that comes no nearer (block principal pivoting: Judice & Pires
1994, doi:10.1016/0305-0548(94)90106-6).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.round_off import EQUAL

# Newton steps without a smaller number of wrong ones, after which single ones are changed; and steps for each.
_PATIENCE, _FIRST_STEPS, _STEPS = 3, 100, 20


@kernel
def factor_touching(C, order, count, L):
    """Cholesky's factor of C in the rows ``order`` (count) into L; whether there is one."""
    for i in range(count):
        p = int(order[i])
        for j in range(i + 1):
            t = C[p, int(order[j])]
            for k in range(j):
                t -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = t / L[j, j]
            elif t > 0.0:
                L[i, i] = math.sqrt(t)
            else:
                return False
    return True


@kernel
def forward(L, count, b):
    """Solve L y = b in place."""
    for i in range(count):
        t = b[i]
        for k in range(i):
            t -= L[i, k] * b[k]
        b[i] = t / L[i, i]


@kernel
def backward(L, count, b):
    """Solve L^T y = b in place."""
    for i in range(count - 1, -1, -1):
        t = b[i]
        for k in range(i + 1, count):
            t -= L[k, i] * b[k]
        b[i] = t / L[i, i]


@kernel
def _largest(a, count):
    """The largest magnitude."""
    found = 0.0
    for i in range(count):
        found = max(found, abs(a[i]))
    return found


@kernel
def _close_gaps(C, b, m, f, left, inside, order, L):
    """Write the forces that close the gaps of what is ``inside``, and the others' gaps; how many, or -1."""
    count = 0
    for i in range(m):
        if inside[i] != 0.0:
            order[count] = i
            count += 1
    if not factor_touching(C, order, count, L):
        return -1
    for i in range(count):
        left[i] = -b[int(order[i])]
    forward(L, count, left)
    backward(L, count, left)
    for i in range(m):
        f[i] = 0.0
    for i in range(count):
        f[int(order[i])] = left[i]
    for i in range(m):
        gap = 0.0
        if inside[i] == 0.0:
            gap = b[i]
            for k in range(count):
                p = int(order[k])
                gap += C[i, p] * f[p]
        left[i] = gap
    return count


@kernel
def solve_complementary(C, b, m, f, left, inside, order, L):
    """Write forces f (m,) and what is left of the gaps; how many touch, the first of ``order``.

    -1 without an answer.  C (m, m), b (m,): see the module.  ``inside``, ``order`` (m,) and L (m, m) are scratch; L is
    left as the factor of C in the rows that touch.
    """
    size = _largest(b, m)
    for i in range(m):
        inside[i] = 1.0 if b[i] < 0.0 else 0.0
    fewest, patience = m + 1, _PATIENCE
    for _ in range(_FIRST_STEPS + _STEPS * m):
        count = _close_gaps(C, b, m, f, left, inside, order, L)
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
def complementary_forces(C, b, f, left, scratch, L):
    """``solve_complementary`` of C (m, m), b (m,); ``scratch`` (2, m), L (m, m); L[0, 0] is -1 without an answer."""
    m = b.shape[0]
    if solve_complementary(C, b, m, f, left, scratch[0], scratch[1], L) < 0:
        L[0, 0] = -1.0
