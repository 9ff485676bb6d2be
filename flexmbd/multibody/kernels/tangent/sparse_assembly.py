"""The tangent of a tree's residual into the blocks of a sparse matrix: the columns of ``residual_tangent``.

It costs as much as the matrix has entries: each pair of unknowns that carry each other, and each pair on the paths of a
force, is met once, its place known from compile (``sparse_places``).

Of a cut body c, numbered outwards from the one that carries it, c', the equations are motion_c - motion_c' - (what
unknowns between them cause) = 0 and wrench_c - answer motion_c - (what unknowns on c require) - (wrenches of cut bodies
that c carries) = 0; joints and modes that carry c meet its wrench in place of what lies outboard of it.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import block_view
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.closure import coupling_term
from flexmbd.multibody.kernels.tangent import sparse_places as sp
from flexmbd.multibody.kernels.tangent import tangent_layout as tl
from flexmbd.multibody.kernels.tangent.body_moments import rigid_composite
from flexmbd.multibody.kernels.tangent.residual_tangent import (
    add_modes,
    begin_columns,
    carry_inward,
    joint_block,
    joint_coupling_block,
    mode_block,
)
from flexmbd.multibody.kernels.tangent.row_pairs import put_group
from flexmbd.multibody.kernels.tangent.sparse_elements import (
    add_sparse_changes,
    add_sparse_elements,
    modes_of_frame,
    number_blocks,
    own_block,
    row_of,
)
from flexmbd.multibody.kernels.tangent.tangent_columns import composite_change, frame_columns, joint_columns
from flexmbd.multibody.kernels.tangent.tree_recursion import SHIFT, TURN
from flexmbd.multibody.kernels.tangent.unknown_blocks import CUT, MOTION, WRENCH

INERTIAL = 9  # entries of a motion that inertia feels: the first
_ZERO = (0.0, 0.0, 0.0)


@deferred_kernel()
def _sparse_modes(plan, work, tw, to, i, x, v, a, per_x, per_v, per_a, values):
    block = to.block[plan.tree[i, at.MODAL_V]]
    own = block_view(values, to.diagonal[block, 0], to.diagonal[block, 1], to.starts[2])
    add_modes(plan, work, tw, i, x, v, a, per_x, per_v, per_a, own)


@deferred_kernel()
def _sparse_frame(plan, work, tw, to, f, row, x, v, a, per_x, per_v, per_a, values):
    block = to.block[modes_of_frame(plan, f)]
    own = block_view(values, to.diagonal[block, 0], to.diagonal[block, 1], to.starts[2])
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
        if tw.cut_of[i] >= 0:
            _put_cut(tw, to, i, values)
        joint_columns(plan, work, tw, i, per_x, per_v, per_a)
        if tree[at.JOINT_SIZE] > 0 and to.block[tree[at.JOINT_V]] >= 0:
            block = to.block[tree[at.JOINT_V]]
            joint_block(plan, tw, tree, block_view(values, to.diagonal[block, 0], to.diagonal[block, 1], to.starts[2]))
        f = tree[at.FRAME_PARENT]
        if plan.frame_of[f, at.FRAME_MODES] >= 0:
            _sparse_frame(plan, work, tw, to, f, tw.body[i], x, v, a, per_x, per_v, per_a, values)
        carry_inward(plan, tw, i)


@kernel
def _couple_bodies(tw, to, values):
    """Fill all entries between a body's unknowns and those that carry it."""
    n = to.starts[2]
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
def _answer(row, c):
    """The wrench of a body with all outboard of it by entry c of its motion: phi', phi'', alpha."""
    unit = (1.0 if c % 3 == 0 else 0.0, 1.0 if c % 3 == 1 else 0.0, 1.0 if c % 3 == 2 else 0.0)
    turn, turn2 = unit if c < 3 else _ZERO, unit if 3 <= c < 6 else _ZERO
    return composite_change(row, turn, turn2, unit if c >= 6 else _ZERO)


@kernel
def _put_cut(tw, to, i, values):
    """The equations of cut body i among its own unknowns: motion = ..., wrench - answer motion = ...

    What carries it does not see its moments, but the wrench.
    """
    first = tw.cut_of[i]
    block = to.block[first]
    own = block_view(values, to.diagonal[block, 0], to.diagonal[block, 1], to.starts[2])
    for k in range(first, first + CUT):
        own[k, k] += 1.0
    for c in range(INERTIAL):
        force, torque = _answer(tw.body[i], c)
        for t in range(3):
            own[first + MOTION + t, first + c] -= force[t]
            own[first + MOTION + 3 + t, first + c] -= torque[t]
    for k in range(tl.C_FORCE):
        tw.body[i, k] = 0.0


@deferred_kernel()
def _couple_cuts(tw, to, values):
    """What cut bodies do to those that they carry, and those that carry them; these come last."""
    n = to.starts[2]
    for p in range(to.carried.shape[0]):
        pair = to.carried[p]
        outer = block_view(values, pair[sp.P_OUTER], pair[sp.P_OUTER_STRIDE], n)
        inner = block_view(values, pair[sp.P_INNER], pair[sp.P_INNER_STRIDE], n)
        first = pair[sp.P_FIRST]
        for r in range(pair[sp.P_START], pair[sp.P_STOP]):
            for c in range(INERTIAL):
                outer[r, first + c] += tw.projection[c, r]
            for c in range(WRENCH):
                inner[first + MOTION + c, r] -= tw.wrench[c, r]
    for p in range(to.carrying.shape[0]):
        pair = to.carrying[p]
        if pair[sp.P_EDGE] >= 0:
            _carry(tw.edge_twist, tw.edge_motion, pair[sp.P_EDGE] - pair[sp.P_START], to, pair, values)
        else:
            _carry(tw.twist, tw.motion, 0, to, pair, values)
    for p in range(to.nested.shape[0]):
        pair = to.nested[p]
        outer = block_view(values, pair[sp.P_OUTER], pair[sp.P_OUTER_STRIDE], n)
        inner = block_view(values, pair[sp.P_INNER], pair[sp.P_INNER_STRIDE], n)
        for c in range(MOTION):
            outer[pair[sp.P_START] + c, pair[sp.P_FIRST] + c] -= 1.0
        for c in range(MOTION, CUT):
            inner[pair[sp.P_FIRST] + c, pair[sp.P_START] + c] -= 1.0


@kernel
def _carry(twist, motion, shift, to, pair, values):
    """A cut body is moved by unknowns that carry it, which bear its wrench; columns are ``shift`` from the unknowns."""
    bearing = block_view(values, pair[sp.P_OUTER], pair[sp.P_OUTER_STRIDE], to.starts[2])
    moved = block_view(values, pair[sp.P_INNER], pair[sp.P_INNER_STRIDE], to.starts[2])
    first = pair[sp.P_FIRST]
    for r in range(pair[sp.P_START], pair[sp.P_STOP]):
        k = r + shift
        for c in range(12):
            moved[first + c, r] -= motion[c, k]
        for c in range(3):
            moved[first + SHIFT + c, r] -= twist[3 + c, k]
            moved[first + TURN + c, r] -= twist[c, k]
            bearing[r, first + MOTION + c] += twist[3 + c, k]
            bearing[r, first + MOTION + 3 + c] += twist[c, k]


@deferred_kernel()
def _add_sparse_rows(plan, work, tw, to, x, v, a, multipliers, per_x, per_v, per_a, values):
    """Add the geometric stiffness of the rows' reactions; write ``tw.jacobian`` and ``tw.rate_jacobian``."""
    n = to.starts[2]
    for s in range(to.row_first.shape[0] - 1):
        first, last = to.row_first[s], to.row_first[s + 1]
        row = plan.rows[first]
        if row[at.ROW_KIND] == kinds.ROW_COUPLING:
            _put_coupling(plan, tw, to, first, per_v)
            continue
        f, g = own_block(plan, to, row[at.ROW_F]), own_block(plan, to, row[at.ROW_G])
        at_f, at_g = block_view(values, f[0], f[1], n), block_view(values, g[0], g[1], n)
        count, moved = put_group(
            plan, work, tw, first, last, x, v, a, multipliers, per_x, per_v, per_a, at_f, at_g, True
        )
        add_sparse_changes(tw, to, plan.elements.shape[0] + s, count, moved, values)


@kernel
def _put_coupling(plan, tw, to, i, per_v):
    """Jacobian of a coupling of coordinates."""
    o = plan.rows[i, at.ROW_DATA]
    count = 0
    for k in range(int(plan.data[o])):
        v, share = coupling_term(plan, o, k)
        if to.block[v] >= 0:
            tw.row_unknown[i, count] = v
            tw.jacobian[i, count] = share
            tw.rate_jacobian[i, count] = per_v * share
            count += 1
    tw.row_count[i] = count


@entry_kernel
def put_rows(plan, tw, to, jacobian, slopes, push, values):
    """Write rows and columns of the multipliers, after ``assemble_sparse``: ``push`` C^T, and by ``slopes`` (m, 3).

    Row i is slopes[i, 0] C_i + slopes[i, 1] (the derivative of its rate), and slopes[i, 2] on the diagonal, with this
    C_i of ``jacobian``, which is ``tw.jacobian`` where turns within a step do not count.
    """
    begin = to.element_first[plan.elements.shape[0]]
    for s in range(to.row_first.shape[0] - 1):
        first, last = to.row_first[s], to.row_first[s + 1]
        e = plan.elements.shape[0] + s
        number_blocks(to, e)
        for i in range(first, last):
            nu = to.starts[0] + i
            own = to.block[nu]
            values[to.diagonal[own, 0] + to.diagonal[own, 1] * nu + nu] = slopes[i, 2]
            for j in range(tw.row_count[first]):
                k = tw.row_unknown[first, j]
                r, sign = row_of(to, k)
                place = to.element_first[e] - begin + to.local[to.block[k]]
                slope = slopes[i, 0] * jacobian[i, j] + slopes[i, 1] * tw.rate_jacobian[i, j]
                values[to.row_bases[place, 0] + to.row_bases[place, 1] * nu + k] = slope
                if r >= 0:
                    values[to.row_bases[place, 2] + to.row_bases[place, 3] * r + nu] = push * sign * tw.jacobian[i, j]


@entry_kernel
def assemble_sparse(plan, work, tw, to, x, v, a, multipliers, per_x, per_v, per_a, values):
    """values = per_x dr/dx + per_v dr/dv + per_a dr/da of ``residual`` at (x, v, a), which left ``work``.

    ``to``: `SparsePlaces`; ``tw``: `new_tangent_work` for its blocks.  Rows and columns of multipliers are left zero.
    """
    for k in range(values.shape[0]):
        values[k] = 0.0
    _put_columns(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values)
    for i in range(plan.shafts.shape[0]):
        k = int(plan.shafts[i, at.SHAFT_V])
        block = to.block[k]
        if block >= 0:
            values[to.diagonal[block, 0] + to.diagonal[block, 1] * k + k] += per_a * plan.shafts[i, at.SHAFT_INERTIA]
    if plan.rows.shape[0] > 0:
        _add_sparse_rows(plan, work, tw, to, x, v, a, multipliers, per_x, per_v, per_a, values)
    # no acceleration changes them; motions of cut bodies do, whose unknowns have their weights already
    if plan.elements.shape[0] > 0 and (per_x != 0.0 or per_v != 0.0 or to.starts[2] > to.starts[1]):
        add_sparse_elements(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values)
    _couple_bodies(tw, to, values)
    if to.carrying.shape[0] > 0:
        _couple_cuts(tw, to, values)
