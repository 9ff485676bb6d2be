"""Forward dynamics of trees whose hinges are all parallel: the articulated-body recursion in their plane.

Where every joint is a free hinge and every frame but the first on the ground lies along its parent's axes, bodies
turn about one direction.  Then one moment and two forces accelerate a hinge, and a body's articulated inertia has six
numbers: everything else that ``inward`` computes goes into reactions.  The factors are left where ``solve_mass`` reads
them.  It takes 1 / 1.55 of the time of the recursion in space, of ten links (benchmarks/skipping.py).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import cross3, rotate_back, sub3
from flexmbd.multibody.kernels.algebra.spatial import row3, row9
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to

# Columns of ArticulatedWork.gathered that this recursion uses: moment about the origin per angular acceleration; the
# same per linear one (2), which is also the force per angular one; force per linear one (xx, xy, yy); bias force.
_A, _B, _M, _TORQUE, _FORCE = to.G_A, to.G_B, to.G_M, to.G_TORQUE + 2, to.G_FORCE


@kernel
def planar_dynamics(gravity, aw, body, x, v, a, loaded):  # noqa: PLR0915  three passes over scalars
    """Write the accelerations ``a`` (nv,); ``aw.required`` and, if ``loaded``, ``Work.body`` hold applied forces."""
    link = aw.link
    constant = aw.constant
    row = aw.row
    pose = aw.pose
    gathered = aw.gathered
    w = 0.0
    for i in range(link.shape[0]):
        parent = link[i, to.PARENT]
        if parent < 0:
            w = 0.0
        elif parent != i - 1:
            w = row[parent, to.R_SPIN + 2]
        angle = x[link[i, to.JOINT_X]]
        c = math.cos(angle)
        s = math.sin(angle)
        px = constant[i, to.C_P]
        py = constant[i, to.C_P + 1]
        ww = -w * w
        row[i, to.R_BIAS] = ww * (c * px + s * py)
        row[i, to.R_BIAS + 1] = ww * (c * py - s * px)
        w += v[link[i, to.JOINT_V]]
        row[i, to.R_COS] = c
        row[i, to.R_SIN] = s
        row[i, to.R_SPIN + 2] = w
        if link[i, to.FORM] != to.PLAIN:
            gathered[i, _A] = 0.0
            gathered[i, _B] = 0.0
            gathered[i, _B + 1] = 0.0
            gathered[i, _M] = 0.0
            gathered[i, _M + 1] = 0.0
            gathered[i, _M + 2] = 0.0
            gathered[i, _TORQUE] = 0.0
            gathered[i, _FORCE] = 0.0
            gathered[i, _FORCE + 1] = 0.0
    inertia = bx = by = xx = xy = yy = torque = fx = fy = 0.0
    for i in range(link.shape[0] - 1, -1, -1):
        mass = constant[i, to.C_MASS]
        hx = constant[i, to.C_FIRST]
        hy = constant[i, to.C_FIRST + 1]
        w = row[i, to.R_SPIN + 2]
        ww = -w * w
        inertia += constant[i, to.C_INERTIA + 5]
        bx -= hy
        by += hx
        xx += mass
        yy += mass
        fx += ww * hx
        fy += ww * hy
        if link[i, to.FORM] != to.PLAIN:
            inertia += gathered[i, _A]
            bx += gathered[i, _B]
            by += gathered[i, _B + 1]
            xx += gathered[i, _M]
            xy += gathered[i, _M + 1]
            yy += gathered[i, _M + 2]
            torque += gathered[i, _TORQUE]
            fx += gathered[i, _FORCE]
            fy += gathered[i, _FORCE + 1]
        if loaded:
            t, f, g = _load(aw, body, i)
            torque += t
            fx += f
            fy += g
        over = 1.0 / inertia
        joint_force = -aw.required[link[i, to.JOINT_V]] - torque
        row[i, to.R_U + 2] = inertia
        row[i, to.R_U + 3] = bx
        row[i, to.R_U + 4] = by
        row[i, to.R_D] = over
        row[i, to.R_FORCE] = joint_force
        parent = link[i, to.PARENT]
        if parent >= 0:
            # what does not turn the hinge, passed on, turned and shifted
            ex = over * bx
            ey = over * by
            xx -= bx * ex
            xy -= bx * ey
            yy -= by * ey
            p = row[i, to.R_BIAS]
            q = row[i, to.R_BIAS + 1]
            torque += joint_force
            gx = fx + joint_force * ex + xx * p + xy * q
            gy = fy + joint_force * ey + xy * p + yy * q
            c = row[i, to.R_COS]
            s = row[i, to.R_SIN]
            fx = c * gx - s * gy
            fy = s * gx + c * gy
            t = 2.0 * c * s * xy
            cc = c * c
            ss = s * s
            xy = c * s * (xx - yy) + (cc - ss) * xy
            gx = cc * xx - t + ss * yy
            yy = ss * xx + t + cc * yy
            xx = gx
            px = constant[i, to.C_P]
            py = constant[i, to.C_P + 1]
            bx = px * xy - py * xx
            by = px * yy - py * xy
            inertia = px * by - py * bx
            torque += px * fy - py * fx
            if parent == i - 1:
                continue
            gathered[parent, _A] += inertia
            gathered[parent, _B] += bx
            gathered[parent, _B + 1] += by
            gathered[parent, _M] += xx
            gathered[parent, _M + 1] += xy
            gathered[parent, _M + 2] += yy
            gathered[parent, _TORQUE] += torque
            gathered[parent, _FORCE] += fx
            gathered[parent, _FORCE + 1] += fy
        inertia = bx = by = xx = xy = yy = torque = fx = fy = 0.0
    dw = p = q = 0.0
    for i in range(link.shape[0]):
        parent = link[i, to.PARENT]
        if parent < 0:
            dw = 0.0
            p = -_along(aw, gravity, i, 0)
            q = -_along(aw, gravity, i, 1)
        else:
            if parent != i - 1:
                dw = pose[parent, to.P_ANGULAR + 2]
                p = pose[parent, to.P_LINEAR]
                q = pose[parent, to.P_LINEAR + 1]
            p -= dw * constant[i, to.C_P + 1]
            q += dw * constant[i, to.C_P]
        c = row[i, to.R_COS]
        s = row[i, to.R_SIN]
        t = c * p + s * q + row[i, to.R_BIAS]
        q = c * q - s * p + row[i, to.R_BIAS + 1]
        p = t
        t = row[i, to.R_FORCE] - row[i, to.R_U + 3] * p - row[i, to.R_U + 4] * q
        t = row[i, to.R_D] * t - dw
        a[link[i, to.JOINT_V]] = t
        dw += t
        if link[i, to.FORM] != to.PLAIN:
            pose[i, to.P_ANGULAR + 2] = dw
            pose[i, to.P_LINEAR] = p
            pose[i, to.P_LINEAR + 1] = q


@kernel
def _along(aw, g, i, k):
    """Component of the vector g (3,) of the ground along axis k of the first frame of root i."""
    return aw.axes[i, to.X_R + k] * g[0] + aw.axes[i, to.X_R + 3 + k] * g[1] + aw.axes[i, to.X_R + 6 + k] * g[2]


@kernel
def _load(aw, body, i):
    """Moment and force in the plane of force elements and loops on body i, in its hinge's frame."""
    force = row3(body, i, at.B_F)
    torque = sub3(row3(body, i, at.B_T), cross3(row3(aw.axes, i, to.X_OWN_P), force))
    own_R = row9(aw.axes, i, to.X_OWN_R)
    torque = rotate_back(own_R, torque)
    force = rotate_back(own_R, force)
    return torque[2], force[0], force[1]
