"""Laws of pieces, as a stop's: whether a step leads from one into another, where no polynomial follows the motion."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.elements.table import (
    force_changes_piece,
    is_between_frames,
    is_coordinate_law,
    law_piece,
)


@deferred_kernel(FLAG)
def changes_piece(plan, work, x, x_end, v_end):
    """Whether any element's law takes another of its pieces at x_end (nx,), v_end (nv,) than at x (nx,).

    Or whether friction of a contact does, as evaluated last.  ``work.time`` holds the time of the end, to which laws
    with memory are led.
    """
    if plan.horizon[1] > 0.0:
        return True
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_coordinate_law(row[at.EL_KIND]):
            k = row[at.EL_X]
            if law_piece(plan, row, x[k]) != law_piece(plan, row, x_end[k]):
                return True
        elif not is_between_frames(row[at.EL_KIND]) and force_changes_piece(plan, work, row, x_end, v_end):
            return True
    return False
