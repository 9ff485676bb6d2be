"""The tangent of a group of elastic surfaces: what moves one changes the forces on all.

The stiffness K of a group over its unknowns, six of each member's motion and the modes of its bodies, is written once;
K times what an unknown of the machine moves of all members stands in ``tw.path_rates``, from which each member takes
what changes its wrench, and the bodies what changes the forces on their modes.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, rotate, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import INTEGER, deferred_kernel
from flexmbd.multibody.kernels.base.lanes import padded
from flexmbd.multibody.kernels.elements import surface_groups as sg
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import sum_forces
from flexmbd.multibody.kernels.elements.surface_stiffness import subtract_given_way, write_normal_row, write_turns
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.pressed_surfaces import (
    is_of_group,
    member_forces,
    modes_of,
    other_modes_of,
    press_group,
)
from flexmbd.multibody.kernels.tangent.frame_pairs import (
    clear_path,
    collect_paths,
    enter,
    load_edges,
    pair_motion,
    put_change,
    put_first,
    variation_by_unknown,
)


@kernel
def _add_member(plan, work, row, g, x, bearing):
    """Add a member's part of K with forces at rest, and its rows of B."""
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    m, count, _ = member_forces(plan, work, row, d, R, x)
    force, torque = sum_forces(plan, work, row, R, m, count)
    members = sg.of_group(plan, g, sg.N_MEMBERS)
    known = matrix_view(work.generalized, sg.of_group(plan, g, sg.MEMBERS), members + 1, sg.N_KNOWN)
    store3(known[sg.number_in_group(plan, row)], sg.FORCED, force)
    store3(known[sg.number_in_group(plan, row)], sg.TWISTED, torque)
    _, p, n = sl.table_of(plan, row)
    _, size, n_other = sl.other_of(plan, row)
    own, N = 6 + n + n_other, padded(sg.of_group(plan, g, sg.N_UNKNOWNS))
    K = matrix_view(work.generalized, sg.of_group(plan, g, sg.STIFFNESS), N, N)
    B = matrix_view(work.generalized, sg.of_group(plan, g, sg.ROWS), bearing, N)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    line = matrix_view(work.generalized, sg.of_group(plan, g, sg.LINE), 1, own)[0]
    write_turns(plan, work, row, R, m, count)
    by_itself = matrix_view(work.generalized, sl.stiffness_place(p, size, own), own, padded(own))
    for r in range(own):
        for c in range(own):
            K[sg.column_of(plan, row, g, r), sg.column_of(plan, row, g, c)] += by_itself[r, c]
    for a in range(count):
        k = int(V[sl.ORDER, a])
        write_normal_row(plan, work, row, R, k, line)
        for c in range(own):
            B[int(V[sl.LEFT, a]), sg.column_of(plan, row, g, c)] += line[c]


@kernel
def _write_stiffness(plan, work, g, x, count):
    """Write K of a group that has been pressed."""
    unknowns = sg.of_group(plan, g, sg.N_UNKNOWNS)
    N, rows, to = padded(unknowns), sg.of_group(plan, g, sg.ROWS), sg.of_group(plan, g, sg.STIFFNESS)
    matrix_view(work.generalized, to, N, N)[:, :] = 0.0
    matrix_view(work.generalized, rows, count, N)[:, :] = 0.0
    for e in range(plan.elements.shape[0]):
        if is_of_group(plan, plan.elements[e], g) and sg.bears(plan, work, plan.elements[e]):
            _add_member(plan, work, plan.elements[e], g, x, count)
    sg.add_couples_by_forces(plan, work, g, count)
    sg.add_couples_by_turns(plan, work, g, count)
    subtract_given_way(work.generalized, sg.factor_place(plan, g), rows, to, count, unknowns)


@kernel
def _add_moved(plan, work, tw, row, g, per_x):
    """Add to ``tw.path_rates`` what the unknowns that move a member's frames apart change of all forces."""
    unknowns, i = sg.of_group(plan, g, sg.N_UNKNOWNS), sg.number_in_group(plan, row)
    K = matrix_view(work.generalized, sg.of_group(plan, g, sg.STIFFNESS), unknowns, padded(unknowns))
    _, (_, c_G, v_G, w_F, w_G, R_F) = pair_motion(plan, work, tw, row[at.EL_F], row[at.EL_G])
    count = collect_paths(plan, tw, row[at.EL_F], row[at.EL_G])
    for j in range(count):
        k = tw.path[j]
        moves, dd, dtheta, _, _, _, _ = variation_by_unknown(tw, k, per_x, c_G, v_G, w_F, w_G, R_F)
        if moves:
            tw.path_rates[unknowns, k] = 1.0
            for r in range(unknowns):
                for c in range(3):
                    tw.path_rates[r, k] -= K[r, 6 * i + c] * dd[c] + K[r, 6 * i + 3 + c] * dtheta[c]
    clear_path(tw, count)


@kernel
def modes_of_body(plan, g, b):
    """The first velocity of the modes of a body of a group, and how many there are."""
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        if is_of_group(plan, row, g):
            i = sg.number_in_group(plan, row)
            if sg.of_member(plan, g, i, sg.OWN) == b:
                _, qv, n = modes_of(plan, row)
                return qv, n
            if sg.of_member(plan, g, i, sg.OTHER) == b:
                _, qv, n = other_modes_of(plan, row)
                return qv, n
    return 0, 0


@deferred_kernel(INTEGER)
def stiffen_group(plan, work, g, x):
    """Write K of a group, and what acts on its members; returns what ``press_group`` does."""
    count = press_group(plan, work, g, x)
    if count > 0:
        _write_stiffness(plan, work, g, x, count)
    return count


@deferred_kernel()
def put_surface_group(plan, work, tw, g, per_x):
    """Write into ``tw.path_rates`` what each unknown changes of a group's forces, as ``stiffen_group`` found it.

    In the row behind the last unknown of the group those are marked that change any.
    """
    unknowns = sg.of_group(plan, g, sg.N_UNKNOWNS)
    tw.path_rates[: unknowns + 1, :] = 0.0
    for e in range(plan.elements.shape[0]):
        if is_of_group(plan, plan.elements[e], g) and sg.bears(plan, work, plan.elements[e]):
            _add_moved(plan, work, tw, plan.elements[e], g, per_x)
    K = matrix_view(work.generalized, sg.of_group(plan, g, sg.STIFFNESS), unknowns, padded(unknowns))
    for b in range(sg.of_group(plan, g, sg.N_BODIES)):
        qv, n = modes_of_body(plan, g, b)
        for k in range(n):
            tw.path_rates[unknowns, qv + k] = 1.0
            for r in range(unknowns):
                tw.path_rates[r, qv + k] -= K[r, sg.of_body(plan, g, b, sg.FIRST_MODE) + k] * per_x


@kernel
def _required(plan, work, row, c_G, R_F):
    """The force that a member requires, in F's axes, and the wrench about o in world axes."""
    g, i = sg.group_of(plan, row), sg.number_in_group(plan, row)
    members = sg.of_group(plan, g, sg.N_MEMBERS)
    known = matrix_view(work.generalized, sg.of_group(plan, g, sg.MEMBERS), members + 1, sg.N_KNOWN)
    force, torque = scale3(-1.0, load3(known[i], sg.FORCED)), scale3(-1.0, load3(known[i], sg.TWISTED))
    pull = rotate(R_F, force)
    return force, pull, add3(rotate(R_F, torque), cross3(c_G, pull))


@kernel
def load_member_edges(plan, work, tw, row, x, v, a, per_x, per_v, per_a, at_f, at_g):
    """As ``load_edges``, which writes what the modes move the frames by, before ``put_surface_group``."""
    f, g = row[at.EL_F], row[at.EL_G]
    _, (_, c_G, _, _, _, R_F) = pair_motion(plan, work, tw, f, g)
    _, pull, moment = _required(plan, work, row, c_G, R_F)
    load_edges(plan, work, tw, f, g, pull, moment, x, v, a, per_x, per_v, per_a, at_f, at_g)


@kernel
def put_surface_member(plan, work, tw, row, per_x):
    """As ``put_element``, of a member whose group ``put_surface_group`` has been given."""
    f, g = row[at.EL_F], row[at.EL_G]
    group, i = sg.group_of(plan, row), sg.number_in_group(plan, row)
    (d, _, _, _), (c_F, c_G, v_G, w_F, w_G, R_F) = pair_motion(plan, work, tw, f, g)
    force, pull, moment = _required(plan, work, row, c_G, R_F)
    count, moved = collect_paths(plan, tw, f, g), 0
    unknowns = sg.of_group(plan, group, sg.N_UNKNOWNS)
    for k in range(tw.path_rates.shape[1]):
        if tw.path_rates[unknowns, k] != 0.0:
            count = enter(tw, count, k)
    for j in range(count):
        k = tw.path[j]
        moves, dd, _, _, _, phi, r = variation_by_unknown(tw, k, per_x, c_G, v_G, w_F, w_G, R_F)
        if not moves and tw.path_rates[unknowns, k] == 0.0:
            continue
        moved = put_first(tw, moved, j)
        rates = tw.path_rates[:, k]
        dforce, dtorque = load3(rates, 6 * i), load3(rates, 6 * i + 3)
        dmoment = add3(dtorque, add3(cross3(dd, force), cross3(d, dforce)))
        put_change(tw, k, per_x, phi, r, dforce, dmoment, pull, moment, c_F, R_F)
    return count, moved
