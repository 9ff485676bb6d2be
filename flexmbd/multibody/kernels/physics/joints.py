"""Joints along the tree: relative pose and motion, generalised force, retraction.

A joint is a kinematic pair, whose motion subspace is constant (Wittenburg 2008, section 5.3): a coordinate k that adds
slides G along a vector of F and may turn it about the z axis that F and G share; a ball's three velocities after those
are w_FG_G, its four coordinates the quaternion of R_FG.  So the linear velocity is a constant matrix times the
velocities in F's axes, and the angular one in G's.  ``turn`` (``kinds.TURN_NONE``, ``TURN_ABOUT_Z``, ``TURN_BALL``)
says how G may turn, ``adds`` how many coordinates add, and ``data[o:]`` has four numbers of each: its turn (rad) and
its slide (3,) (m) a unit.  Nothing else in the package knows how a joint moves.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    load3,
    quaternion_exp,
    quaternion_matrix,
    quaternion_product,
    store3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

_ZERO = (0.0, 0.0, 0.0)


@kernel
def spin_of(link):
    """First entry in v of the angular velocity of a ball, after those of coordinates that add; -1 of other joints."""
    return link[at.JOINT_V] + link[at.JOINT_ADDS] if link[at.JOINT_TURN] == kinds.TURN_BALL else -1


@kernel
def is_free(link):
    """Whether a link's joint holds nothing: its momenta are then those of a body in space, not of coordinates."""
    return link[at.JOINT_SIZE] == 6


@kernel
def is_slide(plan, link, k):
    """Whether velocity k of a link's joint slides along an axis of the inner frame and turns nothing."""
    return k < link[at.JOINT_ADDS] and plan.data[link[at.JOINT_DATA] + 4 * k] == 0.0


@kernel
def _sum_of_coordinates(adds, data, o, values, first):
    """Sum over the coordinates that add: turn about z and slide (3,) in F's axes, for ``values[first:]`` of them."""
    if adds == 0:
        return 0.0, _ZERO
    q = values[first]
    angle = data[o] * q
    px = data[o + 1] * q
    py = data[o + 2] * q
    pz = data[o + 3] * q
    for k in range(1, adds):
        c = o + 4 * k
        q = values[first + k]
        angle += data[c] * q
        px += data[c + 1] * q
        py += data[c + 2] * q
        pz += data[c + 3] * q
    return angle, (px, py, pz)


@entry_kernel
def joint_pose(turn, adds, data, o, x, first):
    """p_FG_F and R_FG from the joint's coordinates x[first:].

    Args:
        turn: int64, kinds.TURN_NONE to TURN_BALL.
        adds: int64, number of coordinates that add.
        data: (k,) float64, Plan.data.
        o: int64, place of the joint's parameters in data.
        x: (nx,) float64, configuration.
        first: int64, place of the joint's coordinates in x.
    """
    angle, p = _sum_of_coordinates(adds, data, o, x, first)
    r = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    if turn == kinds.TURN_ABOUT_Z:
        cos = math.cos(angle)
        sin = math.sin(angle)
        r = (cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
    elif turn == kinds.TURN_BALL:
        b = first + adds
        r = quaternion_matrix((x[b], x[b + 1], x[b + 2], x[b + 3]))
    return p, r


@entry_kernel
def joint_motion(turn, adds, data, o, v, first):
    """Rate of p_FG_F and w_FG_G from the joint's entries v[first:]; for accelerations alike.

    Args:
        turn: int64, kinds.TURN_NONE to TURN_BALL.
        adds: int64, number of coordinates that add.
        data: (k,) float64, Plan.data.
        o: int64, place of the joint's parameters in data.
        v: (nv,) float64, velocities or accelerations.
        first: int64, place of the joint's entries in v.
    """
    rate, linear = _sum_of_coordinates(adds, data, o, v, first)
    if turn == kinds.TURN_BALL:
        return linear, load3(v, first + adds)
    return linear, (0.0, 0.0, rate)


@kernel
def joint_column(adds, data, o, k):
    """Column k of the motion subspace: angular velocity (G's axes) and linear one (F's axes) a unit of velocity k."""
    if k >= adds:
        return _unit(k - adds), _ZERO
    c = o + 4 * k
    return (0.0, 0.0, data[c]), load3(data, c + 1)


@kernel
def _unit(k):
    return (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 1.0 if k == 2 else 0.0)


@kernel
def joint_force(turn, adds, data, o, force_F, torque_G, out, first):
    """Project the wrench at G onto the joint's velocities, the motion subspace transposed: out[first:]."""
    for k in range(adds):
        c = o + 4 * k
        out[first + k] = (
            data[c] * torque_G[2]
            + data[c + 1] * force_F[0]
            + data[c + 2] * force_F[1]
            + data[c + 3] * force_F[2]
        )
    if turn == kinds.TURN_BALL:
        store3(out, first + adds, torque_G)


@kernel
def _turn(x, o, angle, out):
    """out[o:] = quaternion x[o:] turned by the rotation vector ``angle``."""
    turned = quaternion_product(
        (x[o], x[o + 1], x[o + 2], x[o + 3]), quaternion_exp(angle)
    )
    out[o] = turned[0]
    out[o + 1] = turned[1]
    out[o + 2] = turned[2]
    out[o + 3] = turned[3]


@kernel
def coordinates_end(plan):
    """Where the coordinates end in the configuration x, behind which lies what elements remember."""
    end = plan.free.shape[0] + plan.driven.shape[0]
    for i in range(plan.tree.shape[0]):
        if plan.tree[i, at.JOINT_TURN] == kinds.TURN_BALL:
            end += 1
    return end


@entry_kernel
def retract(plan, x, step, out):
    """out = x moved along the tangent vector ``step`` (v-sized, body axes), on the manifold.

    Quaternions by the exponential map (Zienkiewicz, Taylor & Fox, eq. 8.26); other coordinates add, and what elements
    remember behind them stays.

    Args:
        plan: Plan, the compiled scene.
        x: (nx,) float64, configuration.
        step: (nv,) float64.
        out: (nx,) float64, output.
    """
    for i in range(plan.tree.shape[0]):
        row = plan.tree[i]
        adds = row[at.JOINT_ADDS]
        ox = row[at.JOINT_X]
        ov = row[at.JOINT_V]
        for k in range(adds):
            out[ox + k] = x[ox + k] + step[ov + k]
        if row[at.JOINT_TURN] == kinds.TURN_BALL:
            _turn(x, ox + adds, load3(step, ov + adds), out)
        if row[at.FLEX] >= 0:
            qx = row[at.MODAL_X]
            qv = row[at.MODAL_V]
            for k in range(plan.flex[row[at.FLEX], at.N_MODES]):
                out[qx + k] = x[qx + k] + step[qv + k]
    for k in range(coordinates_end(plan), x.shape[0]):
        out[k] = x[k]
