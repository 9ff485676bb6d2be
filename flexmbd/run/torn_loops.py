"""Loops that a run has torn open: constraint rows that were redundant at its start and are not any longer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.sampling.series import row_residuals
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import row_sizes
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.start.loop_closing import CLOSED
from flexmbd.multibody.start.redundancy import forbidden_drives
from flexmbd.run.stopped import SimulationError, rows_before
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]

_TORN = 10.0 * CLOSED  # of a row's size: more than what meshes leave open of overconstrained loops, however these turn
_STRETCH = 1024  # rows of a trajectory that are looked at together


def largest_gaps(full: CompiledScene, t: FloatArray, x: FloatArray) -> FloatArray:
    """(rows,) m or rad: the largest residual of each row, those left out as redundant included."""
    largest = np.zeros(len(full.plan.rows))
    for _, gaps in _gaps(full, t, x):
        np.maximum(largest, gaps.max(axis=0), out=largest)
    return largest


def _gaps(full: CompiledScene, t: FloatArray, x: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Stretch by stretch of a trajectory, from its row k: (n, rows) m or rad, the residual of each constraint row."""
    rows = len(full.plan.rows)
    if not rows:
        return
    work, rest, scratch = new_work(full.plan), np.zeros(full.nv), np.zeros((3, rows))
    for k in range(0, len(t), _STRETCH):
        some = slice(k, k + _STRETCH)
        gaps = np.empty((len(t[some]), rows))
        row_residuals(full.plan, work, t[some], x[some], rest, scratch, gaps)
        yield k, gaps


def _first_opened(start: Start, t: FloatArray, x: FloatArray, sizes: FloatArray) -> tuple[int, int, float] | None:
    """Where a row that was left out is first open: row of the trajectory, constraint row, m or rad; None if nowhere."""
    kept = list(start.choice.rows)
    left_out = np.ones(len(sizes), bool)
    left_out[kept] = False
    for first, gaps in _gaps(start.unreduced, t, x):
        open_by = gaps / sizes
        allowed = np.maximum(_TORN, open_by[:, kept].sum(axis=1))
        torn = np.where(left_out, open_by, 0.0) > allowed[:, None]
        if torn.any():
            k = int(np.argmax(torn.any(axis=1)))
            row = int(np.argmax(np.where(left_out, open_by[k], 0.0)))
            return first + k, row, float(gaps[k, row])
    return None


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
    opened = _first_opened(start, t, x, sizes)
    if opened is None:
        return
    k, torn, gap = opened
    work = new_work(full.plan)
    evaluate_times(full.plan, t[0], work.time)
    drives = forbidden_drives(full, work, x[0])
    told = f"{full.row_names[torn]} by {gap:.3e} (m or rad)"
    if drives:
        why = (
            f"the loops forbid the prescribed motion of {', '.join(map(repr, drives))}: at t = {t[k]:.6g} s it has "
            f"torn them open, {told}; leave out the motion, or a joint that holds what it moves"
        )
    else:
        why = (
            f"the loops were left at t = {t[k]:.6g} s, {told}: the start is a singular position, in which rows say "
            "nothing new that hold the machine beside it; start elsewhere, or leave out a joint that locks the others"
        )
    raise SimulationError(f"{why}; what was computed before is in the error's trajectory", rows_before(trajectory, k))
