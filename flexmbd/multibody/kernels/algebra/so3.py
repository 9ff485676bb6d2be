"""Vectors and rotations in registers: 3-tuples, row-major 9-tuples, scalar-first quaternions.

Tuples of floats stay in registers under numba, so these compose without allocation.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel


@kernel
def load3(row, o):
    """(row[o], row[o + 1], row[o + 2])."""
    return (row[o], row[o + 1], row[o + 2])


@kernel
def store3(row, o, v):
    """row[o : o + 3] = v."""
    row[o] = v[0]
    row[o + 1] = v[1]
    row[o + 2] = v[2]


@kernel
def load9(row, o):
    """Nine entries of row from o."""
    return (
        row[o],
        row[o + 1],
        row[o + 2],
        row[o + 3],
        row[o + 4],
        row[o + 5],
        row[o + 6],
        row[o + 7],
        row[o + 8],
    )


@kernel
def store9(row, o, m):
    """row[o : o + 9] = m."""
    row[o] = m[0]
    row[o + 1] = m[1]
    row[o + 2] = m[2]
    row[o + 3] = m[3]
    row[o + 4] = m[4]
    row[o + 5] = m[5]
    row[o + 6] = m[6]
    row[o + 7] = m[7]
    row[o + 8] = m[8]


@kernel
def add3(a, b):
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@kernel
def sub3(a, b):
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@kernel
def scale3(s, a):
    """s a."""
    return (s * a[0], s * a[1], s * a[2])


@kernel
def dot3(a, b):
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross3(a, b):
    """a x b."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


@kernel
def rotate(m, v):
    """M v."""
    return (
        m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@kernel
def rotate_back(m, v):
    """M^T v."""
    return (
        m[0] * v[0] + m[3] * v[1] + m[6] * v[2],
        m[1] * v[0] + m[4] * v[1] + m[7] * v[2],
        m[2] * v[0] + m[5] * v[1] + m[8] * v[2],
    )


@kernel
def compose(a, b):
    """A B."""
    return (
        a[0] * b[0] + a[1] * b[3] + a[2] * b[6],
        a[0] * b[1] + a[1] * b[4] + a[2] * b[7],
        a[0] * b[2] + a[1] * b[5] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[3] + a[5] * b[6],
        a[3] * b[1] + a[4] * b[4] + a[5] * b[7],
        a[3] * b[2] + a[4] * b[5] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[3] + a[8] * b[6],
        a[6] * b[1] + a[7] * b[4] + a[8] * b[7],
        a[6] * b[2] + a[7] * b[5] + a[8] * b[8],
    )


@kernel
def compose_back(a, b):
    """A B^T."""
    return (
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2],
        a[0] * b[3] + a[1] * b[4] + a[2] * b[5],
        a[0] * b[6] + a[1] * b[7] + a[2] * b[8],
        a[3] * b[0] + a[4] * b[1] + a[5] * b[2],
        a[3] * b[3] + a[4] * b[4] + a[5] * b[5],
        a[3] * b[6] + a[4] * b[7] + a[5] * b[8],
        a[6] * b[0] + a[7] * b[1] + a[8] * b[2],
        a[6] * b[3] + a[7] * b[4] + a[8] * b[5],
        a[6] * b[6] + a[7] * b[7] + a[8] * b[8],
    )


@kernel
def exp_coefficients(x):
    """(a, b, c) with exp(v) = I + a [v] + b [v]^2 and left Jacobian I + b [v] + c [v]^2.

    x = |v|^2.  The series keeps full accuracy where the closed forms cancel.
    """
    if x < 1e-2:
        a = 1.0 - x / 6.0 * (1.0 - x / 20.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0)))
        b = 0.5 - x / 24.0 * (1.0 - x / 30.0 * (1.0 - x / 56.0 * (1.0 - x / 90.0)))
        c = 1.0 / 6.0 - x / 120.0 * (1.0 - x / 42.0 * (1.0 - x / 72.0 * (1.0 - x / 110.0)))
    else:
        angle = math.sqrt(x)
        a = math.sin(angle) / angle
        b = (1.0 - math.cos(angle)) / x
        c = (1.0 - a) / x
    return a, b, c


@kernel
def exp_rotation(v):
    """Rotation matrix of the rotation vector v (rad)."""
    a, b, _ = exp_coefficients(dot3(v, v))
    xx = b * v[0] * v[0]
    yy = b * v[1] * v[1]
    zz = b * v[2] * v[2]
    xy = b * v[0] * v[1]
    xz = b * v[0] * v[2]
    yz = b * v[1] * v[2]
    return (
        1.0 - yy - zz,
        xy - a * v[2],
        xz + a * v[1],
        xy + a * v[2],
        1.0 - xx - zz,
        yz - a * v[0],
        xz - a * v[1],
        yz + a * v[0],
        1.0 - xx - yy,
    )


@kernel
def left_jacobian(v, u):
    """J_l(v) u: the angular velocity, in the axes v turns from, of exp(v(t)) with dv/dt = u."""
    _, b, c = exp_coefficients(dot3(v, v))
    vu = cross3(v, u)
    return add3(u, add3(scale3(b, vu), scale3(c, cross3(v, vu))))


@kernel
def left_jacobian_transposed(v, u):
    """J_l(v)^T u."""
    _, b, c = exp_coefficients(dot3(v, v))
    vu = cross3(v, u)
    return add3(u, add3(scale3(-b, vu), scale3(c, cross3(v, vu))))


@kernel
def left_jacobian_rate(v, u):
    """d/dt J_l(v) u with dv/dt = u: what J_l(v) dv''/dt lacks of the angular acceleration."""
    x = dot3(v, v)
    a, b, c = exp_coefficients(x)
    if x < 1e-2:
        db = -1.0 / 24.0 + x * (1.0 / 360.0 - x * (1.0 / 13440.0 - x / 907200.0))
        dc = -1.0 / 120.0 + x * (1.0 / 2520.0 - x * (1.0 / 120960.0 - x / 9979200.0))
    else:
        db = (a - 2.0 * b) / (2.0 * x)
        dc = (b - 3.0 * c) / (2.0 * x)
    # b and c depend on x alone: db, dc are derivatives by x, and dx/dt = 2 v.u
    rate = 2.0 * dot3(v, u)
    vu = cross3(v, u)
    return add3(
        scale3(db * rate, vu),
        add3(scale3(dc * rate, cross3(v, vu)), scale3(c, cross3(u, vu))),
    )


@entry_kernel
def rotation_vector(m):
    """The rotation vector of a rotation matrix, its angle at most pi (Shepperd 1978).

    Args:
        m: nine float64, the matrix by rows.
    """
    trace = m[0] + m[4] + m[8]
    if trace >= max(m[0], m[4], m[8]):
        w, v = 1.0 + trace, (m[7] - m[5], m[2] - m[6], m[3] - m[1])
    elif m[0] >= m[4] and m[0] >= m[8]:
        w, v = m[7] - m[5], (1.0 + m[0] - m[4] - m[8], m[1] + m[3], m[2] + m[6])
    elif m[4] >= m[8]:
        w, v = m[2] - m[6], (m[1] + m[3], 1.0 - m[0] + m[4] - m[8], m[5] + m[7])
    else:
        w, v = m[3] - m[1], (m[2] + m[6], m[5] + m[7], 1.0 - m[0] - m[4] + m[8])
    length = math.sqrt(dot3(v, v))
    if length < 1e-150:
        return (0.0, 0.0, 0.0)
    angle = 2.0 * math.atan2(length, abs(w))
    return scale3(angle / length if w >= 0.0 else -angle / length, v)


@kernel
def inverse_coefficient(x):
    """(e, de/dx) with inverse left Jacobian I - [v] / 2 + e [v]^2, x = |v|^2 below (2 pi)^2."""
    if x < 0.25:
        c = 3617.0 / 10670622842880000.0
        e = 1.0 / 74724249600.0 + x * c
        slope = 6.0 / 74724249600.0 + 7.0 * x * c
        e = 691.0 / 1307674368000.0 + x * e
        slope = 5.0 * 691.0 / 1307674368000.0 + x * slope
        e = 1.0 / 47900160.0 + x * e
        slope = 4.0 / 47900160.0 + x * slope
        e = 1.0 / 1209600.0 + x * e
        slope = 3.0 / 1209600.0 + x * slope
        e = 1.0 / 30240.0 + x * e
        slope = 2.0 / 30240.0 + x * slope
        e = 1.0 / 720.0 + x * e
        slope = 1.0 / 720.0 + x * slope
        e = 1.0 / 12.0 + x * e
    else:
        half = 0.5 * math.sqrt(x)
        sine = math.sin(half)
        a = half * math.cos(half) / sine
        e = (1.0 - a) / x
        slope = (0.125 / (sine * sine) - 0.5 * a / x - e) / x
    return e, slope


@kernel
def left_jacobian_inverse(v, u):
    """J_l(v)^-1 u: dv/dt of the rotation exp(v(t)) with the angular velocity u, |v| < 2 pi."""
    e, _ = inverse_coefficient(dot3(v, v))
    vu = cross3(v, u)
    return add3(u, add3(scale3(-0.5, vu), scale3(e, cross3(v, vu))))


@kernel
def left_jacobian_inverse_transposed(v, u):
    """J_l(v)^-T u: the torque of a potential with the derivative u by v."""
    e, _ = inverse_coefficient(dot3(v, v))
    vu = cross3(v, u)
    return add3(u, add3(scale3(0.5, vu), scale3(e, cross3(v, vu))))


@kernel
def quaternion_matrix(q):
    """Rotation matrix of a unit scalar-first quaternion."""
    w, x, y, z = q
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@entry_kernel
def quaternion_exp(v):
    """Unit quaternion of the rotation vector v (rad).

    Args:
        v: three float64, rad.
    """
    x = 0.25 * dot3(v, v)
    half, _, _ = exp_coefficients(x)
    return (math.cos(math.sqrt(x)), 0.5 * half * v[0], 0.5 * half * v[1], 0.5 * half * v[2])


@entry_kernel
def quaternion_product(p, q):
    """Hamilton's product, scaled back to unit length.

    Args:
        p: four float64, scalar part first.
        q: four float64, scalar part first.
    """
    w = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    x = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    y = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    z = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    s = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    return (s * w, s * x, s * y, s * z)
