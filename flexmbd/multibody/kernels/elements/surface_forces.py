"""An elastic surface that touches a shape without friction: the forces on its patches, and what they change with.

Of patch i the centroid is, in the axes of the shape's frame F, at z_i = d + R (x_i + phi_i q), where its distance from
the shape is g_i and the gradient n_i.  The forces f_i >= 0 along n_i move the patches by u_i = sum_j R G_ij R^T n_j f_j
besides, and close the gaps: g_i + n_i . u_i >= 0, of force and gap one zero.  Its gaps taken as linear in u, this is
the least energy V = 1/2 f^T C f, C_ij = n_i . R G_ij R^T n_j, that d, R and q allow, so that all forces are V's slopes,
and it keeps energy: along f_i (n_i + H_i u_i) at z_i, H the gradient's slope, and with the couples u_i x n_i f_i, by
which they act where the patches are.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, dot3, load3, rotate, rotate_back, scale3, store3
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.contact.complementarity import forward, solve_complementary
from flexmbd.multibody.kernels.contact.contact_law import way_to_middle
from flexmbd.multibody.kernels.contact.signed_distance import HALF_SPACE, distance, gradient_variation
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.element import Behaviour, Stiffness, SurfaceElement

_ZERO = (0.0, 0.0, 0.0)


@kernel
def _modal(data, o, n, q):
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
    return add3(load3(data, sl.centroid(p, n, t, i)), _modal(data, sl.displacements(p, n, t, i), n, q))


@kernel
def _most(data, t, n, q):
    """How far the modes q (n,) move any patch at most (m)."""
    found = 0.0
    for k in range(n):
        found += data[t + sl.MOST + k] * abs(q[k])
    return found


@kernel
def _bound_step(plan, row, gap, d, R, rate, spin, fastest):
    """Let no step be so long that what is ``gap`` (m) away can pass through the shape; ``fastest``: m/s of the modes."""
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
def _find_near(plan, work, row, d, R, q):
    """Write the distances of the patches undeformed, and which are near: how many, and a bound of the least gap (m).

    None further than the deepest may be pressed in comes to touch: a patch beside others moves less than these.
    """
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    o = row[at.EL_DATA] + sl.SHAPE
    reach = _most(plan.data, t, n, q)
    ball = distance(plan.data, o, add3(d, rotate(R, load3(plan.data, t + sl.CENTRE))))[0]
    ball -= plan.data[t + sl.RADIUS] + reach
    if ball > 0.0:
        return 0, ball
    far, least = V[sl.FAR], math.inf
    for i in range(p):
        far[i] = distance(plan.data, o, add3(d, rotate(R, load3(plan.data, sl.centroid(p, n, t, i)))))[0]
        least = min(least, far[i])
    bound = reach + max(0.0, reach - least)
    near, count = V[sl.PATCH], 0
    for i in range(p):
        if not far[i] > bound:
            near[count] = i
            count += 1
    return count, least - reach


@kernel
def _place_points(plan, work, row, m, d, R, q):
    """Write gaps, places and normals of the near patches; whether any overlaps."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    o, data = row[at.EL_DATA] + sl.SHAPE, plan.data
    near, gap, point = V[sl.PATCH], V[sl.GAP], matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    overlap = False
    for k in range(m):
        i = int(near[k])
        arm = rotate(R, displaced(data, p, n, t, i, q))
        gap[k], normal = distance(data, o, add3(d, arm))
        store3(point[k], sl.NORMAL, normal)
        store3(point[k], sl.PLACE, arm)
        store3(point[k], sl.OWN_NORMAL, rotate_back(R, normal))
        overlap = overlap or not gap[k] >= 0.0
    return overlap


@kernel
def times_matrix(data, o, v):
    """A matrix (3, 3) by rows times v."""
    return (
        data[o] * v[0] + data[o + 1] * v[1] + data[o + 2] * v[2],
        data[o + 3] * v[0] + data[o + 4] * v[1] + data[o + 5] * v[2],
        data[o + 6] * v[0] + data[o + 7] * v[1] + data[o + 8] * v[2],
    )


@kernel
def _solve(plan, work, row, m):
    """Find the forces of the m near patches; how many touch, the first of ORDER."""
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    near, point, C = V[sl.PATCH], matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT), matrix_view(work.generalized, sl.matrix_place(p, 0), m, m)
    gap = V[sl.GAP]
    for k in range(m):
        if gap[k] != gap[k]:  # where the shape has no gradient
            return -1
        own = load3(point[k], sl.OWN_NORMAL)
        for j in range(k + 1):
            o = sl.flexibility(p, n, t, int(near[k]), int(near[j]))
            C[k, j] = dot3(own, times_matrix(plan.data, o, load3(point[j], sl.OWN_NORMAL)))
            C[j, k] = C[k, j]
    return solve_complementary(
        C, gap, m, V[sl.FORCE], V[sl.LEFT],
        V[sl.INSIDE], V[sl.ORDER], matrix_view(work.generalized, sl.matrix_place(p, 1), m, m),
    )  # fmt: skip


@kernel
def _is_finite(d, R, q):
    total = d[0] + d[1] + d[2] + R[0] + R[4] + R[8]
    for k in range(q.shape[0]):
        total += q[k]
    return math.isfinite(total)


@kernel
def press_patches(plan, work, row, d, R, q):
    """Write the forces of a surface's near patches where the body is at d, R and its modes at q (n,).

    Returns how many are near, how many touch, the first of ORDER, and a bound of the least gap of the undeformed (m).
    -1 touch where there are no forces, which is a fault.
    """
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    if not _is_finite(d, R, q):
        return 0, -1, math.nan
    m, least = _find_near(plan, work, row, d, R, q)
    if m == 0 or not _place_points(plan, work, row, m, d, R, q):
        return m, 0, least
    count = _solve(plan, work, row, m)
    if count < 0:
        if plan.flag[0] == 0:
            plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]
        return m, -1, least
    near, order, force = V[sl.PATCH], V[sl.ORDER], V[sl.FORCE]
    point, o, curved = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT), row[at.EL_DATA] + sl.SHAPE, plan.data[row[at.EL_DATA] + sl.SHAPE]
    for a in range(count):
        k = int(order[a])
        u = _ZERO
        for b in range(count):
            j = int(order[b])
            G = sl.flexibility(p, n, t, int(near[k]), int(near[j]))
            u = add3(u, scale3(force[j], times_matrix(plan.data, G, load3(point[j], sl.OWN_NORMAL))))
        store3(point[k], sl.RESIDUAL, u)
        direction = load3(point[k], sl.NORMAL)
        if curved != HALF_SPACE:
            z = add3(d, load3(point[k], sl.PLACE))
            direction = add3(direction, gradient_variation(plan.data, o, z, rotate(R, u)))
        store3(point[k], sl.DIRECTION, direction)
    return m, count, least


@kernel
def _push_modes(data, o, n, force, out):
    """Add what a force on a patch, in the body's axes, does on its modes, whose rows (3, n) begin at ``o``."""
    for k in range(n):
        out[k] += data[o + k] * force[0] + data[o + n + k] * force[1] + data[o + 2 * n + k] * force[2]


@kernel
def sum_forces(plan, work, row, R, count):
    """Force on the body and torque about its origin, in F's axes, of what `press_patches` found.

    The modes' are written to ``modal_forces``; NaN where there are none.
    """
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    out = work.generalized[sl.modal_place(p, n) : sl.modal_place(p, n) + n]
    for k in range(n):
        out[k] = 0.0 if count >= 0 else math.nan
    if count < 0:
        return (math.nan, math.nan, math.nan), (math.nan, math.nan, math.nan)
    near, order, f = V[sl.PATCH], V[sl.ORDER], V[sl.FORCE]
    point, total, torque = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT), _ZERO, _ZERO
    for a in range(count):
        k = int(order[a])
        force, push = scale3(f[k], load3(point[k], sl.DIRECTION)), scale3(f[k], load3(point[k], sl.NORMAL))
        couple = cross3(rotate(R, load3(point[k], sl.RESIDUAL)), push)
        total, torque = add3(total, force), add3(torque, add3(cross3(load3(point[k], sl.PLACE), force), couple))
        _push_modes(plan.data, sl.displacements(p, n, t, int(near[k])), n, rotate_back(R, force), out)
    return total, torque


@kernel
def surface_wrench(plan, work, row, motion, q, q_rate):
    """As ``sum_forces``; bounds the next step."""
    d, R, rate, spin = motion
    t, _, n = sl.table_of(plan, row)
    _, count, least = press_patches(plan, work, row, d, R, q)
    _bound_step(plan, row, least, d, R, rate, spin, _most(plan.data, t, n, q_rate))
    return sum_forces(plan, work, row, R, count)


@kernel
def surface_energy(plan, work, row, d, R, q):
    """What the residual flexibility of a surface stores (J)."""
    _, p, _ = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    _, count, _ = press_patches(plan, work, row, d, R, q)
    if count < 0:
        return math.nan
    order, f, gap = V[sl.ORDER], V[sl.FORCE], V[sl.GAP]
    energy = 0.0
    for a in range(count):
        k = int(order[a])
        energy -= 0.5 * f[k] * gap[k]
    return energy


ELASTIC_SURFACE = SurfaceElement(
    Behaviour(
        "contacts of elastic surfaces, which are stiffer than at the start", Stiffness.UNSEEN, lets_go=True,
        undefined="a patch is on the core of the shape, where its distance has no direction, or its residual "
        "flexibility is none: take larger patches or fewer modes",
    ), surface_energy,
)  # fmt: skip

# ------------------------------------------------------------------------------------------------------- the tangent


@kernel
def _unit(c):
    return (1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0)


@kernel
def _write_rows(plan, work, row, R, count, K):
    """Write B, whose rows times a motion (translation and turn in F's axes, modes) are what the gaps change by.

    At fixed forces, what the body's turn changes of C included, whose second derivative is added to K; of curved
    shapes what moves along them is left out, of the order of the dent over the radius.
    """
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    near, order, f = V[sl.PATCH], V[sl.ORDER], V[sl.FORCE]
    point, B = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT), matrix_view(work.generalized, sl.rows_place(p), count, 6 + n)
    for a in range(count):
        k = int(order[a])
        own, u = load3(point[k], sl.OWN_NORMAL), load3(point[k], sl.RESIDUAL)
        turned = cross3(u, own)
        for b in range(count):
            j = int(order[b])
            G = sl.flexibility(p, n, t, int(near[j]), int(near[k]))
            other = load3(point[j], sl.OWN_NORMAL)
            turned = add3(turned, cross3(scale3(f[j], times_matrix(plan.data, G, own)), other))
            for c in range(3):
                tilted = rotate_back(R, cross3(_unit(c), load3(point[k], sl.NORMAL)))
                couple = rotate(R, cross3(times_matrix(plan.data, G, tilted), other))
                for r in range(3):
                    K[3 + r, 3 + c] -= f[j] * f[k] * couple[r]
        direction = load3(point[k], sl.DIRECTION)
        store3(B[a], 0, direction)
        store3(B[a], 3, add3(cross3(load3(point[k], sl.PLACE), direction), rotate(R, turned)))
        for i in range(n):
            B[a, 6 + i] = 0.0
        _push_modes(plan.data, sl.displacements(p, n, t, int(near[k])), n, rotate_back(R, direction), B[a, 6:])


@kernel
def _add_geometric(plan, work, row, k, R, d, column, dz, turn, moved, K):
    """Add to a column of K what the force of near patch k, at fixed size, changes with.

    For a motion of its centroid by ``dz``, with a turn and a displacement ``moved`` by the modes, in F's axes.
    """
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    point, o, f = matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT), row[at.EL_DATA] + sl.SHAPE, V[sl.FORCE][k]
    force = scale3(f, load3(point[k], sl.DIRECTION))
    u = rotate(R, load3(point[k], sl.RESIDUAL))
    bent = _ZERO
    if plan.data[o] != HALF_SPACE:
        bent = scale3(f, gradient_variation(plan.data, o, add3(d, load3(point[k], sl.PLACE)), dz))
    place, push = load3(point[k], sl.PLACE), scale3(f, load3(point[k], sl.NORMAL))
    torque = add3(cross3(add3(place, u), bent), cross3(add3(cross3(turn, place), moved), force))
    torque = add3(torque, cross3(cross3(turn, u), push))
    for c in range(3):
        K[c, column] += bent[c]
        K[3 + c, column] += torque[c]
    patch = int(V[sl.PATCH][k])
    in_body = rotate_back(R, add3(bent, cross3(force, turn)))
    if in_body[0] == 0.0 and in_body[1] == 0.0 and in_body[2] == 0.0:
        return
    _push_modes(plan.data, sl.displacements(p, n, t, patch), n, in_body, K[6:, column])


@kernel
def write_stiffness(plan, work, row, d, R, m, count):
    """Write K: what force, torque and modal forces change by for a translation, a turn (F's axes) and the modes.

    Of ``m`` near patches of which ``count`` touch, as `press_patches` left them.
    """
    t, p, n = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    K = matrix_view(work.generalized, sl.stiffness_place(p, n), 6 + n, 6 + n)
    K[:, :] = 0.0
    _write_rows(plan, work, row, R, count, K)
    X = matrix_view(work.generalized, sl.rows_place(p), count, 6 + n)
    for i in range(6 + n):
        forward(matrix_view(work.generalized, sl.matrix_place(p, 1), m, m), count, X[:, i])
    for a in range(count):
        for i in range(6 + n):
            for j in range(6 + n):
                K[i, j] -= X[a, i] * X[a, j]
    order, near, point = V[sl.ORDER], V[sl.PATCH], matrix_view(work.generalized, sl.points_place(p), p, sl.N_POINT)
    for a in range(count):
        k = int(order[a])
        place = load3(point[k], sl.PLACE)
        for c in range(3):
            e = _unit(c)
            _add_geometric(plan, work, row, k, R, d, c, e, _ZERO, _ZERO, K)
            _add_geometric(plan, work, row, k, R, d, 3 + c, cross3(e, place), e, _ZERO, K)
        o = sl.displacements(p, n, t, int(near[k]))
        for i in range(n):
            moved = rotate(R, (plan.data[o + i], plan.data[o + n + i], plan.data[o + 2 * n + i]))
            _add_geometric(plan, work, row, k, R, d, 6 + i, moved, _ZERO, moved, K)
