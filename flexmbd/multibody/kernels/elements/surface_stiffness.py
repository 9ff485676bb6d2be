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
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.lanes import LANES, lanes, padded, plus_product, spread, sum_of
from flexmbd.multibody.kernels.contact.cholesky import ROWS, forward_rows, less_products
from flexmbd.multibody.kernels.contact.signed_distance import HALF_SPACE, gradient_variation
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_friction import direction_of, motions_place, rough_stiffness
from flexmbd.multibody.kernels.elements.surface_points import push_modes, push_other_modes, weighted_row
from flexmbd.multibody.kernels.elements.surface_residual import write_couples

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _unit(c):
    return (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)


@kernel
def _turned(V, k, own):
    """What a unit force on near patch k, in the body's axes, changes the couple of all residuals by."""
    return (
        V[sl.COUPLE, k] * own[0] + V[sl.COUPLE + 1, k] * own[1] + V[sl.COUPLE + 2, k] * own[2],
        V[sl.COUPLE + 3, k] * own[0] + V[sl.COUPLE + 4, k] * own[1] + V[sl.COUPLE + 5, k] * own[2],
        V[sl.COUPLE + 6, k] * own[0] + V[sl.COUPLE + 7, k] * own[1] + V[sl.COUPLE + 8, k] * own[2],
    )


@kernel
def write_row(plan, work, row, R, k, direction, pull, push, out):
    """Write what moves near patch k along a direction, at fixed forces, by a motion and by the modes.

    A unit of force along it pulls the body and pushes the other surface along two others (F's axes).
    """
    t, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    own = rotate_back(R, direction)
    turned = add3(cross3(load3(points[k], sl.OWN_RESIDUAL), own), _turned(V, k, own))
    store3(out, 0, pull)
    store3(out, 3, add3(cross3(load3(points[k], sl.PLACE), pull), rotate(R, turned)))
    for i in range(6, out.shape[0]):
        out[i] = 0.0
    push_modes(plan.data, p, n, t, int(V[sl.PATCH, k]), rotate_back(R, pull), out[6:])
    if n_other > 0:
        push_other_modes(plan, row, weights[k], scale3(-1.0, push), out[6 + n :])


@kernel
def _add_turns(plan, work, row, R, count, K):
    """Add to K what torque and couples change by as the body turns, at fixed forces."""
    _, p, _ = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        force, push = load3(points[k], sl.PULLED), load3(points[k], sl.FORCED)
        place, u = load3(points[k], sl.PLACE), rotate(R, load3(points[k], sl.OWN_RESIDUAL))
        for c in range(3):
            e = _unit(c)
            couple = rotate(R, _turned(V, k, rotate_back(R, cross3(e, push))))
            torque = add3(cross3(cross3(e, place), force), cross3(cross3(e, u), push))
            for r in range(3):
                K[3 + r, 3 + c] += torque[r] - couple[r]


@kernel
def write_normal_row(plan, work, row, R, k, out):
    """As ``write_row``, of near patch k along its normal."""
    _, p, _ = sl.table_of(plan, row)
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    normal, pull, push = load3(points[k], sl.NORMAL), load3(points[k], sl.PULL), load3(points[k], sl.PUSH)
    write_row(plan, work, row, R, k, normal, pull, push, out)


@kernel
def subtract_given_way(values, factors, rows, to, count, unknowns):
    """Subtract B^T C^-1 B from K, that begins at ``to``, by the factor of C and B (count, `padded` unknowns)."""
    width = padded(unknowns)
    forward_rows(values, factors, count, values, rows, width)
    for i in range(0, unknowns, ROWS):
        less_products(values, to + width * i, values, rows + i, width, values, rows, width, count, 0)


@kernel
def _add_smooth(plan, work, row, R, count):
    """Subtract B^T C^-1 B from K."""
    _, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    unknowns, rows = 6 + n + n_other, sl.rows_place(p, size)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    B = matrix_view(work.generalized, rows, count, padded(unknowns))
    for a in range(count):
        write_normal_row(plan, work, row, R, int(V[sl.ORDER, a]), B[a])
    to = sl.stiffness_place(p, size, unknowns)
    subtract_given_way(work.generalized, sl.matrix_place(p, 1), rows, to, count, unknowns)


@kernel
def _add_moved_arms(plan, work, row, R, m, K):
    """Add to K what the torque changes by as the modes move the patches under their forces, and the modes' by turns."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    o, P, data = sl.displacements(p, n, t), padded(p), plan.data
    for i in range(n):
        x0 = x1 = x2 = y0 = y1 = y2 = spread(0.0)
        for b in range(0, m, LANES):
            c = o + i * P + int(V[sl.PATCH, b])
            u0, u1, u2 = lanes(data, c), lanes(data, c + n * P), lanes(data, c + 2 * n * P)
            f0, f1, f2 = lanes(V[sl.OWN_PULLED], b), lanes(V[sl.OWN_PULLED + 1], b), lanes(V[sl.OWN_PULLED + 2], b)
            x0, y0 = plus_product(x0, u1, f2), plus_product(y0, u2, f1)
            x1, y1 = plus_product(x1, u2, f0), plus_product(y1, u0, f2)
            x2, y2 = plus_product(x2, u0, f1), plus_product(y2, u1, f0)
        turned = rotate(R, (sum_of(x0) - sum_of(y0), sum_of(x1) - sum_of(y1), sum_of(x2) - sum_of(y2)))
        for c in range(3):
            K[3 + c, 6 + i] += turned[c]
            K[6 + i, 3 + c] += turned[c]


@deferred_kernel()
def _add_rough(plan, work, row, R, count, K):
    """Subtract B^T J^-1 (the residuals' change by B)."""
    _, p, _ = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    first, unknowns = motions_place(plan, row)
    B = matrix_view(work.generalized, first, 3 * count, unknowns)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        for c in range(3):
            along, pull, push = direction_of(plan, work, row, k, c)
            write_row(plan, work, row, R, k, along, pull, push, B[3 * a + c])
    rough_stiffness(plan, work, row, count, K)


@kernel
def _add_bent(plan, work, row, k, R, column, dz, K):
    """Add to a column of K what the force of near patch k, at fixed size, bends with the gradient.

    For a motion of its centroid against the shape by ``dz``, in F's axes.
    """
    t, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    o = row[at.EL_DATA] + sl.SHAPE
    bent = scale3(V[sl.FORCE, k], gradient_variation(plan.data, o, load3(points[k], sl.FOOT), dz))
    arm = add3(load3(points[k], sl.PLACE), rotate(R, load3(points[k], sl.OWN_RESIDUAL)))
    torque = cross3(arm, bent)
    for c in range(3):
        K[c, column] += bent[c]
        K[3 + c, column] += torque[c]
    push_modes(plan.data, p, n, t, int(V[sl.PATCH, k]), rotate_back(R, bent), K[6 : 6 + n, column])
    if n_other > 0:
        push_other_modes(plan, row, weights[k], scale3(-1.0, bent), K[6 + n :, column])


@kernel
def _add_bends(plan, work, row, k, R, K):
    """The same for all unknowns."""
    t, p, n = sl.table_of(plan, row)
    t_other, size, n_other = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    place = load3(points[k], sl.PLACE)
    for c in range(3):
        e = _unit(c)
        _add_bent(plan, work, row, k, R, c, e, K)
        _add_bent(plan, work, row, k, R, 3 + c, cross3(e, place), K)
    o, P = sl.displacements(p, n, t) + int(V[sl.PATCH, k]), padded(p)
    for i in range(n):
        c = o + i * P
        moved = rotate(R, (plan.data[c], plan.data[c + n * P], plan.data[c + 2 * n * P]))
        _add_bent(plan, work, row, k, R, 6 + i, moved, K)
    for i in range(n_other):
        moved = weighted_row(plan.data, t_other, size, n_other, weights[k], i)
        _add_bent(plan, work, row, k, R, 6 + n + i, scale3(-1.0, moved), K)


@kernel
def write_turns(plan, work, row, R, m, count):
    """Write K of forces at rest: what force, torque and modal forces change by as these turn and bend."""
    _, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    unknowns = 6 + n + n_other
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    K = matrix_view(work.generalized, sl.stiffness_place(p, size, unknowns), unknowns, padded(unknowns))
    K[:, :] = 0.0
    for a in range(count):
        write_couples(plan, work, row, int(V[sl.ORDER, a]), m)
    _add_turns(plan, work, row, R, count, K)
    _add_moved_arms(plan, work, row, R, m, K)
    if plan.data[row[at.EL_DATA] + sl.SHAPE] != HALF_SPACE:
        for a in range(count):
            _add_bends(plan, work, row, int(V[sl.ORDER, a]), R, K)


@kernel
def write_stiffness(plan, work, row, R, m, count):
    """Write K: what force, torque and modal forces change by for a translation, a turn (F's axes) and the modes.

    Of the near patches on ``m`` slots, of which ``count`` touch, as `press_patches` left them.
    """
    write_turns(plan, work, row, R, m, count)
    if plan.data[row[at.EL_DATA] + sl.FRICTION] > 0.0:
        _, p, n = sl.table_of(plan, row)
        _, size, n_other = sl.other_of(plan, row)
        unknowns = 6 + n + n_other
        K = matrix_view(work.generalized, sl.stiffness_place(p, size, unknowns), unknowns, padded(unknowns))
        _add_rough(plan, work, row, R, count, K)
    else:
        _add_smooth(plan, work, row, R, count)
