"""Reactions of loops whose rows may be redundant: the smallest multipliers that do what the loops need."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.base.row_blocks import RowBlock
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import (
    constraint_jacobian,
    coordinate_sizes,
    mass_factor,
    row_sizes,
    slopes_at,
)
from flexmbd.multibody.start.independent_rows import decompose_rows
from flexmbd.multibody.start.loop_closing import CLOSED
from flexmbd.round_off import of_solver

FloatArray = NDArray[np.float64]

_AT_ONCE = 256  # instants whose slopes are held at once


def minimum_norm_multipliers(
    scene: CompiledScene, work: Work, x: FloatArray, multipliers: FloatArray, *, kept: Sequence[int]
) -> FloatArray:
    """Spread the reactions of rows over all rows.

    The loads of redundant joints between rigid bodies are indeterminate.  Of all shares with the same
    effect on the machine, C^T nu, the smallest is taken, in the norm of forces and of moments over
    the machine's extent (closed loops by singular values: Zienkiewicz, Taylor & Fox, section 8.5).

    Args:
        scene: with all its rows.
        work: scratch, with ``work.time`` of any instant.
        x: (nt, nx) configurations.
        multipliers: (nt, m) any that do it (N or N m), those of independent rows and zeros.
        kept: as many independent rows as there are, of each block of rows.

    Returns:
        (nt, m) N or N m.
    """
    spread = multipliers.copy()
    for first in range(0, len(x), _AT_ONCE):
        own = slice(first, first + _AT_ONCE)
        slopes = slopes_at(scene, work, x[own])
        for k, block in enumerate(scene.row_blocks):
            rank = int(np.isin(block.rows, kept).sum())
            if 0 < rank < len(block.rows):
                parts = np.array([one.parts[k][:, : len(block.free)] for one in slopes])
                spread[own, block.rows] = _smallest(scene, block, parts, spread[own, block.rows], rank)
    return spread


def _smallest(
    scene: CompiledScene, block: RowBlock, slopes: FloatArray, multipliers: FloatArray, rank: int
) -> FloatArray:
    """(nt, k) the smallest multipliers of a block's rows by their slopes (nt, k, free)."""
    rows, sizes = row_sizes(scene)[block.rows], coordinate_sizes(scene)[block.free]
    # multipliers by their rows' sizes are all of one unit; what lies in the rows' own space is all that acts
    left, sigma, _ = np.linalg.svd(slopes * sizes / rows[:, None], full_matrices=False)
    round_off = of_solver(max(slopes.shape[1:]))
    acts = sigma > round_off * sigma.max(axis=1, initial=0.0, keepdims=True)
    acts[:, rank:] = False
    shares = np.where(acts, np.einsum("tki,tk->ti", left, multipliers * rows), 0.0)
    return np.asarray(np.einsum("tki,ti->tk", left, shares) / rows)


def balancing_multipliers(
    scene: CompiledScene,
    work: Work,
    x: FloatArray,
    v: FloatArray,
    a: FloatArray,
    *,
    rank: int,
    load: FloatArray | None = None,
) -> FloatArray:
    """(m,) N or N m: the smallest multipliers that balance a motion, M a + b - f + C^T nu = 0.

    A motion known to some tolerance is balanced as well as any reactions can, in the metric of M^-1 (Gauss).  The
    smallest are meant as by `minimum_norm_multipliers`.

    Args:
        scene: with all its rows.
        work: scratch; ``work.time`` holds the functions of time at the instant.
        x: (nx,) configuration.
        v: (nv,) velocities.
        a: (nv,) accelerations.
        rank: how many of the rows are independent there.
        load: (nv,) generalised forces that act beside those of the scene; None: there are none.

    Raises:
        AssemblyError: some motion moves no mass.
        SceneError: a user's function of force failed, which is asked anew.
    """
    free, rows = scene.plan.free, row_sizes(scene)
    if rank == 0 or len(free) == 0:
        return np.zeros(len(rows))
    force = np.zeros(scene.nv)
    residual(scene.plan, work, x, v, a, np.zeros(len(rows)), force)
    scene.refuse_failed(work)
    if load is not None:
        force -= load
    lower = mass_factor(scene, work, x)
    slopes = constraint_jacobian(scene, work, x)[:, free] / rows[:, None]
    both = scipy.linalg.solve_triangular(lower, np.column_stack([force[free], slopes.T]), lower=True)
    left, sigma, right = np.linalg.svd(both[:, 1:], full_matrices=False)
    shares = right[:rank].T @ ((left[:, :rank].T @ both[:, 0]) / sigma[:rank])
    return np.asarray(-shares / rows, dtype=np.float64)


def forbidden_drives(full: CompiledScene, work: Work, x: FloatArray) -> list[str]:
    """The driven coordinates whose rates open loops that nothing free can close again.

    Args:
        full: the scene with all its rows.
        work: scratch; ``work.time`` holds the functions of time.
        x: (nx,) a regular configuration with closed loops.
    """
    forbidden = np.zeros(full.nv, bool)
    for block, place in zip(full.row_blocks, decompose_rows(full, work, x), strict=True):
        across = np.abs(place.left[:, place.rank :].T @ place.driven).max(axis=0, initial=0.0)
        # the terms of slopes are of size 1: what is far below is their rounding, or the gap of a loop nearly closed
        forbidden[block.driven] |= across > CLOSED
    return [full.velocity_names[k] for k in np.flatnonzero(forbidden)]
