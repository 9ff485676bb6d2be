"""Accelerations and reactions by the factors of `loop_recursion`."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    load3,
    store3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.forward_dynamics.loop_recursion import (
    add_wrench,
    load_wrench,
    solve_group,
    wrench_product,
)


@entry_kernel
def solve_loops(plan, loops, rank, rows, motion, multipliers):
    """motion (nv,) = M^-1 C^T nu, 0 of prescribed velocities, and nu (m,), so that C motion = ``rows`` (m,).

    With the factors of `factor_loops` and the ranks that it wrote.

    Args:
        plan: Plan, the compiled scene.
        loops: LoopRecursion of the plan.
        rank: (groups,) int64, number of pivots that count, of each node.
        rows: (m,) float64.
        motion: (nv,) float64, output.
        multipliers: (m,) float64, output.
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
    solve_group(loops, first, last, rank[group], rhs, out)
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
            felt[k] = wrench_product(loops.subspace[v + k], bias)
        for k in range(d):
            for c in range(6):
                bias[c] -= loops.gain[v + k, c] * felt[k]
            for q in range(count):
                loops.row_bias[begin + q] -= rows[k * count + q] * felt[k]
        _solve_joint(loops.joint, v, d, felt)
        for k in range(d):
            loops.yielded[v + k] = felt[k]
    s = load3(loops.shift[b], 0)
    force, torque = load_wrench(bias)
    add_wrench(loops.bias[n], force, add3(torque, cross3(s, force)))
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
        nu = loops.row_bias[o + i] + wrench_product(loops.solved[o + i], loops.moved[n])
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
    linear, angular = load_wrench(loops.moved[n])
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
            rate = -loops.yielded[v + k] - wrench_product(loops.gain[v + k], moved)
            for q in range(count):
                rate -= rows[k * count + q] * loops.open_nu[begin + q]
            motion[v + k] = -rate
    if yields:
        for k in range(d):
            for c in range(6):
                moved[c] -= loops.subspace[v + k, c] * motion[v + k]


@entry_kernel
def rows_times(plan, loops, vector, out):
    """out (m,) = C times a vector (nv,), of the poses at which `factor_loops` was called last.

    Args:
        plan: Plan, the compiled scene.
        loops: LoopRecursion of the plan.
        vector: (nv,) float64.
        out: (m,) float64, output.
    """
    ground = plan.tree.shape[0]
    loops.moved[ground:, :] = 0.0
    for b in range(ground):
        linear, angular = load_wrench(loops.moved[loops.base[b]])
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
                out[i] += wrench_product(loops.reaction[i, end], loops.moved[b])
