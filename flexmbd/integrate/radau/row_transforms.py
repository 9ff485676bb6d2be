"""Radau IIA through singular positions, where constraint rows become dependent and independent again within a step.

Of rows C = L Q, Q of unit length, Q goes on smoothly through such a position while L passes through zero; simplified
Newton with one L for all stages does not converge.  So each stage's rows are transformed to those of one stage, by
T_i = (C B^-1 C^T) (C_i B^-1 C^T)^-1: T_i phi_i = 0 is the same equation, with slopes T_i C_i = C where the stages' rows
span the same directions, and the stage's multipliers are T_i^T times those that the iteration corrects.
"""

from __future__ import annotations

import math

import numpy as np

from flexmbd.integrate.radau.coefficients import STAGES
from flexmbd.integrate.radau.matrix import derive
from flexmbd.integrate.radau.stages import evaluate_stage
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import factor, solve
from flexmbd.multibody.kernels.reading.plan_entries import holds_position

_DIFFERENT = math.log(2.0)  # rows whose volumes differ by more than this factor between stages are transformed


@kernel
def _factor_row_matrix(plan, work, scratch, i):
    """Factor the transpose of C_i B^-1 C^T of stage i, evaluated last; log of its volume, -inf if singular."""
    m = plan.rows.shape[0]
    derive(plan, work, scratch, i, 0.0, 0.0, 1.0)
    for r in range(m):
        for q in range(m):
            total = 0.0
            for j in range(plan.free.shape[0]):
                total += scratch.tangent.jacobian[r, plan.free[j]] * scratch.row_response[q, j]
            scratch.stage_row_matrix[q, r] = total
            if not np.isfinite(total):
                return -np.inf
    if factor(plan.lapack, scratch.stage_row_matrix, scratch.row_pivot, scratch.sizes) != 0:
        return -np.inf
    volume = 0.0
    for r in range(m):
        volume += math.log(abs(scratch.stage_row_matrix[r, r]))
    return volume


@kernel
def choose_stage(plan, work, state, scratch):
    """The stage with the best conditioned rows; -1 if all stages are alike, or a row holds velocities alone."""
    for r in range(plan.rows.shape[0]):
        if not holds_position(plan.rows[r]):
            return -1
    best = -np.inf
    least = np.inf
    place = -1
    for i in range(STAGES):
        evaluate_stage(plan, work, state, scratch, i)
        volume = _factor_row_matrix(plan, work, scratch, i)
        least = min(least, volume)
        if volume > best:
            best = volume
            place = i
    return place if best - least > _DIFFERENT else -1


@kernel
def transform_stage_rows(plan, work, scratch, i):
    """Write T_i of stage i, which was evaluated last; whether it exists."""
    if _factor_row_matrix(plan, work, scratch, i) == -np.inf:
        return False
    for r in range(scratch.row_matrix.shape[0]):
        for q in range(scratch.row_matrix.shape[0]):
            scratch.row_transform[i, r, q] = scratch.row_matrix[r, q]
    solve(plan.lapack, scratch.stage_row_matrix, scratch.row_pivot, scratch.sizes, scratch.row_transform[i])
    return True
