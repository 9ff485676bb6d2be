"""Accelerations of a machine without constraint rows by its dense mass matrix: for the start of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import brief_entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive, residual

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DenseWork(ArrayStruct):
    """Work arrays for nv velocities.

    forces: (2 + nv, nv) what residuals leave.  mass: (nv, nv).  rest, unit: (nv,).  no_multipliers: (0,).
    """

    forces: FloatArray
    mass: FloatArray
    rest: FloatArray
    unit: FloatArray
    no_multipliers: FloatArray


def new_dense_work(plan: Plan) -> DenseWork:
    """Allocate for the velocities of ``plan``."""
    nv = len(plan.free) + len(plan.driven)
    return DenseWork(np.zeros((2 + nv, nv)), *(np.zeros(shape) for shape in ((nv, nv), nv, nv, 0)))


@kernel
def _factor(matrix, n):
    """Cholesky factor of the first n rows in place of the lower triangle; whether they are positive definite."""
    for j in range(n):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not (pivot > 0.0 and math.isfinite(pivot)):
            return False
        pivot = math.sqrt(pivot)
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / pivot
    return True


@kernel
def _solve(matrix, n, vector):
    """Solve with the factor, in place."""
    for i in range(n):
        total = vector[i]
        for k in range(i):
            total -= matrix[i, k] * vector[k]
        vector[i] = total / matrix[i, i]
    for i in range(n - 1, -1, -1):
        total = vector[i]
        for k in range(i + 1, n):
            total -= matrix[k, i] * vector[k]
        vector[i] = total / matrix[i, i]


@brief_entry_kernel
def tree_accelerations(plan, bare, work, dense, x, v, a):
    """Set what is prescribed in x, v and a, and the free accelerations from M a = f.

    Args:
        plan: without constraint rows.
        bare: the same without forces and gravity (``force_tables.without_forces``).
        work: scratch; ``work.time`` is up to date.
        dense: scratch.
        x: (nx,) configuration.
        v: (nv,) velocity.
        a: (nv,) output.

    Returns whether every free motion moves some mass; otherwise, or where a user's function failed (``plan.flag``),
    ``a`` holds nothing of use.
    """
    nv = v.shape[0]
    free = plan.free
    n = free.shape[0]
    for k in range(nv):
        a[k] = 0.0
    drive(plan, work, x, v, a)
    for i in range(2 + nv):  # forces of the motion; then, at rest, what no acceleration and each unit of it requires
        if i > 1:
            dense.unit[i - 2] = 1.0
        residual(
            plan if i == 0 else bare, work, x, v if i == 0 else dense.rest, a if i == 0 else dense.unit,
            dense.no_multipliers, dense.forces[i],
        )  # fmt: skip
        if i > 1:
            dense.unit[i - 2] = 0.0
        if plan.flag[0] != 0:
            return False
    for i in range(n):
        p = free[i]
        for j in range(i + 1):
            q = free[j]
            there = dense.forces[2 + q, p] - dense.forces[1, p]
            back = dense.forces[2 + p, q] - dense.forces[1, q]
            dense.mass[i, j] = 0.5 * (there + back)
        dense.unit[i] = -dense.forces[0, p]
    regular = _factor(dense.mass, n)
    if regular:
        _solve(dense.mass, n, dense.unit)
    for i in range(n):
        a[free[i]] += dense.unit[i]
        dense.unit[i] = 0.0
    return regular
