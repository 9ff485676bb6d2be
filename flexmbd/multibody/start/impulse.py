"""Prescribed motions whose rates jump: the impulse, in which the whole machine takes part at once."""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import Work
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.reading.constraint_tables import driven_coordinates
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import (
    constraint_jacobian,
    constraint_values,
    coordinate_sizes,
    mass_matrix,
    row_sizes,
)

FloatArray = NDArray[np.float64]


def refuse_position_jumps(scene: CompiledScene, work: Work, x: FloatArray, *, rtol: float) -> None:
    """Refuse prescribed motions whose values jump: no impulse takes a machine from one place to another.

    Args:
        scene: without redundant rows.
        work: scratch; ``work.time`` holds the functions of time just after the jump.
        x: (nx,) configuration just before it.
        rtol: share of a coordinate's full size that counts as none.

    Raises:
        SceneError: a value jumps by more; the message names its coordinate or row.
    """
    rest, moved = np.zeros(scene.nv), x.copy()
    drive(scene.plan, work, moved, rest.copy(), rest.copy())
    driven = driven_coordinates(scene.plan)
    places, slots = driven.x, driven.v
    leaps = np.concatenate([(moved - x)[places], constraint_values(scene, work, x, rest)[0]])
    sizes = np.concatenate([coordinate_sizes(scene)[slots], row_sizes(scene)])
    shares = np.abs(leaps) / sizes
    if shares.max(initial=0.0) > rtol:
        worst = int(np.argmax(shares))
        names = [*(scene.velocity_names[k] for k in slots), *scene.row_names]
        raise SceneError(
            f"the motion prescribed of {names[worst]!r} jumps by {leaps[worst]:.3e} (m or rad) at "
            f"t = {work.time[-1, 0]:.6g} s; a motion's values must be continuous, its rate alone may jump"
        )


def rates_after_jump(scene: CompiledScene, work: Work, x: FloatArray, v: FloatArray) -> FloatArray:
    """Velocities (nv,) just after the rates of prescribed motions have jumped: M dv + C^T p = 0, C v = -dphi/dt.

    The impulses that drive the prescribed coordinates and those of the loops, p, are all there are: forces that are
    finite do nothing in no time.  The driven coordinates' dv is given.

    Args:
        scene: without redundant rows.
        work: scratch; ``work.time`` holds the functions of time just after the jump.
        x: (nx,) configuration.
        v: (nv,) velocities just before it.

    Source: Ambrosio & Nikravesh 1992, eq. 76-77, integrated over the instant.
    """
    plan, free = scene.plan, scene.plan.free
    after = v.copy()
    drive(plan, work, x.copy(), after, np.zeros(scene.nv))
    if len(free) == 0:
        return after
    mass = mass_matrix(scene, work, x)
    lower = np.linalg.cholesky(mass[np.ix_(free, free)])
    scaled: FloatArray = scipy.linalg.solve_triangular(lower, -(mass @ (after - v))[free], lower=True)
    if len(plan.rows):
        opening = constraint_values(scene, work, x, after)[1]
        unit = scipy.linalg.solve_triangular(lower, constraint_jacobian(scene, work, x)[:, free].T, lower=True).T
        # rows of unit length, since those in rad differ from those in m by the square of the machine's size
        lengths = np.linalg.norm(unit, axis=1)
        lengths[lengths == 0.0] = 1.0
        unit = unit / lengths[:, None]
        scaled = scaled - unit.T @ scipy.linalg.lstsq(unit @ unit.T, unit @ scaled + opening / lengths, cond=1e-13)[0]
    after[free] += scipy.linalg.solve_triangular(lower, scaled, lower=True, trans="T")
    return after
