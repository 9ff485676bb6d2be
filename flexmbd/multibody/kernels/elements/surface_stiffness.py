"""What the forces of an elastic surface change by: a matrix K over a translation, a turn and the modes.

f = -C^-1 g on what touches, so that K = -B^T C^-1 B, B what the gaps change by at fixed forces, and what fixed forces
change by as they turn.  It is exact where the shape is plane and rigid; else what is left out is of the order of the
dent over the radius, or over the size of the other surface's patches.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, rotate, rotate_back, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.complementarity import forward
from flexmbd.multibody.kernels.contact.signed_distance import HALF_SPACE, gradient_variation
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import push_modes, push_other_modes, times_matrix
from flexmbd.multibody.kernels.elements.surface_points import weighted_row

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _unit(c):
    return (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)


@kernel
def _write_rows(plan, work, row, R, count, K):
    """Write B; what the body's turn changes of C is included, whose second derivative is added to K."""
    t, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    points = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), p, size)
    B = matrix_view(work.generalized, sl.rows_place(p, size), count, 6 + n + n_other)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        own, f = load3(points[k], sl.OWN_NORMAL), V[sl.FORCE, k]
        turned = cross3(load3(points[k], sl.RESIDUAL), own)
        for b in range(count):
            j = int(V[sl.ORDER, b])
            G = sl.flexibility(p, n, t, int(V[sl.PATCH, j]), int(V[sl.PATCH, k]))
            other = load3(points[j], sl.OWN_NORMAL)
            turned = add3(turned, cross3(scale3(V[sl.FORCE, j], times_matrix(plan.data, G, own)), other))
            for c in range(3):
                tilted = rotate_back(R, cross3(_unit(c), load3(points[k], sl.NORMAL)))
                couple = rotate(R, cross3(times_matrix(plan.data, G, tilted), other))
                for r in range(3):
                    K[3 + r, 3 + c] -= V[sl.FORCE, j] * f * couple[r]
        pull = load3(points[k], sl.PULL)
        store3(B[a], 0, pull)
        store3(B[a], 3, add3(cross3(load3(points[k], sl.PLACE), pull), rotate(R, turned)))
        for i in range(6, 6 + n + n_other):
            B[a, i] = 0.0
        push_modes(plan.data, sl.displacements(p, n, t, int(V[sl.PATCH, k])), n, rotate_back(R, pull), B[a, 6:])
        if n_other > 0:
            push_other_modes(plan, row, weights[k], scale3(-1.0, load3(points[k], sl.PUSH)), B[a, 6 + n :])


@kernel
def _add_geometric(plan, work, row, k, R, column, dz, turn, moved, K):
    """Add to a column of K what the force of near patch k, at fixed size, changes with.

    For a motion of its centroid against the shape by ``dz``, with a turn and a displacement ``moved`` by its own modes,
    in F's axes.
    """
    t, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    points = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), p, size)
    o, f = row[at.EL_DATA] + sl.SHAPE, V[sl.FORCE, k]
    force, push = scale3(f, load3(points[k], sl.PULL)), scale3(f, load3(points[k], sl.NORMAL))
    u, place = rotate(R, load3(points[k], sl.RESIDUAL)), load3(points[k], sl.PLACE)
    bent = _ZERO
    if plan.data[o] != HALF_SPACE:
        bent = scale3(f, gradient_variation(plan.data, o, load3(points[k], sl.FOOT), dz))
    torque = add3(cross3(add3(place, u), bent), cross3(add3(cross3(turn, place), moved), force))
    torque = add3(torque, cross3(cross3(turn, u), push))
    for c in range(3):
        K[c, column] += bent[c]
        K[3 + c, column] += torque[c]
    own = rotate_back(R, add3(bent, cross3(force, turn)))
    if own[0] != 0.0 or own[1] != 0.0 or own[2] != 0.0:
        push_modes(plan.data, sl.displacements(p, n, t, int(V[sl.PATCH, k])), n, own, K[6:, column])
    if n_other > 0 and (bent[0] != 0.0 or bent[1] != 0.0 or bent[2] != 0.0):
        push_other_modes(plan, row, weights[k], scale3(-1.0, bent), K[6 + n :, column])


@kernel
def write_stiffness(plan, work, row, R, m, count):
    """Write K: what force, torque and modal forces change by for a translation, a turn (F's axes) and the modes.

    Of ``m`` near patches of which ``count`` touch, as `press_patches` left them.
    """
    t, p, n = sl.table_of(plan, row)
    t_other, size, n_other = sl.other_of(plan, row)
    unknowns = 6 + n + n_other
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    points = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), p, size)
    K = matrix_view(work.generalized, sl.stiffness_place(p, size, unknowns), unknowns, unknowns)
    B = matrix_view(work.generalized, sl.rows_place(p, size), count, unknowns)
    L = matrix_view(work.generalized, sl.matrix_place(p, 1), m, m)
    K[:, :] = 0.0
    _write_rows(plan, work, row, R, count, K)
    for i in range(unknowns):
        forward(L, count, B[:, i])
    for a in range(count):
        for i in range(unknowns):
            for j in range(unknowns):
                K[i, j] -= B[a, i] * B[a, j]
    for a in range(count):
        k = int(V[sl.ORDER, a])
        place = load3(points[k], sl.PLACE)
        for c in range(3):
            e = _unit(c)
            _add_geometric(plan, work, row, k, R, c, e, _ZERO, _ZERO, K)
            _add_geometric(plan, work, row, k, R, 3 + c, cross3(e, place), e, _ZERO, K)
        o = sl.displacements(p, n, t, int(V[sl.PATCH, k]))
        for i in range(n):
            moved = rotate(R, (plan.data[o + i], plan.data[o + n + i], plan.data[o + 2 * n + i]))
            _add_geometric(plan, work, row, k, R, 6 + i, moved, _ZERO, moved, K)
        for i in range(n_other):
            moved = weighted_row(plan.data, t_other, size, n_other, weights[k], i)
            _add_geometric(plan, work, row, k, R, 6 + n + i, scale3(-1.0, moved), _ZERO, _ZERO, K)
