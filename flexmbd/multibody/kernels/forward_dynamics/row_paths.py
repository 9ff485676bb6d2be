"""Constraint rows on the tree: C and C M^-1 C^T, each row by the bodies between its frames and the ground alone.

A row's unit reaction, carried inwards along its path, leaves at each joint a generalised force against a parent at
rest.  With these forces U and the joint accelerations Y = D^-1 U that they cause, C M^-1 C^T is U Y^T (the innovations
form of the inverse mass matrix, Rodriguez, Jain & Kreutz-Delgado 1991); two rows are coupled where their paths share
bodies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.algebra.so3 import load9, rotate_back, store3
from flexmbd.multibody.kernels.algebra.spatial import load6, put6
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.base.row_blocks import (
    block_bounds,
    bodies_on_paths,
    row_blocks,
    row_bodies,
)
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.flexible import accelerate_modes
from flexmbd.multibody.kernels.forward_dynamics.interface_elimination import interface_modes
from flexmbd.multibody.kernels.forward_dynamics.inward import propagate_forces
from flexmbd.multibody.kernels.forward_dynamics.multi_dof_joints import FORCE, OVER
from flexmbd.multibody.kernels.inverse_dynamics.closure import coupling_term, load_relative, relative_pose
from flexmbd.multibody.kernels.inverse_dynamics.recursion import propagate_wrench
from flexmbd.multibody.kernels.physics.constraint_laws import row_wrench
from flexmbd.multibody.kernels.physics.frame_modes import add_frame_forces
from flexmbd.multibody.kernels.sparse.index_lists import new_lists, owned

_ZERO3 = (0.0, 0.0, 0.0)
_ZERO6 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class RowPaths(ArrayStruct):
    """Which bodies each of m rows visits, and which rows visit each body.

    first: (m + 1,) where a row's bodies begin in ``body``, outermost first.
    visited: (bodies + 1,) where the rows of a body that is eliminated begin in ``row``, in rising order.
    block: (blocks + 1,) where stretches of rows begin that are coupled among themselves alone.
    slots: (bodies, 5) of its joint the first velocity, the number of velocities, how many of them are eliminated; first
    velocity and number of its modes.
    jacobian: (m, nv) C.  joint_force, joint_acceleration: (m, nv) U and Y.  All are zero off the paths.
    """

    first: IntArray
    body: IntArray
    visited: IntArray
    row: IntArray
    block: IntArray
    slots: IntArray
    jacobian: FloatArray
    joint_force: FloatArray
    joint_acceleration: FloatArray


def new_row_paths(plan: Plan) -> RowPaths:
    """Find the paths of the rows of ``plan``."""
    if not len(plan.rows):
        return _NO_ROWS
    parents: Any = plan.tree[:, at.PARENT].tolist()
    ends = [row_bodies(plan, row) for row in plan.rows]
    path_of = {bodies: sorted(bodies_on_paths(parents, bodies), reverse=True) for bodies in set(ends)}
    paths = [path_of[bodies] for bodies in ends]
    driven = set(map(int, plan.driven[:, at.DRIVEN_V]))
    slots = np.zeros((len(plan.tree), 5), np.int64)
    trees: Any = plan.tree.tolist()
    for i, tree in enumerate(trees):
        count = tree[at.JOINT_SIZE]
        slots[i, :3] = tree[at.JOINT_V], count, 0 if tree[at.JOINT_V] in driven else count
        if tree[at.FLEX] >= 0:
            slots[i, 3:] = tree[at.MODAL_V], plan.flex[tree[at.FLEX], at.N_MODES]
    bodies = new_lists(paths)
    moving = (slots[:, 2] + slots[:, 4] > 0)[bodies.items]
    rows_of = owned(bodies.items[moving], bodies.owner[moving], len(trees))
    shape = (len(plan.rows), len(plan.free) + len(plan.driven))
    return RowPaths(
        *bodies,
        *rows_of,
        block_bounds(row_blocks(plan), len(plan.rows)),
        slots,
        np.zeros(shape),
        np.zeros(shape),
        np.zeros(shape),
    )


def no_row_paths(block: IntArray) -> RowPaths:
    """No paths, for rows that are solved otherwise, in stretches of rows between ``block``."""
    places, matrix = np.zeros(0, np.int64), np.zeros((0, 0))
    return RowPaths(places, places, places, places, block, np.zeros((0, 5), np.int64), matrix, matrix, matrix)


_NO_ROWS = no_row_paths(np.zeros(1, np.int64))


@entry_kernel
def solve_rows(plan, work, aw, paths, small):
    """Write C, U, Y into ``paths`` and the lower triangles of the blocks of C M^-1 C^T into ``small`` (m, m).

    Of the forward dynamics at hand, whose factors are in ``aw``, and of the kinematics in ``work``.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        aw: ArticulatedWork of the plan.
        paths: RowPaths, output.
        small: (m, m) float64, output.
    """
    for c in range(paths.block.shape[0] - 1):
        for i in range(paths.block[c], paths.block[c + 1]):
            _unit_reaction(plan, work, paths, i)
            _propagate_row(plan, aw, paths, i)
            for j in range(paths.block[c], i + 1):
                small[i, j] = 0.0
    for b in range(paths.slots.shape[0]):
        for p in range(paths.visited[b], paths.visited[b + 1]):
            i = paths.row[p]
            for q in range(paths.visited[b], p + 1):
                j = paths.row[q]
                total = 0.0
                for k in range(paths.slots[b, 0], paths.slots[b, 0] + paths.slots[b, 2]):
                    total += paths.joint_force[i, k] * paths.joint_acceleration[j, k]
                for k in range(paths.slots[b, 3], paths.slots[b, 3] + paths.slots[b, 4]):
                    total += paths.joint_force[i, k] * paths.joint_acceleration[j, k]
                small[i, j] += total


@entry_kernel
def row_slopes(plan, work, paths):
    """Write C into ``paths.jacobian``, which is zero off the paths, of the kinematics in ``work``.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        paths: RowPaths, output.
    """
    for i in range(plan.rows.shape[0]):
        _unit_reaction(plan, work, paths, i)


@kernel
def row_times(paths, i, vector):
    """Row i of C times a vector (nv,)."""
    total = 0.0
    for n in range(paths.first[i], paths.first[i + 1]):
        slot = paths.slots[paths.body[n]]
        for k in range(slot[0], slot[0] + slot[1]):
            total += paths.jacobian[i, k] * vector[k]
        for k in range(slot[3], slot[3] + slot[4]):
            total += paths.jacobian[i, k] * vector[k]
    return total


@kernel
def add_row(paths, i, share, out):
    """Add ``share`` times row i of C to ``out`` (nv,)."""
    for n in range(paths.first[i], paths.first[i + 1]):
        slot = paths.slots[paths.body[n]]
        for k in range(slot[0], slot[0] + slot[1]):
            out[k] += share * paths.jacobian[i, k]
        for k in range(slot[3], slot[3] + slot[4]):
            out[k] += share * paths.jacobian[i, k]


@kernel
def _unit_reaction(plan, work, paths, i):
    """Row i of C, as the generalised forces of its unit multiplier."""
    row = plan.rows[i]
    out = paths.jacobian[i]
    for n in range(paths.first[i], paths.first[i + 1]):
        b = paths.body[n]
        for k in range(paths.slots[b, 0], paths.slots[b, 0] + paths.slots[b, 1]):
            out[k] = 0.0
        for k in range(paths.slots[b, 3], paths.slots[b, 3] + paths.slots[b, 4]):
            out[k] = 0.0
        store3(work.body[b], at.B_F, _ZERO3)
        store3(work.body[b], at.B_T, _ZERO3)
    if row[at.ROW_KIND] == kinds.ROW_COUPLING:
        o = row[at.ROW_DATA]
        for k in range(int(plan.data[o])):
            v, share = coupling_term(plan, o, k)
            out[v] += share
        return
    f = row[at.ROW_F]
    g = row[at.ROW_G]
    d, R = relative_pose(plan, work, f, g)
    force, torque = row_wrench(plan.data, row, d, R)
    load_relative(plan, work, f, g, d, R, force, torque, out)
    for n in range(paths.first[i], paths.first[i + 1]):
        propagate_wrench(plan, work, paths.body[n], out)


@kernel
def _propagate_row(plan, aw, paths, i):
    """Rows i of U and Y from that of C, inwards."""
    for n in range(paths.first[i], paths.first[i + 1]):
        b = paths.body[n]
        put6(aw.gathered, b, to.G_TORQUE, _ZERO6)
        k = aw.link[b, to.FLEX]
        if k >= 0:
            first = aw.flex[k, to.F_FIRST]
            for slot in range(first, first + aw.flex[k, to.F_COUNT]):
                put6(aw.interface, slot, to.I_TORQUE, _ZERO6)
    for n in range(paths.first[i], paths.first[i + 1]):
        b = paths.body[n]
        propagate_forces(plan, aw, b, paths.jacobian[i])
        o = aw.link[b, to.JOINT_V]
        if aw.link[b, to.FORM] == to.MULTI_DOF:
            own = aw.force[aw.link[b, to.SUBSPACE]]
            for k in range(aw.link[b, to.FREEDOMS]):
                paths.joint_force[i, o + k] = own[FORCE, k]
                paths.joint_acceleration[i, o + k] = own[FORCE, k] * own[OVER, k]
        elif aw.link[b, to.FREEDOMS] > 0:
            paths.joint_force[i, o] = aw.row[b, to.R_FORCE]
            paths.joint_acceleration[i, o] = aw.row[b, to.R_FORCE] * aw.row[b, to.R_D]
        if aw.link[b, to.FLEX] >= 0:
            _propagate_row_modes(plan, aw, paths, i, aw.link[b, to.FLEX])


@deferred_kernel()
def _propagate_row_modes(plan, aw, paths, i, k):
    """The modes' part of ``_propagate_row``, after flexible body k has passed its wrench on."""
    accelerate_modes(plan, aw, k, _ZERO3, _ZERO3, 0.0, paths.joint_acceleration[i])
    n = aw.flex[k, to.F_MODES]
    o = plan.tree[aw.flex[k, to.F_BODY], at.MODAL_V]
    joint_force = paths.joint_force[i, o : o + n]
    for j in range(n):
        joint_force[j] = paths.jacobian[i, o + j]
    first = aw.flex[k, to.F_FIRST]
    for slot in range(first, first + aw.flex[k, to.F_COUNT]):
        wrench = load6(aw.interface[slot], to.I_TORQUE)
        turn = rotate_back(load9(aw.interface[slot], to.I_TURN), (-wrench[0], -wrench[1], -wrench[2]))
        modes = interface_modes(aw, slot)
        add_frame_forces(aw.interface_rows, modes, n, (-wrench[3], -wrench[4], -wrench[5]), turn, joint_force)
