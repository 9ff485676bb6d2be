"""The signed distance of a point from a surface of triangles, flat ones and curved patches, by a tree of boxes.

A triangle: its kind; its first corner (3), and from there the two others (2, 3), so that far from the origin no digits
are lost between near places; its unit normal (3); of its three edges and of its three corners the
normal by which what is nearest to them is signed (3, 3 each; Baerentzen & Aanaes 2005: of an edge the sum of the two
triangles', of a corner that of all, weighed by their angles), or zeros where the surface is smooth there.  Of a patch
follow how far it is from the flat triangle at most, and its control points, from the first corner too
(``gregory_patch``).  All in m.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, scale3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, TUPLE3, deferred_kernel
from flexmbd.multibody.kernels.contact.box_tree import first_leaf, item_of, next_leaf
from flexmbd.multibody.kernels.contact.curve import curve_point
from flexmbd.multibody.kernels.contact.gregory_patch import (
    normal_variation,
    patch_foot,
    patch_point,
    unit_normal,
)
from flexmbd.round_off import ROUND_OFF

#: Kinds of triangles.
FLAT, PATCH = range(2)

#: Places in a triangle's numbers.
CORNERS, NORMAL, EDGE_NORMALS, CORNER_NORMALS, BULGE, CONTROL = 1, 10, 13, 22, 31, 32


@kernel
def _corner(data, o, k):
    """Corner k of the triangle, from its first one."""
    return load3(data, o + CORNERS + 3 * k) if k > 0 else (0.0, 0.0, 0.0)


@kernel
def _flat_foot(data, o, q):
    """v, w of the flat triangle's point nearest to q, which is seen from its first corner, and its part.

    0, edges 1 to 3, corners 4 to 6 (Ericson 2005).
    """
    b, c = _corner(data, o, 1), _corner(data, o, 2)
    d1, d2 = dot3(b, q), dot3(c, q)
    if d1 <= 0.0 and d2 <= 0.0:
        return 0.0, 0.0, 4
    g, h, k = dot3(b, b), dot3(b, c), dot3(c, c)
    d3, d4 = d1 - g, d2 - h
    if d3 >= 0.0 and d4 <= d3:
        return 1.0, 0.0, 5
    d5, d6 = d1 - h, d2 - k
    if d6 >= 0.0 and d5 <= d6:
        return 0.0, 1.0, 6
    vc = d1 * d4 - d3 * d2
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        return d1 / (d1 - d3), 0.0, 1
    vb = d5 * d2 - d1 * d6
    if vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        return 0.0, d2 / (d2 - d6), 3
    va = d3 * d6 - d5 * d4
    if va <= 0.0 and d4 - d3 >= 0.0 and d5 - d6 >= 0.0:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return 1.0 - w, w, 2
    over = 1.0 / (va + vb + vc)
    return vb * over, vc * over, 0


@kernel
def _flat_point(data, o, v, w):
    return add3(scale3(v, _corner(data, o, 1)), scale3(w, _corner(data, o, 2)))


@kernel
def _nearest(data, table, p):
    """The triangle, v, w and part of the nearest point, and the way from there to p."""
    node, least = first_leaf(data, table, p), math.inf
    triangle, v, w, part, way = 0, 0.0, 0.0, 0, p  # no number where p is none
    begun = False
    while node >= 0:
        o = item_of(data, table, node)
        q = sub3(p, load3(data, o + CORNERS))
        a, b, k = _flat_foot(data, o, q)
        d = sub3(q, _flat_point(data, o, a, b))
        square = dot3(d, d)
        if data[o] == PATCH:
            if max(math.sqrt(square) - data[o + BULGE], 0.0) ** 2 < least:
                a, b, k = patch_foot(data, o + CONTROL, q, a, b)
                d = sub3(q, patch_point(data, o + CONTROL, a, b)[0])
                square = dot3(d, d)
            else:
                square = math.inf
        if square < least:
            least, triangle, v, w, part, way = square, o, a, b, k, d
        node = next_leaf(data, table, node + 1 if begun else 0, p, least)
        begun = True
    return triangle, v, w, part, way


@kernel
def _sharp_normal(data, o, part):
    """What signs the distance from an edge or a corner, and whether the surface is sharp there."""
    if part == 0:
        return (0.0, 0.0, 0.0), False
    n = load3(data, o + EDGE_NORMALS + 3 * (part - 1))
    return n, dot3(n, n) > 0.0


@kernel
def _distance(data, found, p):
    """Signed distance, gradient, and whether the nearest point is on a sharp edge or corner."""
    o, v, w, part, q = found
    m, sharp = _sharp_normal(data, o, part)
    if not sharp:
        n = load3(data, o + NORMAL)
        if data[o] == PATCH:
            _, xv, xw, _, _, _ = patch_point(data, o + CONTROL, v, w)
            n = unit_normal(xv, xw)
        return dot3(q, n), n, False
    far = math.sqrt(dot3(q, q))
    if far <= ROUND_OFF * math.sqrt(dot3(p, p)):
        return 0.0, scale3(1.0 / math.sqrt(dot3(m, m)), m), False
    far = math.copysign(far, dot3(q, m))
    return far, scale3(1.0 / far, q), True


@deferred_kernel((NUMBER, TUPLE3))
def surface_distance(data, table, p):
    """Signed distance (m) of p from the surface whose table begins at ``table``, and its gradient."""
    far, n, _ = _distance(data, _nearest(data, table, p), p)
    return far, n


@deferred_kernel(TUPLE3)
def surface_variation(data, table, p, dp):
    """How much the gradient at p changes for p + dp."""
    found = _nearest(data, table, p)
    far, n, sharp = _distance(data, found, p)
    o, v, w, part, way = found
    curved = data[o] == PATCH
    if not sharp:
        return normal_variation(data, o + CONTROL, v, w, far, dp) if curved else (0.0, 0.0, 0.0)
    moved = dp
    if part <= 3:  # the nearest point moves along the edge
        if curved:
            edge = part - 1
            t = v if edge == 0 else (w if edge == 1 else 1.0 - w)
            _, along, bend = curve_point(data, o + CONTROL + 12 * edge, t)
            size = dot3(along, along) - dot3(way, bend)
        else:
            along = sub3(_corner(data, o, part % 3), _corner(data, o, part - 1))
            size = dot3(along, along)
        if size > 0.0:
            moved = sub3(dp, scale3(dot3(along, dp) / size, along))
    return scale3(1.0 / far, sub3(moved, scale3(dot3(n, moved), n)))
