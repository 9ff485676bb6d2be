"""The tangent of the forces of elastic surfaces that touch: by the frames' motion, and by the modes of the patches."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, rotate, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.lanes import padded
from flexmbd.multibody.kernels.elements import surface_groups as sg
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import press_patches, sum_forces
from flexmbd.multibody.kernels.elements.surface_stiffness import write_stiffness
from flexmbd.multibody.kernels.elements.table import is_of_surface
from flexmbd.multibody.kernels.inverse_dynamics.pressed_surfaces import (
    APART,
    is_of_group,
    modes_of,
    other_modes_of,
    role,
)
from flexmbd.multibody.kernels.tangent.frame_pairs import (
    add_changes,
    clear_path,
    collect_paths,
    load_edges,
    pair_motion,
    put_change,
    put_first,
    variation_by_unknown,
)
from flexmbd.multibody.kernels.tangent.surface_group_tangent import (
    load_member_edges,
    modes_of_body,
    put_surface_group,
    put_surface_member,
    stiffen_group,
)


@kernel
def _enter_modes(tw, count, first, n):
    """Put the modes of the patches on the path, where they are not there yet; the path's length."""
    for k in range(first, first + n):
        if tw.path_mark[k] == 0:
            tw.path_mark[k] = 1
            tw.path[count] = k
            count += 1
            for t in range(18):
                tw.path_twist[k, t] = 0.0
    return count


@kernel
def _change(K, r, dd, dtheta, mode, size):
    """What force r changes by for a motion, and for a mode, -1 of none, by ``size``."""
    t = 0.0
    for c in range(3):
        t += K[r, c] * dd[c] + K[r, 3 + c] * dtheta[c]
    return t + K[r, 6 + mode] * size if mode >= 0 else t


@kernel
def _number_of_mode(k, qv, n, rv, n_other):
    """The number of unknown k among the modes of both surfaces, -1 if it is none of them."""
    if qv <= k < qv + n:
        return k - qv
    return n + k - rv if rv <= k < rv + n_other else -1


@kernel
def put_surface(plan, work, tw, row, x, v, a, per_x, per_v, per_a, at_f, at_g):
    """As ``put_element``; the changes of the forces on the modes are in ``tw.path_rates``."""
    f, g = row[at.EL_F], row[at.EL_G]
    qx, qv, n = modes_of(plan, row)
    rx, rv, n_other = other_modes_of(plan, row)
    (d, R, _, _), (c_F, c_G, v_G, w_F, w_G, R_F) = pair_motion(plan, work, tw, f, g)
    m, touching, _ = press_patches(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + n_other])
    if touching <= 0:
        return 0, 0
    force, torque = sum_forces(plan, work, row, R, m, touching)
    force, torque = scale3(-1.0, force), scale3(-1.0, torque)
    pull = rotate(R_F, force)
    moment = add3(rotate(R_F, torque), cross3(c_G, pull))
    load_edges(plan, work, tw, f, g, pull, moment, x, v, a, per_x, per_v, per_a, at_f, at_g)
    count = _enter_modes(tw, _enter_modes(tw, collect_paths(plan, tw, f, g), qv, n), rv, n_other)
    write_stiffness(plan, work, row, R, m, touching)
    _, p, _ = sl.table_of(plan, row)
    _, p_other, _ = sl.other_of(plan, row)
    size, moved = 6 + n + n_other, 0
    K = matrix_view(work.generalized, sl.stiffness_place(p, p_other, size), size, padded(size))
    for j in range(count):
        k = tw.path[j]
        mode = _number_of_mode(k, qv, n, rv, n_other)
        moves, dd, dtheta, _, _, phi, r = variation_by_unknown(tw, k, per_x, c_G, v_G, w_F, w_G, R_F)
        if not moves and mode < 0:
            continue
        moved = put_first(tw, moved, j)
        dforce = (
            -_change(K, 0, dd, dtheta, mode, per_x),
            -_change(K, 1, dd, dtheta, mode, per_x),
            -_change(K, 2, dd, dtheta, mode, per_x),
        )
        dtorque = (
            -_change(K, 3, dd, dtheta, mode, per_x),
            -_change(K, 4, dd, dtheta, mode, per_x),
            -_change(K, 5, dd, dtheta, mode, per_x),
        )
        for i in range(n + n_other):
            tw.path_rates[i, k] = -_change(K, 6 + i, dd, dtheta, mode, per_x)
        dmoment = add3(dtorque, add3(cross3(dd, force), cross3(d, dforce)))
        put_change(tw, k, per_x, phi, r, dforce, dmoment, pull, moment, c_F, R_F)
    return count, moved


@kernel
def _add_modal_rows(tw, shift, qv, n, moved, matrix):
    """Add the stored changes of the forces on n modes, stored from ``shift`` on, by the first ``moved`` of the path."""
    for j in range(moved):
        k = tw.path[j]
        for i in range(n):
            matrix[qv + i, k] += tw.path_rates[shift + i, k]


@deferred_kernel()
def _add_surface(plan, work, tw, row, x, v, a, per_x, per_v, per_a, matrix):
    count, moved = put_surface(plan, work, tw, row, x, v, a, per_x, per_v, per_a, matrix, matrix)
    add_changes(tw, count, moved, matrix)
    _, qv, n = modes_of(plan, row)
    _, rv, n_other = other_modes_of(plan, row)
    _add_modal_rows(tw, 0, qv, n, moved, matrix)
    _add_modal_rows(tw, n, rv, n_other, moved, matrix)
    clear_path(tw, count)


@deferred_kernel()
def _add_group(plan, work, tw, g, x, v, a, per_x, per_v, per_a, matrix):
    count = stiffen_group(plan, work, g, x)
    if count == APART:
        for e in range(plan.elements.shape[0]):
            if is_of_group(plan, plan.elements[e], g):
                _add_surface(plan, work, tw, plan.elements[e], x, v, a, per_x, per_v, per_a, matrix)
    if count <= 0:
        return
    for e in range(plan.elements.shape[0]):
        if is_of_group(plan, plan.elements[e], g) and sg.bears(plan, work, plan.elements[e]):
            load_member_edges(plan, work, tw, plan.elements[e], x, v, a, per_x, per_v, per_a, matrix, matrix)
    put_surface_group(plan, work, tw, g, per_x)
    first = True
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        if not (is_of_group(plan, row, g) and sg.bears(plan, work, row)):
            continue
        count, moved = put_surface_member(plan, work, tw, row, per_x)
        add_changes(tw, count, moved, matrix)
        if first:
            for b in range(sg.of_group(plan, g, sg.N_BODIES)):
                qv, n = modes_of_body(plan, g, b)
                _add_modal_rows(tw, sg.of_body(plan, g, b, sg.FIRST_MODE), qv, n, moved, matrix)
            first = False
        clear_path(tw, count)


@kernel
def add_surfaces(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix):
    """Add the stiffness of elastic surfaces that touch."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_of_surface(row[at.EL_KIND]):
            part = role(plan, row)
            if part == 0:
                _add_surface(plan, work, tw, row, x, v, a, per_x, per_v, per_a, matrix)
            elif part == 1:
                _add_group(plan, work, tw, sg.group_of(plan, row), x, v, a, per_x, per_v, per_a, matrix)
