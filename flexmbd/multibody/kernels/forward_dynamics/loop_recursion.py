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
from dataclasses import dataclass

import numpy as np

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
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.row_blocks import root_of, row_bodies
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_pose
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion
from flexmbd.multibody.kernels.physics.constraint_laws import row_wrench
from flexmbd.multibody.kernels.physics.joints import joint_column

_MOST = 6
_LEAST = 800.0  # operations for a body
_GAIN = 1.5  # how much fewer operations it must take than rows by their paths


@dataclass(frozen=True, eq=False)
class LoopRecursion(ArrayStruct):
    """Open rows of each node and the factors; no node where the recursion does not serve.

    The nodes are the bodies and then the ground, once for each set of branches that loops join.
    base: (bodies,) the node that carries a body.
    first: (nodes + 1,) where a node's open rows begin in ``push``, those that end there before the others.
    ending: (nodes + 1,) where the rows that end at a node begin in ``ended`` (m,), rows by nodes, outermost first.
    square: (nodes + 1,) where a node's L begins in ``mutual``.  inner: (k,) place of an open row among its parent's, -1
    where it ends.  entry: (m, 2) places of a row at the bodies of its frames F and G, -1 of the ground.
    open_joint: (bodies,) where a body's part of ``joint_rows`` begins.  yields: (nv,) 0 of prescribed velocities.
    subspace, gain: (nv, 6) S, D^-1 U^T.  joint: (nv, 6) D's Cholesky factor.  joint_rows: D^-1 (P S)^T of open rows.
    inertia: (nodes, 6, 6).  push: (k, 6) P.  solved: (k, 6) L^-1 P of ending rows.
    mutual: L of open rows; between ending rows and others, above the diagonal, L^-1 times it.
    reaction: (m, 2, 6) what a unit of nu does to the bodies of F and G.
    factors: (m, widest) of L of ending rows, with order, scale (m,), as ``rank_revealing`` has them.
    shift: (bodies, 3) from the parent's origin.  bias, moved: (nodes, 6) wrench and acceleration.  row_bias: (k,).
    open_nu: (k,) reactions.  yielded: (nv,) joints' rates without their parents' motion.  scratch: (3, widest).
    force: (6,).
    """

    base: IntArray
    first: IntArray
    ending: IntArray
    ended: IntArray
    square: IntArray
    inner: IntArray
    entry: IntArray
    open_joint: IntArray
    yields: IntArray
    subspace: FloatArray
    gain: FloatArray
    joint: FloatArray
    joint_rows: FloatArray
    inertia: FloatArray
    push: FloatArray
    solved: FloatArray
    mutual: FloatArray
    reaction: FloatArray
    factors: FloatArray
    order: IntArray
    scale: FloatArray
    shift: FloatArray
    bias: FloatArray
    moved: FloatArray
    row_bias: FloatArray
    open_nu: FloatArray
    yielded: FloatArray
    scratch: FloatArray
    force: FloatArray


def new_loop_recursion(plan: Plan, *, serves: bool = True) -> LoopRecursion:
    """Find the open rows of ``plan``; no nodes unless it ``serves`` and takes fewer operations than rows by paths."""
    base: IntArray = np.zeros(0, np.int64)
    nodes: list[tuple[list[int], int]] = []
    if serves and len(plan.rows) and not len(plan.flex) and _most_operations(plan) > _LEAST * len(plan.tree):
        base = _bases(plan)
        nodes = _open_rows(plan, base)
    counts = np.array([len(one) for one, _ in nodes], np.int64)
    if nodes and _GAIN * float((_LEAST + 80.0 * counts + 30.0 * counts**2).sum()) > _most_operations(plan):
        base, nodes, counts = base[:0], [], counts[:0]
    nv, m = (len(plan.free) + len(plan.driven), len(plan.rows)) if nodes else (0, 0)
    bodies = len(base)
    first = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts, dtype=np.int64)])
    ended = [row for open_rows, ends in nodes for row in open_rows[:ends]]
    ends = np.array([ends for _, ends in nodes], np.int64)
    places = [{row: int(first[n]) + i for i, row in enumerate(one)} for n, (one, _) in enumerate(nodes)]
    inner = np.full(int(first[-1]), -1, np.int64)
    entry = np.full((m, 2), -1, np.int64)
    for n in range(bodies):
        parent = places[base[n]]
        for row in nodes[n][0][nodes[n][1] :]:
            inner[places[n][row]] = parent[row]
    for row in range(m):
        for end, body in enumerate(row_bodies(plan, plan.rows[row])):
            entry[row, end] = places[body][row] if body >= 0 else -1
    sizes = plan.tree[:bodies, at.JOINT_SIZE].astype(np.int64)
    joint_rows = np.concatenate([np.zeros(1, np.int64), np.cumsum(sizes * counts[:bodies], dtype=np.int64)])
    yields = np.ones(nv, np.int64)
    yields[plan.driven[:, at.DRIVEN_V] if nodes else slice(0)] = 0
    zeros = np.zeros
    k = int(first[-1])
    return LoopRecursion(
        base=base,
        first=first,
        ending=np.concatenate([np.zeros(1, np.int64), np.cumsum(ends, dtype=np.int64)]),
        ended=np.array(ended, np.int64),
        square=np.concatenate([np.zeros(1, np.int64), np.cumsum(counts**2, dtype=np.int64)]),
        inner=inner,
        entry=entry,
        open_joint=joint_rows[:-1],
        yields=yields,
        subspace=zeros((nv, 6)),
        gain=zeros((nv, 6)),
        joint=zeros((nv, _MOST)),
        joint_rows=zeros(int(joint_rows[-1])),
        inertia=zeros((len(nodes), 6, 6)),
        push=zeros((k, 6)),
        solved=zeros((k, 6)),
        mutual=zeros(int((counts**2).sum())),
        reaction=zeros((m, 2, 6)),
        factors=zeros((m, int(ends.max(initial=0)))),
        order=zeros(m, np.int64),
        scale=np.ones(m),
        shift=zeros((bodies, 3)),
        bias=zeros((len(nodes), 6)),
        moved=zeros((len(nodes), 6)),
        row_bias=zeros(k),
        open_nu=zeros(k),
        yielded=zeros(nv),
        scratch=zeros((3, int(ends.max(initial=0)))),
        force=zeros(_MOST),
    )


def _most_operations(plan: Plan) -> float:
    """Operations of rows by their paths (``row_paths``); 0 where rows couple coordinates, which join no frames."""
    if (plan.rows[:, at.ROW_KIND] == kinds.ROW_COUPLING).any():
        return 0.0
    parents = [int(p) for p in plan.tree[:, at.PARENT]]
    visiting = np.zeros(len(parents))  # rows of which a frame lies outboard, those of which both do but once
    for row in plan.rows:
        one, other = row_bodies(plan, row)
        visiting[[b for b in (one, other) if b >= 0]] += 1.0
        nearest = _nearest(parents, one, other)
        if nearest >= 0:
            visiting[nearest] -= 1.0
    for b in range(len(parents) - 1, -1, -1):
        if parents[b] >= 0:
            visiting[parents[b]] += visiting[b]
    # rows lie far apart in matrices that have a column for each velocity: they miss caches
    spread = 2.0 * len(plan.rows) * (len(plan.free) + len(plan.driven))
    return float((150.0 * visiting + 2.0 * visiting**2).sum()) + spread


def _nearest(parents: list[int], one: int, other: int) -> int:
    """The outermost body from which both hang, -1 for the ground."""
    while one != other:  # parents come before children
        one, other = min(one, other), parents[max(one, other)]
    return one


def _bases(plan: Plan) -> IntArray:
    """(bodies,) the node that carries each body: its parent, or the ground of the branches that loops join with it."""
    base = plan.tree[:, at.PARENT].astype(np.int64)
    root: list[int] = []
    for b, parent in enumerate(base):
        root.append(b if parent < 0 else root[parent])
    joined = {b: b for b in set(root)}
    for row in plan.rows:
        moving = [root[b] for b in row_bodies(plan, row) if b >= 0]
        for b in moving[1:]:
            joined[root_of(joined, b)] = root_of(joined, moving[0])
    grounds: dict[int, int] = {}
    for b in np.flatnonzero(base < 0):
        base[b] = grounds.setdefault(root_of(joined, int(b)), len(base) + len(grounds))
    return base


def _open_rows(plan: Plan, base: IntArray) -> list[tuple[list[int], int]]:
    """Of each node the open rows, and how many of them, the first, end there."""
    parents = [int(p) for p in plan.tree[:, at.PARENT]]
    nodes = int(base.max()) + 1
    open_rows: list[set[int]] = [set() for _ in range(nodes)]
    last: list[int] = []
    for r, row in enumerate(plan.rows):
        ends = row_bodies(plan, row)
        for body in ends:
            if body >= 0:
                open_rows[body].add(r)
        last.append(_nearest(parents, *ends))
        if max(ends) < 0:  # between frames of the ground
            open_rows[-1].add(r)
    found: list[tuple[list[int], int]] = [([], 0)] * nodes
    for n in (*range(len(base) - 1, -1, -1), *range(len(base), nodes)):
        ends_here = sorted(r for r in open_rows[n] if last[r] == (n if n < len(base) else -1))
        rest = sorted(open_rows[n].difference(ends_here))
        found[n] = ends_here + rest, len(ends_here)
        if n < len(base):
            open_rows[base[n]].update(rest)
    return found


@kernel
def _load(row):
    return (row[0], row[1], row[2]), (row[3], row[4], row[5])


@kernel
def _add_wrench(row, force, torque):
    """Add a wrench, or what else moves as one, to six numbers."""
    for c in range(3):
        row[c] += force[c]
        row[3 + c] += torque[c]


@kernel
def _product(a, b):
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
            _add_wrench(unit, scale3(sign, force), scale3(sign, add3(torque, cross3(arm, force))))
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
        _solve_group(loops, first, last, found, rhs, out)
        for i in range(size):
            loops.solved[o + i, c] = out[i]
    for q in range(size, count):
        for i in range(size):
            rhs[i] = mutual[square + q * count + i]
        _solve_group(loops, first, last, found, rhs, out)
        for i in range(size):
            mutual[square + i * count + q] = out[i]
    _take_in_reactions(loops, n, o, size, count, square)
    return group + 1


@kernel
def _solve_group(loops, first, last, rank, rhs, out):
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
            gain[v + k, c] = _product(inertia[c], subspace[v + k])
        for j in range(k + 1):
            joint[v + k, j] = _product(gain[v + k], subspace[v + j])
    _factor_joint(joint, v, d)
    rows = loops.joint_rows[loops.open_joint[b] :]
    count = end - begin
    for q in range(count):
        for k in range(d):
            rows[k * count + q] = _product(loops.push[begin + q], subspace[v + k])
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
        force, torque = _load(inertia[r])
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
        force, torque = _load(loops.push[q])
        _add_wrench(loops.push[place], force, add3(torque, cross3(s, force)))
        for p in range(begin, loops.first[b + 1]):
            loops.mutual[loops.square[n] + (place - loops.first[n]) * inner + loops.inner[p] - loops.first[n]] += (
                loops.mutual[loops.square[b] + (q - loops.first[b]) * whole + p - loops.first[b]]
            )


@entry_kernel
def solve_loops(plan, loops, rank, rows, motion, multipliers):
    """motion (nv,) = M^-1 C^T nu, 0 of prescribed velocities, and nu (m,), so that C motion = ``rows`` (m,).

    With the factors of `factor_loops` and the ranks that it wrote.
    """
    ground = plan.tree.shape[0]
    loops.bias[:, :] = 0.0
    loops.row_bias[:] = 0.0
    group = 0
    for b in range(ground - 1, -1, -1):
        group = _gather_rows(loops, b, rows, rank, group)
        _gather_joint(plan, loops, b)
    for n in range(ground, loops.moved.shape[0]):
        group = _gather_rows(loops, n, rows, rank, group)
        loops.moved[n, :] = 0.0
        _spread_rows(loops, n, multipliers)
    for b in range(ground):
        _spread_joint(plan, loops, b, motion)
        _spread_rows(loops, b, multipliers)


@kernel
def _gather_rows(loops, n, rows, rank, group):
    """Reactions of the rows that end at a node, with the node at rest and no other open row pushing."""
    first, last = loops.ending[n], loops.ending[n + 1]
    size = last - first
    if size == 0:
        return group
    o, count, square = loops.first[n], loops.first[n + 1] - loops.first[n], loops.square[n]
    rhs, out = loops.scratch[0, :size], loops.scratch[1, :size]
    for i in range(size):
        rhs[i] = loops.row_bias[o + i] + rows[loops.ended[first + i]]
    _solve_group(loops, first, last, rank[group], rhs, out)
    for i in range(size):
        loops.row_bias[o + i] = out[i]
        for c in range(6):
            loops.bias[n, c] += loops.push[o + i, c] * out[i]
        for q in range(size, count):
            loops.row_bias[o + q] -= loops.mutual[square + q * count + i] * out[i]
    return group + 1


@kernel
def _gather_joint(plan, loops, b):
    """Let the joint of body b yield to the wrench outboard of it, and hand on what is left."""
    v, d, n = plan.tree[b, at.JOINT_V], plan.tree[b, at.JOINT_SIZE], loops.base[b]
    begin, end = loops.first[b] + loops.ending[b + 1] - loops.ending[b], loops.first[b + 1]
    count = end - begin
    bias = loops.bias[b]
    if d > 0 and loops.yields[v] == 1:
        rows = loops.joint_rows[loops.open_joint[b] :]
        felt = loops.force
        for k in range(d):
            felt[k] = _product(loops.subspace[v + k], bias)
        for k in range(d):
            for c in range(6):
                bias[c] -= loops.gain[v + k, c] * felt[k]
            for q in range(count):
                loops.row_bias[begin + q] -= rows[k * count + q] * felt[k]
        _solve_joint(loops.joint, v, d, felt)
        for k in range(d):
            loops.yielded[v + k] = felt[k]
    s = load3(loops.shift[b], 0)
    force, torque = _load(bias)
    _add_wrench(loops.bias[n], force, add3(torque, cross3(s, force)))
    for q in range(begin, end):
        loops.row_bias[loops.inner[q]] += loops.row_bias[q]


@kernel
def _solve_joint(joint, v, d, values):
    for k in range(d):
        for j in range(k):
            values[k] -= joint[v + k, j] * values[j]
        values[k] /= joint[v + k, k]
    for k in range(d - 1, -1, -1):
        for j in range(k + 1, d):
            values[k] -= joint[v + j, k] * values[j]
        values[k] /= joint[v + k, k]


@kernel
def _spread_rows(loops, n, multipliers):
    """Reactions of the rows that end at a node, which moves, and on which other rows push."""
    first, size = loops.ending[n], loops.ending[n + 1] - loops.ending[n]
    o, count, square = loops.first[n], loops.first[n + 1] - loops.first[n], loops.square[n]
    for i in range(size):
        nu = loops.row_bias[o + i] + _product(loops.solved[o + i], loops.moved[n])
        for q in range(size, count):
            nu -= loops.mutual[square + i * count + q] * loops.open_nu[o + q]
        loops.open_nu[o + i] = nu
        multipliers[loops.ended[first + i]] = nu


@kernel
def _spread_joint(plan, loops, b, motion):
    """The joint of body b, on its parent as that moves."""
    v, d, n = plan.tree[b, at.JOINT_V], plan.tree[b, at.JOINT_SIZE], loops.base[b]
    begin, end = loops.first[b] + loops.ending[b + 1] - loops.ending[b], loops.first[b + 1]
    count = end - begin
    linear, angular = _load(loops.moved[n])
    moved = loops.moved[b]
    store3(moved, 0, add3(linear, cross3(angular, load3(loops.shift[b], 0))))
    store3(moved, 3, angular)
    for q in range(begin, end):
        loops.open_nu[q] = loops.open_nu[loops.inner[q]]
    yields = d > 0 and loops.yields[v] == 1
    rows = loops.joint_rows[loops.open_joint[b] :]
    for k in range(d):
        motion[v + k] = 0.0
        if yields:
            rate = -loops.yielded[v + k] - _product(loops.gain[v + k], moved)
            for q in range(count):
                rate -= rows[k * count + q] * loops.open_nu[begin + q]
            motion[v + k] = -rate
    if yields:
        for k in range(d):
            for c in range(6):
                moved[c] -= loops.subspace[v + k, c] * motion[v + k]


@entry_kernel
def rows_times(plan, loops, vector, out):
    """out (m,) = C times a vector (nv,), of the poses at which `factor_loops` was called last."""
    ground = plan.tree.shape[0]
    loops.moved[ground:, :] = 0.0
    for b in range(ground):
        linear, angular = _load(loops.moved[loops.base[b]])
        moved = loops.moved[b]
        store3(moved, 0, add3(linear, cross3(angular, load3(loops.shift[b], 0))))
        store3(moved, 3, angular)
        for k in range(plan.tree[b, at.JOINT_V], plan.tree[b, at.JOINT_V] + plan.tree[b, at.JOINT_SIZE]):
            for c in range(6):
                moved[c] += loops.subspace[k, c] * vector[k]
    for i in range(plan.rows.shape[0]):
        out[i] = 0.0
        for end in range(2):
            b = plan.frame_of[plan.rows[i, at.ROW_F if end == 0 else at.ROW_G], at.FRAME_BODY]
            if b >= 0:
                out[i] += _product(loops.reaction[i, end], loops.moved[b])
