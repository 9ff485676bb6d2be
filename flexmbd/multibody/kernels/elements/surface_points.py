"""Which patches of an elastic surface are near what it touches, and where they are for it.

A point at z between the patches of another elastic surface moves with the weighted mean of their displacements,
D(z) = sum_p w_p(z) D_p.  The weights are smooth, not negative, and sum to one (Shepard's, of kernels of a finite
support), so that nothing jumps where a point goes from patch to patch.  For the undeformed shape of that surface the
point is at z - D(z), as far as the modes make D.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    load3,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.lanes import LANES, lanes, padded, plus_product, put_lanes, spread, sum_of
from flexmbd.multibody.kernels.contact.contact_law import way_to_middle
from flexmbd.multibody.kernels.contact.signed_distance import distance, gradient_variation
from flexmbd.multibody.kernels.elements import surface_layout as sl

_ZERO = (0.0, 0.0, 0.0)


@kernel
def displace(data, p, n, t, i, q, out, first, k):
    """Write, by rows from ``first``, how the modes q (n,) move eight patches from i (m), at the columns from k."""
    o, P = sl.displacements(p, n, t) + i, padded(p)
    for c in range(3):
        moved = spread(0.0)
        for j in range(n):
            moved = plus_product(moved, spread(q[j]), lanes(data, o + P * (c * n + j)))
        put_lanes(out[first + c], k, moved)


@kernel
def displacement(data, p, n, t, i, q):
    """How the modes q (n,) move patch i (m)."""
    o, P = sl.displacements(p, n, t) + i, padded(p)
    x = y = z = 0.0
    for j in range(n):
        x += data[o + P * j] * q[j]
        y += data[o + P * (n + j)] * q[j]
        z += data[o + P * (2 * n + j)] * q[j]
    return x, y, z


@kernel
def place_own(plan, work, row, i, q, k):
    """Write the centroids of eight patches from i with the modes at q in the body's axes (m), at the slots from k."""
    t, p, n = sl.table_of(plan, row)
    V, o = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p)), sl.centroids(n, t) + i
    displace(plan.data, p, n, t, i, q, V, sl.OWN_PLACE, k)
    for c in range(3):
        one = V[sl.OWN_PLACE + c]
        put_lanes(one, k, plus_product(lanes(one, k), spread(1.0), lanes(plan.data, o + c * padded(p))))


@kernel
def farthest(data, t, n, q):
    """How far the modes q (n,) move any patch at most (m)."""
    found = 0.0
    for k in range(n):
        found += data[t + sl.MOST + k] * abs(q[k])
    return found


@kernel
def bound_step(plan, row, gap, motion, fastest):
    """Let no step be so long that what is ``gap`` (m) away can pass through; ``fastest``: m/s of the modes."""
    d, R, rate, spin = motion
    t, _, _ = sl.table_of(plan, row)
    o = row[at.EL_DATA] + sl.SHAPE
    way = way_to_middle(plan.data, o)
    if way == math.inf or not gap > 0.0:
        return
    arm = rotate(R, load3(plan.data, t + sl.CENTRE))
    speed, n = add3(rate, cross3(spin, arm)), distance(plan.data, o, add3(d, arm))[1]
    beside = math.sqrt(dot3(spin, spin)) * plan.data[t + sl.RADIUS] + fastest
    if dot3(n, speed) < beside:
        most = math.sqrt(dot3(speed, speed)) + beside
        plan.horizon[0] = min(plan.horizon[0], (gap + 0.5 * way) / most)


@kernel
def find_near(plan, work, row, d, R, reach, deep):
    """Write which patches are near, by slots: how many, and a bound of the least gap (m).

    ``reach``: how far modes move any patch (m).  None further than the deepest may be pressed in comes to touch: a
    patch beside others moves less than these.  ``deep``: how deep others of the body may be (m).
    """
    t, p, n = sl.table_of(plan, row)
    o = row[at.EL_DATA] + sl.SHAPE
    radius = plan.data[row[at.EL_DATA] + sl.POINT_RADIUS]
    ball = distance(plan.data, o, add3(d, rotate(R, load3(plan.data, t + sl.CENTRE))))[0]
    ball -= plan.data[t + sl.RADIUS] + reach + radius
    if ball > deep:
        return 0, ball
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    least = math.inf
    for i in range(p):
        far = distance(plan.data, o, add3(d, rotate(R, sl.centroid(plan.data, p, n, t, i))))[0] - radius
        V[sl.FAR, i] = far
        least = min(least, far)
    bound, count = reach + max(deep, reach - least), 0
    for first in range(0, p, LANES):
        near = False
        for i in range(first, min(first + LANES, p)):
            near = near or not V[sl.FAR, i] > bound
        if near:
            for i in range(first, first + LANES):
                V[sl.PATCH, count] = i
                V[sl.GAP, count] = 0.0 if i < p and not V[sl.FAR, i] > bound else math.inf
                count += 1
    return count, least - reach


@kernel
def _share(data, p, n, t, z, i):
    """How much patch i is felt at z, before its third power, and minus half of what that changes by with z (1/m)."""
    r = sub3(z, sl.centroid(data, p, n, t, i))
    o, P = sl.forms(p, n, t) + i, padded(p)
    turned = (
        data[o] * r[0] + data[o + P] * r[1] + data[o + 2 * P] * r[2],
        data[o + P] * r[0] + data[o + 3 * P] * r[1] + data[o + 4 * P] * r[2],
        data[o + 2 * P] * r[0] + data[o + 4 * P] * r[1] + data[o + 5 * P] * r[2],
    )
    return 1.0 - dot3(r, turned), turned


@kernel
def weigh(data, t, p, n, z, w):
    """Write the weights (P,) of a surface's patches for a point z (m); whether any feels it."""
    total = 0.0
    for i in range(p):
        share, _ = _share(data, p, n, t, z, i)
        w[i] = share * share * share if share > 0.0 else 0.0
        total += w[i]
    for i in range(p, padded(p)):
        w[i] = 0.0
    if not total > 0.0:
        return False
    for i in range(p):
        w[i] /= total
    return True


@kernel
def mean_of(vectors, first, w):
    """The weighted mean of vectors, by rows from ``first``."""
    x = y = z = spread(0.0)
    for b in range(0, w.shape[0], LANES):
        share = lanes(w, b)
        x = plus_product(x, share, lanes(vectors[first], b))
        y = plus_product(y, share, lanes(vectors[first + 1], b))
        z = plus_product(z, share, lanes(vectors[first + 2], b))
    return sum_of(x), sum_of(y), sum_of(z)


@kernel
def _slope_of_mean(data, t, p, n, z, vectors, first, e):
    """The gradient by z, where it is felt, of e . (the weighted mean of vectors, by rows from ``first``)."""
    slope, slopes, total, mean = _ZERO, _ZERO, 0.0, 0.0
    for i in range(p):
        share, turned = _share(data, p, n, t, z, i)
        if share > 0.0:
            along, grown = dot3(e, sl.at3(vectors, first, i)), scale3(-6.0 * share * share, turned)
            total, mean = total + share * share * share, mean + share * share * share * along
            slope, slopes = add3(slope, scale3(along, grown)), add3(slopes, grown)
    if total == 0.0:
        return _ZERO
    return scale3(1.0 / total, sub3(slope, scale3(mean / total, slopes)))


@kernel
def _felt_at(plan, row, z):
    """Where the other surface feels a point at z: there, and where a sphere's centre is the shape's nearest point."""
    o = row[at.EL_DATA] + sl.SHAPE
    if plan.data[row[at.EL_DATA] + sl.POINT_RADIUS] == 0.0:
        return z
    far, normal = distance(plan.data, o, z)
    return sub3(z, scale3(far, normal))


@kernel
def tilt(plan, row, z, vectors, first, e):
    """The gradient by a point's place z of e . (the weighted mean of vectors, by rows from ``first``)."""
    t, p, n = sl.other_of(plan, row)
    slope = _slope_of_mean(plan.data, t, p, n, _felt_at(plan, row, z), vectors, first, e)
    o = row[at.EL_DATA] + sl.SHAPE
    if plan.data[row[at.EL_DATA] + sl.POINT_RADIUS] == 0.0:
        return slope
    far, normal = distance(plan.data, o, z)
    flat = sub3(slope, scale3(dot3(normal, slope), normal))
    return sub3(flat, scale3(far, gradient_variation(plan.data, o, z, slope)))


@kernel
def place_point(plan, row, d, arm, w, others):
    """Of a centroid at ``arm`` (m) from the body's origin its gap, the normal, and where it is for the shape.

    ``w``: output, its weights; ``others``: vectors of these patches.  Infinite beside the other surface.
    """
    z, o = add3(d, arm), row[at.EL_DATA] + sl.SHAPE
    t, p, n = sl.other_of(plan, row)
    if p > 0:
        if not weigh(plan.data, t, p, n, _felt_at(plan, row, z), w):
            return math.inf, (1.0, 0.0, 0.0), z
        z = sub3(z, mean_of(others, sl.MODAL, w))
    gap, normal = distance(plan.data, o, z)
    return gap - plan.data[row[at.EL_DATA] + sl.POINT_RADIUS], normal, z


@kernel
def move_others(plan, work, row, q_other):
    """Write how the modes of the other surface move its patches."""
    _, p, _ = sl.table_of(plan, row)
    t, size, n = sl.other_of(plan, row)
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    for i in range(0, size, LANES):
        displace(plan.data, size, n, t, i, q_other, others, sl.MODAL, i)


@kernel
def place_points(plan, work, row, m, d, R, q, q_other):
    """Write gaps, places and normals of the near patches on m slots; whether any overlaps."""
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    move_others(plan, work, row, q_other)
    overlap = False
    for k in range(m):
        if k % LANES == 0:
            place_own(plan, work, row, int(V[sl.PATCH, k]), q, k)
        if V[sl.GAP, k] == math.inf:
            continue
        arm = rotate(R, sl.at3(V, sl.OWN_PLACE, k))
        gap, normal, foot = place_point(plan, row, d, arm, weights[k], others)
        V[sl.GAP, k] = gap
        store3(points[k], sl.NORMAL, normal)
        store3(points[k], sl.PLACE, arm)
        sl.put3(V, sl.OWN_NORMAL, k, rotate_back(R, normal))
        store3(points[k], sl.FOOT, foot)
        overlap = overlap or not gap >= 0.0
    return overlap


@kernel
def weighted_row(data, t, p, n, w, k):
    """The weighted mean of a surface's displacements by mode k."""
    o, P = sl.displacements(p, n, t) + k * padded(p), padded(p)
    x = y = z = spread(0.0)
    for b in range(0, P, LANES):
        share = lanes(w, b)
        x = plus_product(x, share, lanes(data, o + b))
        y = plus_product(y, share, lanes(data, o + n * P + b))
        z = plus_product(z, share, lanes(data, o + 2 * n * P + b))
    return sum_of(x), sum_of(y), sum_of(z)


@kernel
def push_modes(data, p, n, t, i, force, out):
    """Add what a force on patch i, in its body's axes, does on the modes (n,)."""
    o, P = sl.displacements(p, n, t) + i, padded(p)
    for k in range(n):
        c = o + k * P
        out[k] += data[c] * force[0] + data[c + n * P] * force[1] + data[c + 2 * n * P] * force[2]


@kernel
def push_other_modes(plan, row, w, force, out):
    """Add what a force on the patches of the other surface, by weights, does on its modes."""
    t, size, n = sl.other_of(plan, row)
    o, P = sl.displacements(size, n, t), padded(size)
    f0, f1, f2 = spread(force[0]), spread(force[1]), spread(force[2])
    for k in range(n):
        done = spread(0.0)
        for b in range(0, P, LANES):
            c = o + k * P + b
            along = plus_product(spread(0.0), f0, lanes(plan.data, c))
            along = plus_product(along, f1, lanes(plan.data, c + n * P))
            along = plus_product(along, f2, lanes(plan.data, c + 2 * n * P))
            done = plus_product(done, lanes(w, b), along)
        out[k] += sum_of(done)


@kernel
def push_all(plan, work, row, m, out):
    """Add what the pulls on the patches of m slots, in the body's axes, do on its modes (n,)."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    data, P = plan.data, padded(p)
    o = sl.displacements(p, n, t)
    for k in range(n):
        done = spread(0.0)
        for b in range(0, m, LANES):
            c = o + k * P + int(V[sl.PATCH, b])
            done = plus_product(done, lanes(V[sl.OWN_PULLED], b), lanes(data, c))
            done = plus_product(done, lanes(V[sl.OWN_PULLED + 1], b), lanes(data, c + n * P))
            done = plus_product(done, lanes(V[sl.OWN_PULLED + 2], b), lanes(data, c + 2 * n * P))
        out[k] += sum_of(done)


@kernel
def push_others(plan, row, others, first, out):
    """Add what forces on the patches of the other surface, by rows from ``first``, do on its modes (n,)."""
    t, size, n = sl.other_of(plan, row)
    o, P = sl.displacements(size, n, t), padded(size)
    for k in range(n):
        done = spread(0.0)
        for b in range(0, P, LANES):
            c = o + k * P + b
            done = plus_product(done, lanes(others[first], b), lanes(plan.data, c))
            done = plus_product(done, lanes(others[first + 1], b), lanes(plan.data, c + n * P))
            done = plus_product(done, lanes(others[first + 2], b), lanes(plan.data, c + 2 * n * P))
        out[k] += sum_of(done)
