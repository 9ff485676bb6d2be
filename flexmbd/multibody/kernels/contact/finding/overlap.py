"""Points of two convex cores along a normal: the corners of the overlap of two faces as seen along it.

Of each core a face about its foremost vertex, or edge, the one that looks along most; of a segment or a point, itself.
Seen along the normal their overlap is a polygon, and the gap along the normal is linear on it, so its corners bound it:
vertices of a within b's face, vertices of b within a's, and crossings of edges.  Neither shape is the one of reference:
places, gaps and ids do not change with which face is nearer to the normal, and a point leaves where its gap exceeds the
reach, not where a face does.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, rotate, rotate_back, scale3
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.finding.candidates import add_point, between, feature
from flexmbd.multibody.kernels.contact.finding.shape_table import (
    FACES,
    FIRST_FACE,
    FIRST_VERTEX,
    TWO_EDGES,
    VERTEX_OF_A,
    VERTEX_OF_B,
    VERTICES,
)
from flexmbd.round_off import EQUAL, SAME_PLACE, SEVEN_DIGITS

#: Of the smaller shape's size: within this two points are one, and a point is at a corner.
SAME = SEVEN_DIGITS


@kernel
def _basis(n):
    """Two unit vectors that make right-handed axes with n."""
    if abs(n[0]) < abs(n[1]):
        first = (1.0, 0.0, 0.0) if abs(n[0]) < abs(n[2]) else (0.0, 0.0, 1.0)
    else:
        first = (0.0, 1.0, 0.0) if abs(n[1]) < abs(n[2]) else (0.0, 0.0, 1.0)
    u = cross3(first, n)
    u = scale3(1.0 / math.sqrt(dot3(u, u)), u)
    return u, cross3(n, u)


@kernel
def _project(polygon, k, vertex, u, v, n):
    polygon[k, 0], polygon[k, 1], polygon[k, 2] = dot3(u, vertex), dot3(v, vertex), dot3(n, vertex)


@kernel
def _foremost_face(cores, head, vertices, direction, own, same):
    """The face with most of the foremost vertices, a whole edge before one end; of these the one that looks along.

    direction, own: in the axes of the vertices and in the core's own.
    """
    front = -math.inf
    for k in range(head[VERTICES]):
        front = max(front, dot3(direction, load3(vertices[k], 0)))
    face, best, most = -1, -math.inf, 0
    for k in range(head[VERTICES]):
        if dot3(direction, load3(vertices[k], 0)) < front - same:
            continue
        at = head[FIRST_VERTEX] + k
        for q in range(cores.around_at[at], cores.around_at[at + 1]):
            f = head[FIRST_FACE] + cores.around[q]
            with_it = 0
            for c in range(cores.face_at[f], cores.face_at[f + 1]):
                if dot3(direction, load3(vertices[cores.corners[c]], 0)) >= front - same:
                    with_it += 1
            along = dot3(own, load3(cores.normals[f], 0))
            if with_it > most or (with_it == most and along > best):
                face, best, most = f, along, with_it
    return face


@kernel
def _lay_face(cores, core, vertices, turn, direction, u, v, n, polygon, names, same, exact):
    """Write the face that looks along ``direction``, seen along n: places and height of its vertices, their numbers.

    Returns how many they are, and the slope of the height along u and v.
    """
    head = cores.head[core]
    if head[FACES] == 0:
        for k in range(head[VERTICES]):
            _project(polygon, k, load3(vertices[k], 0), u, v, n)
            names[k, 0], names[k, 1] = k, 0
        if head[VERTICES] == 1:
            return 1, 0.0, 0.0
        dx, dy, rise = polygon[1, 0] - polygon[0, 0], polygon[1, 1] - polygon[0, 1], polygon[1, 2] - polygon[0, 2]
        squared = dx * dx + dy * dy
        if squared > same * same:
            return 2, rise * dx / squared, rise * dy / squared
        if (dot3(direction, n) > 0.0) == (rise > 0.0):  # seen end-on: the end that is in front
            for c in range(3):
                polygon[0, c] = polygon[1, c]
            names[0, 0] = 1
        return 1, 0.0, 0.0
    face = _foremost_face(cores, head, vertices, direction, rotate_back(turn, direction), exact)
    begin = cores.face_at[face]
    count = cores.face_at[face + 1] - begin
    for k in range(count):
        corner = cores.corners[begin + k]
        _project(polygon, k, load3(vertices[corner], 0), u, v, n)
        names[k, 0], names[k, 1] = corner, cores.sides[begin + k]
    m = rotate(turn, load3(cores.normals[face], 0))
    up = dot3(m, n)
    if abs(up) < EQUAL:  # seen edge-on: its corners alone have heights
        return count, 0.0, 0.0
    return count, -dot3(m, u) / up, -dot3(m, v) / up


@kernel
def _height(polygon, count, slope_x, slope_y, x, y):
    """The height of a face at a place; of a segment never beyond its ends."""
    height = polygon[0, 2] + slope_x * (x - polygon[0, 0]) + slope_y * (y - polygon[0, 1])
    if count != 2:
        return height
    return min(max(height, min(polygon[0, 2], polygon[1, 2])), max(polygon[0, 2], polygon[1, 2]))


@kernel
def _within(polygon, count, sign, x, y):
    """How far a place is within a polygon (m), negative outside; ``sign``: 1 of a counterclockwise one.

    Of a segment or a point: how far it is away, negative.
    """
    if count < 3:
        rx, ry = x - polygon[0, 0], y - polygon[0, 1]
        if count == 2:
            dx, dy = polygon[1, 0] - polygon[0, 0], polygon[1, 1] - polygon[0, 1]
            squared = dx * dx + dy * dy
            t = min(max((rx * dx + ry * dy) / squared, 0.0), 1.0) if squared > 0.0 else 0.0
            rx, ry = rx - t * dx, ry - t * dy
        return -math.sqrt(rx * rx + ry * ry)
    least = math.inf
    for k in range(count):
        after = k + 1 if k + 1 < count else 0
        dx, dy = polygon[after, 0] - polygon[k, 0], polygon[after, 1] - polygon[k, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length > 0.0:
            least = min(least, sign * (dx * (y - polygon[k, 1]) - dy * (x - polygon[k, 0])) / length)
    return least


@kernel
def overlap(work, cores, core_a, core_b, R, n, axes, centre, radius_a, radius_b, reach, size):
    """Add the points along the normal n whose gap is within ``reach``; ``work.vertices_a`` and ``_b`` are laid.

    axes, centre: of a, in the world.  Returns how many points there are, and the least gap of the cores at a point.
    """
    u, v = _basis(n)
    P, Q, own = work.polygon_a, work.polygon_b, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    back = scale3(-1.0, n)
    same, exact = SAME * size, SAME_PLACE * size
    ka, ax, ay = _lay_face(cores, core_a, work.vertices_a, own, back, u, v, n, P, work.names_a, same, exact)
    kb, bx, by = _lay_face(cores, core_b, work.vertices_b, R, n, u, v, n, Q, work.names_b, same, exact)
    normal = rotate(axes, n)
    found, least = 0, math.inf
    for kind in range(VERTEX_OF_A, TWO_EDGES + 1):
        outer = kb if kind == VERTEX_OF_B else ka
        inner = kb if kind == TWO_EDGES else 1
        for i in range(outer):
            for j in range(inner):
                if kind == VERTEX_OF_A:
                    x, y, above = P[i, 0], P[i, 1], P[i, 2]
                    depth, below = _within(Q, kb, 1.0, x, y), _height(Q, kb, bx, by, x, y)
                elif kind == VERTEX_OF_B:
                    x, y, below = Q[i, 0], Q[i, 1], Q[i, 2]
                    depth, above = _within(P, ka, -1.0, x, y), _height(P, ka, ax, ay, x, y)
                else:
                    x, y, above, below, depth = _crossing(P, ka, i, Q, kb, j)
                if not depth >= -exact:
                    continue
                gap = above - below
                least = min(least, gap)
                if gap - radius_a - radius_b > reach:
                    continue
                flat = add3(scale3(x, u), scale3(y, v))
                on_a = add3(centre, rotate(axes, add3(flat, scale3(above, n))))
                on_b = add3(centre, rotate(axes, add3(flat, scale3(below, n))))
                on_a, on_b, gap = between(on_a, on_b, gap, radius_a, radius_b, normal)
                name = _name(work, kind, i, j, ka, kb, x, y, same)
                found = add_point(work, found, on_a, on_b, normal, gap, name, same)
    return found, least


@kernel
def _near(polygon, count, x, y, same):
    """The vertex of a polygon that is within ``same`` of a place; -1: none."""
    for k in range(count):
        dx, dy = polygon[k, 0] - x, polygon[k, 1] - y
        if dx * dx + dy * dy <= same * same:
            return k
    return -1


@kernel
def _name(work, kind, i, j, ka, kb, x, y, same):
    """What touches at a place: a vertex of a if one is there, else one of b, else two edges.

    So corners that lie on each other, or on a border, keep their name whichever is a little outside.
    """
    k = i if kind == VERTEX_OF_A else _near(work.polygon_a, ka, x, y, same)
    if k >= 0:
        return feature(VERTEX_OF_A, work.names_a[k, 0], 0)
    k = i if kind == VERTEX_OF_B else _near(work.polygon_b, kb, x, y, same)
    if k >= 0:
        return feature(VERTEX_OF_B, work.names_b[k, 0], 0)
    return feature(TWO_EDGES, work.names_a[i, 1], work.names_b[j, 1])


@kernel
def _crossing(P, ka, i, Q, kb, j):
    """Where two edges cross, their heights there, and 0 if they do, -inf if not."""
    none = (0.0, 0.0, 0.0, 0.0, -math.inf)
    if ka < 2 or kb < 2 or (ka == 2 and i == 1) or (kb == 2 and j == 1):
        return none
    after, next_ = i + 1 if i + 1 < ka else 0, j + 1 if j + 1 < kb else 0
    px, py = P[after, 0] - P[i, 0], P[after, 1] - P[i, 1]
    qx, qy = Q[next_, 0] - Q[j, 0], Q[next_, 1] - Q[j, 1]
    over = px * qy - py * qx
    if over * over <= EQUAL * (px * px + py * py) * (qx * qx + qy * qy):
        return none
    rx, ry = Q[j, 0] - P[i, 0], Q[j, 1] - P[i, 1]
    t, k = (rx * qy - ry * qx) / over, (rx * py - ry * px) / over
    if not (t >= 0.0 and t <= 1.0 and k >= 0.0 and k <= 1.0):
        return none
    above = P[i, 2] + t * (P[after, 2] - P[i, 2])
    below = Q[j, 2] + k * (Q[next_, 2] - Q[j, 2])
    return P[i, 0] + t * px, P[i, 1] + t * py, above, below, 0.0
