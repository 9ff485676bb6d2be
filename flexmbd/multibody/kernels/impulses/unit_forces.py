"""Generalised forces of unit forces and wrenches, carried inwards along the paths of the bodies that they act on."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import cross3, load9, rotate_back, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion, load_frame, propagate_wrench

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _clear(plan, work, row, b):
    """Zero what body b is to take, and the row's entries of its velocities."""
    store3(work.body[b], at.B_F, _ZERO)
    store3(work.body[b], at.B_T, _ZERO)
    first = plan.tree[b, at.JOINT_V]
    for k in range(first, first + plan.tree[b, at.JOINT_SIZE]):
        row[k] = 0.0
    if plan.tree[b, at.FLEX] >= 0:
        first = plan.tree[b, at.MODAL_V]
        for k in range(first, first + plan.flex[plan.tree[b, at.FLEX], at.N_MODES]):
            row[k] = 0.0


@kernel
def _onwards(plan, i, j, b):
    """Both places on two paths inwards once body b is passed."""
    parent = plan.tree[b, at.PARENT]
    return parent if i == b else i, parent if j == b else j


@kernel
def forget_paths(plan, work, i, j, row):
    """Zero the row along the paths of bodies i and j; -1: the ground."""
    while i >= 0 or j >= 0:
        b = max(i, j)
        _clear(plan, work, row, b)
        i, j = _onwards(plan, i, j, b)


@kernel
def _carry_inwards(plan, work, i, j, row):
    while i >= 0 or j >= 0:
        b = max(i, j)
        propagate_wrench(plan, work, b, row)
        i, j = _onwards(plan, i, j, b)


@kernel
def _load_point(plan, work, f, p, force, out):
    """Add a force (N, inertial axes) at p on frame f to what its body is to take."""
    p_F, R_F, _, _, _, _ = frame_motion(plan, work, f)
    load_frame(plan, work, f, rotate_back(R_F, force), rotate_back(R_F, cross3(sub3(p, p_F), force)), out)


@kernel
def unit_force(plan, work, f, g, p, e, row):
    """Write the generalised forces of a unit force e on frame g at p, and its opposite on f, along both paths."""
    i, j = plan.frame_of[f, at.FRAME_BODY], plan.frame_of[g, at.FRAME_BODY]
    forget_paths(plan, work, i, j, row)
    _load_point(plan, work, g, p, e, row)
    _load_point(plan, work, f, p, scale3(-1.0, e), row)
    _carry_inwards(plan, work, i, j, row)


@kernel
def unit_wrench(plan, work, b, arm, force, torque, row):
    """Write the generalised forces of a wrench on the rigid body b, about a point ``arm`` (m) from its origin.

    arm, force, torque: inertial axes.
    """
    forget_paths(plan, work, b, -1, row)
    R = load9(work.body[b], at.B_R)
    moment = cross3(arm, force)
    store3(work.body[b], at.B_F, rotate_back(R, force))
    store3(
        work.body[b],
        at.B_T,
        rotate_back(R, (moment[0] + torque[0], moment[1] + torque[1], moment[2] + torque[2])),
    )
    _carry_inwards(plan, work, b, -1, row)
