"""Elimination of a hinge whose frame lies along its parent's axes, the most frequent joint of machines."""

from __future__ import annotations

from flexmbd.multibody.kernels.base.compiling import kernel


@kernel
def eliminate_hinge(c, s, r, a, b, m, torque, force, joint_force, over, w, rate, bias):  # noqa: PLR0915  scalars
    """Blocks A, B, M and the wrench (torque, force) that a hinge passes on, about the parent's origin.

    No torque about z is passed on but the applied one, so the last row and column of A and the last row of B
    vanish.  ``joint_force``: torque about z that accelerates; ``over``: 1/D; ``w``, ``rate``: angular velocity of the
    body and of the joint; ``bias``: linear acceleration of G that needs no other.
    """
    u0, u1, u3, u4, u5 = a[2], a[4], b[6], b[7], b[8]
    e0 = over * u0
    e1 = over * u1
    e3 = over * u3
    e4 = over * u4
    e5 = over * u5
    a00 = a[0] - u0 * e0
    a01 = a[1] - u0 * e1
    a11 = a[3] - u1 * e1
    b00 = b[0] - u0 * e3
    b01 = b[1] - u0 * e4
    b02 = b[2] - u0 * e5
    b10 = b[3] - u1 * e3
    b11 = b[4] - u1 * e4
    b12 = b[5] - u1 * e5
    m00 = m[0] - u3 * e3
    m01 = m[1] - u3 * e4
    m02 = m[2] - u3 * e5
    m11 = m[3] - u4 * e4
    m12 = m[4] - u4 * e5
    m22 = m[5] - u5 * e5
    # the angular bias is w x (0, 0, rate)
    p = w[1] * rate
    q = -w[0] * rate
    x, y, z = bias
    n0 = torque[0] + joint_force * e0 + a00 * p + a01 * q + b00 * x + b01 * y + b02 * z
    n1 = torque[1] + joint_force * e1 + a01 * p + a11 * q + b10 * x + b11 * y + b12 * z
    n2 = torque[2] + joint_force
    f0 = force[0] + joint_force * e3 + b00 * p + b10 * q + m00 * x + m01 * y + m02 * z
    f1 = force[1] + joint_force * e4 + b01 * p + b11 * q + m01 * x + m11 * y + m12 * z
    f2 = force[2] + joint_force * e5 + b02 * p + b12 * q + m02 * x + m12 * y + m22 * z
    # turned by the joint
    cc = c * c
    ss = s * s
    cs = c * s
    t = 2.0 * cs * a01
    d = cc - ss
    k00 = cc * a00 - t + ss * a11
    k11 = ss * a00 + t + cc * a11
    k01 = cs * (a00 - a11) + d * a01
    t = 2.0 * cs * m01
    l00 = cc * m00 - t + ss * m11
    l11 = ss * m00 + t + cc * m11
    l01 = cs * (m00 - m11) + d * m01
    l02 = c * m02 - s * m12
    l12 = s * m02 + c * m12
    t00 = c * b00 - s * b10
    t01 = c * b01 - s * b11
    t02 = c * b02 - s * b12
    t10 = s * b00 + c * b10
    t11 = s * b01 + c * b11
    t12 = s * b02 + c * b12
    h00 = t00 * c - t01 * s
    h01 = t00 * s + t01 * c
    h10 = t10 * c - t11 * s
    h11 = t10 * s + t11 * c
    g0 = c * f0 - s * f1
    g1 = s * f0 + c * f1
    # shifted by r
    x, y, z = r
    i00 = h00 - z * l01 + y * l02
    i01 = h01 - z * l11 + y * l12
    i02 = t02 - z * l12 + y * m22
    i10 = h10 + z * l00 - x * l02
    i11 = h11 + z * l01 - x * l12
    i12 = t12 + z * l02 - x * m22
    i20 = x * l01 - y * l00
    i21 = x * l11 - y * l01
    i22 = x * l12 - y * l02
    return (
        (
            k00 + y * (t02 + i02) - z * (h01 + i01),
            k01 + z * h00 - x * t02 + y * i12 - z * i11,
            x * h01 - y * h00 + y * i22 - z * i21,
            k11 + z * (h10 + i10) - x * (t12 + i12),
            x * h11 - y * h10 + z * i20 - x * i22,
            x * i21 - y * i20,
        ),
        (i00, i01, i02, i10, i11, i12, i20, i21, i22),
        (l00, l01, l02, l11, l12, m22),
        (c * n0 - s * n1 + y * f2 - z * g1, s * n0 + c * n1 + z * g0 - x * f2, n2 + x * g1 - y * g0),
        (g0, g1, f2),
    )
