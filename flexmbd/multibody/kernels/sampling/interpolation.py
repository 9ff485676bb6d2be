"""Motion between two instants from configuration, velocity and acceleration at both.

Coordinates follow the quintic that has all three at both ends; a quaternion turns from its first value
by a rotation vector u(t) that is such a quintic, after the steady spin of a body that is round about an axis
(``round_bodies``).  The error of the configuration is of order 6 in the
interval h between the instants, that of the velocity 5, that of the acceleration 4: of x it is at most
h^6 / 46080 times the sixth derivative of the motion.

A mode that vibrates more than once in two intervals is not resolved by them.  It may follow its loads smoothly all the
same; but of what a method leaves of its vibration the quintic would make up to (omega h)^2 / 64 times as much.  Where
accelerations bend such a mode's curve more than velocities do, as they never do on smooth curves, its coordinate, rate
and acceleration follow straight lines between their values at the ends, which none of them exceeds.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.algebra.rotation_update import coordinate_slots
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    left_jacobian,
    left_jacobian_inverse,
    left_jacobian_rate,
    load3,
    quaternion_exp,
    quaternion_product,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.forward_dynamics.round_bodies import despun_motion, round_axes, turn_about
from flexmbd.multibody.kernels.reading.tree import flexible_row, modal_places

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def interpolated_coordinates(plan: Plan) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """The first arguments of ``interpolate``.

    ``coordinate_slots``; ``round_axes``; (nv,) angular frequencies (rad/s) of modal coordinates, zero elsewhere.
    """
    plain, quaternions = coordinate_slots(plan)
    frequencies = np.zeros(len(plan.free) + len(plan.driven))
    for place in modal_places(plan):
        first = flexible_row(plan, place.row)[at.MODAL_STIFFNESS]
        stiffness = plan.modal[first : first + place.v.stop - place.v.start]
        frequencies[place.v] = np.sqrt(np.maximum(stiffness, 0.0))
    return plain, quaternions, round_axes(plan, quaternions), frequencies


@kernel
def _quintic(h, s, v0, a0, move, v1, a1):
    """Move, velocity, acceleration at s in [0, 1] of the interval h; the move is 0 at s = 0."""
    first = h * v0
    second = h * h * a0
    d = move - first - 0.5 * second
    e = h * v1 - first - second
    f = h * h * a1 - second
    c3 = 10.0 * d - 4.0 * e + 0.5 * f
    c4 = -15.0 * d + 7.0 * e - f
    c5 = 6.0 * d - 3.0 * e + 0.5 * f
    u = s * (first + s * (0.5 * second + s * (c3 + s * (c4 + s * c5))))
    rate = (first + s * (second + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h
    rate2 = (second + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h)
    return u, rate, rate2


@kernel
def _contradicts(h, v0, a0, move, v1, a1):
    """Whether accelerations bend the curve more than velocities do: the quintic off the cubic, that off the line."""
    first = h * v0 - move
    last = h * v1 - move
    off_line = 4.0 / 27.0 * (abs(first) + abs(last))
    off_cubic = (abs(h * h * a0 + 4.0 * first + 2.0 * last) + abs(h * h * a1 - 2.0 * first - 4.0 * last)) / 64.0
    return off_cubic > off_line


@kernel
def _straight(s, begin, end):
    """On the straight line from one value to another."""
    return (1.0 - s) * begin + s * end


@kernel
def _turn_between(x0, x1, o, e, angle):
    """Rotation vector (rad) from quaternion x0[o:] to x1[o:] less a turn by ``angle`` about e; up to a whole turn."""
    w, x, y, z = quaternion_product(
        (x0[o], -x0[o + 1], -x0[o + 2], -x0[o + 3]), (x1[o], x1[o + 1], x1[o + 2], x1[o + 3])
    )
    w, x, y, z = quaternion_product((w, x, y, z), quaternion_exp(scale3(-angle, e)))
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 2.0
    return scale3(scale, (x, y, z))


@kernel
def _interpolate_turn(h, s, x0, v0, a0, x1, v1, a1, ox, ov, axis, x, v, a):
    """The part of ``interpolate`` of the quaternion at x[ox:] and its spin at v[ov:]; ``axis`` of a round body."""
    e = load3(axis, 0)
    spin = dot3(e, load3(v0, ov))
    end = _turn_between(x0, x1, ox, e, spin * h)
    # of a turn by u, in the turned axes: spin J_l(-u) du/dt, and its rate
    back = scale3(-1.0, end)
    w, dw = despun_motion(e, spin, math.cos(spin * h), math.sin(spin * h), load3(v1, ov), load3(a1, ov))
    rate = left_jacobian_inverse(back, w)
    bend = left_jacobian_rate(back, scale3(-1.0, rate))
    rate2 = left_jacobian_inverse(back, add3(dw, bend))
    first, second = despun_motion(e, spin, 1.0, 0.0, load3(v0, ov), load3(a0, ov))
    u0, r0, c0 = _quintic(h, s, first[0], second[0], end[0], rate[0], rate2[0])
    u1, r1, c1 = _quintic(h, s, first[1], second[1], end[1], rate[1], rate2[1])
    u2, r2, c2 = _quintic(h, s, first[2], second[2], end[2], rate[2], rate2[2])
    turned = quaternion_product(
        (x0[ox], x0[ox + 1], x0[ox + 2], x0[ox + 3]), quaternion_exp((u0, u1, u2))
    )
    turned = quaternion_product(turned, quaternion_exp(scale3(spin * s * h, e)))
    x[ox] = turned[0]
    store3(x, ox + 1, (turned[1], turned[2], turned[3]))
    back = (-u0, -u1, -u2)
    eta = add3(left_jacobian(back, (r0, r1, r2)), scale3(spin, e))
    bend = add3(left_jacobian_rate(back, (-r0, -r1, -r2)), scale3(spin, cross3(e, eta)))
    c = math.cos(spin * s * h)
    sine = math.sin(spin * s * h)
    store3(v, ov, turn_about(e, c, -sine, eta))
    store3(a, ov, turn_about(e, c, -sine, sub3(left_jacobian(back, (c0, c1, c2)), bend)))


@entry_kernel
def interpolate(plain, quaternions, axes, frequencies, h, s, x0, v0, a0, x1, v1, a1, x, v, a):
    """Write configuration, velocity and acceleration at s in [0, 1] of an interval of h (s).

    ``x0, v0, a0`` and ``x1, v1, a1`` stand at its ends, where the result equals them.  ``plain, quaternions, axes,
    frequencies``: ``interpolated_coordinates``.
    """
    for i in range(plain.shape[0]):
        j = plain[i, 0]
        k = plain[i, 1]
        if frequencies[k] * h > math.pi and _contradicts(h, v0[k], a0[k], x1[j] - x0[j], v1[k], a1[k]):
            x[j], v[k], a[k] = _straight(s, x0[j], x1[j]), _straight(s, v0[k], v1[k]), _straight(s, a0[k], a1[k])
        else:
            u, v[k], a[k] = _quintic(h, s, v0[k], a0[k], x1[j] - x0[j], v1[k], a1[k])
            x[j] = x0[j] + u
    for i in range(quaternions.shape[0]):
        _interpolate_turn(
            h, s, x0, v0, a0, x1, v1, a1, quaternions[i, 0], quaternions[i, 1], axes[i], x, v, a
        )
    for k in range(plain.shape[0] + 4 * quaternions.shape[0], x.shape[0]):  # what elements remember at the beginning
        x[k] = x0[k]


@entry_kernel
def interpolate_series(plain, quaternions, axes, frequencies, t, x, v, a, interval, wanted, out_x, out_v, out_a):
    """Interpolate a series t, x, v, a at times ``wanted``, each in the interval after row ``interval``.

    At the instants of the series its rows come out as they are.
    """
    for i in range(wanted.shape[0]):
        k = interval[i]
        h = t[k + 1] - t[k]
        if wanted[i] <= t[k] or wanted[i] >= t[k + 1]:
            row = k if wanted[i] <= t[k] and h > 0.0 else k + 1
            for j in range(x.shape[1]):
                out_x[i, j] = x[row, j]
            for j in range(v.shape[1]):
                out_v[i, j] = v[row, j]
                out_a[i, j] = a[row, j]
        else:
            s = (wanted[i] - t[k]) / h
            interpolate(
                plain, quaternions, axes, frequencies, h, s, x[k], v[k], a[k], x[k + 1], v[k + 1], a[k + 1],
                out_x[i], out_v[i], out_a[i],
            )  # fmt: skip


def motion_at(
    coordinates: tuple[IntArray, IntArray, FloatArray, FloatArray],
    series: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    wanted: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Configurations (k, nx), velocities and accelerations (k, nv) at times ``wanted`` (k,), s.

    Args:
        coordinates: by ``interpolated_coordinates``.
        series: t (nt,), x (nt, nx), v, a (nt, nv) of at least two rows.
        wanted: within t.
    """
    t, x, v, a = series
    n = len(wanted)
    found = np.zeros((n, x.shape[1])), np.zeros((n, v.shape[1])), np.zeros((n, v.shape[1]))
    # numpy's clip takes as long as the rest of a short series
    interval = np.minimum(np.maximum(np.searchsorted(t, wanted, side="right") - 1, 0), len(t) - 2)
    interpolate_series(*coordinates, t, x, v, a, interval, wanted, *found)
    return found
