"""Loops that hang together, solved in O(bodies + loops): the articulated-body recursion with rows that are still open.

M a + C^T nu = 0 and C a = t.  A row of a loop concerns the bodies inboard of its frames up to the one from which both
hang, and none farther in: there it is eliminated, as joints are on the way.  Until then what is outboard of a body
answers its acceleration A and the reactions nu of the open rows by a wrench and by the rows' own accelerations,

    W = I A + P^T nu,    r = P A - L nu

(Featherstone 2008, section 7.1, without rows; with rows that are eliminated early: Sathya & Carpentier 2024,
"Constrained articulated body dynamics algorithms").  A joint with the motion subspace S takes U D^-1 U^T from I and
(P S) D^-1 U^T from P, and adds (P S) D^-1 (P S)^T to L, with U = I S and D = S^T U.  Rows that end at a body give
nu = L^-1 (P A - t) there.  L is the mobility of these rows with the body at rest and the loops farther out closed, so
that its rank is theirs.

A body's vectors are about its own origin, in world axes: differences of what lies far apart would lose digits.
"""
from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.rank_revealing import factor_semidefinite, solve_semidefinite
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    cross3,
    load3,
    load9,
    rotate,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_pose
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion
from flexmbd.multibody.kernels.physics.constraint_laws import row_wrench
from flexmbd.multibody.kernels.physics.joints import joint_column


@kernel
def load_wrench(row):
    """Force and torque of six numbers, or what else moves as one."""
    return (row[0], row[1], row[2]), (row[3], row[4], row[5])


@kernel
def add_wrench(row, force, torque):
    """Add a wrench, or what else moves as one, to six numbers."""
    for c in range(3):
        row[c] += force[c]
        row[3 + c] += torque[c]


@kernel
def wrench_product(a, b):
    """Sum of the products of six numbers."""
    total = 0.0
    for c in range(6):
        total += a[c] * b[c]
    return total


@kernel
def _put_body(plan, work, loops, b):
    """The body's own inertia about its origin, and the motion subspace of its joint there."""
    body, rigid, inertia = work.body[b], plan.rigid[b], loops.inertia[b]
    R = load9(body, at.B_R)
    m, h = rigid[at.MASS], rotate(R, load3(rigid, at.FIRST_MOMENT))
    o = at.SECOND_MOMENT
    xx, xy, xz, yy, yz, zz = rigid[o], rigid[o + 1], rigid[o + 2], rigid[o + 3], rigid[o + 4], rigid[o + 5]
    J = (yy + zz, -xy, -xz, -xy, xx + zz, -yz, -xz, -yz, xx + yy)
    J = compose(compose(R, J), (R[0], R[3], R[6], R[1], R[4], R[7], R[2], R[5], R[8]))
    for r in range(3):
        for c in range(3):
            inertia[r, c] = m if r == c else 0.0
            inertia[3 + r, 3 + c] = J[3 * r + c]
    skew = (0.0, -h[2], h[1], h[2], 0.0, -h[0], -h[1], h[0], 0.0)
    for r in range(3):
        for c in range(3):
            inertia[3 + r, c] = skew[3 * r + c]
            inertia[c, 3 + r] = skew[3 * r + c]
    link = plan.tree[b]
    place, parent = load3(body, at.B_P), link[at.PARENT]
    store3(loops.shift[b], 0, sub3(place, load3(work.body[parent], at.B_P)) if parent >= 0 else place)
    _, R_F, _, _, _, _ = frame_motion(plan, work, link[at.FRAME_PARENT])
    child = plan.frames[link[at.FRAME_CHILD]]
    R_G = compose(R, load9(child, at.FRAME_R))
    arm = rotate(R, load3(child, at.FRAME_P))
    for k in range(link[at.JOINT_SIZE]):
        angular, linear = joint_column(link[at.JOINT_ADDS], plan.data, link[at.JOINT_DATA], k)
        angular = rotate(R_G, angular)
        row = loops.subspace[link[at.JOINT_V] + k]
        store3(row, 0, add3(rotate(R_F, linear), cross3(arm, angular)))
        store3(row, 3, angular)


@kernel
def _put_row(plan, work, loops, i):
    """What a unit of row i's reaction does to both bodies, about their origins."""
    row = plan.rows[i]
    f, g = row[at.ROW_F], row[at.ROW_G]
    d, R = relative_pose(plan, work, f, g)
    force, torque = row_wrench(plan.data, row, d, R)
    _, R_F, _, _, _, _ = frame_motion(plan, work, f)
    p_G, _, _, _, _, _ = frame_motion(plan, work, g)
    force, torque = rotate(R_F, force), rotate(R_F, torque)
    for end in range(2):
        b = plan.frame_of[f if end == 0 else g, at.FRAME_BODY]
        sign = -1.0 if end == 0 else 1.0
        unit = loops.reaction[i, end]
        for c in range(6):
            unit[c] = 0.0
        if b >= 0:
            arm = sub3(p_G, load3(work.body[b], at.B_P))
            add_wrench(unit, scale3(sign, force), scale3(sign, add3(torque, cross3(arm, force))))
            place = loops.entry[i, end]
            for c in range(6):
                loops.push[place, c] += unit[c]


@entry_kernel
def factor_loops(plan, work, loops, row_scale, least, norm, rank):
    """Factor at the poses in ``work``.

    ``row_scale``: (m,) usual lengths of the rows, or 0 for those at hand, which ``norm`` (m,) gets.  ``least``:
    (groups,) the smallest pivots that count, of each node at which rows end, outermost first; ``rank``: written.
    """
    loops.push[:, :] = 0.0
    loops.mutual[:] = 0.0
    ground = plan.tree.shape[0]
    loops.inertia[ground:, :, :] = 0.0
    for b in range(ground):
        _put_body(plan, work, loops, b)
    for i in range(plan.rows.shape[0]):
        _put_row(plan, work, loops, i)
    group = 0
    for b in range(ground - 1, -1, -1):
        group = _end_rows(loops, b, row_scale, least, norm, rank, group)
        _eliminate_joint(plan, loops, b)
        _hand_inwards(loops, b)
    for n in range(ground, loops.inertia.shape[0]):
        group = _end_rows(loops, n, row_scale, least, norm, rank, group)


@kernel
def _end_rows(loops, n, row_scale, least, norm, rank, group):
    """Eliminate the rows that end at a node; the number of groups so far."""
    first, last = loops.ending[n], loops.ending[n + 1]
    size = last - first
    if size == 0:
        return group
    o, count, square = loops.first[n], loops.first[n + 1] - loops.first[n], loops.square[n]
    factors, mutual = loops.factors[first:last, :size], loops.mutual
    for i in range(size):
        row = loops.ended[first + i]
        length = math.sqrt(max(mutual[square + i * count + i], 0.0))
        norm[row] = length
        scale = row_scale[row] if row_scale[row] > 0.0 else length
        loops.scale[first + i] = scale if scale > 0.0 else 1.0
        for j in range(i + 1):
            factors[i, j] = mutual[square + i * count + j]
    found = factor_semidefinite(factors, loops.order[first:last], loops.scale[first:last])
    while found > 1 and factors[found - 1, found - 1] ** 2 < least[group]:
        found -= 1
    rank[group] = found
    rhs, out = loops.scratch[0, :size], loops.scratch[1, :size]
    for c in range(6):
        for i in range(size):
            rhs[i] = loops.push[o + i, c]
        solve_group(loops, first, last, found, rhs, out)
        for i in range(size):
            loops.solved[o + i, c] = out[i]
    for q in range(size, count):
        for i in range(size):
            rhs[i] = mutual[square + q * count + i]
        solve_group(loops, first, last, found, rhs, out)
        for i in range(size):
            mutual[square + i * count + q] = out[i]
    _take_in_reactions(loops, n, o, size, count, square)
    return group + 1


@kernel
def solve_group(loops, first, last, rank, rhs, out):
    """out = L^-1 rhs of the rows first to last that end at one body."""
    size = last - first
    order, scale, scratch = loops.order[first:last], loops.scale[first:last], loops.scratch[2, :size]
    solve_semidefinite(loops.factors[first:last, :size], rank, order, scale, rhs, scratch, out)


@kernel
def _take_in_reactions(loops, n, o, size, count, square):
    """What the reactions of the ``size`` rows that end at a node change of inertia and of the other rows."""
    inertia, push, solved, mutual = loops.inertia[n], loops.push, loops.solved, loops.mutual
    for i in range(size):
        for r in range(6):
            for c in range(6):
                inertia[r, c] += push[o + i, r] * solved[o + i, c]
    for q in range(size, count):
        for i in range(size):
            share = mutual[square + q * count + i]
            if share != 0.0:
                for c in range(6):
                    push[o + q, c] -= share * solved[o + i, c]
                for p in range(size, count):
                    mutual[square + q * count + p] -= share * mutual[square + i * count + p]


@kernel
def _eliminate_joint(plan, loops, b):
    """Let the joint of body b yield."""
    v, d = plan.tree[b, at.JOINT_V], plan.tree[b, at.JOINT_SIZE]
    if d == 0 or loops.yields[v] == 0:
        return
    inertia, gain, joint, subspace = loops.inertia[b], loops.gain, loops.joint, loops.subspace
    begin, end = loops.first[b] + loops.ending[b + 1] - loops.ending[b], loops.first[b + 1]
    for k in range(d):
        for c in range(6):
            gain[v + k, c] = wrench_product(inertia[c], subspace[v + k])
        for j in range(k + 1):
            joint[v + k, j] = wrench_product(gain[v + k], subspace[v + j])
    _factor_joint(joint, v, d)
    rows = loops.joint_rows[loops.open_joint[b] :]
    count = end - begin
    for q in range(count):
        for k in range(d):
            rows[k * count + q] = wrench_product(loops.push[begin + q], subspace[v + k])
    for k in range(d):  # forward substitution: L^-1 of U^T and of (P S)^T
        for j in range(k):
            _subtract(gain, rows, v, count, k, j, joint[v + k, j])
        _divide(gain, rows, v, count, k, joint[v + k, k])
    _take_out_joint(loops, b, v, d, begin, count, rows)
    for k in range(d - 1, -1, -1):
        for j in range(k + 1, d):
            _subtract(gain, rows, v, count, k, j, joint[v + j, k])
        _divide(gain, rows, v, count, k, joint[v + k, k])


@kernel
def _subtract(gain, rows, v, count, k, j, share):
    """Subtract a share of line j from line k, of a joint's gain and of its open rows."""
    for c in range(6):
        gain[v + k, c] -= share * gain[v + j, c]
    for q in range(count):
        rows[k * count + q] -= share * rows[j * count + q]


@kernel
def _divide(gain, rows, v, count, k, pivot):
    """Divide line k by a pivot."""
    over = 1.0 / pivot
    for c in range(6):
        gain[v + k, c] *= over
    for q in range(count):
        rows[k * count + q] *= over


@kernel
def _factor_joint(joint, v, d):
    """Cholesky factor of D in place of its lower triangle."""
    for k in range(d):
        for j in range(k + 1):
            total = joint[v + k, j]
            for c in range(j):
                total -= joint[v + k, c] * joint[v + j, c]
            joint[v + k, j] = math.sqrt(total) if j == k else total / joint[v + j, j]


@kernel
def _take_out_joint(loops, b, v, d, begin, count, rows):
    """Take what the joint yields from inertia and rows, halfway through the substitution: sums of squares."""
    inertia, gain, push, mutual = loops.inertia[b], loops.gain, loops.push, loops.mutual
    whole = loops.first[b + 1] - loops.first[b]
    o = loops.square[b] + (begin - loops.first[b]) * (whole + 1)
    for k in range(d):
        for r in range(6):
            for c in range(6):
                inertia[r, c] -= gain[v + k, r] * gain[v + k, c]
        for q in range(count):
            share = rows[k * count + q]
            if share != 0.0:
                for c in range(6):
                    push[begin + q, c] -= share * gain[v + k, c]
                for p in range(count):
                    mutual[o + q * whole + p] += share * rows[k * count + p]


@kernel
def _hand_inwards(loops, b):
    """Add inertia and open rows of body b to those of its parent, about whose origin they are then."""
    s = load3(loops.shift[b], 0)
    n = loops.base[b]
    inertia, target = loops.inertia[b], loops.inertia[n]
    for r in range(6):
        force, torque = load_wrench(inertia[r])
        store3(inertia[r], 3, add3(torque, cross3(s, force)))
    for c in range(6):
        force = (inertia[0, c], inertia[1, c], inertia[2, c])
        torque = add3((inertia[3, c], inertia[4, c], inertia[5, c]), cross3(s, force))
        for r in range(3):
            target[r, c] += force[r]
            target[3 + r, c] += torque[r]
    begin = loops.first[b] + loops.ending[b + 1] - loops.ending[b]
    whole, inner = loops.first[b + 1] - loops.first[b], loops.first[n + 1] - loops.first[n]
    for q in range(begin, loops.first[b + 1]):
        place = loops.inner[q]
        force, torque = load_wrench(loops.push[q])
        add_wrench(loops.push[place], force, add3(torque, cross3(s, force)))
        for p in range(begin, loops.first[b + 1]):
            loops.mutual[loops.square[n] + (place - loops.first[n]) * inner + loops.inner[p] - loops.first[n]] += (
                loops.mutual[loops.square[b] + (q - loops.first[b]) * whole + p - loops.first[b]]
            )
