"""Loop closures: scalar constraints between two frames, their rates, and their reactions.

A row holds p_FG_F[k] = 0, R_FG[a, b] = 0, or one component of the axis of R_FG = 0 (the vector
of its skew part); the reaction is the virtual-work dual, so it does no work
(Ambrosio & Nikravesh 1992, eq. 74-77; theory: seed 2 section 8.5).
"""

from __future__ import annotations

from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.compiling import kernel
from flexmbd.multibody.kernels.recursion import frame_motion, load_frame
from flexmbd.multibody.kernels.so3 import (
    add3,
    compose,
    cross3,
    dot3,
    rotate,
    rotate_back,
    scale3,
    sub3,
)


@kernel
def _column(m, k):
    if k == 0:
        return (m[0], m[3], m[6])
    if k == 1:
        return (m[1], m[4], m[7])
    return (m[2], m[5], m[8])


@kernel
def _unit(k):
    if k == 0:
        return (1.0, 0.0, 0.0)
    if k == 1:
        return (0.0, 1.0, 0.0)
    return (0.0, 0.0, 1.0)


@kernel
def _transpose(m):
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@kernel
def _relative(plan, work, f, g):
    """p_FG_F, R_FG and the velocity and acceleration of G against F, all in F's axes."""
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
def _same_frames(row, other):
    """Whether two rows join the same pair of frames, so that their kinematics can be shared."""
    return row[at.ROW_F] == other[at.ROW_F] and row[at.ROW_G] == other[at.ROW_G]


@kernel
def _skew_axis(m):
    """Vector of the skew part of m: sin(angle) axis for a rotation."""
    return (0.5 * (m[7] - m[5]), 0.5 * (m[2] - m[6]), 0.5 * (m[3] - m[1]))


@kernel
def _axis_rate(R, w):
    """Vector of the skew part of [w] R."""
    trace = R[0] + R[4] + R[8]
    return scale3(0.5, sub3(scale3(trace, w), rotate(R, w)))


@kernel
def _spin_twice(w, R):
    """[w]^2 R."""
    c0 = cross3(w, cross3(w, _column(R, 0)))
    c1 = cross3(w, cross3(w, _column(R, 1)))
    c2 = cross3(w, cross3(w, _column(R, 2)))
    return (c0[0], c1[0], c2[0], c0[1], c1[1], c2[1], c0[2], c1[2], c2[2])


@kernel
def constraints(plan, work, position, velocity, acceleration):
    """Write every row's residual (m or rad) and its first two time derivatives."""
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        if i == 0 or not _same_frames(row, plan.rows[i - 1]):
            d, R, rate, spin, rate2, spin_rate = _relative(
                plan, work, row[at.ROW_F], row[at.ROW_G]
            )
        k = row[at.ROW_INDEX]
        if row[at.ROW_KIND] == at.ROW_TRANSLATION:
            e = _unit(k)
            position[i] = dot3(e, d)
            velocity[i] = dot3(e, rate)
            acceleration[i] = dot3(e, rate2)
        elif row[at.ROW_KIND] == at.ROW_DIRECTION:
            e = _unit(k // 3)
            z = _column(R, k % 3)
            z_rate = cross3(spin, z)
            position[i] = dot3(e, z)
            velocity[i] = dot3(e, z_rate)
            acceleration[i] = dot3(e, add3(cross3(spin_rate, z), cross3(spin, z_rate)))
        else:
            e = _unit(k)
            position[i] = dot3(e, _skew_axis(R))
            velocity[i] = dot3(e, _axis_rate(R, spin))
            acceleration[i] = dot3(e, _axis_rate(R, spin_rate)) + dot3(
                e, _skew_axis(_spin_twice(spin, R))
            )


@kernel
def load_constraints(plan, work, multipliers, out):
    """Ask the reactions of the rows' multipliers (N or N m) of both frames' bodies.

    Added to what the motion asks for: residual = asked inertia + C^T nu - applied.
    """
    for i in range(plan.rows.shape[0]):
        row = plan.rows[i]
        f = row[at.ROW_F]
        g = row[at.ROW_G]
        if i == 0 or not _same_frames(row, plan.rows[i - 1]):
            p_F, R_F, _, _, _, _ = frame_motion(plan, work, f)
            p_G, R_G, _, _, _, _ = frame_motion(plan, work, g)
            d = rotate_back(R_F, sub3(p_G, p_F))
            R = compose(_transpose(R_F), R_G)
        k = row[at.ROW_INDEX]
        force = (0.0, 0.0, 0.0)
        torque = (0.0, 0.0, 0.0)
        if row[at.ROW_KIND] == at.ROW_TRANSLATION:
            force = scale3(multipliers[i], _unit(k))
        elif row[at.ROW_KIND] == at.ROW_DIRECTION:
            torque = scale3(multipliers[i], cross3(_column(R, k % 3), _unit(k // 3)))
        else:
            e = _unit(k)
            trace = R[0] + R[4] + R[8]
            torque = scale3(
                0.5 * multipliers[i], sub3(scale3(trace, e), rotate_back(R, e))
            )
        load_frame(plan, work, g, rotate_back(R, force), rotate_back(R, torque), out)
        back = add3(torque, cross3(d, force))
        load_frame(plan, work, f, scale3(-1.0, force), scale3(-1.0, back), out)
