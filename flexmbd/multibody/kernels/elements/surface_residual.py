"""What forces on the patches of elastic surfaces move these by, by their residual flexibility."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, load3, scale3, store3, sub3
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.elements import surface_layout as sl

_ZERO = (0.0, 0.0, 0.0)


@kernel
def times_matrix(data, o, v):
    """A matrix (3, 3) by rows times v."""
    return (
        data[o] * v[0] + data[o + 1] * v[1] + data[o + 2] * v[2],
        data[o + 3] * v[0] + data[o + 4] * v[1] + data[o + 5] * v[2],
        data[o + 6] * v[0] + data[o + 7] * v[1] + data[o + 8] * v[2],
    )


@kernel
def own_residual(plan, work, row, i, count):
    """What the residual flexibility moves patch i by (m), in the body's axes."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    points = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    u = _ZERO
    for a in range(count):
        k = int(V[sl.ORDER, a])
        G = sl.flexibility(p, n, t, i, int(V[sl.PATCH, k]))
        u = add3(u, times_matrix(plan.data, G, load3(points[k], sl.OWN_FORCE)))
    return u


@kernel
def dent_other(plan, work, row, count):
    """Write the forces on the patches of the other surface, and how its residual flexibility moves them."""
    _, p, _ = sl.table_of(plan, row)
    t, size, n = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    points = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), p, size)
    others = matrix_view(work.generalized, sl.others_place(p, size), size, sl.N_OTHER)
    for i in range(size):
        load = _ZERO
        for a in range(count):
            k = int(V[sl.ORDER, a])
            if weights[k, i] != 0.0:
                load = sub3(load, scale3(weights[k, i], load3(points[k], sl.FORCED)))
        store3(others[i], sl.LOAD, load)
    for i in range(size):
        dent = _ZERO
        for j in range(size):
            load = load3(others[j], sl.LOAD)
            if load[0] != 0.0 or load[1] != 0.0 or load[2] != 0.0:
                dent = add3(dent, times_matrix(plan.data, sl.flexibility(size, n, t, i, j), load))
        store3(others[i], sl.DENT, dent)
