"""Joint kinds along the tree: relative pose, relative motion, generalised force, retraction.

The joint turns and slides about the z axis of its frames F (on the parent) and G (on the
child); any other axis is reached by how the frames are laid.  Velocities of a spherical or
free joint are w_FG_G and the rate of p_FG_F.  ``pitch`` (m/rad) is a screw's advance, and not
read for other kinds.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    load3,
    quaternion_exp,
    quaternion_matrix,
    quaternion_product,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

_ZERO = (0.0, 0.0, 0.0)
_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@entry_kernel
def joint_pose(kind, pitch, x, o):
    """p_FG_F and R_FG from the joint's coordinates x[o:]."""
    p = _ZERO
    r = _IDENTITY
    if kind == kinds.REVOLUTE or kind == kinds.SCREW:
        c = math.cos(x[o])
        s = math.sin(x[o])
        r = (c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
        if kind == kinds.SCREW:
            p = (0.0, 0.0, pitch * x[o])
    elif kind == kinds.PRISMATIC:
        p = (0.0, 0.0, x[o])
    elif kind == kinds.SPHERICAL:
        r = quaternion_matrix((x[o], x[o + 1], x[o + 2], x[o + 3]))
    elif kind == kinds.FREE:
        p = load3(x, o)
        r = quaternion_matrix((x[o + 3], x[o + 4], x[o + 5], x[o + 6]))
    return p, r


@kernel
def joint_size(kind):
    """Number of velocities of a joint."""
    if kind == kinds.FIXED:
        return 0
    if kind == kinds.SPHERICAL:
        return 3
    return 6 if kind == kinds.FREE else 1


@entry_kernel
def joint_motion(kind, pitch, v, o):
    """Rate of p_FG_F and w_FG_G from the joint's entries v[o:]; for accelerations alike."""
    linear = _ZERO
    angular = _ZERO
    if kind == kinds.REVOLUTE:
        angular = (0.0, 0.0, v[o])
    elif kind == kinds.PRISMATIC:
        linear = (0.0, 0.0, v[o])
    elif kind == kinds.SCREW:
        linear = (0.0, 0.0, pitch * v[o])
        angular = (0.0, 0.0, v[o])
    elif kind == kinds.SPHERICAL:
        angular = load3(v, o)
    elif kind == kinds.FREE:
        linear = load3(v, o)
        angular = load3(v, o + 3)
    return linear, angular


@kernel
def joint_force(kind, pitch, force_F, torque_G, out, o):
    """Project the wrench at G onto the joint's coordinates: out[o:]."""
    if kind == kinds.REVOLUTE:
        out[o] = torque_G[2]
    elif kind == kinds.PRISMATIC:
        out[o] = force_F[2]
    elif kind == kinds.SCREW:
        out[o] = torque_G[2] + pitch * force_F[2]
    elif kind == kinds.SPHERICAL:
        out[o] = torque_G[0]
        out[o + 1] = torque_G[1]
        out[o + 2] = torque_G[2]
    elif kind == kinds.FREE:
        out[o] = force_F[0]
        out[o + 1] = force_F[1]
        out[o + 2] = force_F[2]
        out[o + 3] = torque_G[0]
        out[o + 4] = torque_G[1]
        out[o + 5] = torque_G[2]


@kernel
def has_one_coordinate(kind):
    """Whether the joint is a revolute, prismatic or screw joint."""
    return kind == kinds.REVOLUTE or kind == kinds.PRISMATIC or kind == kinds.SCREW


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


@entry_kernel
def retract(plan, x, step, out):
    """out = x moved along the tangent vector ``step`` (v-sized, body axes), on the manifold.

    Quaternions by the exponential map (Zienkiewicz, Taylor & Fox, eq. 8.26); everything else adds.
    """
    for i in range(plan.tree.shape[0]):
        row = plan.tree[i]
        kind = row[at.JOINT]
        ox = row[at.JOINT_X]
        ov = row[at.JOINT_V]
        if has_one_coordinate(kind):
            out[ox] = x[ox] + step[ov]
        elif kind == kinds.SPHERICAL:
            _turn(x, ox, load3(step, ov), out)
        elif kind == kinds.FREE:
            for k in range(3):
                out[ox + k] = x[ox + k] + step[ov + k]
            _turn(x, ox + 3, load3(step, ov + 3), out)
        if row[at.FLEX] >= 0:
            qx = row[at.MODAL_X]
            qv = row[at.MODAL_V]
            for k in range(plan.flex[row[at.FLEX], at.N_MODES]):
                out[qx + k] = x[qx + k] + step[qv + k]

