"""The tangent of what acts between two frames: force elements, and by ``row_pairs`` reactions of constraint rows.

Both give a wrench from the motion of frame G against frame F in F's axes, and its variation.  Columns that move one of
the frames and not the other change it; that it goes along with the bodies is part of their columns already.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
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
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.contact_wrench import state_count
from flexmbd.multibody.kernels.elements.differences import difference_step
from flexmbd.multibody.kernels.elements.frame_states import put_rates, wrench_by_state
from flexmbd.multibody.kernels.elements.table import (
    element_wrench,
    element_wrench_variation,
    is_between_frames,
    is_of_pairs,
    is_of_surface,
)
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_motion
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion
from flexmbd.multibody.kernels.tangent import tangent_layout as tl
from flexmbd.multibody.kernels.tangent.tangent_columns import frame_columns
from flexmbd.multibody.kernels.tangent.tree_recursion import MOTION, RATE, SHIFT, TURN


@kernel
def enter(tw, count, k):
    """Put unknown k on the path, without a twist, where it is not there yet; return the path's length."""
    if tw.path_mark[k] == 0:
        tw.path_mark[k] = 1
        tw.path[count] = k
        count += 1
        for t in range(18):
            tw.path_twist[k, t] = 0.0
    return count


@kernel
def _add_cut(tw, count, first, o, sign):
    """Add the entries of a cut body's motion, from unknown ``first``, that say where it is and how fast."""
    for t in range(3):
        for entry in (t, RATE + t, SHIFT + t, TURN + t):
            count = enter(tw, count, first + entry)
        tw.path_twist[first + TURN + t, o + t] = 1.0
        tw.path_twist[first + SHIFT + t, o + 3 + t] = 1.0
        tw.path_twist[first + t, 12 + t] += sign
        tw.path_twist[first + RATE + t, 15 + t] += sign
    return count


@kernel
def _add_unknown(tw, count, k, twist, motion, column, o, sign):
    """Add a column's twist to unknown k of the path, its rate with a sign; return the path's length."""
    count = enter(tw, count, k)
    for t in range(6):
        tw.path_twist[k, o + t] = twist[t, column]
    for t in range(3):
        tw.path_twist[k, 12 + t] += sign * motion[t, column]
        tw.path_twist[k, 15 + t] += sign * motion[9 + t, column]
    return count


@kernel
def _collect_path(plan, tw, f, o, sign, count):
    """Enter all unknowns that move frame f into the path, their twists at rows o; return its length."""
    b = plan.frame_of[f, at.FRAME_BODY]
    edge = tw.edge_of[f]
    while b >= 0:
        tree = plan.tree[b]
        if edge >= 0:
            for k in range(plan.flex[tree[at.FLEX], at.N_MODES]):
                q = tree[at.MODAL_V] + k
                count = _add_unknown(tw, count, q, tw.edge_twist, tw.edge_motion, edge + k, o, sign)
        if tw.cut_of[b] >= 0:
            return _add_cut(tw, count, tw.cut_of[b], o, sign)
        for k in range(tree[at.JOINT_SIZE]):
            j = tree[at.JOINT_V] + k
            count = _add_unknown(tw, count, j, tw.twist, tw.motion, j, o, sign)
        edge = tw.edge_of[tree[at.FRAME_PARENT]]
        b = tree[at.PARENT]
    return count


@kernel
def collect_paths(plan, tw, f, g):
    """Enter all unknowns that move frames f or g into the path; return their number."""
    return _collect_path(plan, tw, g, 6, 1.0, _collect_path(plan, tw, f, 0, -1.0, 0))


@kernel
def clear_path(tw, count):
    """Take all unknowns off the path."""
    for i in range(count):
        tw.path_mark[tw.path[i]] = 0


@kernel
def relative_variation(phi, r, turn, rate, c_G, v_G, w_F, w_G, R_F):
    """Variation dd, dtheta, drate, dspin (F's axes) of G's motion against F.

    By G's rotation phi and translation r of point o against F, phi' and r', in world axes.
    """
    move = add3(r, cross3(phi, c_G))
    move_rate = add3(add3(rate, cross3(turn, c_G)), cross3(phi, v_G))
    dd = rotate_back(R_F, move)
    dtheta = rotate_back(R_F, phi)
    drate = rotate_back(R_F, sub3(move_rate, cross3(w_F, move)))
    dspin = rotate_back(R_F, add3(turn, cross3(phi, w_G)))
    return dd, dtheta, drate, dspin


@kernel
def variation_by_unknown(tw, k, per_x, c_G, v_G, w_F, w_G, R_F):
    """Variation of G's motion against F by unknown k: whether there is one, dd, dtheta, drate, dspin (F's axes).

    Also the relative twist (phi, r) itself, in world axes.
    """
    m = tw.path_twist[k]
    phi = (m[6] - m[0], m[7] - m[1], m[8] - m[2])
    r = (m[9] - m[3], m[10] - m[4], m[11] - m[5])
    turn = (m[12], m[13], m[14])
    rate = (m[15], m[16], m[17])
    any_of = abs(phi[0]) + abs(phi[1]) + abs(phi[2]) + abs(r[0]) + abs(r[1]) + abs(r[2])
    if k >= tw.twist.shape[1]:  # an entry of a cut body's motion, of which some are rates alone
        any_of += abs(turn[0]) + abs(turn[1]) + abs(turn[2]) + abs(rate[0]) + abs(rate[1]) + abs(rate[2])
    moved = scale3(per_x, phi), scale3(per_x, r)
    dd, dtheta, drate, dspin = relative_variation(moved[0], moved[1], turn, rate, c_G, v_G, w_F, w_G, R_F)
    return any_of > 0.0, dd, dtheta, drate, dspin, phi, r


@kernel
def pair_frames(plan, work, tw, f, g):
    """Places of F and G against o, velocity of G against o, angular velocities, R_WF; in world axes."""
    p_F, R_F, _, w_F, _, _ = frame_motion(plan, work, f)
    p_G, R_G, v_G, w_G, _, _ = frame_motion(plan, work, g)
    o = load3(tw.origin, 0)
    v = sub3(rotate(R_G, v_G), load3(tw.origin, 3))
    return sub3(p_F, o), sub3(p_G, o), v, rotate(R_F, w_F), rotate(R_G, w_G), R_F


@kernel
def pair_motion(plan, work, tw, f, g):
    """The motion of G against F, as of ``relative_rates``, and what ``pair_frames`` gives."""
    p_F, R_F, v_F, w_F, _, _ = frame_motion(plan, work, f)
    p_G, R_G, v_G, w_G, _, _ = frame_motion(plan, work, g)
    d = rotate_back(R_F, sub3(p_G, p_F))
    R = compose((R_F[0], R_F[3], R_F[6], R_F[1], R_F[4], R_F[7], R_F[2], R_F[5], R_F[8]), R_G)
    rate = sub3(rotate(R, v_G), add3(v_F, cross3(w_F, d)))
    spin = sub3(rotate(R, w_G), w_F)
    o = load3(tw.origin, 0)
    v = sub3(rotate(R_G, v_G), load3(tw.origin, 3))
    return (d, R, rate, spin), (sub3(p_F, o), sub3(p_G, o), v, rotate(R_F, w_F), rotate(R_G, w_G), R_F)


@kernel
def put_change(tw, k, per_x, phi, r, dforce, dmoment, force, torque, c_F, R_F):
    """Store what unknown k changes of the wrench between F and G, about o in world axes.

    ``dforce``, ``dmoment`` about F's origin in F's axes; (force, torque) the wrench itself in world axes.
    """
    change = rotate(R_F, dforce)
    changed = tw.path_wrench[k]
    store3(changed, 0, change)
    store3(changed, 3, add3(rotate(R_F, dmoment), cross3(c_F, change)))
    phi, r = scale3(per_x, phi), scale3(per_x, r)
    store3(changed, 6, cross3(phi, force))
    store3(changed, 9, add3(cross3(phi, torque), cross3(r, force)))


@kernel
def put_first(tw, moved, j):
    """Exchange the path's unknown j with the one at ``moved``; one more than that."""
    tw.path[moved], tw.path[j] = tw.path[j], tw.path[moved]
    return moved + 1


@kernel
def add_changes(tw, count, moved, matrix):
    """Add the stored changes, on the ``count`` unknowns that move F or G, by the first ``moved`` of them.

    The others move both alike, as all that lies between the two and the ground does, and change nothing.
    """
    path, wrench = tw.path, tw.path_wrench
    for i in range(count):
        r = path[i]
        motion = motion_of_pair(tw.path_twist, r)
        for j in range(moved):
            k = path[j]
            matrix[r, k] += change_by(wrench, motion, k)


@kernel
def motion_of_pair(twist, r):
    """What unknown r turns and moves: G relative to F, then G."""
    m = twist[r]
    angular, linear = (m[6], m[7], m[8]), (m[9], m[10], m[11])
    apart = (angular[0] - m[0], angular[1] - m[1], angular[2] - m[2])
    away = (linear[0] - m[3], linear[1] - m[4], linear[2] - m[5])
    return apart, away, angular, linear


@kernel
def change_by(wrench, motion, k):
    """What unknown k changes of the wrench between F and G, as an unknown feels it by its ``motion_of_pair``."""
    apart, away, angular, linear = motion
    changed = wrench[k]
    t = 0.0
    for c in range(3):
        t += away[c] * changed[c] + apart[c] * changed[3 + c]
        t -= linear[c] * changed[6 + c] + angular[c] * changed[9 + c]
    return t


@kernel
def load_edges(plan, work, tw, f, g, force, torque, x, v, a, per_x, per_v, per_a, at_f, at_g):
    """Columns of the modes that move F or G under the wrench (force, torque about o; world axes) on G.

    ``at_f`` and ``at_g`` have the entries of their bodies' modes.
    """
    for side in range(2):
        end = f if side == 0 else g
        if tw.edge_of[end] >= 0:
            sign = -1.0 if side == 0 else 1.0
            for t in range(3):
                tw.point[tl.C_FORCE + t] = sign * force[t]
                tw.point[tl.C_TORQUE + t] = sign * torque[t]
            matrix = at_f if side == 0 else at_g
            frame_columns(plan, work, tw, end, tw.point, x, v, a, per_x, per_v, per_a, matrix)


@kernel
def put_element(plan, work, tw, row, x, v, a, per_x, per_v, per_a, at_f, at_g):
    """Store what the unknowns change of a force between frames, which is applied, so subtracted.

    ``at_f`` and ``at_g`` have the entries of the modes that move the frames.  Returns how many unknowns move one of the
    frames and how many of these, the first of the path, move them apart; the states of the force are among both.
    """
    f, g = row[at.EL_F], row[at.EL_G]
    (d, R, rate, spin), (c_F, c_G, v_G, w_F, w_G, R_F) = pair_motion(plan, work, tw, f, g)
    force, torque = element_wrench(plan, work, row, d, R, rate, spin)
    force, torque = scale3(-1.0, force), scale3(-1.0, torque)
    pull = rotate(R_F, force)
    moment = add3(rotate(R_F, torque), cross3(c_G, pull))
    load_edges(plan, work, tw, f, g, pull, moment, x, v, a, per_x, per_v, per_a, at_f, at_g)
    count = collect_paths(plan, tw, f, g)
    moved = 0
    for j in range(count):
        k = tw.path[j]
        moves, dd, dtheta, drate, dspin, phi, r = variation_by_unknown(tw, k, per_x, c_G, v_G, w_F, w_G, R_F)
        if not moves:
            continue
        moved = put_first(tw, moved, j)
        sized = k if k < tw.twist.shape[1] else 0  # laws that need a difference meet no cut bodies
        step = difference_step(per_x, per_v, tw.size_x[sized], tw.size_v[sized])
        dforce, dtorque = element_wrench_variation(plan, work, row, d, R, rate, spin, dd, dtheta, drate, dspin, step)
        if row[at.EL_V] >= 0:
            put_rates(plan, work, row, k, 1.0, tw.path_rates)
        dforce, dtorque = scale3(-1.0, dforce), scale3(-1.0, dtorque)
        dmoment = add3(dtorque, add3(cross3(dd, force), cross3(d, dforce)))
        put_change(tw, k, per_x, phi, r, dforce, dmoment, pull, moment, c_F, R_F)
    if row[at.EL_V] >= 0:
        count, moved = _put_states(plan, work, tw, row, (d, R, rate, spin), (c_F, R_F), count, moved, per_v)
    return count, moved


@kernel
def _put_states(plan, work, tw, row, motion, of_F, count, moved, per_v):
    """Store what an element's own states change of its force and of their rates, as unknowns that move no frame."""
    d, R, rate, spin = motion
    c_F, R_F = of_F
    none = (0.0, 0.0, 0.0)
    for i in range(state_count(plan, row)):
        k = row[at.EL_V] + i
        force, torque = wrench_by_state(plan, work, row, d, R, rate, spin, i, tw.size_v[k])
        put_rates(plan, work, row, k, per_v, tw.path_rates)
        tw.path_mark[k] = 1
        for t in range(18):
            tw.path_twist[k, t] = 0.0
        tw.path[count] = k
        count += 1
        moved = put_first(tw, moved, count - 1)
        dforce = scale3(-per_v, force)
        dmoment = add3(scale3(-per_v, torque), cross3(d, dforce))
        put_change(tw, k, 0.0, none, none, dforce, dmoment, none, none, c_F, R_F)
    return count, moved


@kernel
def _put_frame_load(plan, work, tw, row, count):
    """Write into its row of ``tw.frame_loads`` the generalised forces of a given force whose function of time is 1."""
    d, R, rate, spin, _, _ = relative_motion(plan, work, row[at.EL_F], row[at.EL_G])
    _, c_G, _, _, _, R_F = pair_frames(plan, work, tw, row[at.EL_F], row[at.EL_G])
    value = work.time[row[at.EL_TIME], 0]
    work.time[row[at.EL_TIME], 0] = 1.0
    force, torque = element_wrench(plan, work, row, d, R, rate, spin)
    work.time[row[at.EL_TIME], 0] = value
    pull = rotate(R_F, force)
    moment = add3(rotate(R_F, torque), cross3(c_G, pull))
    load = tw.frame_loads[row[at.EL_X]]
    load[:] = 0.0
    for j in range(count):
        apart, away, _, _ = motion_of_pair(tw.path_twist, tw.path[j])
        load[tw.path[j]] = dot3(away, pull) + dot3(apart, moment)


@kernel
def _add_rates(plan, tw, row, moved, matrix):
    """Add the stored changes of the rates of a force's own states."""
    for i in range(state_count(plan, row)):
        for j in range(moved):
            matrix[row[at.EL_V] + i, tw.path[j]] += tw.path_rates[i, tw.path[j]]


@deferred_kernel()
def add_elements(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix):
    """Add stiffness and damping of the force elements between frames."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_between_frames(row[at.EL_KIND]) and not (is_of_pairs(row[at.EL_KIND]) or is_of_surface(row[at.EL_KIND])):
            count, moved = put_element(plan, work, tw, row, x, v, a, per_x, per_v, per_a, matrix, matrix)
            add_changes(tw, count, moved, matrix)
            if row[at.EL_V] >= 0:
                _add_rates(plan, tw, row, moved, matrix)
            if row[at.EL_X] >= 0:
                _put_frame_load(plan, work, tw, row, count)
            clear_path(tw, count)


@kernel
def is_from_ground(plan, row):
    """Whether a force between frames acts between a body and the ground."""
    return min(plan.frame_of[row[at.EL_F], at.FRAME_BODY], plan.frame_of[row[at.EL_G], at.FRAME_BODY]) < 0


@deferred_kernel()
def add_elements_of_joints(plan, work, tw, recursion, x, v, a, per_x, per_v, per_a):
    """As ``add_elements`` where each acts across one joint: into ``own`` and ``push`` of a ``TreeRecursion``.

    Those from the ground are left to ``add_ground_forces`` where bodies answer to their place.
    """
    placed = recursion.motion.shape[1] > MOTION
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_between_frames(row[at.EL_KIND]) and not (placed and is_from_ground(plan, row)):
            count, moved = put_element(plan, work, tw, row, x, v, a, per_x, per_v, per_a, recursion.own, recursion.own)
            for j in range(moved):
                k = tw.path[j]
                for q in range(moved):
                    motion = motion_of_pair(tw.path_twist, tw.path[q])
                    recursion.own[tw.path[q], recursion.place[k]] += change_by(tw.path_wrench, motion, k)
                for c in range(6):
                    recursion.push[k, c] -= tw.path_wrench[k, 6 + c]
            clear_path(tw, count)
