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
from flexmbd.multibody.kernels.contact.contact_law import way_to_middle
from flexmbd.multibody.kernels.contact.signed_distance import distance, gradient_variation
from flexmbd.multibody.kernels.elements import surface_layout as sl

_ZERO = (0.0, 0.0, 0.0)


@kernel
def by_modes(data, o, n, q):
    """The displacement (m) by the modes q (n,), whose rows (3, n) begin at ``o``."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(n):
        x += data[o + k] * q[k]
        y += data[o + n + k] * q[k]
        z += data[o + 2 * n + k] * q[k]
    return x, y, z


@kernel
def displaced(data, p, n, t, i, q):
    """Where patch i is with the modes at q (n,) in the body's axes (m)."""
    return add3(load3(data, sl.centroid(p, n, t, i)), by_modes(data, sl.displacements(p, n, t, i), n, q))


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
def find_near(plan, work, row, d, R, reach):
    """Write which patches are near: how many, and a bound of the least gap (m).

    ``reach``: how far modes move any patch (m).  None further than the deepest may be pressed in comes to touch: a
    patch beside others moves less than these.
    """
    t, p, n = sl.table_of(plan, row)
    o = row[at.EL_DATA] + sl.SHAPE
    radius = plan.data[row[at.EL_DATA] + sl.POINT_RADIUS]
    ball = distance(plan.data, o, add3(d, rotate(R, load3(plan.data, t + sl.CENTRE))))[0]
    ball -= plan.data[t + sl.RADIUS] + reach + radius
    if ball > 0.0:
        return 0, ball
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    least = math.inf
    for i in range(p):
        far = distance(plan.data, o, add3(d, rotate(R, load3(plan.data, sl.centroid(p, n, t, i)))))[0] - radius
        V[sl.FAR, i] = far
        least = min(least, far)
    bound, count = reach + max(0.0, reach - least), 0
    for i in range(p):
        if not V[sl.FAR, i] > bound:
            V[sl.PATCH, count] = i
            count += 1
    return count, least - reach


@kernel
def weigh(data, t, p, n, z, w):
    """Write the weights (p,) of a surface's patches for a point z (m); whether any feels it."""
    total, support = 0.0, data[t + sl.SUPPORT] ** 2
    for i in range(p):
        r = sub3(z, load3(data, sl.centroid(p, n, t, i)))
        share = 1.0 - dot3(r, r) / support
        w[i] = share * share * share if share > 0.0 else 0.0
        total += w[i]
    if not total > 0.0:
        return False
    for i in range(p):
        w[i] /= total
    return True


@kernel
def mean_of(rows, column, w, p):
    """The weighted mean of what stands in the rows (p, ...) from a column."""
    found = _ZERO
    for i in range(p):
        if w[i] != 0.0:
            found = add3(found, scale3(w[i], load3(rows[i], column)))
    return found


@kernel
def _slope_of_mean(data, t, p, n, z, rows, column, e):
    """The gradient by z, where it is felt, of e . (the weighted mean of what stands in the rows from a column)."""
    slope, slopes, total, mean, support = _ZERO, _ZERO, 0.0, 0.0, data[t + sl.SUPPORT] ** 2
    for i in range(p):
        r = sub3(z, load3(data, sl.centroid(p, n, t, i)))
        share = 1.0 - dot3(r, r) / support
        if share > 0.0:
            along, grown = dot3(e, load3(rows[i], column)), scale3(-6.0 * share * share / support, r)
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
def tilt(plan, row, z, rows, column, e):
    """The gradient by a point's place z of e . (the weighted mean of what stands in the rows from a column)."""
    t, p, n = sl.other_of(plan, row)
    slope = _slope_of_mean(plan.data, t, p, n, _felt_at(plan, row, z), rows, column, e)
    o = row[at.EL_DATA] + sl.SHAPE
    if plan.data[row[at.EL_DATA] + sl.POINT_RADIUS] == 0.0:
        return slope
    far, normal = distance(plan.data, o, z)
    flat = sub3(slope, scale3(dot3(normal, slope), normal))
    return sub3(flat, scale3(far, gradient_variation(plan.data, o, z, slope)))


@kernel
def place_point(plan, row, d, arm, w, others):
    """Of a centroid at ``arm`` (m) from the body's origin its gap, the normal, and where it is for the shape.

    ``w``: (p_other,) output, its weights; ``others``: rows of these patches.  Infinite beside the other surface.
    """
    z, o = add3(d, arm), row[at.EL_DATA] + sl.SHAPE
    t, p, n = sl.other_of(plan, row)
    if p > 0:
        if not weigh(plan.data, t, p, n, _felt_at(plan, row, z), w):
            return math.inf, (1.0, 0.0, 0.0), z
        z = sub3(z, mean_of(others, sl.MODAL, w, p))
    gap, normal = distance(plan.data, o, z)
    return gap - plan.data[row[at.EL_DATA] + sl.POINT_RADIUS], normal, z


@kernel
def move_others(plan, work, row, q_other):
    """Write how the modes of the other surface move its patches."""
    _, p, _ = sl.table_of(plan, row)
    t, size, n = sl.other_of(plan, row)
    others = matrix_view(work.generalized, sl.others_place(p, size), size, sl.N_OTHER)
    for i in range(size):
        store3(others[i], sl.MODAL, by_modes(plan.data, sl.displacements(size, n, t, i), n, q_other))


@kernel
def place_points(plan, work, row, m, d, R, q, q_other):
    """Write gaps, places and normals of the m near patches; whether any overlaps."""
    t, p, n = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    points = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), p, size)
    others = matrix_view(work.generalized, sl.others_place(p, size), size, sl.N_OTHER)
    move_others(plan, work, row, q_other)
    overlap = False
    for k in range(m):
        arm = rotate(R, displaced(plan.data, p, n, t, int(V[sl.PATCH, k]), q))
        gap, normal, foot = place_point(plan, row, d, arm, weights[k], others)
        V[sl.GAP, k] = gap
        store3(points[k], sl.NORMAL, normal)
        store3(points[k], sl.PLACE, arm)
        store3(points[k], sl.OWN_NORMAL, rotate_back(R, normal))
        store3(points[k], sl.FOOT, foot)
        overlap = overlap or not gap >= 0.0
    return overlap


@kernel
def weighted_row(data, t, p, n, w, k):
    """The weighted mean of a surface's displacements by mode k."""
    found = _ZERO
    for i in range(p):
        if w[i] != 0.0:
            o = sl.displacements(p, n, t, i)
            found = add3(found, scale3(w[i], (data[o + k], data[o + n + k], data[o + 2 * n + k])))
    return found


@kernel
def push_modes(data, o, n, force, out):
    """Add what a force on a patch, in its body's axes, does on its modes, whose rows (3, n) begin at ``o``."""
    for k in range(n):
        out[k] += data[o + k] * force[0] + data[o + n + k] * force[1] + data[o + 2 * n + k] * force[2]


@kernel
def push_other_modes(plan, row, w, force, out):
    """Add what a force on the patches of the other surface, with weights, does on its modes."""
    t, size, n = sl.other_of(plan, row)
    for i in range(size):
        if w[i] != 0.0:
            push_modes(plan.data, sl.displacements(size, n, t, i), n, scale3(w[i], force), out)
