"""Reactions of loops whose rows may be redundant: the smallest multipliers that do what the loops need."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import (
    constraint_jacobian,
    coordinate_sizes,
    mass_factor,
    row_sizes,
)
from flexmbd.multibody.start.independent_rows import decompose_rows
from flexmbd.multibody.start.loop_closing import CLOSED

FloatArray = NDArray[np.float64]


def minimum_norm_multipliers(
    scene: CompiledScene, work: Work, x: FloatArray, multipliers: FloatArray, *, independent: int
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
        independent: how many of the rows are.

    Returns:
        (nt, m) N or N m.
    """
    rows = row_sizes(scene)
    spread = np.zeros_like(multipliers)
    for k, (place, reaction) in enumerate(zip(x, multipliers, strict=True)):
        # multipliers by their rows' sizes are all of one unit; what lies in the rows' own space is all that acts
        found = decompose_rows(scene, work, place)
        round_off = max(found.slopes.shape) * np.finfo(float).eps
        own = found.left[:, : min(independent, int(np.sum(found.sigma > round_off)))]
        spread[k] = own @ (own.T @ (reaction * rows)) / rows
    return spread


def balancing_multipliers(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, a: FloatArray, *, rank: int
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
    place = decompose_rows(full, work, x)
    driven = np.setdiff1d(np.arange(full.nv), full.plan.free)
    slopes = constraint_jacobian(full, work, x)[:, driven] * coordinate_sizes(full)[driven] / row_sizes(full)[:, None]
    left_open = np.abs(place.left[:, place.rank :].T @ slopes).max(axis=0, initial=0.0)
    return [full.velocity_names[k] for k in driven[left_open > CLOSED * np.abs(slopes).max(initial=0.0)]]
