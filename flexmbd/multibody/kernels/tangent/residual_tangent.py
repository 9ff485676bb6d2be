"""The tangent of a tree's residual: analytic, with nonzeros only between ancestors and descendants.

One sweep outwards for each body's own moments and modes, one inwards that sums the moments up and makes the columns
of joints and frames, and one pass over all pairs of a body and its ancestors, a few products an entry.  Closed forms
by summed moments for rigid bodies: Singh, Russell & Wensing 2022 (doi:10.1109/LRA.2022.3141194); here moments of r and
r' take the place of their spatial matrices, and frames that deform that of joints.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import left_jacobian_transposed, load3, load9, rotate, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import is_slide, spin_of
from flexmbd.multibody.kernels.tangent import tangent_layout as tl
from flexmbd.multibody.kernels.tangent.body_moments import (
    add_modal_block,
    flexible_composite,
    modal_columns,
    rigid_composite,
)
from flexmbd.multibody.kernels.tangent.diagonal_blocks import between, clear_blocks
from flexmbd.multibody.kernels.tangent.frame_pairs import add_elements, add_elements_of_joints
from flexmbd.multibody.kernels.tangent.ground_forces import add_ground_forces
from flexmbd.multibody.kernels.tangent.laws import add_laws, add_laws_of_joints
from flexmbd.multibody.kernels.tangent.pair_tangent import add_pairs
from flexmbd.multibody.kernels.tangent.row_pairs import add_closures
from flexmbd.multibody.kernels.tangent.surface_tangent import add_surfaces
from flexmbd.multibody.kernels.tangent.tangent_columns import (
    add_motion_products,
    add_products,
    frame_columns,
    joint_columns,
    load_column,
)
from flexmbd.multibody.kernels.tangent.tree_recursion import MOTION, put_bodies, put_joints

_MOST_OF_JOINT = 6  # unknowns of a joint


@kernel
def begin_columns(plan, work, tw):
    """Place the point o, and clear what columns add up."""
    for k in range(3):
        tw.origin[k] = 0.0
        tw.origin[3 + k] = 0.0
    if plan.tree.shape[0] > 0:
        body = work.body[0]
        place = load3(body, at.B_P)
        velocity = rotate(load9(body, at.B_R), load3(body, at.B_V))
        for k in range(3):
            tw.origin[k] = place[k]
            tw.origin[3 + k] = velocity[k]
    tw.wrench[:] = 0.0
    tw.projection[:] = 0.0


@kernel
def _body_sweep(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix):
    """Each body's moments, and all about its own modes."""
    begin_columns(plan, work, tw)
    for i in range(plan.tree.shape[0]):
        tree = plan.tree[i]
        if tree[at.FLEX] < 0:
            rigid_composite(plan, work, tw, i)
        else:
            add_modes(plan, work, tw, i, x, v, a, per_x, per_v, per_a, matrix)


@deferred_kernel()
def add_modes(plan, work, tw, i, x, v, a, per_x, per_v, per_a, matrix):
    """Moments of flexible body i, and all about its own modes."""
    tree = plan.tree[i]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    q = x[qx : qx + n]
    flexible_composite(plan, work, tw, i, q, v[qv : qv + n], a[qv : qv + n])
    modal_columns(plan, work, tw, i, per_x, per_v, per_a)
    add_modal_block(plan, work, tw, i, q, per_x, per_v, per_a, matrix)


@kernel
def _inward_sweep(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix):
    """Sum the moments up and make the columns of joints and of the frames they stand on."""
    for i in range(plan.tree.shape[0] - 1, -1, -1):
        tree = plan.tree[i]
        joint_columns(plan, work, tw, i, per_x, per_v, per_a)
        f = tree[at.FRAME_PARENT]
        if plan.frame_of[f, at.FRAME_MODES] >= 0:
            frame_columns(plan, work, tw, f, tw.body[i], x, v, a, per_x, per_v, per_a, matrix)
        carry_inward(plan, tw, i)


@kernel
def carry_inward(plan, tw, i):
    """Add the moments of body i, and of all outboard of it, to those of the body that carries it."""
    parent = plan.tree[i, at.PARENT]
    if parent >= 0:
        for k in range(tl.C_FORCE):
            tw.body[parent, k] += tw.body[i, k]


@kernel
def _projection_product(tw, r, motion, k):
    """Projection of column k's motion on row r."""
    t = 0.0
    for c in range(9):
        t += tw.projection[c, r] * motion[c, k]
    return t


@kernel
def _twist_product(tw, r, k):
    """The wrench of column k, projected on the motion subspace of joint unknown r."""
    t = 0.0
    for c in range(3):
        t += tw.twist[c, r] * tw.wrench[3 + c, k] + tw.twist[3 + c, r] * tw.wrench[c, k]
    return t


@kernel
def joint_block(plan, tw, link, matrix):
    """The unknowns of one joint among themselves.

    What slides along an axis of the parent's frame does not turn with the body; an axis of turning moves with it.
    """
    size = link[at.JOINT_SIZE]
    o = link[at.JOINT_V]
    for r in range(size):
        slides = is_slide(plan, link, r)
        for k in range(size):
            if slides:
                matrix[o + r, o + k] += _twist_product(tw, o + r, o + k)
            else:
                matrix[o + r, o + k] += _projection_product(tw, o + r, tw.motion, o + k)


@deferred_kernel()
def mode_block(tw, edge, n, first, start, stop, outer, inner):
    """Unknowns start .. stop - 1 of a body outboard of a frame, with the n modes that move the frame.

    ``outer`` has the rows of those outboard, ``inner`` those of the modes: the same matrix, or two blocks of one.
    """
    for r in range(start, stop):
        add_motion_products(tw.projection, r, tw.edge_motion, edge, outer[r, first : first + n])
    for b in range(n):
        angular, linear = load_column(tw.edge_twist, edge + b)
        add_products(linear, angular, tw.wrench, start, inner[first + b, start:stop])


@kernel
def joint_coupling_block(tw, o, size, start, stop, outer, inner):
    """Unknowns start .. stop - 1 outboard of a joint with the joint's own, from o; ``outer``, ``inner``: as above."""
    if stop - start > _MOST_OF_JOINT:
        _modes_of_joint(tw, o, size, start, stop, outer, inner)
        return
    for r in range(start, stop):
        for k in range(o, o + size):
            outer[r, k] += _projection_product(tw, r, tw.motion, k)
            inner[k, r] += _twist_product(tw, k, r)


@deferred_kernel()
def _modes_of_joint(tw, o, size, start, stop, outer, inner):
    """`joint_coupling_block` of many unknowns, in vector registers."""
    for k in range(o, o + size):
        angular, linear = load_column(tw.twist, k)
        add_products(linear, angular, tw.wrench, start, inner[k, start:stop])
        add_motion_products(tw.motion, k, tw.projection, start, outer[start:stop, k])


@kernel
def _ancestor_sweep(plan, tw, matrix):
    """Fill all entries between a body's unknowns and those of its ancestors."""
    for i in range(plan.tree.shape[0]):
        tree = plan.tree[i]
        size = tree[at.JOINT_SIZE]
        o = tree[at.JOINT_V]
        modes = 0
        q = tree[at.MODAL_V]
        joint_block(plan, tw, tree, matrix)
        if tree[at.FLEX] >= 0:
            modes = plan.flex[tree[at.FLEX], at.N_MODES]
            joint_coupling_block(tw, o, size, q, q + modes, matrix, matrix)
        child = i
        parent = tree[at.PARENT]
        while parent >= 0:
            above = plan.tree[parent]
            f = plan.tree[child, at.FRAME_PARENT]
            edge = tw.edge_of[f]
            if edge >= 0:
                n = plan.flex[above[at.FLEX], at.N_MODES]
                mode_block(tw, edge, n, above[at.MODAL_V], o, o + size, matrix, matrix)
                mode_block(tw, edge, n, above[at.MODAL_V], q, q + modes, matrix, matrix)
            above_size = above[at.JOINT_SIZE]
            joint_coupling_block(tw, above[at.JOINT_V], above_size, o, o + size, matrix, matrix)
            joint_coupling_block(tw, above[at.JOINT_V], above_size, q, q + modes, matrix, matrix)
            child = parent
            parent = above[at.PARENT]


@entry_kernel
def tangent_after_residual(plan, work, tw, x, v, a, multipliers, per_x, per_v, per_a, matrix):
    """`tangent`, where ``work`` is as `residual` at (x, v, a) and the multipliers left it.

    ``matrix`` must be zero outside of ``tw.blocks``, as it is when it is new and stays.
    """
    clear_blocks(tw.blocks, matrix)
    _body_sweep(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix)
    _inward_sweep(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix)
    for i in range(plan.shafts.shape[0]):
        k = int(plan.shafts[i, at.SHAFT_V])
        matrix[k, k] += per_a * plan.shafts[i, at.SHAFT_INERTIA]
    if plan.rows.shape[0] > 0:
        add_closures(plan, work, tw, x, v, a, multipliers, per_x, per_v, per_a, matrix)
    if plan.elements.shape[0] > 0:
        add_elements(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix)
        add_pairs(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix)
        add_surfaces(plan, work, tw, x, v, a, per_x, per_v, per_a, matrix)
        add_laws(plan, work, tw, x, v, per_x, per_v, matrix)
    _ancestor_sweep(plan, tw, matrix)


@entry_kernel
def tree_tangent_after_residual(plan, work, tw, recursion, x, v, a, per_x, per_v, per_a):
    """What `factor_recursion` factors: columns of `tangent`, bodies one by one, forces.

    Of trees that ``tree_recursion`` serves; ``work`` as for `tangent_after_residual`.
    """
    own = recursion.own
    own[:, :] = 0.0
    _body_sweep(plan, work, tw, x, v, a, per_x, per_v, per_a, own)
    put_bodies(plan, tw, recursion)
    _inward_sweep(plan, work, tw, x, v, a, per_x, per_v, per_a, own)
    put_joints(plan, tw, recursion, per_x)
    for i in range(plan.shafts.shape[0]):
        k = int(plan.shafts[i, at.SHAFT_V])
        own[k, recursion.place[k]] += per_a * plan.shafts[i, at.SHAFT_INERTIA]
    if plan.elements.shape[0] > 0:
        add_elements_of_joints(plan, work, tw, recursion, x, v, a, per_x, per_v, per_a)
        if recursion.motion.shape[1] > MOTION:
            add_ground_forces(plan, work, tw, recursion.answer)
        add_laws_of_joints(plan, work, tw, recursion, x, v, per_x, per_v)


@entry_kernel
def tree_tangent(plan, work, tw, recursion, x, v, a, multipliers, per_x, per_v, per_a):
    """`tree_tangent_after_residual`, the residual included; arguments as of `tangent`."""
    residual(plan, work, x, v, a, multipliers, tw.out)
    tree_tangent_after_residual(plan, work, tw, recursion, x, v, a, per_x, per_v, per_a)


@entry_kernel
def tangent(plan, work, tw, x, v, a, multipliers, per_x, per_v, per_a, matrix):
    """matrix = per_x dr/dx + per_v dr/dv + per_a dr/da of `residual`, (nv, nv).

    dx is the tangent vector of `retract` at x: rotations in the axes of the frame that they turn (rad).
    ``work.time`` must be up to date; ``tw`` is `new_tangent_work`.  M, C and K alone by unit weights.
    """
    matrix[:, :] = 0.0
    residual(plan, work, x, v, a, multipliers, tw.out)
    tangent_after_residual(plan, work, tw, x, v, a, multipliers, per_x, per_v, per_a, matrix)


@kernel
def turn_columns(plan, blocks, move, matrix):
    """Make derivatives by x at retract(x0, move) those by ``move``: columns of rotations times J(-move).

    ``matrix`` (nv, nv) is a tangent in its ``blocks``, whose columns are by small turns of x itself.
    """
    c = 0
    for i in range(plan.tree.shape[0]):
        o = spin_of(plan.tree[i])
        if o >= 0:
            c = _block_of(blocks, c, o)
            if c < blocks.velocity.shape[0]:
                _turn(move, o, matrix, blocks.velocity[c, 0], blocks.velocity[c, 1])


@kernel
def turn_row_columns(plan, blocks, move, rows):
    """As ``turn_columns`` of derivatives of constraint rows (m, nv)."""
    c = 0
    for i in range(plan.tree.shape[0]):
        o = spin_of(plan.tree[i])
        if o >= 0:
            c = _block_of(blocks, c, o)
            if c < blocks.velocity.shape[0]:
                _turn(move, o, rows, *between(blocks.rows, c))


@kernel
def _block_of(blocks, c, o):
    """The first block from c on that does not end before velocity o; one past the last where there is none."""
    while c < blocks.velocity.shape[0] and blocks.velocity[c, 1] <= o:
        c += 1
    return c


@kernel
def _turn(move, o, matrix, first, last):
    """Turn the columns from o of rows ``first`` to before ``last``."""
    turn = scale3(-1.0, load3(move, o))
    for r in range(first, last):
        store3(matrix[r], o, left_jacobian_transposed(turn, load3(matrix[r], o)))
