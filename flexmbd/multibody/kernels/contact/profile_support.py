"""The point of a planar profile that is farthest along a direction: where a flat follower touches a cam.

The table is that of ``planar_profile``.  Farthest is a point of the profile's convex hull: hollows are never reached.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, TUPLE3, deferred_kernel
from flexmbd.multibody.kernels.contact.box_tree import NODE, item_of
from flexmbd.multibody.kernels.contact.curve import curve_point
from flexmbd.multibody.kernels.contact.planar_profile import ARC, LINE, OWN


@kernel
def _box_reach(data, n, u):
    """How far the box of the node at n reaches along u (m)."""
    x = data[n + 3] if u[0] > 0.0 else data[n]
    y = data[n + 4] if u[1] > 0.0 else data[n + 1]
    return x * u[0] + y * u[1]


@kernel
def _farther(ax, ay, bx, by, u):
    """The one of two places that is farther along u."""
    return (ax, ay) if ax * u[0] + ay * u[1] >= bx * u[0] + by * u[1] else (bx, by)


@kernel
def _arc_support(data, o, u):
    cx, cy, radius, middle, half, turn = data[o], data[o + 1], data[o + 2], data[o + 3], data[o + 4], data[o + 5]
    if turn > 0.0:
        angle = math.atan2(u[1], u[0]) - middle
        angle -= 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)
        if abs(angle) < half:
            return cx + radius * u[0], cy + radius * u[1], radius
    x, y = _farther(data[o + 6], data[o + 7], data[o + 8], data[o + 9], u)
    return x, y, 0.0


@kernel
def _along(data, o, i, j, u):
    return (data[o + 3 * j] - data[o + 3 * i]) * u[0] + (data[o + 3 * j + 1] - data[o + 3 * i + 1]) * u[1]


@kernel
def _curve_support(data, o, u):
    """Of a cubic, whose control points are told as a quartic's: where its tangent is across u, or an end of it."""
    x, y = _farther(data[o], data[o + 1], data[o + 12], data[o + 13], u)
    reach, radius = x * u[0] + y * u[1], 0.0
    # the derivative along u is a quadratic with Bezier's coefficients first, middle, last
    first, last = _along(data, o, 0, 1, u), _along(data, o, 3, 4, u)
    middle = 0.75 * _along(data, o, 0, 4, u) - first - last
    a, b = first - 2.0 * middle + last, middle - first
    inside = b * b - a * first
    if not inside >= 0.0:
        return x, y, radius
    q = -(b + math.copysign(math.sqrt(inside), b))
    for k in range(2):
        if k == 0:
            t = q / a if a != 0.0 else -1.0
        else:
            t = first / q if q != 0.0 else -1.0
        if 0.0 < t < 1.0:
            point, rate, second = curve_point(data, o, t)
            far = point[0] * u[0] + point[1] * u[1]
            turn = rate[0] * second[1] - rate[1] * second[0]
            if far > reach and turn > 0.0:
                speed = math.sqrt(rate[0] * rate[0] + rate[1] * rate[1])
                x, y, reach, radius = point[0], point[1], far, speed * speed * speed / turn
    return x, y, radius


@kernel
def _piece_support(data, o, u):
    """Of the piece at o the farthest place, and there the radius of curvature (m), 0 at an end."""
    kind = data[o]
    if kind == LINE:
        ax, ay, length = data[o + OWN], data[o + OWN + 1], data[o + OWN + 4]
        x, y = _farther(ax, ay, ax + length * data[o + OWN + 2], ay + length * data[o + OWN + 3], u)
        return x, y, 0.0
    if kind == ARC:
        return _arc_support(data, o + OWN, u)
    return _curve_support(data, o + OWN, u)


@kernel
def _likely_leaf(data, table, u):
    """The leaf that is reached by always entering the box of two that reaches farther."""
    node, nodes = 0, table + 1
    while data[nodes + NODE * node + 7] < 0.0:
        left = node + 1
        right = int(data[nodes + NODE * left + 6])
        farther = _box_reach(data, nodes + NODE * left, u) >= _box_reach(data, nodes + NODE * right, u)
        node = left if farther else right
    return node


@deferred_kernel((TUPLE3, NUMBER))
def profile_support(data, table, u):
    """The point (m) of the profile at ``table`` that is farthest along the unit vector u, and its radius of curvature.

    That is 0 at a corner.  Of a straight side across u it is one of both ends.
    """
    node, nodes, count = _likely_leaf(data, table, u), table + 1, int(data[table])
    x, y, radius = _piece_support(data, item_of(data, table, node), u)
    reach = x * u[0] + y * u[1]
    node = 0
    while node < count:
        n = nodes + NODE * node
        if _box_reach(data, n, u) <= reach:
            node = int(data[n + 6])
            continue
        if data[n + 7] >= 0.0:
            ax, ay, bend = _piece_support(data, item_of(data, table, node), u)
            if ax * u[0] + ay * u[1] > reach:
                x, y, radius = ax, ay, bend
                reach = x * u[0] + y * u[1]
        node += 1
    return (x, y, 0.0), radius
