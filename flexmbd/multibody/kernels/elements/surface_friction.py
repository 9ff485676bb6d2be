"""Friction of an elastic surface: patches stick where they are, as far as mu N goes, and give way by their flexibility.

A patch that sticks keeps its anchor, the place on the shape where it came to stick (F's axes): what its centroid, and
the residual flexibility with that, would slide from there is zero.  One that slips bears mu N against its slip, and its
anchor comes along.  The way is from the anchor, which elements remember at the ends of steps, to where a step ends
(return mapping); a patch that sets in within a step slides from where it met the shape, its gap taken to close evenly.

A patch's memory: the anchor (3, m), then below zero where it bears, its gap where it does not, and 0 where nothing is
known of it.  The scratch space, from ``rough_place``, of the q = 3 p components: C, J (q, q), B (q, 6 + modes), the
right-hand sides (6 + modes, q), the vectors y, b, r, what is left, pivots and sizes of LAPACK, and the rows of points.
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
from flexmbd.multibody.kernels.base.block_view import integer_view, matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import INTEGER, deferred_kernel
from flexmbd.multibody.kernels.base.lanes import padded, padded_size
from flexmbd.multibody.kernels.base.native import N_SIZES, solve
from flexmbd.multibody.kernels.contact.rough_complementarity import solve_rough, weights_of
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_points import mean_of, tilt
from flexmbd.multibody.kernels.elements.surface_residual import (
    dent_by_point,
    dent_other,
    own_residual,
    times_flexibility,
)
from flexmbd.round_off import EQUAL

_ZERO = (0.0, 0.0, 0.0)
PATCH_MEMORY = 4
# Columns of the row of a point: the two tangents, what a unit of force along each pulls the body along, the anchor.
_TANGENT, _TUGGED, _ANCHOR, _N_ROUGH = 0, 6, 12, 15
_Y, _B, _R, _LEFT, _PIVOT, _N_VECTORS = range(6)


def friction_scratch(p: int, modes: int) -> int:
    """How many numbers friction adds to those of ``surface_scratch``; ``modes``: of both surfaces."""
    q = 3 * p
    return 2 * q * q + 2 * q * (6 + modes) + _N_VECTORS * q + N_SIZES + _N_ROUGH * padded_size(p)


@kernel
def _place(plan, row):
    """Where the scratch space of friction begins, its number of components and of unknowns."""
    _, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    unknowns = 6 + n + n_other
    return sl.rough_place(p, size, unknowns), 3 * p, unknowns


@kernel
def _vectors_place(o, q, unknowns):
    return o + 2 * q * q + 2 * q * unknowns


@kernel
def _rows_place(o, q, unknowns):
    return _vectors_place(o, q, unknowns) + _N_VECTORS * q + N_SIZES


@kernel
def _write_tangents(n, out):
    """Two unit vectors that are at right angles to n and each other."""
    k = 0 if abs(n[0]) < 0.6 else 1
    e = (1.0 if k == 0 else 0.0, 1.0 if k == 1 else 0.0, 0.0)
    t = sub3(e, scale3(dot3(n, e), n))
    t = scale3(1.0 / math.sqrt(dot3(t, t)), t)
    store3(out, _TANGENT, t)
    store3(out, _TANGENT + 3, cross3(n, t))


@kernel
def _anchor(work, row, patch, foot, gap):
    """Where a patch sticks, that is at ``foot`` now, with this gap before forces (m)."""
    m = row[at.EL_MEMORY] + at.N_MEMORY_HEAD + PATCH_MEMORY * patch
    kept, state = load3(work.memory, m), work.memory[m + 3]
    if state == 0.0:
        return foot
    if state < 0.0 or not gap < 0.0:
        return kept
    return add3(kept, scale3(state / (state - gap), sub3(foot, kept)))


@kernel
def _direction(points, rough, k, c):
    return load3(points[k], sl.NORMAL) if c == 0 else load3(rough[k], _TANGENT + 3 * (c - 1))


@kernel
def _write_flexibility(plan, work, row, R, count):
    """Write C of all three directions of each patch that may touch."""
    t, p, n = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    o, q, unknowns = _place(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    rough = matrix_view(work.generalized, _rows_place(o, q, unknowns), padded(p), _N_ROUGH)
    C = matrix_view(work.generalized, o, 3 * count, 3 * count)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        for c in range(3):
            along = _direction(points, rough, k, c)
            own = rotate_back(R, along)
            if size > 0:
                dent_by_point(plan, work, row, k, along)
            for b in range(a + 1):
                j = int(V[sl.ORDER, b])
                i = int(V[sl.PATCH, j])
                moved = rotate(R, times_flexibility(plan.data, p, n, t, i, int(V[sl.PATCH, k]), own))
                if size > 0:
                    moved = add3(moved, mean_of(others, sl.LOAD, weights[j]))
                for e in range(3):
                    C[3 * b + e, 3 * a + c] = dot3(_direction(points, rough, j, e), moved)
                    C[3 * a + c, 3 * b + e] = C[3 * b + e, 3 * a + c]


@kernel
def _write_ways(plan, work, row, count):
    """Write the tangents of all patches that may touch, their gaps, and how far they are from their anchors."""
    _, p, _ = sl.table_of(plan, row)
    o, q, unknowns = _place(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    rough = matrix_view(work.generalized, _rows_place(o, q, unknowns), padded(p), _N_ROUGH)
    vectors = matrix_view(work.generalized, _vectors_place(o, q, unknowns), _N_VECTORS, q)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        foot = load3(points[k], sl.FOOT)
        anchor = _anchor(work, row, int(V[sl.PATCH, k]), foot, V[sl.GAP, k])
        _write_tangents(load3(points[k], sl.NORMAL), rough[k])
        store3(rough[k], _ANCHOR, anchor)
        vectors[_B, 3 * a] = V[sl.GAP, k]
        vectors[_Y, 3 * a] = V[sl.FORCE, k]
        for c in range(1, 3):
            vectors[_B, 3 * a + c] = dot3(_direction(points, rough, k, c), sub3(foot, anchor))
            vectors[_Y, 3 * a + c] = 0.0


@kernel
def _take_forces(plan, work, row, R, count):
    """Write the forces that were found at their points."""
    _, p, _ = sl.table_of(plan, row)
    o, q, unknowns = _place(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    rough = matrix_view(work.generalized, _rows_place(o, q, unknowns), padded(p), _N_ROUGH)
    vectors = matrix_view(work.generalized, _vectors_place(o, q, unknowns), _N_VECTORS, q)
    for a in range(count):
        k, force = int(V[sl.ORDER, a]), _ZERO
        for c in range(3):
            force = add3(force, scale3(vectors[_Y, 3 * a + c], _direction(points, rough, k, c)))
        V[sl.FORCE, k] = vectors[_Y, 3 * a]
        store3(points[k], sl.FORCED, force)
        sl.put3(V, sl.OWN_FORCE, k, rotate_back(R, force))


@kernel
def _enter_closed(plan, work, row, R, m, count):
    """Add to ORDER what overlaps under the forces that were found; how many there are then."""
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    if size > 0:
        dent_other(plan, work, row, count)
    for k in range(m):
        V[sl.INSIDE, k] = 0.0
    deepest = 0.0
    for a in range(count):
        V[sl.INSIDE, int(V[sl.ORDER, a])] = 1.0
        deepest = max(deepest, -V[sl.GAP, int(V[sl.ORDER, a])])
    found = count
    for k in range(m):
        if V[sl.INSIDE, k] == 0.0 and V[sl.GAP, k] < math.inf:
            apart = rotate(R, own_residual(plan, work, row, int(V[sl.PATCH, k]), m))
            if size > 0:
                apart = sub3(apart, mean_of(others, sl.DENT, weights[k]))
            if V[sl.GAP, k] + dot3(load3(points[k], sl.NORMAL), apart) < -EQUAL * deepest:
                V[sl.ORDER, found] = k
                V[sl.FORCE, k] = 0.0
                found += 1
    return found


@deferred_kernel(INTEGER)
def add_friction(plan, work, row, R, m, count):
    """Find the forces with friction, from those without on the first ``count`` of ORDER; how many may touch, or -1."""
    o, q, unknowns = _place(plan, row)
    mu, vectors_at = plan.data[row[at.EL_DATA] + sl.FRICTION], _vectors_place(o, q, unknowns)
    vectors = matrix_view(work.generalized, vectors_at, _N_VECTORS, q)
    for _ in range(m + 1):
        size = 3 * count
        _write_ways(plan, work, row, count)
        _write_flexibility(plan, work, row, R, count)
        C = matrix_view(work.generalized, o, size, size)
        J = matrix_view(work.generalized, o + q * q, size, size)
        left = matrix_view(work.generalized, vectors_at + _LEFT * q, 1, size)
        pivot = integer_view(work.generalized, vectors_at + _PIVOT * q, size)
        sizes = integer_view(work.generalized, vectors_at + _N_VECTORS * q, N_SIZES)
        y, b, r = vectors[_Y, :size], vectors[_B, :size], vectors[_R, :size]
        if not solve_rough(plan.lapack, C, b, mu, y, r, left, J, pivot, sizes):
            return -1
        _take_forces(plan, work, row, R, count)
        found = _enter_closed(plan, work, row, R, m, count)
        if found == count:
            return count
        count = found
    return -1


@kernel
def direction_of(plan, work, row, k, c):
    """Of near patch k its normal (0) or a tangent, and along what a unit of force along it pulls and pushes."""
    _, p, _ = sl.table_of(plan, row)
    o, q, unknowns = _place(plan, row)
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    rough = matrix_view(work.generalized, _rows_place(o, q, unknowns), padded(p), _N_ROUGH)
    along = _direction(points, rough, k, c)
    if c == 0:
        return along, load3(points[k], sl.PULL), load3(points[k], sl.PUSH)
    return along, load3(rough[k], _TUGGED + 3 * (c - 1)), along


@deferred_kernel()
def push_along(plan, work, row, d, R, count):
    """Add what friction pulls the body, and pushes the other surface, along."""
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    o, q, unknowns = _place(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    rough = matrix_view(work.generalized, _rows_place(o, q, unknowns), padded(p), _N_ROUGH)
    vectors = matrix_view(work.generalized, _vectors_place(o, q, unknowns), _N_VECTORS, q)
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    for a in range(count):
        k = int(V[sl.ORDER, a])
        pulled, pushed = load3(points[k], sl.PULLED), load3(points[k], sl.PUSHED)
        for c in range(1, 3):
            along, force = _direction(points, rough, k, c), vectors[_Y, 3 * a + c]
            pull = along
            if size > 0:
                z = add3(d, load3(points[k], sl.PLACE))
                pull = sub3(pull, tilt(plan, row, z, others, sl.MODAL, along))
                pull = sub3(pull, tilt(plan, row, z, others, sl.DENT, along))
            store3(rough[k], _TUGGED + 3 * (c - 1), pull)
            pulled, pushed = add3(pulled, scale3(force, pull)), add3(pushed, scale3(force, along))
        store3(points[k], sl.PULLED, pulled)
        store3(points[k], sl.PUSHED, pushed)


@kernel
def motions_place(plan, row):
    """Where the rows of all directions (3 m, unknowns) are written for ``rough_stiffness``, and how many unknowns."""
    o, q, unknowns = _place(plan, row)
    return o + 2 * q * q, unknowns


@kernel
def rough_stiffness(plan, work, row, count, K):
    """Subtract B^T J^-1 (what the residuals change by with B), the rows at ``motions_place``."""
    o, q, unknowns = _place(plan, row)
    size, vectors_at = 3 * count, _vectors_place(o, q, unknowns)
    mu = plan.data[row[at.EL_DATA] + sl.FRICTION]
    vectors = matrix_view(work.generalized, vectors_at, _N_VECTORS, q)
    C = matrix_view(work.generalized, o, size, size)
    J = matrix_view(work.generalized, o + q * q, size, size)
    B = matrix_view(work.generalized, o + 2 * q * q, size, unknowns)
    right = matrix_view(work.generalized, o + 2 * q * q + q * unknowns, unknowns, size)
    pivot = integer_view(work.generalized, vectors_at + _PIVOT * q, size)
    sizes = integer_view(work.generalized, vectors_at + _N_VECTORS * q, N_SIZES)
    for a in range(count):
        by_gap, by_slip = weights_of(C, vectors[_R, :size], vectors[_Y, :size], mu, a)
        for i in range(unknowns):
            right[i, 3 * a] = by_gap * B[3 * a, i]
            right[i, 3 * a + 1] = by_slip[0] * B[3 * a + 1, i] + by_slip[1] * B[3 * a + 2, i]
            right[i, 3 * a + 2] = by_slip[2] * B[3 * a + 1, i] + by_slip[3] * B[3 * a + 2, i]
    solve(plan.lapack, J, pivot, sizes, right)
    for j in range(unknowns):
        for c in range(size):
            for i in range(unknowns):
                K[i, j] -= B[c, i] * right[j, c]


@kernel
def remember_patches(plan, work, row, x, m, count):
    """Write into the configuration x where all patches stick, as the forces were found."""
    _, p, _ = sl.table_of(plan, row)
    o, q, unknowns = _place(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    rough = matrix_view(work.generalized, _rows_place(o, q, unknowns), padded(p), _N_ROUGH)
    vectors = matrix_view(work.generalized, _vectors_place(o, q, unknowns), _N_VECTORS, q)
    first = row[at.EL_MEMORY] + at.N_MEMORY_HEAD
    for i in range(p):
        for c in range(PATCH_MEMORY):
            x[first + PATCH_MEMORY * i + c] = 0.0
    for k in range(m):
        place = first + PATCH_MEMORY * int(V[sl.PATCH, k])
        if 0.0 < V[sl.GAP, k] < math.inf:
            store3(x, place, load3(points[k], sl.FOOT))
            x[place + 3] = V[sl.GAP, k]
    for a in range(count):
        k = int(V[sl.ORDER, a])
        place = first + PATCH_MEMORY * int(V[sl.PATCH, k])
        if vectors[_Y, 3 * a] > 0.0:
            anchor = load3(rough[k], _ANCHOR)
            for c in range(1, 3):
                anchor = add3(anchor, scale3(vectors[_R, 3 * a + c], _direction(points, rough, k, c)))
            store3(x, place, anchor)
            x[place + 3] = -1.0
