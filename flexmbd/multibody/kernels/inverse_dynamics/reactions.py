"""Reactions of joints over a whole trajectory, compiled."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.elements.table import element_wrench, is_between_frames
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_motion
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.constraint_laws import row_wrench
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times


@kernel
def passed_on(plan, work, i, f):
    """Force and moment of the inboard joint of row i on its body, about frame f and in its axes, after ``residual``."""
    row = work.body[i]
    p, R, _, _, _, _ = frame_motion(plan, work, f)
    R_WB = load9(row, at.B_R)
    force = rotate(R_WB, load3(row, at.B_F))
    arm = sub3(load3(row, at.B_P), p)
    torque = add3(rotate(R_WB, load3(row, at.B_T)), cross3(arm, force))
    return rotate_back(R, force), rotate_back(R, torque)


@entry_kernel
def tree_reactions(plan, work, i, f, t, x, v, a, multipliers, scratch, out):
    """out[k] = force and moment that the inboard joint of row i passes on to its body.

    The moment is about the origin of frame f, both in f's axes: the wrench that the motion of all
    outboard of the joint requires, less that of other forces.  ``scratch`` is (nv,).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        i: int64, row of Plan.tree.
        f: int64, row of Plan.frames.
        t: (nt,) float64, s.
        x: (nt, nx) float64, configurations.
        v: (nt, nv) float64, velocities.
        a: (nt, nv) float64, accelerations.
        multipliers: (nt, m) float64, N or N m, of the constraint rows.
        scratch: (nv,) float64.
        out: (nt, 6) float64, output.
    """
    for k in range(x.shape[0]):
        evaluate_times(plan, t[k], work.time)
        residual(plan, work, x[k], v[k], a[k], multipliers[k], scratch)
        force, torque = passed_on(plan, work, i, f)
        store3(out[k], 0, force)
        store3(out[k], 3, torque)


@entry_kernel
def row_reactions(plan, work, f, g, t, x, v, a, multipliers, scratch, out):
    """out[k] = force and moment on frame g, about its origin and in its axes, that rows from f to g give.

    Elements between the same two frames count with them.  ``scratch`` is (nv,).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        f: int64, row of Plan.frames.
        g: int64, row of Plan.frames.
        t: (nt,) float64, s.
        x: (nt, nx) float64, configurations.
        v: (nt, nv) float64, velocities.
        a: (nt, nv) float64, accelerations.
        multipliers: (nt, m) float64, N or N m, of the constraint rows.
        scratch: (nv,) float64.
        out: (nt, 6) float64, output.
    """
    for k in range(x.shape[0]):
        evaluate_times(plan, t[k], work.time)
        residual(plan, work, x[k], v[k], a[k], multipliers[k], scratch)
        d, R, rate, spin, _, _ = relative_motion(plan, work, f, g)
        force = (0.0, 0.0, 0.0)
        torque = (0.0, 0.0, 0.0)
        for i in range(plan.rows.shape[0]):
            row = plan.rows[i]
            if row[at.ROW_F] == f and row[at.ROW_G] == g:
                row_force, row_torque = row_wrench(plan.data, row, d, R)
                force = sub3(force, scale3(multipliers[k, i], row_force))
                torque = sub3(torque, scale3(multipliers[k, i], row_torque))
        for i in range(plan.elements.shape[0]):
            row = plan.elements[i]
            if is_between_frames(row[at.EL_KIND]) and row[at.EL_F] == f and row[at.EL_G] == g:
                row_force, row_torque = element_wrench(plan, work, row, d, R, rate, spin)
                force = add3(force, row_force)
                torque = add3(torque, row_torque)
        store3(out[k], 0, rotate_back(R, force))
        store3(out[k], 3, rotate_back(R, torque))
