"""Triangular patches with one tangent plane along their edges, quartic, after Gregory; the point nearest to another.

Along each edge the patch touches the plane of the edge's tangent and of a field that both triangles share (Chiyokura &
Kimura 1983; of triangles Walton & Meek 1996).  Of its control points the boundary's stand first, around and back to the
first corner, so that those of each edge are five in a row: with (u, v, w) the shares of the corners,

    x = sum over edges 0, 1, 2 of (1, 4, 6, 4)_j l^(4-j) m^j b_j + 12 sum over corners of l^2 m n (m g + n h) / (m + n)

where l, m, n are the shares of the edge's, or the corner's, first corner and of the following ones.  Of the corners'
g and h, behind the boundary, g belongs to the edge that begins there and h to the one that ends there.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, scale3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.curve import LAST_STEP, curve_foot

#: Control points of a patch: 13 of the boundary, 6 within.
BOUNDARY, WITHIN = 13, 6

#: How Newton's iteration for a point within ends: there, beyond an edge, or within but before its steps are round-off,
#: as of points far from the patch.
FOUND, LEFT, ENDED = range(3)

_BINOMIALS = (1.0, 4.0, 6.0, 4.0)
_BY_V, _BY_W = (-1.0, 1.0, 0.0), (-1.0, 0.0, 1.0)  # of the shares u, v, w
_MOST = 20  # Newton's iterations


@kernel
def _add_term(sums, f, by, i, j, point):
    """Add a point's share to the six sums: f, and its derivatives by the shares i and j, ``by`` (5,)."""
    iv, iw, jv, jw = _BY_V[i], _BY_W[i], _BY_V[j], _BY_W[j]
    fi, fj, fii, fij, fjj = by
    return (
        add3(sums[0], scale3(f, point)),
        add3(sums[1], scale3(fi * iv + fj * jv, point)),
        add3(sums[2], scale3(fi * iw + fj * jw, point)),
        add3(sums[3], scale3(fii * iv * iv + 2.0 * fij * iv * jv + fjj * jv * jv, point)),
        add3(sums[4], scale3(fii * iv * iw + fij * (iv * jw + iw * jv) + fjj * jv * jw, point)),
        add3(sums[5], scale3(fii * iw * iw + 2.0 * fij * iw * jw + fjj * jw * jw, point)),
    )


@kernel
def _power(x, n):
    """x^n, n from 0 to 4, and its two derivatives."""
    if n == 0:
        return 1.0, 0.0, 0.0
    if n == 1:
        return x, 1.0, 0.0
    below = x if n == 3 else (x * x if n == 4 else 1.0)
    return below * x * x, n * below * x, n * (n - 1.0) * below


@kernel
def _blend(m, n):
    """m^2 n / (m + n), and its derivatives by m, n, mm, mn, nn; at a corner, where none is defined, 0."""
    s = m + n
    if not s > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    a, b = m / s, n / s
    return m * m * b, m * b * (1.0 + b), m * a * a, 2.0 * b * b * b, a * a * (a + 3.0 * b), -2.0 * a * a * a


@kernel
def _add_inner(sums, m, n, j, k, order, point):
    """Add the share of a point within; m and n are the shares j and k, ``order`` whether m is the squared one."""
    if order:
        r, rm, rn, rmm, rmn, rnn = _blend(m, n)
    else:
        r, rn, rm, rnn, rmn, rmm = _blend(n, m)
    c = 1.0 - m - n
    by = (
        12.0 * c * (c * rm - 2.0 * r),
        12.0 * c * (c * rn - 2.0 * r),
        12.0 * (2.0 * r - 4.0 * c * rm + c * c * rmm),
        12.0 * (2.0 * r - 2.0 * c * (rm + rn) + c * c * rmn),
        12.0 * (2.0 * r - 4.0 * c * rn + c * c * rnn),
    )
    return _add_term(sums, 12.0 * c * c * r, by, j, k, point)


@kernel
def patch_point(data, c, v, w):
    """The point at the shares (1 - v - w, v, w), and its derivatives by v, w, vv, vw and ww: six tuples."""
    zero = (0.0, 0.0, 0.0)
    sums = (zero, zero, zero, zero, zero, zero)
    shares = (1.0 - v - w, v, w)
    for k in range(12):
        e, j = k // 4, k % 4
        i = (e + 1) % 3
        f, f1, f2 = _power(shares[e], 4 - j)
        g, g1, g2 = _power(shares[i], j)
        b = _BINOMIALS[j]
        by = (b * f1 * g, b * f * g1, b * f2 * g, b * f1 * g1, b * f * g2)
        sums = _add_term(sums, b * f * g, by, e, i, load3(data, c + 3 * k))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        o = c + 3 * BOUNDARY + 6 * k
        sums = _add_inner(sums, shares[i], shares[j], i, j, True, load3(data, o))
        sums = _add_inner(sums, shares[i], shares[j], i, j, False, load3(data, o + 3))
    return sums


@kernel
def edge_shares(edge, t):
    """v and w at t along an edge."""
    if edge == 0:
        return t, 0.0
    return (1.0 - t, t) if edge == 1 else (0.0, 1.0 - t)


@kernel
def _inner_foot(data, c, p, v, w):
    """v, w of the point within that is nearest to p, by Newton's method, and how it ended: FOUND, LEFT or ENDED."""
    for _ in range(_MOST):
        x, xv, xw, xvv, xvw, xww = patch_point(data, c, v, w)
        d = sub3(x, p)
        by_v, by_w = dot3(d, xv), dot3(d, xw)
        g, h, k = dot3(xv, xv), dot3(xv, xw), dot3(xw, xw)
        vv, vw, ww = g + dot3(d, xvv), h + dot3(d, xvw), k + dot3(d, xww)
        if not (vv > 0.0 and vv * ww > vw * vw):  # no least one near: downhill all the same
            vv, vw, ww = g, h, k
        over = 1.0 / (vv * ww - vw * vw)
        to_v, to_w = v - over * (ww * by_v - vw * by_w), w - over * (vv * by_w - vw * by_v)
        within = to_v >= 0.0 and to_w >= 0.0 and to_v + to_w <= 1.0
        to_v, to_w = max(to_v, 0.0), max(to_w, 0.0)
        if to_v + to_w > 1.0:
            share = to_v / (to_v + to_w)
            to_v, to_w = share, 1.0 - share
        step = max(abs(to_v - v), abs(to_w - w))
        v, w = to_v, to_w
        if step <= LAST_STEP:
            return v, w, FOUND if within else LEFT
    return v, w, ENDED if v > 0.0 and w > 0.0 and v + w < 1.0 else LEFT


@kernel
def patch_foot(data, c, p, v, w):
    """The nearest point, sought from (v, w): v, w, and its part, 0 the inside, 1 to 3 an edge, 4 to 6 a corner."""
    v, w, how = _inner_foot(data, c, p, v, w)
    if how == FOUND:
        return v, w, 0
    part, at, least = 0, 0.0, math.inf
    if how == ENDED:
        d = sub3(patch_point(data, c, v, w)[0], p)
        least = dot3(d, d)
    for edge in range(3):
        o = c + 12 * edge
        t = curve_foot(data, o, p)
        a, b = edge_shares(edge, t)
        d = sub3(patch_point(data, c, a, b)[0], p)
        square = dot3(d, d)
        if square < least:
            part, at, least = edge + 1, t, square
    if part == 0:
        return v, w, 0
    v, w = edge_shares(part - 1, at)
    if at == 0.0:
        part = part + 3
    elif at == 1.0:
        part = 4 + part % 3
    return v, w, part


@kernel
def unit_normal(xv, xw):
    """Out of a patch with these derivatives."""
    n = cross3(xv, xw)
    return scale3(1.0 / math.sqrt(dot3(n, n)), n)


@kernel
def normal_variation(data, c, v, w, far, dp):
    """Change of the unit normal at the foot of p, ``far`` (m, signed) away along it, for p + dp (Weingarten)."""
    _, xv, xw, xvv, xvw, xww = patch_point(data, c, v, w)
    n = unit_normal(xv, xw)
    g, h, k = dot3(xv, xv), dot3(xv, xw), dot3(xw, xw)
    a, b, d = dot3(n, xvv), dot3(n, xvw), dot3(n, xww)
    vv, vw, ww = g - far * a, h - far * b, k - far * d
    det = vv * ww - vw * vw
    if not det > 0.0:
        return (0.0, 0.0, 0.0)
    by_v, by_w = dot3(xv, dp), dot3(xw, dp)
    dv, dw = (ww * by_v - vw * by_w) / det, (vv * by_w - vw * by_v) / det
    one, other = a * dv + b * dw, b * dv + d * dw  # of the second fundamental form
    area = g * k - h * h
    return scale3(-1.0 / area, add3(scale3(k * one - h * other, xv), scale3(g * other - h * one, xw)))
