"""An elastic surface that touches a shape, or another elastic surface, without friction: the forces on its patches.

Of patch i the centroid is, in the axes of the shape's frame F, at z_i = d + R (x_i + phi_i q), where its distance from
the shape is g_i and the gradient n_i.  The forces f_i >= 0 along n_i move it by u_i = sum_j W_ij n_j f_j against the
shape besides, and close the gaps: g_i + n_i . u_i >= 0, of force and gap one zero.  W_ij = R G_ij R^T is the residual
flexibility, with that of the other surface by the points' weights (``surface_points``).

The gaps taken as linear in u, V = 1/2 f^T C f, C_ij = n_i . W_ij n_j, is the least energy that d, R and the modes
allow, so that all forces are V's slopes, and it keeps energy: on the body f_i m_i at z_i, where m_i is
(I - grad D)^T (n_i + H_i u_i), H the gradient's slope and D the displacement of the other surface; on that, by weights,
f_i (n_i + H_i u_i); and couples u_i x n_i f_i, of the body's own u_i, by which forces act where the patches are.
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
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.lanes import padded
from flexmbd.multibody.kernels.contact.cholesky import factor
from flexmbd.multibody.kernels.contact.complementarity import solve_complementary
from flexmbd.multibody.kernels.contact.signed_distance import HALF_SPACE, gradient_variation
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.element import Behaviour, Stiffness, SurfaceElement
from flexmbd.multibody.kernels.elements.surface_friction import add_friction, push_along
from flexmbd.multibody.kernels.elements.surface_points import (
    bound_step,
    farthest,
    find_near,
    mean_of,
    place_points,
    push_all,
    push_others,
    tilt,
)
from flexmbd.multibody.kernels.elements.surface_residual import (
    clear_others,
    dent_by_point,
    dent_other,
    own_residual,
    share_force,
    write_own_flexibility,
)
from flexmbd.round_off import EPSILON

_ZERO = (0.0, 0.0, 0.0)
_STEPS, _DOUBLINGS = 100, 30


@kernel
def _add_other_flexibility(plan, work, row, m):
    """Add to C the residual flexibility of the other surface."""
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    C = matrix_view(work.generalized, sl.matrix_place(p, 0), m, m)
    for k in range(m):
        if V[sl.GAP, k] < math.inf:
            dent_by_point(plan, work, row, k, load3(points[k], sl.NORMAL))
            for j in range(k, m):
                if V[sl.GAP, j] < math.inf:
                    C[k, j] += dot3(load3(points[j], sl.NORMAL), mean_of(others, sl.LOAD, weights[j]))


@kernel
def point_depth(plan, row, N):
    """How deep a law of one point is pressed by N (m), what that changes by with N (m/N), and what it stores (J)."""
    k, p = plan.data[row[at.EL_DATA] + sl.LAW], plan.data[row[at.EL_DATA] + sl.EXPONENT]
    depth = (N / k) ** (1.0 / p)
    return depth, depth / (p * N) if N > 0.0 else math.inf, N * depth / (p + 1.0)


@kernel
def _press_point(plan, row, gap, c):
    """N with gap + c N + the law's depth = 0, and what that depth changes by; NaN where there is none.

    c may be negative, where the law's depth has a part that the modes give way by already: then there is an answer as
    long as the sum grows with N.
    """
    k, p = plan.data[row[at.EL_DATA] + sl.LAW], plan.data[row[at.EL_DATA] + sl.EXPONENT]
    N = k * (-gap) ** p
    low, high = 0.0, N
    for _ in range(_DOUBLINGS):
        if c >= 0.0 or gap + c * high + point_depth(plan, row, high)[0] >= 0.0:
            break
        high *= 2.0
    for _ in range(_STEPS):
        depth, slope, _ = point_depth(plan, row, N)
        excess = gap + c * N + depth
        if excess > 0.0:
            high = min(high, N)
        else:
            low = max(low, N)
        if c + slope <= 0.0:
            return math.nan, math.nan
        step = excess / (c + slope)
        if abs(step) <= EPSILON * N or not high > low:
            return N, slope
        N -= step
        if not low < N < high:
            N = 0.5 * (low + high)
    return N, point_depth(plan, row, N)[1]


@kernel
def _solve(plan, work, row, m):
    """Find the forces of the near patches on m slots; how many touch, the first of ORDER."""
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    for k in range(m):
        if V[sl.GAP, k] != V[sl.GAP, k]:  # where the shape has no gradient
            return -1
    write_own_flexibility(plan, work, row, m)
    if size > 0:
        _add_other_flexibility(plan, work, row, m)
    C = matrix_view(work.generalized, sl.matrix_place(p, 0), m, m)
    factors, place = work.generalized, sl.matrix_place(p, 1)
    if plan.data[row[at.EL_DATA] + sl.LAW] > 0.0:
        V[sl.ORDER, 0] = 0.0
        V[sl.FORCE, 0], slope = _press_point(plan, row, V[sl.GAP, 0], C[0, 0])
        factors[place] = C[0, 0] + slope
        return 1 if V[sl.FORCE, 0] >= 0.0 and factor(factors, place, 1) else -1
    return solve_complementary(
        C, V[sl.GAP], m, V[sl.FORCE], V[sl.LEFT], V[sl.INSIDE], V[sl.ORDER], factors, place
    )


@kernel
def set_forces(work, p, m, count):
    """Write the forces of all patches that touch as vectors along their normals; of all others none."""
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    for k in range(m):
        sl.put3(V, sl.OWN_FORCE, k, _ZERO)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        store3(points[k], sl.FORCED, scale3(V[sl.FORCE, k], load3(points[k], sl.NORMAL)))
        sl.put3(V, sl.OWN_FORCE, k, scale3(V[sl.FORCE, k], sl.at3(V, sl.OWN_NORMAL, k)))


@kernel
def _write_residuals(plan, work, row, m, count):
    """Write how the residual flexibility moves all patches that touch, and those of the other surface."""
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    if size > 0:
        dent_other(plan, work, row, count)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        store3(points[k], sl.OWN_RESIDUAL, own_residual(plan, work, row, int(V[sl.PATCH, k]), m))


@kernel
def write_directions(plan, work, row, d, R, count):
    """Write of all patches that touch how they are moved besides, and along what their forces push."""
    _, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    o = row[at.EL_DATA] + sl.SHAPE
    for a in range(count):
        k = int(V[sl.ORDER, a])
        push, apart = load3(points[k], sl.NORMAL), rotate(R, load3(points[k], sl.OWN_RESIDUAL))
        if size > 0:
            apart = sub3(apart, mean_of(others, sl.DENT, weights[k]))
        if plan.data[o] != HALF_SPACE:
            push = add3(push, gradient_variation(plan.data, o, load3(points[k], sl.FOOT), apart))
        pull = push
        if size > 0:
            z = add3(d, load3(points[k], sl.PLACE))
            pull = sub3(pull, tilt(plan, row, z, others, sl.MODAL, push))
            pull = sub3(pull, tilt(plan, row, z, others, sl.DENT, load3(points[k], sl.NORMAL)))
        store3(points[k], sl.APART, apart)
        store3(points[k], sl.PUSH, push)
        store3(points[k], sl.PULL, pull)
        store3(points[k], sl.PUSHED, scale3(V[sl.FORCE, k], push))
        store3(points[k], sl.PULLED, scale3(V[sl.FORCE, k], pull))


@kernel
def _is_finite(d, R, q, q_other):
    total = d[0] + d[1] + d[2] + R[0] + R[4] + R[8]
    for k in range(q.shape[0]):
        total += q[k]
    for k in range(q_other.shape[0]):
        total += q_other[k]
    return math.isfinite(total)


@kernel
def near_patches(plan, work, row, d, R, q, q_other, deep):
    """As ``find_near``; the least gap is not a number where the motion is none."""
    t, _, n = sl.table_of(plan, row)
    if not _is_finite(d, R, q, q_other):
        return 0, math.nan
    reach = farthest(plan.data, t, n, q)
    t_other, _, n_other = sl.other_of(plan, row)
    if n_other > 0:
        reach += farthest(plan.data, t_other, n_other, q_other)
    return find_near(plan, work, row, d, R, reach, deep)


@kernel
def find_gaps(plan, work, row, d, R, q, q_other, deep):
    """Write the gaps of a surface's near patches, before forces, where the body is at d, R and its modes at q (n,).

    ``q_other``: the modes of the other surface's body; ``deep``: see ``find_near``.  Returns on how many slots there
    are near ones, whether any overlaps, and a bound of the least gap of the undeformed (m), which is not a number where
    the arguments are none.
    """
    m, least = near_patches(plan, work, row, d, R, q, q_other, deep)
    return m, m > 0 and place_points(plan, work, row, m, d, R, q, q_other), least


@kernel
def tell_undefined(plan, row):
    """Note that there are no forces, which is a fault."""
    if plan.flag[0] == 0:
        plan.flag[0] = kinds.FLAG_ELEMENT + row[at.EL_NUMBER]


@kernel
def press_patches(plan, work, row, d, R, q, q_other):
    """As ``find_gaps``, and write the forces.

    Returns on how many slots there are near patches, how many touch, the first of ORDER, and that bound.  -1 touch
    where there are no forces, which is a fault.
    """
    _, p, _ = sl.table_of(plan, row)
    m, overlap, least = find_gaps(plan, work, row, d, R, q, q_other, 0.0)
    if not overlap:
        set_forces(work, p, m, 0)
        return m, 0 if least == least else -1, least
    count = _solve(plan, work, row, m)
    set_forces(work, p, m, count)
    rough = plan.data[row[at.EL_DATA] + sl.FRICTION] > 0.0
    if rough and count > 0:
        count = add_friction(plan, work, row, R, m, count)
    if count < 0:
        tell_undefined(plan, row)
        return m, -1, least
    _write_residuals(plan, work, row, m, count)
    write_directions(plan, work, row, d, R, count)
    if rough and count > 0:
        push_along(plan, work, row, d, R, count)
    return m, count, least


@kernel
def sum_forces(plan, work, row, R, m, count):
    """Force on the body and torque about its origin, in F's axes, of what `press_patches` found.

    The modes' are written, see ``modal_place``; NaN where there are none.
    """
    _, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    first = sl.modal_place(p, size, 6 + n + n_other)
    out = work.generalized[first : first + n + n_other]
    for k in range(n + n_other):
        out[k] = 0.0 if count >= 0 else math.nan
    if count < 0:
        return (math.nan, math.nan, math.nan), (math.nan, math.nan, math.nan)
    total, torque = _ZERO, _ZERO
    if count == 0:
        return total, torque
    for k in range(m):
        sl.put3(V, sl.OWN_PULLED, k, _ZERO)
    if n_other > 0:
        clear_others(others, sl.LOAD)
    for a in range(count):
        k = int(V[sl.ORDER, a])
        force = load3(points[k], sl.PULLED)
        couple = cross3(rotate(R, load3(points[k], sl.OWN_RESIDUAL)), load3(points[k], sl.FORCED))
        total, torque = add3(total, force), add3(torque, add3(cross3(load3(points[k], sl.PLACE), force), couple))
        sl.put3(V, sl.OWN_PULLED, k, rotate_back(R, force))
        if n_other > 0:
            share_force(others, sl.LOAD, weights[k], scale3(-1.0, load3(points[k], sl.PUSHED)))
    push_all(plan, work, row, m, out)
    if n_other > 0:
        push_others(plan, row, others, sl.LOAD, out[n:])
    return total, torque


@kernel
def surface_wrench(plan, work, row, motion, q_rate, q_other_rate, pressed):
    """As ``sum_forces`` of what ``press_patches`` gave; bounds the next step."""
    _, R, _, _ = motion
    t, _, n = sl.table_of(plan, row)
    t_other, _, n_other = sl.other_of(plan, row)
    m, count, least = pressed
    fastest = farthest(plan.data, t, n, q_rate)
    if n_other > 0:
        fastest += farthest(plan.data, t_other, n_other, q_other_rate)
    bound_step(plan, row, least, motion, fastest)
    return sum_forces(plan, work, row, R, m, count)


@kernel
def surface_energy(plan, work, row, d, R, q, q_other):
    """What the residual flexibility of a surface stores (J)."""
    _, p, _ = sl.table_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    _, count, _ = press_patches(plan, work, row, d, R, q, q_other)
    if count < 0:
        return math.nan
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    energy = 0.0
    for a in range(count):
        k = int(V[sl.ORDER, a])
        energy += 0.5 * dot3(load3(points[k], sl.FORCED), load3(points[k], sl.APART))
        if plan.data[row[at.EL_DATA] + sl.LAW] > 0.0:
            energy += point_depth(plan, row, V[sl.FORCE, k])[2]
    return energy


_NAME = "contacts of elastic surfaces, which are stiffer than at the start"
_UNDEFINED = (
    "a patch is on the core of the shape, where its distance has no direction, its residual flexibility is none, or no "
    "forces balance its friction: take larger patches, fewer modes, or a smaller mu"
)
ELASTIC_SURFACE = SurfaceElement(
    Behaviour(_NAME, Stiffness.UNSEEN, lets_go=True, undefined=_UNDEFINED), surface_energy
)
#: With friction, which remembers where its patches stick.
ROUGH_SURFACE = SurfaceElement(
    Behaviour(_NAME, Stiffness.UNSEEN, remembers=True, lets_go=True, undefined=_UNDEFINED), surface_energy
)
