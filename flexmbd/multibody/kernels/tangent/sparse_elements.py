"""What force elements, elastic surfaces among them, change in the blocks of a sparse matrix (``sparse_assembly``)."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import block_view
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements import surface_groups as sg
from flexmbd.multibody.kernels.elements.contact_wrench import state_count
from flexmbd.multibody.kernels.elements.table import (
    coordinate_law,
    is_between_frames,
    is_coordinate_law,
    is_of_surface,
    subtract_force_tangent,
)
from flexmbd.multibody.kernels.inverse_dynamics.pressed_surfaces import (
    APART,
    is_of_group,
    modes_of,
    other_modes_of,
    role,
)
from flexmbd.multibody.kernels.tangent.frame_pairs import change_by, clear_path, motion_of_pair, put_element
from flexmbd.multibody.kernels.tangent.surface_group_tangent import (
    load_member_edges,
    modes_of_body,
    put_surface_group,
    put_surface_member,
    stiffen_group,
)
from flexmbd.multibody.kernels.tangent.surface_tangent import put_surface
from flexmbd.multibody.kernels.tangent.tree_recursion import SHIFT
from flexmbd.multibody.kernels.tangent.unknown_blocks import CUT, WRENCH


@kernel
def modes_of_frame(plan, f):
    """The first velocity of the modes that move frame f, or any of its body; -1 where the body has none."""
    body = plan.frame_of[f, at.FRAME_BODY]
    if body < 0 or plan.tree[body, at.FLEX] < 0:
        return -1
    return plan.tree[body, at.MODAL_V]


@kernel
def own_block(plan, to, f):
    """Base and stride of the block of the modes that move frame f; any where there are none."""
    modes = modes_of_frame(plan, f)
    block = to.block[modes] if modes >= 0 else 0
    return to.diagonal[block, 0], to.diagonal[block, 1]


@kernel
def number_blocks(to, e):
    """Count the blocks that force element e, or a group of rows, joins; return how many."""
    begin, blocks = to.element_first[e], to.element_first[e + 1] - to.element_first[e]
    for j in range(blocks):
        to.local[to.element_blocks[begin + j]] = j
    return blocks


@kernel
def row_of(to, r):
    """The row of the matrix in which what acts on unknown r stands, and its sign; -1: there is none.

    A wrench on what a cut body carries is part of the equation of its wrench: that is the one on its place and turn.
    """
    if r < to.starts[1]:
        return r, 1.0
    return r + WRENCH if (r - to.starts[1]) % CUT >= SHIFT else -1, -1.0


@kernel
def add_sparse_changes(tw, to, e, count, moved, values):
    """Add the stored changes of force element e, or of a group of rows; see ``frame_pairs``."""
    blocks = number_blocks(to, e)
    path = tw.path
    for i in range(count):
        r, sign = row_of(to, path[i])
        if r < 0:
            continue
        motion = motion_of_pair(tw.path_twist, path[i])
        line = to.base_first[e] + blocks * to.local[to.block[r]]
        for j in range(moved):
            k = path[j]
            place = line + to.local[to.block[k]]
            change = sign * change_by(tw.path_wrench, motion, k)
            values[to.bases[place, 0] + to.bases[place, 1] * r + k] += change
    clear_path(tw, count)


@deferred_kernel()
def _add_rates(tw, to, e, first, size, shift, moved, values):
    """Add the stored changes of a force element's own rows from ``first``, after ``add_sparse_changes``.

    They are the rates of its states, or the forces on the modes of its patches, and stored from ``shift`` on.
    """
    blocks = to.element_first[e + 1] - to.element_first[e]
    for i in range(size):
        r = first + i
        line = to.base_first[e] + blocks * to.local[to.block[r]]
        for j in range(moved):
            k = tw.path[j]
            place = line + to.local[to.block[k]]
            values[to.bases[place, 0] + to.bases[place, 1] * r + k] += tw.path_rates[shift + i, k]


@deferred_kernel()
def _add_surface(plan, work, tw, to, e, x, v, a, per_x, per_v, per_a, at_f, at_g, values):
    """Add the stiffness of an elastic surface that touches."""
    count, moved = put_surface(plan, work, tw, plan.elements[e], x, v, a, per_x, per_v, per_a, at_f, at_g)
    add_sparse_changes(tw, to, e, count, moved, values)
    _, first, n = modes_of(plan, plan.elements[e])
    _, other, n_other = other_modes_of(plan, plan.elements[e])
    _add_rates(tw, to, e, first, n, 0, moved, values)
    _add_rates(tw, to, e, other, n_other, n, moved, values)


@deferred_kernel()
def _add_group(plan, work, tw, to, g, x, v, a, per_x, per_v, per_a, values):
    """Add the stiffness of all elastic surfaces of a group."""
    bearing, first, n = stiffen_group(plan, work, g, x), True, to.starts[2]
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        if is_of_group(plan, row, g):
            one, other = own_block(plan, to, row[at.EL_F]), own_block(plan, to, row[at.EL_G])
            at_f, at_g = block_view(values, one[0], one[1], n), block_view(values, other[0], other[1], n)
            if bearing == APART:
                _add_surface(plan, work, tw, to, e, x, v, a, per_x, per_v, per_a, at_f, at_g, values)
            elif bearing > 0 and sg.bears(plan, work, row):
                load_member_edges(plan, work, tw, row, x, v, a, per_x, per_v, per_a, at_f, at_g)
    if bearing <= 0:
        return
    put_surface_group(plan, work, tw, g, per_x)
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        if not (is_of_group(plan, row, g) and sg.bears(plan, work, row)):
            continue
        count, moved = put_surface_member(plan, work, tw, row, per_x)
        add_sparse_changes(tw, to, e, count, moved, values)
        if first:
            for b in range(sg.of_group(plan, g, sg.N_BODIES)):
                qv, modes = modes_of_body(plan, g, b)
                _add_rates(tw, to, e, qv, modes, sg.of_body(plan, g, b, sg.FIRST_MODE), moved, values)
            first = False


@kernel
def _add_element(plan, work, tw, to, e, x, v, a, per_x, per_v, per_a, values):
    """Add stiffness and damping of a force between frames."""
    row, n = plan.elements[e], to.starts[2]
    f, g = own_block(plan, to, row[at.EL_F]), own_block(plan, to, row[at.EL_G])
    at_f, at_g = block_view(values, f[0], f[1], n), block_view(values, g[0], g[1], n)
    if is_of_surface(row[at.EL_KIND]):
        part = role(plan, row)
        if part == 0:
            _add_surface(plan, work, tw, to, e, x, v, a, per_x, per_v, per_a, at_f, at_g, values)
        elif part == 1:
            _add_group(plan, work, tw, to, sg.group_of(plan, row), x, v, a, per_x, per_v, per_a, values)
        return
    count, moved = put_element(plan, work, tw, row, x, v, a, per_x, per_v, per_a, at_f, at_g)
    add_sparse_changes(tw, to, e, count, moved, values)
    if row[at.EL_V] >= 0:
        _add_rates(tw, to, e, row[at.EL_V], state_count(plan, row), 0, moved, values)


@deferred_kernel()
def add_sparse_elements(plan, work, tw, to, x, v, a, per_x, per_v, per_a, values):
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
                own = block_view(values, base, stride, to.starts[2])
                subtract_force_tangent(plan, work, tw, row, x, v, per_x, per_v, own)
