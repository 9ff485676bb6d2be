"""The signed distance of a point from a closed planar curve that is extruded along z, piece by piece.

The curve runs anticlockwise, so its outward normal is to the right of its tangent.  A piece: its kind; a normal at its
start and one at its end (2, 2), each the sum of the two pieces' unit normals that meet there; then

    LINE   start (2), unit tangent (2), length
    ARC    centre (2), radius, angle of its middle, half the angle that it sweeps, 1 anticlockwise or -1,
           start (2), end (2)
    CURVE  five control points (3) of a quartic Bezier curve (``curve``), z = 0

in m and rad.  What is nearest to a corner is signed by the normal there (Baerentzen & Aanaes 2005).
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, TUPLE3, deferred_kernel
from flexmbd.multibody.kernels.contact.box_tree import first_leaf, item_of, next_leaf
from flexmbd.multibody.kernels.contact.curve import curve_foot, curve_point

#: Kinds of pieces, and where their own numbers begin.
LINE, ARC, CURVE = range(3)
OWN = 5

_WITHIN, _AT_START, _AT_END = 0, 1, 2


@kernel
def _line_foot(data, o, x, y):
    ax, ay, tx, ty, length = data[o], data[o + 1], data[o + 2], data[o + 3], data[o + 4]
    along = (x - ax) * tx + (y - ay) * ty
    side = _AT_START if along <= 0.0 else (_AT_END if along >= length else _WITHIN)
    along = min(max(along, 0.0), length)
    return side, ax + along * tx, ay + along * ty, ty, -tx, 0.0


@kernel
def _arc_foot(data, o, x, y):
    cx, cy, radius, middle, half, turn = data[o], data[o + 1], data[o + 2], data[o + 3], data[o + 4], data[o + 5]
    dx, dy = x - cx, y - cy
    far = math.sqrt(dx * dx + dy * dy)
    angle = math.atan2(dy, dx) - middle if far > 0.0 else 0.0  # from its centre all are as near
    angle -= 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)
    if abs(angle) >= half:
        at_start = angle * turn < 0.0
        e = o + 6 if at_start else o + 8
        return (_AT_START if at_start else _AT_END), data[e], data[e + 1], 0.0, 0.0, 0.0
    ex, ey = (dx / far, dy / far) if far > 0.0 else (math.cos(middle), math.sin(middle))
    return _WITHIN, cx + radius * ex, cy + radius * ey, turn * ex, turn * ey, turn / radius


@kernel
def _curve_foot(data, o, x, y):
    t = curve_foot(data, o, (x, y, 0.0))
    point, first, second = curve_point(data, o, t)
    speed = math.sqrt(first[0] * first[0] + first[1] * first[1])
    bend = (first[0] * second[1] - first[1] * second[0]) / (speed * speed * speed)
    side = _AT_START if t == 0.0 else (_AT_END if t == 1.0 else _WITHIN)
    return side, point[0], point[1], first[1] / speed, -first[0] / speed, bend


@kernel
def _piece_foot(data, o, x, y):
    """Of the piece at o the nearest point: which end it is, its place, and within it normal and curvature (1/m)."""
    kind = data[o]
    if kind == LINE:
        return _line_foot(data, o + OWN, x, y)
    if kind == ARC:
        return _arc_foot(data, o + OWN, x, y)
    return _curve_foot(data, o + OWN, x, y)


@kernel
def _nearest(data, table, p):
    """The same of the whole curve, and the piece; within a piece the signed distance, at an end its size."""
    flat = (p[0], p[1], 0.0)
    node, least = first_leaf(data, table, flat), math.inf
    piece, found = 0, (0, 0.0, 0.0, 0.0, 0.0, 0.0)
    begun = False
    while node >= 0:
        o = item_of(data, table, node)
        foot = _piece_foot(data, o, p[0], p[1])
        square = (p[0] - foot[1]) ** 2 + (p[1] - foot[2]) ** 2
        if square < least:
            least, piece, found = square, o, foot
        node = next_leaf(data, table, node + 1 if begun else 0, flat, least)
        begun = True
    return piece, found


@kernel
def _distance(data, piece, found, p):
    """Signed distance and gradient."""
    side, x, y, nx, ny, _ = found
    dx, dy = p[0] - x, p[1] - y
    if side == _WITHIN:
        return dx * nx + dy * ny, (nx, ny, 0.0)
    n = piece + 1 if side == _AT_START else piece + 3
    nx, ny = data[n], data[n + 1]
    far = math.sqrt(dx * dx + dy * dy)
    if far == 0.0:
        size = math.sqrt(nx * nx + ny * ny)
        return 0.0, (nx / size, ny / size, 0.0)
    far = math.copysign(far, dx * nx + dy * ny)
    return far, (dx / far, dy / far, 0.0)


@deferred_kernel((NUMBER, TUPLE3))
def profile_distance(data, table, p):
    """Signed distance (m) of p from the profile whose table begins at ``table``, and its gradient."""
    piece, found = _nearest(data, table, p)
    return _distance(data, piece, found, p)


@deferred_kernel(TUPLE3)
def profile_variation(data, table, p, dp):
    """How much the gradient at p changes for p + dp."""
    piece, found = _nearest(data, table, p)
    far, n = _distance(data, piece, found, p)
    along = n[0] * dp[1] - n[1] * dp[0]
    size = 1.0 + found[5] * far if found[0] == _WITHIN else far
    bend = (found[5] if found[0] == _WITHIN else 1.0) / size if size != 0.0 else 0.0  # 0: at the centre of curvature
    return (-n[1] * bend * along, n[0] * bend * along, 0.0)
