"""Loops that a run has torn open: constraint rows that were redundant at its start and are not any longer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.sampling.series import largest_residuals
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import row_sizes
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.start.loop_closing import CLOSED
from flexmbd.multibody.start.redundancy import forbidden_drives
from flexmbd.run.stopped import SimulationError, rows_before
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]

_TORN = 10.0 * CLOSED  # of a row's size: more than what meshes leave open of overconstrained loops, however these turn


def largest_gaps(full: CompiledScene, t: FloatArray, x: FloatArray) -> FloatArray:
    """(rows,) m or rad: the largest residual of each row, those left out as redundant included."""
    residuals = np.zeros(len(full.plan.rows))
    if len(residuals):
        scratch = np.zeros((3, len(residuals)))
        largest_residuals(full.plan, new_work(full.plan), t, x, np.zeros(full.nv), scratch, residuals)
    return residuals


def refuse_torn_loops(start: Start, trajectory: Trajectory) -> None:
    """Raise where rows that were left out as redundant have opened, with the rows of the trajectory before.

    Nothing that is free could move them at the start: a prescribed motion has torn them open, or the start was a
    singular position in which they say nothing new, and only there.  What depends on the kept rows is as open as these
    are, which the tolerance says.
    """
    full, t, x = start.unreduced, trajectory.t, trajectory.x
    sizes = row_sizes(full)
    if not start.scene.redundant or trajectory.stats.constraint_residual <= _TORN * sizes.min():
        return
    kept = start.choice.rows
    for k in range(len(t)):
        gaps = largest_gaps(full, t[k : k + 1], x[k : k + 1])
        allowed = max(_TORN, float(np.sum(gaps[kept] / sizes[kept])))
        left_out = gaps.copy()
        left_out[kept] = 0.0
        torn = int(np.argmax(left_out / sizes))
        if left_out[torn] > allowed * sizes[torn]:
            break
    else:
        return
    work = new_work(full.plan)
    evaluate_times(full.plan, t[0], work.time)
    drives = forbidden_drives(full, work, x[0])
    opened = f"{full.row_names[torn]} by {gaps[torn]:.3e} (m or rad)"
    if drives:
        why = (
            f"the loops forbid the prescribed motion of {', '.join(map(repr, drives))}: at t = {t[k]:.6g} s it has "
            f"torn them open, {opened}; leave out the motion, or a joint that holds what it moves"
        )
    else:
        why = (
            f"the loops were left at t = {t[k]:.6g} s, {opened}: the start is a singular position, in which rows say "
            "nothing new that hold the machine beside it; start elsewhere, or leave out a joint that locks the others"
        )
    raise SimulationError(f"{why}; what was computed before is in the error's trajectory", rows_before(trajectory, k))
