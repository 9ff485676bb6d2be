"""Normal forces of joints at given accelerations, and the friction that follows them; compiled."""

from __future__ import annotations

import math

import numpy as np

from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.native import factor, solve
from flexmbd.multibody.kernels.inverse_dynamics.reactions import passed_on
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times

_ITERATIONS = 50
_SETTLED = 1e-13  # of the largest friction force


@entry_kernel
def normal_forces(
    plan, work, places, factors, t, x, v, a, multipliers, a_slopes, multiplier_slopes, scratch, here, slopes
):
    """Write N (k, 2), in N, of each joint, and its ``slopes`` (k, k, 2) by the friction force of each.

    These are told by forces of the friction's own size, for beside it a unit of force may be round-off.

    The plan is that of the machine without that friction, and ``a`` and ``multipliers`` are those of its motion;
    ``a_slopes`` (k, nv) and ``multiplier_slopes`` (k, m) are what a unit of each friction force adds.  ``places``
    (k, 2) has each joint's row of ``plan.tree`` and its frame, z along its axis; ``factors`` (k,) friction over normal
    force.  ``scratch`` is (2 nv + m,).
    """
    nv = v.shape[0]
    m = multipliers.shape[0]
    moved = scratch[nv : 2 * nv]
    moved_multipliers = scratch[2 * nv : 2 * nv + m]
    evaluate_times(plan, t, work.time)
    for j in range(-1, places.shape[0]):  # first without friction, then with that of each; one call, compiled once
        size = 0.0 if j < 0 else factors[j] * math.hypot(here[j, 0], here[j, 1])
        if j >= 0 and size == 0.0:
            size = 1.0
        for k in range(nv):
            moved[k] = a[k] + (size * a_slopes[j, k] if j >= 0 else 0.0)
        for k in range(m):
            moved_multipliers[k] = multipliers[k] + (size * multiplier_slopes[j, k] if j >= 0 else 0.0)
        residual(plan, work, x, v, moved, moved_multipliers, scratch[:nv])
        for i in range(places.shape[0]):
            across, _ = passed_on(plan, work, places[i, 0], places[i, 1])
            for c in range(2):
                if j < 0:
                    here[i, c] = across[c]
                else:
                    slopes[j, i, c] = (across[c] - here[i, c]) / size


@entry_kernel
def settle(lapack, sliding, here, slopes, f, matrix, step, pivot, sizes):
    """Solve f_i = -sliding_i |N_i| with N = here + sum of f_j slopes_j for the forces f (k,) by Newton's method.

    Returns whether such forces are reached from none, and are not of those that would grow by themselves.
    ``sliding`` (k,) is friction over normal force, with the direction; ``here`` and ``slopes`` are those of
    ``normal_forces``.  ``matrix`` (k, k), ``step`` (1, k), and of int32 ``pivot`` (k,) and ``sizes`` (N_SIZES,) are
    scratch.
    """
    count = f.shape[0]
    for i in range(count):
        f[i] = 0.0
    for _ in range(_ITERATIONS):
        left = 0.0
        largest = np.finfo(np.float64).tiny
        for i in range(count):
            across = here[i, 0]
            along = here[i, 1]
            for j in range(count):
                across += f[j] * slopes[j, i, 0]
                along += f[j] * slopes[j, i, 1]
            size = math.hypot(across, along)
            step[0, i] = f[i] + sliding[i] * size
            left = max(left, abs(step[0, i]))
            largest = max(largest, abs(sliding[i] * size))
            if size > 0.0:
                across /= size
                along /= size
            for j in range(count):
                matrix[i, j] = sliding[i] * (across * slopes[j, i, 0] + along * slopes[j, i, 1])
            matrix[i, i] += 1.0
        if factor(lapack, matrix, pivot, sizes) != 0:
            return False
        if left <= _SETTLED * largest:
            return _has_positive_determinant(matrix, pivot)
        solve(lapack, matrix, pivot, sizes, step)
        for i in range(count):
            f[i] -= step[0, i]
    return False


@kernel
def _has_positive_determinant(factors, pivot):
    """Of the matrix that ``factor`` was given."""
    positive = True
    for i in range(pivot.shape[0]):
        if (factors[i, i] < 0.0) != (pivot[i] != i + 1):
            positive = not positive
    return positive
