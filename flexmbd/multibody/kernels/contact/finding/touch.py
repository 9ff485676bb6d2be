"""The points of a pair of shapes, by what the two are."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    cross3,
    dot3,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.finding.candidates import add_point, between, feature, keep_points
from flexmbd.multibody.kernels.contact.finding.overlap import SAME, overlap
from flexmbd.multibody.kernels.contact.finding.separating_axes import (
    box_axis,
    core_axis,
    edges_meet,
    lay_core,
    nearest_edges,
)
from flexmbd.multibody.kernels.contact.finding.shape_table import (
    CUBE,
    FIRST_VERTEX,
    POINT,
    POLYTOPE,
    SEGMENT,
    TWO_EDGES,
    VERTEX_OF_A,
    VERTEX_OF_B,
    VERTICES,
)
from flexmbd.multibody.kernels.contact.signed_distance import CYLINDER, distance
from flexmbd.round_off import EQUAL, SAME_PLACE

_UP = (0.0, 0.0, 1.0)


@kernel
def _is_hollow_or_flat(table, s):
    """Whether a shape is touched by the vertices of any other: no part of an edge or a face is nearer than these."""
    return table.core[s] < 0


@kernel
def touch(table, work, out, a, b, reach, count):
    """Add the points of shapes a < b whose gap is within ``reach`` (m) to ``out``; how many there are then."""
    if _is_hollow_or_flat(table, a) or (table.core[b] == POINT and table.numbers[4 * a] != POLYTOPE):
        found = _by_vertices(table, work, a, b, -1.0, reach)
    elif _is_hollow_or_flat(table, b) or (table.core[a] == POINT and table.numbers[4 * b] != POLYTOPE):
        found = _by_vertices(table, work, b, a, 1.0, reach)
    elif table.core[a] == SEGMENT and table.core[b] == SEGMENT:
        found = _segments(table, work, a, b, reach)
    else:
        found = _cores(table, work, a, b, reach)
    return keep_points(table, work, out, a, b, found, count)


@kernel
def _by_vertices(table, work, touched, other, sign, reach):
    """Points at which vertices of the core of ``other`` touch; sign: 1 where ``other`` is a, -1 where it is b."""
    head = table.cores.head[table.core[other]]
    axes, centre = load9(work.turn[touched], 0), load3(work.centre[touched], 0)
    own, scale = load9(work.turn[other], 0), load3(table.scale[other], 0)
    arm, radius = sub3(load3(work.centre[other], 0), centre), table.radius[other]
    kind = VERTEX_OF_A if sign > 0.0 else VERTEX_OF_B
    found = 0
    for k in range(head[VERTICES]):
        v = load3(table.cores.vertices[head[FIRST_VERTEX] + k], 0)
        place = add3(arm, rotate(own, (scale[0] * v[0], scale[1] * v[1], scale[2] * v[2])))
        gap, gradient = distance(table.numbers, 4 * touched, rotate_back(axes, place))
        if gap != gap:  # on the core of a round shape, any direction leads out
            gap, gradient = -table.radius[touched], (1.0, 0.0, 0.0)
        if gap - radius > reach:
            continue
        gradient = rotate(axes, gradient)
        place = add3(place, centre)
        foot = sub3(place, scale3(gap, gradient))
        surface = sub3(place, scale3(radius, gradient))
        normal = scale3(sign, gradient)
        on_a, on_b = (surface, foot) if sign > 0.0 else (foot, surface)
        found = add_point(work, found, on_a, on_b, normal, gap - radius, feature(kind, k, 0), 0.0)
    return found


@kernel
def _placed_core(table, work, s, other):
    """Where a shape's core is: centre, axes, scale.  Of an endless cylinder the part beside the other shape."""
    centre, axes, scale = load3(work.centre[s], 0), load9(work.turn[s], 0), load3(table.scale[s], 0)
    if table.numbers[4 * s] == CYLINDER:
        along = (axes[2], axes[5], axes[8])
        shift = dot3(along, sub3(load3(work.centre[other], 0), centre))
        return add3(centre, scale3(shift, along)), axes, (1.0, 1.0, 1.1 * table.bound[other])
    return centre, axes, scale


@kernel
def _add_between(work, found, p, q, n, radius_a, radius_b, reach, name, same):
    """Add the point about two places of the cores, along the normal between them, n where they are one."""
    r = sub3(p, q)
    length = math.sqrt(dot3(r, r))
    if length - radius_a - radius_b > reach:
        return found
    if length > 0.0:
        n = scale3(1.0 / length, r)
    on_a, on_b, gap = between(p, q, length, radius_a, radius_b, n)
    return add_point(work, found, on_a, on_b, n, gap, name, same)


@kernel
def _on(p, u, half, x):
    """Where along a segment about p, of the unit vector u, the place x is, and the end that is nearest if beyond."""
    t = dot3(u, sub3(x, p))
    if t > half:
        return half, 1
    if t < -half:
        return -half, 0
    return t, -1


@kernel
def _segments(table, work, a, b, reach):
    """Points of two capsules: where their axes are nearest, and where an end of one is beside the other.

    Two that lie along each other touch at two points, as their smaller overlap ends.
    """
    p, axes, scale_a = _placed_core(table, work, a, b)
    u, half_a = (axes[2], axes[5], axes[8]), scale_a[2]
    q, axes, scale_b = _placed_core(table, work, b, a)
    w, half_b = (axes[2], axes[5], axes[8]), scale_b[2]
    ra, rb = table.radius[a], table.radius[b]
    same = SAME * min(half_a, half_b)
    r = sub3(p, q)
    across = cross3(u, w)
    over = dot3(across, across)
    fallback = _across(u) if over < EQUAL else scale3(1.0 / math.sqrt(over), across)
    if dot3(fallback, r) < 0.0:
        fallback = scale3(-1.0, fallback)
    found = 0
    if over >= EQUAL:
        along = dot3(u, w)
        t, k = (along * dot3(w, r) - dot3(u, r)) / over, (dot3(w, r) - along * dot3(u, r)) / over
        if abs(t) <= half_a and abs(k) <= half_b:
            x, y = add3(p, scale3(t, u)), add3(q, scale3(k, w))
            found = _add_between(work, found, x, y, fallback, ra, rb, reach, feature(TWO_EDGES, 0, 0), same)
    for i in range(2):
        x = add3(p, scale3(half_a if i == 1 else -half_a, u))
        k, end = _on(q, w, half_b, x)
        y = add3(q, scale3(k, w))
        if end < 0 or _on(p, u, half_a, y)[1] == i:
            found = _add_between(work, found, x, y, fallback, ra, rb, reach, feature(VERTEX_OF_A, i, 0), same)
    for j in range(2):
        y = add3(q, scale3(half_b if j == 1 else -half_b, w))
        t, end = _on(p, u, half_a, y)
        if end < 0:
            x = add3(p, scale3(t, u))
            found = _add_between(work, found, x, y, fallback, ra, rb, reach, feature(VERTEX_OF_B, j, 0), same)
    return found


@kernel
def _across(u):
    """A unit vector across u."""
    v = cross3(u, (1.0, 0.0, 0.0) if abs(u[0]) < 0.6 else (0.0, 1.0, 0.0))
    return scale3(1.0 / math.sqrt(dot3(v, v)), v)


@kernel
def _cores(table, work, a, b, reach):
    """Points of two shapes about cores of which one at least has faces."""
    cores, core_a, core_b = table.cores, table.core[a], table.core[b]
    ra, rb = table.radius[a], table.radius[b]
    centre, axes, scale_a = _placed_core(table, work, a, b)
    centre_b, axes_b, scale_b = _placed_core(table, work, b, a)
    R = compose((axes[0], axes[3], axes[6], axes[1], axes[4], axes[7], axes[2], axes[5], axes[8]), axes_b)
    d = rotate_back(axes, sub3(centre_b, centre))
    limit = reach + ra + rb
    size = min(table.bound[a], table.bound[b])
    if size == 0.0:  # of a vertex
        size = max(table.bound[a], table.bound[b])
    edge_a, edge_b = -1, -1
    boxes = core_a == CUBE and core_b == CUBE
    if boxes:
        separation, n = box_axis(scale_a, scale_b, R, d)
        if separation > limit:
            return 0
    va, vb = work.vertices_a, work.vertices_b
    lay_core(cores, core_a, scale_a, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), va)
    lay_core(cores, core_b, scale_b, R, d, vb)
    if not boxes:
        separation, n, edge_a, edge_b = core_axis(cores, core_a, core_b, va, vb, R, limit)
        if separation > limit:
            return 0
    found, least = overlap(work, cores, core_a, core_b, R, n, axes, centre, ra, rb, reach, size)
    exact = SAME_PLACE * size
    if least <= separation + exact:
        return found
    if edge_a >= 0:
        x, y, within = edges_meet(cores, core_a, core_b, va, vb, edge_a, edge_b)
        if within:
            name = feature(TWO_EDGES, edge_a, edge_b)
            return _add_along(work, found, x, y, n, centre, axes, ra, rb, name, SAME * size)
    if not separation > 0.0:
        return found
    gap, x, y, kind, vertex = nearest_edges(cores, core_a, core_b, va, vb)
    if gap > limit:
        return 0
    if gap > exact:  # nearer than that, the direction from one to the other has no digits
        n = scale3(1.0 / gap, sub3(x, y))
    found, least = overlap(work, cores, core_a, core_b, R, n, axes, centre, ra, rb, reach, size)
    if least <= gap + exact:
        return found
    return _add_along(work, found, x, y, n, centre, axes, ra, rb, feature(kind, vertex, 0), SAME * size)


@kernel
def _add_along(work, found, x, y, n, centre, axes, radius_a, radius_b, name, same):
    """Add the point about two places, in a's axes, of the cores that are nearest along n."""
    normal = rotate(axes, n)
    on_a, on_b = add3(centre, rotate(axes, x)), add3(centre, rotate(axes, y))
    on_a, on_b, gap = between(on_a, on_b, dot3(n, sub3(x, y)), radius_a, radius_b, normal)
    return add_point(work, found, on_a, on_b, normal, gap, name, same)
