"""The axis that separates two convex cores most, or along which they overlap least, and their nearest edges.

All vectors are in a's axes and from its centre; normals point from b to a.  Of polytopes that overlap, or that are
nearest by a vertex and a face or by two edges, the separation along the best axis is their signed distance; otherwise
it is less, and ``nearest_edges`` finds it.  Pairs of edges: Gregorius, "The separating axis test between convex
polyhedra" (GDC 2013): two edges make a face of the Minkowski difference where their arcs on the sphere of normals
cross.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, rotate, rotate_back, scale3, store3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.finding.shape_table import (
    EDGES,
    FACES,
    FIRST_EDGE,
    FIRST_FACE,
    FIRST_VERTEX,
    VERTEX_OF_A,
    VERTEX_OF_B,
    VERTICES,
)
from flexmbd.round_off import EPSILON

_ZERO = (0.0, 0.0, 0.0)
_PARALLEL = EPSILON  # of the squared sine between two edges: fewer than half of their normal's digits are right


@kernel
def lay_core(cores, core, scale, turn, offset, out):
    """Write the vertices of a core that is scaled, turned and moved into ``out``."""
    first = cores.head[core, FIRST_VERTEX]
    for k in range(cores.head[core, VERTICES]):
        v = load3(cores.vertices[first + k], 0)
        store3(out[k], 0, add3(offset, rotate(turn, (scale[0] * v[0], scale[1] * v[1], scale[2] * v[2]))))


@kernel
def _side(d, half, other):
    """Separation along an axis on which the centres are d apart, and the sign of the normal."""
    return abs(d) - half - other, 1.0 if d < 0.0 else -1.0


@kernel
def box_axis(p, q, R, d):
    """Separation and normal of two boxes of half sides p and q; R and d: b's axes and centre."""
    best, normal = -math.inf, _ZERO
    for i in range(3):
        other = q[0] * abs(R[3 * i]) + q[1] * abs(R[3 * i + 1]) + q[2] * abs(R[3 * i + 2])
        s, sign = _side(d[i], p[i], other)
        if s > best:
            best = s
            normal = (sign if i == 0 else 0.0, sign if i == 1 else 0.0, sign if i == 2 else 0.0)
    for j in range(3):
        axis = (R[j], R[3 + j], R[6 + j])
        other = p[0] * abs(axis[0]) + p[1] * abs(axis[1]) + p[2] * abs(axis[2])
        s, sign = _side(dot3(d, axis), q[j], other)
        if s > best:
            best, normal = s, scale3(sign, axis)
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            u, w = R[3 * i1 + j], R[3 * i2 + j]  # the edge of b, across the edge of a
            squared = u * u + w * w
            if squared < _PARALLEL:
                continue
            scale = 1.0 / math.sqrt(squared)
            half = p[i1] * abs(w) + p[i2] * abs(u)
            other = q[j1] * abs(R[3 * i + j2]) + q[j2] * abs(R[3 * i + j1])
            s, sign = _side(scale * (d[i2] * u - d[i1] * w), scale * half, scale * other)
            if s > best:
                best = s
                first, second = -sign * scale * w, sign * scale * u
                normal = (
                    0.0 if i == 0 else (second if i == 1 else first),
                    0.0 if i == 1 else (second if i == 2 else first),
                    0.0 if i == 2 else (second if i == 0 else first),
                )
    return best, normal


@kernel
def _lowest(vertices, count, n):
    """The least component along n."""
    found = math.inf
    for k in range(count):
        found = min(found, dot3(n, load3(vertices[k], 0)))
    return found


@kernel
def _faces_axis(cores, core, vertices, turn, others, count, sign, best, normal):
    """The best of the axes along the faces of one core."""
    head = cores.head[core]
    for f in range(head[FIRST_FACE], head[FIRST_FACE] + head[FACES]):
        n = rotate(turn, load3(cores.normals[f], 0))
        s = _lowest(others, count, n) - dot3(n, load3(vertices[cores.corners[cores.face_at[f]]], 0))
        if s > best:
            best, normal = s, scale3(sign, n)
    return best, normal


@kernel
def _edge_normals(cores, head, edge, turn):
    """The normals of an edge's two faces; zeros of a segment."""
    f, g = cores.edges[edge, 2], cores.edges[edge, 3]
    if f < 0:
        return _ZERO, _ZERO
    first = head[FIRST_FACE]
    return rotate(turn, load3(cores.normals[first + f], 0)), rotate(turn, load3(cores.normals[first + g], 0))


@kernel
def _edge(cores, edge, vertices):
    """Where an edge begins, and the vector along it."""
    begin = load3(vertices[cores.edges[edge, 0]], 0)
    return begin, sub3(load3(vertices[cores.edges[edge, 1]], 0), begin)


@kernel
def core_axis(cores, core_a, core_b, va, vb, R, limit):
    """Separation, normal, and the edges (-1: none) of two cores; any axis where it exceeds ``limit``."""
    head_a, head_b = cores.head[core_a], cores.head[core_b]
    own = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    best, normal, edge_a, edge_b = -math.inf, _ZERO, -1, -1
    best, normal = _faces_axis(cores, core_a, va, own, vb, head_b[VERTICES], -1.0, best, normal)
    if best > limit:
        return best, normal, edge_a, edge_b
    best, normal = _faces_axis(cores, core_b, vb, R, va, head_a[VERTICES], 1.0, best, normal)
    for i in range(head_a[EDGES]):
        if best > limit:
            break
        pa, ea = _edge(cores, head_a[FIRST_EDGE] + i, va)
        a1, a2 = _edge_normals(cores, head_a, head_a[FIRST_EDGE] + i, own)
        outside_a = add3(a1, a2)
        there = rotate_back(R, ea)
        for j in range(head_b[EDGES]):
            f, g = cores.edges[head_b[FIRST_EDGE] + j, 2], cores.edges[head_b[FIRST_EDGE] + j, 3]
            if f >= 0:
                first = head_b[FIRST_FACE]
                one = dot3(there, load3(cores.normals[first + f], 0))
                if one * dot3(there, load3(cores.normals[first + g], 0)) >= 0.0:
                    continue
            pb, eb = _edge(cores, head_b[FIRST_EDGE] + j, vb)
            if head_a[FACES] > 0 and dot3(eb, a1) * dot3(eb, a2) >= 0.0:
                continue
            n = cross3(ea, eb)
            squared = dot3(n, n)
            if squared <= _PARALLEL * dot3(ea, ea) * dot3(eb, eb):
                continue
            b1, b2 = _edge_normals(cores, head_b, head_b[FIRST_EDGE] + j, R)
            by_a, by_b = -dot3(n, outside_a), dot3(n, add3(b1, b2))
            if head_a[FACES] > 0 and head_b[FACES] > 0 and by_a * by_b <= 0.0:
                continue
            n = scale3((1.0 if by_a + by_b > 0.0 else -1.0) / math.sqrt(squared), n)
            s = dot3(n, sub3(pa, pb))
            if s > best:
                best, normal, edge_a, edge_b = s, n, i, j
    return best, normal, edge_a, edge_b


@kernel
def edges_meet(cores, core_a, core_b, va, vb, edge_a, edge_b):
    """Where two edges are nearest, on each, and whether both are within their ends."""
    p, u = _edge(cores, cores.head[core_a, FIRST_EDGE] + edge_a, va)
    q, w = _edge(cores, cores.head[core_b, FIRST_EDGE] + edge_b, vb)
    r = sub3(p, q)
    uu, uw, ww = dot3(u, u), dot3(u, w), dot3(w, w)
    over = uu * ww - uw * uw
    if over <= _PARALLEL * uu * ww:
        return p, q, False
    t = (uw * dot3(w, r) - ww * dot3(u, r)) / over
    k = (uu * dot3(w, r) - uw * dot3(u, r)) / over
    within = t >= 0.0 and t <= 1.0 and k >= 0.0 and k <= 1.0
    return add3(p, scale3(t, u)), add3(q, scale3(k, w)), within


@kernel
def _nearest_on_edges(cores, core, vertices, points, count):
    """Of some points and the edges of a core, the nearest: squared distance, the point, its place on the edge."""
    best, which, place = math.inf, -1, _ZERO
    head = cores.head[core]
    for j in range(head[FIRST_EDGE], head[FIRST_EDGE] + head[EDGES]):
        p, u = _edge(cores, j, vertices)
        scale = 1.0 / dot3(u, u)
        for k in range(count):
            r = sub3(load3(points[k], 0), p)
            t = min(max(scale * dot3(r, u), 0.0), 1.0)
            off = sub3(r, scale3(t, u))
            squared = dot3(off, off)
            if squared < best:
                best, which, place = squared, k, add3(p, scale3(t, u))
    return best, which, place


@kernel
def nearest_edges(cores, core_a, core_b, va, vb):
    """The nearest vertex of one and edge of the other: distance, places on a and b, kind and number of the vertex."""
    far_a, i, place_b = _nearest_on_edges(cores, core_b, vb, va, cores.head[core_a, VERTICES])
    far_b, j, place_a = _nearest_on_edges(cores, core_a, va, vb, cores.head[core_b, VERTICES])
    if far_a <= far_b:
        return math.sqrt(far_a), load3(va[i], 0), place_b, VERTEX_OF_A, i
    return math.sqrt(far_b), place_a, load3(vb[j], 0), VERTEX_OF_B, j
