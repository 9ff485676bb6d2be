"""Accelerations of the tree by generalised forces, for the start: by dense factors or, of many bodies, by recursion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.forward_dynamics.articulated import articulate, solve_mass
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.row_slopes import RowSlopes
from flexmbd.multibody.plan.scene_matrices import mass_factor

FloatArray = NDArray[np.float64]

#: Of generalised forces (k, nv) the accelerations (k, nv) M^-1 f of the free coordinates; zero of driven ones.
MassSolver = Callable[[FloatArray], FloatArray]

#: Velocities up to which M is set up and factored in less time than the recursion's kernels take to be loaded.
DENSE_UP_TO = 100


def mass_solver(scene: CompiledScene, work: Work, x: FloatArray) -> MassSolver:
    """M of the tree at configuration x (nx,), factored.

    Raises:
        AssemblyError: some motion moves no mass; the message names its largest coordinate.
    """
    return dense_solver(scene, work, x) if scene.nv <= DENSE_UP_TO else recursive_solver(scene, work, x)


def dense_solver(scene: CompiledScene, work: Work, x: FloatArray) -> MassSolver:
    """``mass_solver`` by the Cholesky factor of M."""
    lower, free = mass_factor(scene, work, x), scene.plan.free

    def solve(forces: FloatArray) -> FloatArray:
        motion = np.zeros_like(forces)
        if not len(free):
            return motion
        motion[:, free] = scipy.linalg.lapack.dpotrs(lower, forces[:, free].T, lower=1)[0].T
        return motion

    return solve


def recursive_solver(scene: CompiledScene, work: Work, x: FloatArray) -> MassSolver:
    """``mass_solver`` by the articulated-body recursion, in O(bodies)."""
    plan, aw = scene.plan, new_articulated_work(scene.plan)
    articulate(plan, work, aw, x)

    def solve(forces: FloatArray) -> FloatArray:
        motion = np.zeros_like(forces)
        solve_mass(plan, work, aw, np.ascontiguousarray(forces), motion)
        if np.isfinite(motion).all() or not np.isfinite(forces).all():
            return motion
        return dense_solver(scene, work, x)(forces)  # a joint without inertia; it is named

    return solve


def row_mobilities(slopes: RowSlopes, solve: MassSolver) -> list[FloatArray]:
    """C M^-1 C^T (k, k) of each block of rows, symmetric.

    No block's reactions move another's coordinates, so that those of all act at once, one row of each.
    """
    forces = np.zeros((max((len(block.rows) for block in slopes.blocks), default=0), slopes.shape[1]))
    for block, part in slopes:
        forces[: len(part), block.free] = part[:, : len(block.free)]
    motion = solve(forces)
    found = []
    for block, part in slopes:
        mobility = part[:, : len(block.free)] @ motion[: len(part), block.free].T
        found.append(0.5 * (mobility + mobility.T))
    return found
