"""The kinds of constraint rows: value, wrench, and the wrench's variation.

A row is a scalar constraint on the motion of frame G against frame F, seen in F's axes: d = p_FG_F
(m), R = R_FG.  ``row_wrench`` is what a unit multiplier does to G: a force at G's origin and a
torque, so that the row's rate is force . rate + torque . spin, with the rate of d and the angular
velocity ``spin`` of G against F.  ``row_wrench_variation`` is its change for d + dd and
exp(dtheta) R.  Velocity and acceleration level, reactions, Jacobians and geometric stiffness follow
from these three for every kind alike.

Rows of kind ``ROW_COUPLING`` join no frames and are not for these functions.  Translation and
rotation constraints: Zienkiewicz, Taylor & Fox, section 8.5.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    rotate_back,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

_ZERO = (0.0, 0.0, 0.0)


@kernel
def column(m, k):
    """Column k of a 3 x 3 matrix."""
    if k == 0:
        return (m[0], m[3], m[6])
    if k == 1:
        return (m[1], m[4], m[7])
    return (m[2], m[5], m[8])


@kernel
def unit(k):
    """Unit vector along axis k."""
    if k == 0:
        return (1.0, 0.0, 0.0)
    if k == 1:
        return (0.0, 1.0, 0.0)
    return (0.0, 0.0, 1.0)


@kernel
def skew_axis(m):
    """Vector of the skew part of m: sin(angle) axis for a rotation."""
    return (0.5 * (m[7] - m[5]), 0.5 * (m[2] - m[6]), 0.5 * (m[3] - m[1]))


@kernel
def _axis_torque(R, e):
    """Gradient of e . skew_axis(R): (trace(R) e - R^T e) / 2."""
    return scale3(0.5, sub3(scale3(R[0] + R[4] + R[8], e), rotate_back(R, e)))


@kernel
def _axis_torque_variation(R, e, dtheta):
    """Change of the gradient for exp(dtheta) R."""
    dtrace = -2.0 * dot3(dtheta, skew_axis(R))
    return scale3(0.5, add3(scale3(dtrace, e), rotate_back(R, cross3(dtheta, e))))


@kernel
def twist(R):
    """Angle (rad) of the turn about z in R, between -pi and pi.

    R is a turn by the angle about z followed by one about an axis across z; for a turn about z
    it is its angle.
    """
    return math.atan2(R[3] - R[1], R[0] + R[4])


@kernel
def _twist_parts(R):
    """(s, c) = r (sin, cos) of the twist, and their gradients."""
    s = R[3] - R[1]
    c = R[0] + R[4]
    ds = scale3(2.0, _axis_torque(R, (0.0, 0.0, 1.0)))
    dc = add3(cross3(column(R, 0), (1.0, 0.0, 0.0)), cross3(column(R, 1), (0.0, 1.0, 0.0)))
    return s, c, ds, dc


@kernel
def twist_torque(R):
    """Gradient of ``twist``: the torque that does work on it alone."""
    s, c, ds, dc = _twist_parts(R)
    return scale3(1.0 / (s * s + c * c), sub3(scale3(c, ds), scale3(s, dc)))


@kernel
def twist_torque_variation(R, dtheta):
    """Change of ``twist_torque`` for exp(dtheta) R."""
    s, c, ds, dc = _twist_parts(R)
    s_change = dot3(ds, dtheta)
    c_change = dot3(dc, dtheta)
    ds_change = scale3(2.0, _axis_torque_variation(R, (0.0, 0.0, 1.0), dtheta))
    dc_change = add3(
        cross3(cross3(dtheta, column(R, 0)), (1.0, 0.0, 0.0)),
        cross3(cross3(dtheta, column(R, 1)), (0.0, 1.0, 0.0)),
    )
    size = s * s + c * c
    size_change = 2.0 * (s * s_change + c * c_change)
    top = sub3(scale3(c, ds), scale3(s, dc))
    top_change = sub3(
        add3(scale3(c_change, ds), scale3(c, ds_change)),
        add3(scale3(s_change, dc), scale3(s, dc_change)),
    )
    return scale3(1.0 / size, sub3(top_change, scale3(size_change / size, top)))


@kernel
def wrap(angle):
    """The angle (rad) without whole turns, between -pi and pi."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def _rise(n):
    """Unit vector across n that rises most along z, its slope; n a unit vector off z."""
    slope = math.sqrt(max(1.0 - n[2] * n[2], 1e-300))
    u = scale3(1.0 / slope, sub3((0.0, 0.0, 1.0), scale3(n[2], n)))
    return u, slope


@kernel
def _rise_variation(n, dn):
    """Change of the unit vector of ``_rise`` as n changes by dn."""
    u, slope = _rise(n)
    change = scale3(-1.0, add3(scale3(n[2], dn), scale3(dn[2], n)))
    return scale3(1.0 / slope, add3(change, scale3(n[2] * dn[2] / slope, u)))


@entry_kernel
def row_value(data, row, d, R):
    """Value (m or rad) of a row that holds positions; 0 for one that holds velocities alone.

    Args:
        data: (k,) float64, Plan.data.
        row: (N_ROW,) int64, row of Plan.rows.
        d: three float64, m, p_FG_F.
        R: nine float64, R_FG by rows.
    """
    kind = row[at.ROW_KIND]
    k = row[at.ROW_INDEX]
    value = 0.0
    if kind == kinds.ROW_TRANSLATION:
        value = dot3(unit(k), d)
    elif kind == kinds.ROW_DIRECTION:
        value = dot3(unit(k // 3), column(R, k % 3))
    elif kind == kinds.ROW_AXIS:
        value = dot3(unit(k), skew_axis(R))
    elif kind == kinds.ROW_ANGLE:
        value = twist(R)
    elif kind == kinds.ROW_SCREW:
        pitch = data[row[at.ROW_DATA]]
        value = -pitch * wrap(twist(R) - d[2] / pitch)
    elif kind == kinds.ROW_DISTANCE:
        length = data[row[at.ROW_DATA]]
        value = 0.5 * (dot3(d, d) / length - length)
    elif kind == kinds.ROW_TOUCH:
        _, slope = _rise(column(R, 2))
        value = d[2] - data[row[at.ROW_DATA]] * slope
    return value


@entry_kernel
def row_wrench(data, row, d, R):
    """(force on G at G's origin, torque on G) of a unit multiplier, in F's axes.

    Args:
        data: (k,) float64, Plan.data.
        row: (N_ROW,) int64, row of Plan.rows.
        d: three float64, m, p_FG_F.
        R: nine float64, R_FG by rows.
    """
    kind = row[at.ROW_KIND]
    k = row[at.ROW_INDEX]
    force = _ZERO
    torque = _ZERO
    if kind == kinds.ROW_TRANSLATION:
        force = unit(k)
    elif kind == kinds.ROW_DIRECTION:
        torque = cross3(column(R, k % 3), unit(k // 3))
    elif kind == kinds.ROW_AXIS:
        torque = _axis_torque(R, unit(k))
    elif kind == kinds.ROW_ANGLE:
        torque = twist_torque(R)
    elif kind == kinds.ROW_SCREW:
        force = (0.0, 0.0, 1.0)
        torque = scale3(-data[row[at.ROW_DATA]], twist_torque(R))
    elif kind == kinds.ROW_DISTANCE:
        force = scale3(1.0 / data[row[at.ROW_DATA]], d)
    elif kind == kinds.ROW_TOUCH:
        # the arm from the centre to the touching point, times the force along z there
        u, _ = _rise(column(R, 2))
        force = (0.0, 0.0, 1.0)
        torque = cross3(scale3(-data[row[at.ROW_DATA]], u), force)
    elif kind == kinds.ROW_ROLL:
        u, _ = _rise(column(R, 2))
        force = unit(k)
        torque = cross3(scale3(-data[row[at.ROW_DATA]], u), force)
    return force, torque


@entry_kernel
def row_wrench_variation(data, row, d, R, dd, dtheta):
    """Change of ``row_wrench`` as d moves by dd (m) and R turns by dtheta (rad, F's axes).

    Args:
        data: (k,) float64, Plan.data.
        row: (N_ROW,) int64, row of Plan.rows.
        d: three float64, m, p_FG_F.
        R: nine float64, R_FG by rows.
        dd: three float64, m, change of d.
        dtheta: three float64, rad, rotation of R, in F's axes.
    """
    kind = row[at.ROW_KIND]
    k = row[at.ROW_INDEX]
    force = _ZERO
    torque = _ZERO
    if kind == kinds.ROW_DIRECTION:
        torque = cross3(cross3(dtheta, column(R, k % 3)), unit(k // 3))
    elif kind == kinds.ROW_AXIS:
        torque = _axis_torque_variation(R, unit(k), dtheta)
    elif kind == kinds.ROW_ANGLE:
        torque = twist_torque_variation(R, dtheta)
    elif kind == kinds.ROW_SCREW:
        torque = scale3(-data[row[at.ROW_DATA]], twist_torque_variation(R, dtheta))
    elif kind == kinds.ROW_DISTANCE:
        force = scale3(1.0 / data[row[at.ROW_DATA]], dd)
    elif kind == kinds.ROW_TOUCH or kind == kinds.ROW_ROLL:
        n = column(R, 2)
        du = _rise_variation(n, cross3(dtheta, n))
        e = (0.0, 0.0, 1.0) if kind == kinds.ROW_TOUCH else unit(k)
        torque = cross3(scale3(-data[row[at.ROW_DATA]], du), e)
    return force, torque
