"""Constraint rows of a moving machine: values, rates, and reactions on the bodies.

The reaction is the virtual-work dual of the row, so it does no work (Ambrosio & Nikravesh 1992,
eq. 74-77).  The kinds of rows are defined in ``physics.constraint_laws``.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    cross3,
    dot3,
    rotate,
    rotate_back,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion, load_frame
from flexmbd.multibody.kernels.physics.constraint_laws import (
    row_value,
    row_wrench,
    row_wrench_variation,
    wrap,
)


@kernel
def _transpose(m):
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@kernel
def relative_rates(plan, work, f, g):
    """d = p_FG_F, R_FG, and the velocity and angular velocity of G against F, all in F's axes."""
    p_F, R_F, v_F, w_F, _, _ = frame_motion(plan, work, f)
    p_G, R_G, v_G, w_G, _, _ = frame_motion(plan, work, g)
    d = rotate_back(R_F, sub3(p_G, p_F))
    R = compose(_transpose(R_F), R_G)
    rate = sub3(rotate(R, v_G), add3(v_F, cross3(w_F, d)))
    return d, R, rate, sub3(rotate(R, w_G), w_F)


@entry_kernel
def relative_motion(plan, work, f, g):
    """p_FG_F, R_FG and the velocity and acceleration of G against F, all in F's axes.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        f: int64, row of Plan.frames, frame F.
        g: int64, row of Plan.frames, frame G.
    """
    p_F, R_F, v_F, w_F, a_F, dw_F = frame_motion(plan, work, f)
    p_G, R_G, v_G, w_G, a_G, dw_G = frame_motion(plan, work, g)
    d = rotate_back(R_F, sub3(p_G, p_F))
    R_FG = compose(_transpose(R_F), R_G)
    wd = cross3(w_F, d)
    rate = sub3(rotate(R_FG, v_G), add3(v_F, wd))
    spin = sub3(rotate(R_FG, w_G), w_F)
    rate2 = sub3(
        rotate(R_FG, a_G),
        add3(
            add3(a_F, scale3(2.0, cross3(w_F, rate))),
            add3(cross3(dw_F, d), cross3(w_F, wd)),
        ),
    )
    spin_rate = sub3(sub3(rotate(R_FG, dw_G), dw_F), cross3(w_F, spin))
    return d, R_FG, rate, spin, rate2, spin_rate


@kernel
def relative_pose(plan, work, f, g):
    """p_FG_F and R_FG."""
    p_F, R_F, _, _, _, _ = frame_motion(plan, work, f)
    p_G, R_G, _, _, _, _ = frame_motion(plan, work, g)
    return rotate_back(R_F, sub3(p_G, p_F)), compose(_transpose(R_F), R_G)


@kernel
def load_relative(plan, work, f, g, d, R, force, torque, out):
    """Add the wrench (force at G's origin, torque; F's axes) to that required of G's body, its opposite to F's.

    d = p_FG_F and R = R_FG, as ``relative_pose`` gives them; ``out`` gets modal parts.
    """
    load_frame(plan, work, g, rotate_back(R, force), rotate_back(R, torque), out)
    back = add3(torque, cross3(d, force))
    load_frame(plan, work, f, scale3(-1.0, force), scale3(-1.0, back), out)


@kernel
def _same_frames(row, other):
    """Whether two rows join the same pair of frames, so that their kinematics can be shared."""
    return row[at.ROW_F] == other[at.ROW_F] and row[at.ROW_G] == other[at.ROW_G]


@kernel
def coupling_term(plan, o, k):
    """Entry in v and factor of term k of the coupling whose data begin at ``o``."""
    c = o + 2 + 3 * k
    return plan.tree[int(plan.data[c]), at.JOINT_V] + int(plan.data[c + 1]), plan.data[c + 2]


@kernel
def _coupling_sum(plan, work, row, order):
    """Sum of r_k times coupled coordinates (order 0), their rates (1) or accelerations (2)."""
    o = row[at.ROW_DATA]
    total = 0.0
    for k in range(int(plan.data[o])):
        c = o + 2 + 3 * k
        body = work.body[int(plan.data[c])]
        total += plan.data[c + 2] * body[at.B_COORDINATE + 3 * int(plan.data[c + 1]) + order]
    return total


@entry_kernel
def constraints(plan, work, position, velocity, acceleration):
    """Write every row's residual (m or rad) and its first two time derivatives.

    The residual of a row that holds velocities alone is 0.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        position: (m,) float64, output.
        velocity: (m,) float64, output.
        acceleration: (m,) float64, output.
    """
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        if row[at.ROW_KIND] == kinds.ROW_COUPLING:
            position[i] = _coupling_sum(plan, work, row, 0) - plan.data[row[at.ROW_DATA] + 1]
            velocity[i] = _coupling_sum(plan, work, row, 1)
            acceleration[i] = _coupling_sum(plan, work, row, 2)
            continue
        if i == 0 or not _same_frames(row, plan.rows[i - 1]):
            d, R, rate, spin, rate2, spin_rate = relative_motion(
                plan, work, row[at.ROW_F], row[at.ROW_G]
            )
        force, torque = row_wrench(plan.data, row, d, R)
        force_rate, torque_rate = row_wrench_variation(plan.data, row, d, R, rate, spin)
        position[i] = row_value(plan.data, row, d, R)
        velocity[i] = dot3(force, rate) + dot3(torque, spin)
        acceleration[i] = (
            dot3(force, rate2)
            + dot3(torque, spin_rate)
            + dot3(force_rate, rate)
            + dot3(torque_rate, spin)
        )
        f = row[at.ROW_TIME]
        if f >= 0:
            position[i] -= work.time[f, 0]
            velocity[i] -= work.time[f, 1]
            acceleration[i] -= work.time[f, 2]
            if row[at.ROW_KIND] == kinds.ROW_ANGLE:
                position[i] = wrap(position[i])


@deferred_kernel()
def load_constraints(plan, work, multipliers, out):
    """Add the reactions of the rows' multipliers (N or N m) to the wrenches required of both frames' bodies.

    The residual is inertial + C^T nu - applied forces.  The reactions
    of couplings are ``load_couplings``' part.
    """
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        if row[at.ROW_KIND] == kinds.ROW_COUPLING:
            continue
        f = row[at.ROW_F]
        g = row[at.ROW_G]
        if i == 0 or not _same_frames(row, plan.rows[i - 1]):
            d, R = relative_pose(plan, work, f, g)
        force, torque = row_wrench(plan.data, row, d, R)
        force = scale3(multipliers[i], force)
        torque = scale3(multipliers[i], torque)
        load_relative(plan, work, f, g, d, R, force, torque, out)


@kernel
def load_couplings(plan, multipliers, out):
    """Add the couplings' reactions to the joints' generalised forces; after ``backward``."""
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        if row[at.ROW_KIND] == kinds.ROW_COUPLING:
            o = row[at.ROW_DATA]
            for k in range(int(plan.data[o])):
                v, share = coupling_term(plan, o, k)
                out[v] += share * multipliers[i]
