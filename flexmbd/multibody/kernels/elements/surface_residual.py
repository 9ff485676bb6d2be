"""How the residual flexibility moves the patches of an elastic surface, and of another one that it touches."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import scale3
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.lanes import LANES, lanes, padded, plus_product, put_lanes, spread, sum_of
from flexmbd.multibody.kernels.elements import surface_layout as sl


@kernel
def times_flexibility(data, p, n, t, i, j, v):
    """What a force v on patch j moves patch i by (m), in the body's axes."""
    o, s = sl.flexibility(p, n, t, i, j), sl.apart(p)
    return (
        data[o] * v[0] + data[o + s] * v[1] + data[o + 2 * s] * v[2],
        data[o + 3 * s] * v[0] + data[o + 4 * s] * v[1] + data[o + 5 * s] * v[2],
        data[o + 6 * s] * v[0] + data[o + 7 * s] * v[1] + data[o + 8 * s] * v[2],
    )


@kernel
def own_residual(plan, work, row, i, m):
    """What the residual flexibility moves patch i by (m) under the forces on m slots, in the body's axes."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    data, s = plan.data, sl.apart(p)
    first, second, third = V[sl.OWN_FORCE], V[sl.OWN_FORCE + 1], V[sl.OWN_FORCE + 2]
    o = sl.flexibility(p, n, t, i, 0)
    x = y = z = spread(0.0)
    for b in range(0, m, LANES):
        c = o + int(V[sl.PATCH, b])
        f0, f1, f2 = lanes(first, b), lanes(second, b), lanes(third, b)
        x = plus_product(x, lanes(data, c), f0)
        y = plus_product(y, lanes(data, c + 3 * s), f0)
        z = plus_product(z, lanes(data, c + 6 * s), f0)
        x = plus_product(x, lanes(data, c + s), f1)
        y = plus_product(y, lanes(data, c + 4 * s), f1)
        z = plus_product(z, lanes(data, c + 7 * s), f1)
        x = plus_product(x, lanes(data, c + 2 * s), f2)
        y = plus_product(y, lanes(data, c + 5 * s), f2)
        z = plus_product(z, lanes(data, c + 8 * s), f2)
    return sum_of(x), sum_of(y), sum_of(z)


@kernel
def write_own_flexibility(plan, work, row, m):
    """Write the upper triangle of C, in the rows of slots with a gap, of the surface's own residual flexibility."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    data, s = plan.data, sl.apart(p)
    first, second, third = V[sl.OWN_NORMAL], V[sl.OWN_NORMAL + 1], V[sl.OWN_NORMAL + 2]
    C = sl.matrix_place(p, 0)
    for k in range(m):
        if V[sl.GAP, k] < math.inf:
            a0, a1, a2 = spread(first[k]), spread(second[k]), spread(third[k])
            o = sl.flexibility(p, n, t, int(V[sl.PATCH, k]), 0)
            for b in range(k // LANES * LANES, m, LANES):
                c = o + int(V[sl.PATCH, b])
                n0, n1, n2 = lanes(first, b), lanes(second, b), lanes(third, b)
                x = plus_product(spread(0.0), lanes(data, c), n0)
                y = plus_product(spread(0.0), lanes(data, c + 3 * s), n0)
                z = plus_product(spread(0.0), lanes(data, c + 6 * s), n0)
                x = plus_product(x, lanes(data, c + s), n1)
                y = plus_product(y, lanes(data, c + 4 * s), n1)
                z = plus_product(z, lanes(data, c + 7 * s), n1)
                x = plus_product(x, lanes(data, c + 2 * s), n2)
                y = plus_product(y, lanes(data, c + 5 * s), n2)
                z = plus_product(z, lanes(data, c + 8 * s), n2)
                x = plus_product(plus_product(plus_product(spread(0.0), a2, z), a1, y), a0, x)
                put_lanes(work.generalized, C + m * k + b, x)


@kernel
def write_couples(plan, work, row, k, m):
    """Write, of near patch k, what the sum of own residuals x own forces changes by for a unit force on it (9,)."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    data, s = plan.data, sl.apart(p)
    first, second, third = V[sl.OWN_FORCE], V[sl.OWN_FORCE + 1], V[sl.OWN_FORCE + 2]
    o = sl.flexibility(p, n, t, int(V[sl.PATCH, k]), 0)
    for c in range(3):
        # a force along axis c of patch k moves the others by row c of its own flexibility under theirs
        x0 = x1 = x2 = y0 = y1 = y2 = spread(0.0)
        for b in range(0, m, LANES):
            place = o + 3 * c * s + int(V[sl.PATCH, b])
            u0, u1, u2 = lanes(data, place), lanes(data, place + s), lanes(data, place + 2 * s)
            f0, f1, f2 = lanes(first, b), lanes(second, b), lanes(third, b)
            x0, y0 = plus_product(x0, u1, f2), plus_product(y0, u2, f1)
            x1, y1 = plus_product(x1, u2, f0), plus_product(y1, u0, f2)
            x2, y2 = plus_product(x2, u0, f1), plus_product(y2, u1, f0)
        V[sl.COUPLE + c, k] = sum_of(x0) - sum_of(y0)
        V[sl.COUPLE + 3 + c, k] = sum_of(x1) - sum_of(y1)
        V[sl.COUPLE + 6 + c, k] = sum_of(x2) - sum_of(y2)


@kernel
def move_by(data, p, n, t, i, force, vectors, first):
    """Add to vectors of all patches, by rows from ``first``, what a force on patch i moves them by."""
    s = sl.apart(p)
    f0, f1, f2 = spread(force[0]), spread(force[1]), spread(force[2])
    o = sl.flexibility(p, n, t, i, 0)
    for a in range(3):
        moved = vectors[first + a]
        for b in range(0, padded(p), LANES):
            c = o + a * s + b  # of patch i under forces on others, turned
            u = plus_product(lanes(moved, b), lanes(data, c), f0)
            u = plus_product(u, lanes(data, c + 3 * s), f1)
            put_lanes(moved, b, plus_product(u, lanes(data, c + 6 * s), f2))


@kernel
def clear_others(others, first):
    """Set three vectors of the other surface's patches, from a row, to zero."""
    for b in range(0, others.shape[1], LANES):
        for a in range(3):
            put_lanes(others[first + a], b, spread(0.0))


@kernel
def share_force(others, first, w, force):
    """Add to vectors of the other surface's patches, from a row, a force by weights."""
    for a in range(3):
        one, share = others[first + a], spread(force[a])
        for b in range(0, others.shape[1], LANES):
            put_lanes(one, b, plus_product(lanes(one, b), share, lanes(w, b)))


@kernel
def dent_by_point(plan, work, row, k, along):
    """Write at LOAD how a unit of force on near patch k along a direction moves the patches of the other surface."""
    _, p, _ = sl.table_of(plan, row)
    t, size, n = sl.other_of(plan, row)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    clear_others(others, sl.LOAD)
    for j in range(size):
        if weights[k, j] != 0.0:
            move_by(plan.data, size, n, t, j, scale3(weights[k, j], along), others, sl.LOAD)


@kernel
def dent_other(plan, work, row, count):
    """Write the forces on the patches of the other surface, and how its residual flexibility moves them."""
    _, p, _ = sl.table_of(plan, row)
    t, size, n = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    clear_others(others, sl.LOAD)
    clear_others(others, sl.DENT)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        force = points[k, sl.FORCED], points[k, sl.FORCED + 1], points[k, sl.FORCED + 2]
        share_force(others, sl.LOAD, weights[k], scale3(-1.0, force))
    for j in range(size):
        load = sl.at3(others, sl.LOAD, j)
        if load[0] != 0.0 or load[1] != 0.0 or load[2] != 0.0:
            move_by(plan.data, size, n, t, j, load, others, sl.DENT)
