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
from flexmbd.multibody.kernels.base.deferred import FLAG, INTEGER, deferred_kernel
from flexmbd.multibody.kernels.base.native import factor_part, solve_part
from flexmbd.multibody.kernels.reading.plan_entries import holds_position
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between

_DIFFERENT = math.log(2.0)  # rows whose volumes differ by more than this factor between stages are transformed


@kernel
def _factor_row_matrix(plan, work, scratch, i):
    """Factor the transpose of C_i B^-1 C^T of stage i, evaluated last; log of its volume, -inf if singular."""
    derive(plan, work, scratch, i, 0.0, 0.0, 1.0)
    blocks = scratch.tangent.blocks
    matrix, pivot, sizes = scratch.stage_row_matrix, scratch.row_pivot, scratch.sizes
    volume = 0.0
    for c in range(scratch.bounds.shape[0] - 1):
        above, below = between(blocks.rows, c)
        for r in range(above, below):
            for q in range(above, below):
                total = 0.0
                for j in range(*between(blocks.free, c)):
                    total += scratch.tangent.jacobian[r, plan.free[j]] * scratch.row_response[q, j]
                matrix[q, r - above] = total
                if not np.isfinite(total):
                    return -np.inf
        if factor_part(plan.lapack, matrix, above, below, pivot, sizes) != 0:
            return -np.inf
        for r in range(above, below):
            volume += math.log(abs(matrix[r, r - above]))
    return volume


@deferred_kernel(INTEGER)
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


@deferred_kernel(FLAG)
def transform_stage_rows(plan, work, scratch, i):
    """Write T_i of stage i, which was evaluated last; whether it exists."""
    if _factor_row_matrix(plan, work, scratch, i) == -np.inf:
        return False
    blocks = scratch.tangent.blocks
    for c in range(scratch.bounds.shape[0] - 1):
        above, below = between(blocks.rows, c)
        for r in range(above, below):
            for q in range(above, below):
                scratch.row_transform[i, r, q] = scratch.row_matrix[r, q]
        matrix, pivot, sizes = scratch.stage_row_matrix, scratch.row_pivot, scratch.sizes
        solve_part(plan.lapack, matrix, above, below, pivot, sizes, scratch.row_transform[i], above, below)
    return True
