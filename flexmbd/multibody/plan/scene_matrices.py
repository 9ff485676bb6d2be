"""Constraint rows, their Jacobian and the mass matrix of a compiled scene, dense: for the start and for checks."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import AssemblyError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.forward_dynamics.row_paths import RowPaths, row_slopes
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.sampling.series import constraint_rates
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.row_slopes import RowSlopes

FloatArray = NDArray[np.float64]

_AT_ONCE = 64  # velocities by which slopes are taken in one call: memory in proportion to the machine


def constraint_values(
    scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray, a: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (m,) of all rows and their first and second time derivatives."""
    m = len(scene.plan.rows)
    values = np.zeros((3, m))
    forward_kinematics(scene.plan, work, x, v, np.zeros(scene.nv) if a is None else a)
    constraints(scene.plan, work, *values)
    return values[0], values[1], values[2]


def constraint_jacobian(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """C (m, nv): rates of the rows per unit of each velocity."""
    return constraint_slopes(scene, work, x).matrix()


def constraint_slopes(scene: CompiledScene, work: Work, x: FloatArray) -> RowSlopes:
    """C block by block: rates of the rows per unit of each velocity."""
    (slopes,) = slopes_at(scene, work, x[None])
    return slopes


def slopes_at(scene: CompiledScene, work: Work, x: FloatArray) -> list[RowSlopes]:
    """As ``constraint_slopes``, at each of several configurations (nt, nx).

    Blocks share no free velocity, so all of them move by one velocity each at once: as many sweeps over the machine as
    the largest block has, and one for each velocity that is driven.  Where those are many, each row by itself, as the
    generalised forces of its unit reaction.
    """
    if scene.row_structure.paths is not None:
        return [_slopes_by_paths(scene, work, one, scene.row_structure.paths) for one in x]
    sweeps, m = scene.row_structure.sweeps, len(scene.plan.rows)
    rates = np.zeros((len(x), sweeps.count, m))
    rest, scratch = np.zeros(scene.nv), np.zeros((4, m))
    if 0 < sweeps.count <= _AT_ONCE:
        constraint_rates(scene.plan, work, x, sweeps.all_velocities, rest, scratch, rates)
        return [sweeps.slopes(by_sweep) for by_sweep in rates]
    for first in range(0, sweeps.count, _AT_ONCE):
        velocities = sweeps.velocities(first, min(first + _AT_ONCE, sweeps.count))
        found = np.zeros((len(x), len(velocities), m))
        constraint_rates(scene.plan, work, x, velocities, rest, scratch, found)
        rates[:, first : first + len(velocities)] = found
    return [sweeps.slopes(by_sweep) for by_sweep in rates]


def _slopes_by_paths(scene: CompiledScene, work: Work, x: FloatArray, paths: RowPaths) -> RowSlopes:
    """As ``constraint_slopes``, row by row."""
    own = paths.replace(jacobian=np.zeros_like(paths.jacobian))  # which variants share
    forward_kinematics(scene.plan, work, x, *np.zeros((2, scene.nv)))
    row_slopes(scene.plan, work, own)
    blocks = scene.row_structure.blocks
    parts = tuple(own.jacobian[block.rows[:, None], block.velocities] for block in blocks)
    return RowSlopes(blocks, parts, (len(scene.plan.rows), scene.nv))


def coordinate_sizes(scene: CompiledScene) -> FloatArray:
    """(nv,) full size of each coordinate: 1 rad, the machine's extent (m), of modes that times root mass."""
    return scene.group_full[scene.group_of] if scene.nv else np.zeros(0)


def fastest_rate(mass: FloatArray, stiffness: FloatArray) -> float:
    """The rate (1/s) of the fastest coordinate by itself; 1 where none is held, for then no velocity is too large."""
    inertia = np.diag(mass)
    rates = np.divide(np.abs(np.diag(stiffness)), inertia, out=np.zeros(len(inertia)), where=inertia > 0.0)
    fastest = float(np.sqrt(rates.max(initial=0.0)))
    return fastest if fastest > 0.0 else 1.0


def row_sizes(scene: CompiledScene) -> FloatArray:
    """(m,) full size of each row's residual, m or rad: the machine's extent, or 1 rad.  Not to be written to."""
    return scene.row_sizes


def modal_stiffness(scene: CompiledScene) -> FloatArray:
    """(nv,) stiffness of each modal coordinate (1/s^2); 0 of others."""
    stiffness = np.zeros(scene.nv)
    for body, slots in scene.index.modes.items():
        record = scene.index.now(body).reduced()
        if record is not None:
            stiffness[slots.v] = record.stiffness
    return stiffness


def mass_matrix(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """M (nv, nv) of the tree at configuration x, without its loops."""
    plan = scene.inertia_plan
    rest = np.zeros(scene.nv)
    none = np.zeros(len(plan.rows))
    offset, columns = np.zeros(scene.nv), np.zeros((scene.nv, scene.nv))
    residual(plan, work, x, rest, rest, none, offset)
    for unit, column in zip(np.eye(scene.nv), columns, strict=True):
        residual(plan, work, x, rest, unit, none, column)
    columns -= offset
    return 0.5 * (columns + columns.T)


def mass_factor(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """Cholesky factor of M on the free coordinates.

    Raises:
        AssemblyError: some motion moves no mass; the message names its largest coordinate.
    """
    free = scene.plan.free
    mass = mass_matrix(scene, work, x)[np.ix_(free, free)]
    try:
        lower: FloatArray = np.linalg.cholesky(mass).astype(np.float64, copy=False)
    except np.linalg.LinAlgError as reason:
        _, vectors = np.linalg.eigh(mass)
        name = scene.velocity_names[free[int(np.argmax(np.abs(vectors[:, 0])))]]
        raise AssemblyError(
            f"moving {name!r} moves no mass, so that no force determines its acceleration; give the body an "
            "inertia, or fix the joint"
        ) from reason
    return lower


def scaled_jacobian(scene: CompiledScene, work: Work, x: FloatArray) -> FloatArray:
    """C on the free coordinates, per unit of kinetic energy, rows over the largest of them."""
    free = scene.plan.free
    jacobian = constraint_jacobian(scene, work, x)[:, free]
    lower = mass_factor(scene, work, x)
    return scipy.linalg.solve_triangular(lower, jacobian.T, lower=True).T
