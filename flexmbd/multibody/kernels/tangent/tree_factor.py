"""LU factors of a tree's matrix: entries only between ancestors and descendants, and no others while it is factored.

Unknowns are eliminated from the leaves to the root: what an unknown leaves behind lies among its ancestors, who stand
in each other's rows already (Featherstone 2008, section 6.5, for symmetric matrices).  No pivots are sought: an
iteration matrix is a mass matrix plus what a short step leaves of damping and stiffness, and a pivot is the mass of an
unknown with all outboard of it free to follow.  Where one is small all the same the factors are refused, and the
caller takes LAPACK's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel

_LEAST_PIVOT = 1e-8  # of the diagonal entry before the elimination
_DENSE_GAIN = 3.0  # how much faster LAPACK does a flop than these loops over indices do, at some 50 unknowns


def ancestors(plan: Plan) -> NDArray[np.int64]:
    """(k, 1 + the longest line) of each free unknown: how many ancestors, and which, nearest first.

    Unknowns are counted as in ``plan.free``; those of one body stand in line, joint before modes.
    """
    number = {int(k): j for j, k in enumerate(plan.free)}
    last: dict[int, list[int]] = {-1: []}
    lines: list[list[int]] = [[] for _ in plan.free]
    for i, row in enumerate(plan.tree):
        line = list(last[int(row[at.PARENT])])
        own = list(range(row[at.JOINT_V], row[at.JOINT_V] + row[at.JOINT_SIZE]))
        if row[at.FLEX] >= 0:
            own += range(row[at.MODAL_V], row[at.MODAL_V] + plan.flex[row[at.FLEX], at.N_MODES])
        for k in own:
            if k in number:
                lines[number[k]] = line[::-1]
                line.append(number[k])
        last[i] = line
    table = np.zeros((len(lines), 1 + max(map(len, lines), default=0)), np.int64)
    for j, line in enumerate(lines):
        table[j, 0] = len(line)
        table[j, 1 : 1 + len(line)] = line
    return table


def is_cheaper_than_dense(table: NDArray[np.int64]) -> bool:
    """Whether factoring by the tree takes fewer operations than LAPACK's LU of the full matrix."""
    n = len(table)
    lengths = table[:, 0].astype(float)
    return bool(_DENSE_GAIN * float((2.0 * lengths**2 + lengths).sum()) < 2.0 / 3.0 * n**3)


@entry_kernel
def factor_tree(table, matrix):
    """Factor ``matrix`` (n, n) in place; False if a pivot is too small."""
    n = matrix.shape[0]
    for k in range(n - 1, -1, -1):
        pivot = matrix[k, k]
        size = table[k, 0]
        if not np.isfinite(pivot) or pivot == 0.0:
            return False
        for p in range(1, size + 1):
            i = table[k, p]
            if matrix[i, k] == 0.0:
                continue
            share = matrix[i, k] / pivot
            matrix[i, k] = share
            kept = matrix[i, i]
            for r in range(1, size + 1):
                j = table[k, r]
                matrix[i, j] -= share * matrix[k, j]
            if not abs(matrix[i, i]) > _LEAST_PIVOT * abs(kept):
                return False
    return True


@entry_kernel
def solve_tree(table, matrix, rhs):
    """Solve with the factors; each row of the (k, n) ``rhs`` is one right-hand side, in place."""
    n = matrix.shape[0]
    for c in range(rhs.shape[0]):
        for k in range(n - 1, -1, -1):
            value = rhs[c, k]
            for p in range(1, table[k, 0] + 1):
                i = table[k, p]
                rhs[c, i] -= matrix[i, k] * value
        for k in range(n):
            value = rhs[c, k]
            for p in range(1, table[k, 0] + 1):
                j = table[k, p]
                value -= matrix[k, j] * rhs[c, j]
            rhs[c, k] = value / matrix[k, k]
