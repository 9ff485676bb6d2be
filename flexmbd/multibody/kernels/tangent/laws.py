"""The tangent of forces on coordinates and on the state."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.table import (
    coordinate_law,
    force_slope,
    is_between_frames,
    is_coordinate_law,
    subtract_force_tangent,
)


@deferred_kernel()
def add_laws(plan, work, tw, x, v, per_x, per_v, matrix):
    """Subtract from the tangent the derivatives of all forces but those between frames."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        kind = row[at.EL_KIND]
        if is_coordinate_law(kind):
            k = row[at.EL_V]
            _, slope_x, slope_v = coordinate_law(plan, row, x[row[at.EL_X]], v[k])
            matrix[k, k] -= per_x * slope_x + per_v * slope_v
        elif not is_between_frames(kind):
            subtract_force_tangent(plan, work, tw, row, x, v, per_x, per_v, matrix)


@deferred_kernel()
def add_laws_of_joints(plan, work, tw, recursion, x, v, per_x, per_v):
    """As ``add_laws`` of forces that each act on one coordinate by its own, into ``own`` of a ``TreeRecursion``."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_coordinate_law(row[at.EL_KIND]):
            k = row[at.EL_V]
            _, slope_x, slope_v = coordinate_law(plan, row, x[row[at.EL_X]], v[k])
            recursion.own[k, recursion.place[k]] -= per_x * slope_x + per_v * slope_v
        elif not is_between_frames(row[at.EL_KIND]):
            k = row[at.EL_V]
            recursion.own[k, recursion.place[k]] -= per_x * force_slope(plan, work, row, x, v, tw.size_x[k])
