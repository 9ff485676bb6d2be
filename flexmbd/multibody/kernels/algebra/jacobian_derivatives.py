"""The left Jacobian of exp(v) as a matrix, and its derivatives: how modes turn a frame.

J(v) = I + b [v] + c [v]^2 with b and c functions of |v|^2 (`so3.exp_coefficients`).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import dot3
from flexmbd.multibody.kernels.base.compiling import kernel

_TERMS = 12


@kernel
def _coefficients(x):
    """b, c and their first two derivatives by x = |v|^2."""
    if x < 1.0:
        # b = sum (-x)^k / (2 k + 2)!, c = sum (-x)^k / (2 k + 3)!
        b = b1 = b2 = c = c1 = c2 = 0.0
        term = 0.5
        power0, power1, power2 = 1.0, 0.0, 0.0
        for k in range(_TERMS):
            b += term * power0
            b1 += term * power1
            b2 += term * power2
            odd = term / (2 * k + 3)
            c += odd * power0
            c1 += odd * power1
            c2 += odd * power2
            term = -odd / (2 * k + 4)
            power2 = (k + 1) * power1
            power1 = (k + 1) * power0
            power0 *= x
        return b, c, b1, c1, b2, c2
    angle = math.sqrt(x)
    a = math.sin(angle) / angle
    b = (1.0 - math.cos(angle)) / x
    c = (1.0 - a) / x
    a1 = (math.cos(angle) - a) / (2.0 * x)
    b1 = (a - 2.0 * b) / (2.0 * x)
    c1 = (b - 3.0 * c) / (2.0 * x)
    b2 = (a1 - 4.0 * b1) / (2.0 * x)
    c2 = (b1 - 5.0 * c1) / (2.0 * x)
    return b, c, b1, c1, b2, c2


@kernel
def skew(v):
    """[v], the matrix of the cross product."""
    return (0.0, -v[2], v[1], v[2], 0.0, -v[0], -v[1], v[0], 0.0)


@kernel
def add9(a, b):
    """A + B."""
    return (
        a[0] + b[0], a[1] + b[1], a[2] + b[2],
        a[3] + b[3], a[4] + b[4], a[5] + b[5],
        a[6] + b[6], a[7] + b[7], a[8] + b[8],
    )  # fmt: skip


@kernel
def scale9(s, a):
    """s A."""
    return (s * a[0], s * a[1], s * a[2], s * a[3], s * a[4], s * a[5], s * a[6], s * a[7], s * a[8])


@kernel
def _mixed(u, v):
    """([u] [v] + [v] [u]) / 2 = (u v^T + v u^T) / 2 - (u . v) I."""
    d = dot3(u, v)
    xy = 0.5 * (u[0] * v[1] + u[1] * v[0])
    xz = 0.5 * (u[0] * v[2] + u[2] * v[0])
    yz = 0.5 * (u[1] * v[2] + u[2] * v[1])
    return (u[0] * v[0] - d, xy, xz, xy, u[1] * v[1] - d, yz, xz, yz, u[2] * v[2] - d)


@kernel
def left_jacobian_derivatives(v, rate, rate2):
    """J(v), and its first and second time derivatives for dv/dt and d^2 v/dt^2 (9-tuples)."""
    b, c, b1, c1, b2, c2 = _coefficients(dot3(v, v))
    x_rate = 2.0 * dot3(v, rate)
    x_rate2 = 2.0 * (dot3(rate, rate) + dot3(v, rate2))
    vv, vr = _mixed(v, v), _mixed(v, rate)
    value = add9((1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), add9(scale9(b, skew(v)), scale9(c, vv)))
    first = add9(
        add9(scale9(b1 * x_rate, skew(v)), scale9(b, skew(rate))),
        add9(scale9(c1 * x_rate, vv), scale9(2.0 * c, vr)),
    )
    turns = add9(
        scale9(b2 * x_rate * x_rate + b1 * x_rate2, skew(v)),
        add9(scale9(2.0 * b1 * x_rate, skew(rate)), scale9(b, skew(rate2))),
    )
    bends = add9(
        add9(scale9(c2 * x_rate * x_rate + c1 * x_rate2, vv), scale9(4.0 * c1 * x_rate, vr)),
        scale9(2.0 * c, add9(_mixed(v, rate2), _mixed(rate, rate))),
    )
    return value, first, add9(turns, bends)


@kernel
def left_jacobian_torque_derivative(v, torque):
    """Q with u^T Q w = torque . (derivative of J(v) along u) w."""
    b, c, b1, c1, _, _ = _coefficients(dot3(v, v))
    # torque^T [e_i] w = (torque x e_i) . w, and so for the products
    sv = (torque[1] * v[2] - torque[2] * v[1], torque[2] * v[0] - torque[0] * v[2], torque[0] * v[1] - torque[1] * v[0])
    tv = dot3(torque, v)
    vv = dot3(v, v)
    # torque^T [v]^2 = (torque . v) v - |v|^2 torque
    along = (
        2.0 * (b1 * sv[0] + c1 * (tv * v[0] - vv * torque[0])),
        2.0 * (b1 * sv[1] + c1 * (tv * v[1] - vv * torque[1])),
        2.0 * (b1 * sv[2] + c1 * (tv * v[2] - vv * torque[2])),
    )
    # rows i: b torque x e_i + c (torque^T ([e_i] [v] + [v] [e_i])), outer(v, along)
    t0, t1, t2 = torque
    s = skew(torque)  # row i of -[torque] is torque x e_i, as [torque]^T = -[torque]
    return (
        v[0] * along[0] - b * s[0] + c * (t0 * v[0] + tv - 2.0 * v[0] * t0),
        v[0] * along[1] - b * s[1] + c * (t0 * v[1] - 2.0 * v[0] * t1),
        v[0] * along[2] - b * s[2] + c * (t0 * v[2] - 2.0 * v[0] * t2),
        v[1] * along[0] - b * s[3] + c * (t1 * v[0] - 2.0 * v[1] * t0),
        v[1] * along[1] - b * s[4] + c * (t1 * v[1] + tv - 2.0 * v[1] * t1),
        v[1] * along[2] - b * s[5] + c * (t1 * v[2] - 2.0 * v[1] * t2),
        v[2] * along[0] - b * s[6] + c * (t2 * v[0] - 2.0 * v[2] * t0),
        v[2] * along[1] - b * s[7] + c * (t2 * v[1] - 2.0 * v[2] * t1),
        v[2] * along[2] - b * s[8] + c * (t2 * v[2] + tv - 2.0 * v[2] * t2),
    )
