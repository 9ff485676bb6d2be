"""The tangent of a tree's residual into the blocks of a sparse matrix: the columns of ``residual_tangent``.

It costs as much as the matrix has entries: each pair of unknowns that carry each other, and each pair on the paths of a
force, is met once, its place known from compile (``sparse_places``).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.table import (
    coordinate_law,
    is_between_frames,
    is_coordinate_law,
    subtract_force_tangent,
)
from flexmbd.multibody.kernels.tangent import sparse_places as sp
from flexmbd.multibody.kernels.tangent.block_view import block_view
from flexmbd.multibody.kernels.tangent.body_moments import rigid_composite
from flexmbd.multibody.kernels.tangent.frame_pairs import change_by, clear_path, motion_of_pair, put_element
from flexmbd.multibody.kernels.tangent.residual_tangent import (
    add_modes,
    begin_columns,
    carry_inward,
    joint_block,
    joint_coupling_block,
    mode_block,
)
from flexmbd.multibody.kernels.tangent.tangent_columns import frame_columns, joint_columns


@kernel
def _modes_of_frame(plan, f):
    """The first velocity of the modes that move frame f, or any of its body; -1 where the body has none."""
    body = plan.frame_of[f, at.FRAME_BODY]
    if body < 0 or plan.tree[body, at.FLEX] < 0:
        return -1
    return plan.tree[body, at.MODAL_V]


@deferred_kernel()
def _sparse_modes(plan, work, tw, to, i, x, v, a, per_x, per_v, per_a, values):
    block = to.block[plan.tree[i, at.MODAL_V]]
    own = block_view(values, to.diagonal[block, 0], to.diagonal[block, 1], v.shape[0])
    add_modes(plan, work, tw, i, x, v, a, per_x, per_v, per_a, own)


@deferred_kernel()
def _sparse_frame(plan, work, tw, to, f, row, x, v, a, per_x, per_v, per_a, values):
    block = to.block[_modes_of_frame(plan, f)]
    own = block_view(values, to.diagonal[block, 0], to.diagonal[block, 1], v.shape[0])
    frame_columns(plan, work, tw, f, row, x, v, a, per_x, per_v, per_a, own)


@kernel
def _put_columns(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values):
    """The columns, and what modes and joints make among themselves."""
    begin_columns(plan, work, tw)
    for i in range(plan.tree.shape[0]):
        if plan.tree[i, at.FLEX] < 0:
            rigid_composite(plan, work, tw, i)
        else:
            _sparse_modes(plan, work, tw, to, i, x, v, a, per_x, per_v, per_a, values)
    for i in range(plan.tree.shape[0] - 1, -1, -1):
        tree = plan.tree[i]
        joint_columns(plan, work, tw, i, per_x, per_v, per_a)
        if tree[at.JOINT_SIZE] > 0 and to.block[tree[at.JOINT_V]] >= 0:
            block = to.block[tree[at.JOINT_V]]
            joint_block(plan, tw, tree, block_view(values, to.diagonal[block, 0], to.diagonal[block, 1], v.shape[0]))
        f = tree[at.FRAME_PARENT]
        if plan.frame_of[f, at.FRAME_MODES] >= 0:
            _sparse_frame(plan, work, tw, to, f, tw.body[i], x, v, a, per_x, per_v, per_a, values)
        carry_inward(plan, tw, i)


@kernel
def _couple_bodies(tw, to, values):
    """Fill all entries between a body's unknowns and those that carry it."""
    n = to.block.shape[0]
    for p in range(to.pairs.shape[0]):
        pair = to.pairs[p]
        start, stop, first, count = pair[sp.P_START], pair[sp.P_STOP], pair[sp.P_FIRST], pair[sp.P_COUNT]
        outer = block_view(values, pair[sp.P_OUTER], pair[sp.P_OUTER_STRIDE], n)
        inner = block_view(values, pair[sp.P_INNER], pair[sp.P_INNER_STRIDE], n)
        if pair[sp.P_EDGE] >= 0:
            mode_block(tw, pair[sp.P_EDGE], count, first, start, stop, outer, inner)
        else:
            joint_coupling_block(tw, first, count, start, stop, outer, inner)


@kernel
def _own_block(plan, to, f):
    """Base and stride of the block of the modes that move frame f; any where there are none."""
    modes = _modes_of_frame(plan, f)
    block = to.block[modes] if modes >= 0 else 0
    return to.diagonal[block, 0], to.diagonal[block, 1]


@kernel
def _add_element(plan, work, tw, to, e, x, v, a, per_x, per_v, per_a, values):
    """Add stiffness and damping of a force between frames."""
    row, n = plan.elements[e], v.shape[0]
    base_f, stride_f = _own_block(plan, to, row[at.EL_F])
    base_g, stride_g = _own_block(plan, to, row[at.EL_G])
    at_f, at_g = block_view(values, base_f, stride_f, n), block_view(values, base_g, stride_g, n)
    count, moved = put_element(plan, work, tw, row, x, v, a, per_x, per_v, per_a, at_f, at_g)
    begin, blocks = to.element_first[e], to.element_first[e + 1] - to.element_first[e]
    for j in range(blocks):
        to.local[to.element_blocks[begin + j]] = j
    path, bases = tw.path, to.base_first[e]
    for i in range(count):
        r = path[i]
        motion = motion_of_pair(tw.path_twist, r)
        line = bases + blocks * to.local[to.block[r]]
        for j in range(moved):
            k = path[j]
            place = line + to.local[to.block[k]]
            values[to.bases[place, 0] + to.bases[place, 1] * r + k] += change_by(tw.path_wrench, motion, k)
    clear_path(tw, count)


@deferred_kernel()
def _add_sparse_elements(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values):
    """Add what all force elements change."""
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        kind, k = row[at.EL_KIND], row[at.EL_V]
        if is_between_frames(kind):
            _add_element(plan, work, tw, to, e, x, v, a, per_x, per_v, per_a, values)
        elif to.block[k] >= 0:
            block = to.block[k]
            base, stride = to.diagonal[block, 0], to.diagonal[block, 1]
            if is_coordinate_law(kind):
                _, slope_x, slope_v = coordinate_law(plan, row, x[row[at.EL_X]], v[k])
                values[base + stride * k + k] -= per_x * slope_x + per_v * slope_v
            else:
                own = block_view(values, base, stride, v.shape[0])
                subtract_force_tangent(plan, work, tw, row, x, v, per_x, per_v, own)


@entry_kernel
def assemble_sparse(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values):
    """values = per_x dr/dx + per_v dr/dv + per_a dr/da of ``residual`` at (x, v, a), which left ``work``.

    ``to``: `SparsePlaces`; ``tw``: `new_tangent_work`, of the free unknowns alone.  Of trees without constraint rows.
    """
    for k in range(values.shape[0]):
        values[k] = 0.0
    _put_columns(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values)
    for i in range(plan.shafts.shape[0]):
        k = int(plan.shafts[i, at.SHAFT_V])
        block = to.block[k]
        if block >= 0:
            values[to.diagonal[block, 0] + to.diagonal[block, 1] * k + k] += per_a * plan.shafts[i, at.SHAFT_INERTIA]
    if plan.elements.shape[0] > 0:
        _add_sparse_elements(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values)
    _couple_bodies(tw, to, values)
