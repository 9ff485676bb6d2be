"""The scratch space of the tangent, and what its columns hold.

All vectors here are in world axes and all moments about one point o that moves with the first body, so that what
bodies add up needs no transformation.  A column belongs to one unknown (an entry of v); an edge column to one modal
unknown of a body, as seen by what hangs on one of its frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import Plan, memories_end, sides_end
from flexmbd.multibody.kernels.elements.table import act_between_frames, moved_unknowns, of_surfaces, own_links
from flexmbd.multibody.kernels.tangent.diagonal_blocks import DiagonalBlocks, diagonal_blocks
from flexmbd.multibody.kernels.tangent.unknown_blocks import UnknownBlocks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Columns of TangentWork.body: mass, first moment, momentum, second moment (xx xy xz yy yz zz), the integral of
# rho r v^T, all of the body and what hangs on it; then the wrench that it requires of its joint.
C_MASS, C_FIRST, C_MOMENTUM, C_SECOND, C_FLOW, C_FORCE, C_TORQUE, N_COMPOSITE = 0, 1, 4, 7, 13, 22, 25, 28

# Rows of TangentWork.mode_moments that hold moments with Phi qd and with Phi qdd.
M_RATES, M_SECOND_RATES = 12, 21


@dataclass(frozen=True, eq=False)
class TangentWork(ArrayStruct):
    """Scratch arrays of the tangent.

    origin: (6,) place and velocity of o.
    body: (bodies, N_COMPOSITE).
    twist: (6, nv) rotation and translation at o that a unit of a joint's unknown causes outboard.
    motion: (12, nv) what the column causes outboard: rate of the rotation, its second rate, second rate of the
        translation at o with gravity's share (alpha), and its first rate.
    wrench: (6, nv) force and torque about o that the column changes for all that lies inboard.
    projection: (9, nv) on the row of this unknown of an inboard column's motion (its first nine).
    edge_of: (frames,) first edge column of a deforming frame, -1 for the others.
    edge_twist, edge_motion: twist and motion of the edge columns.
    mode_moments: (30, n) of one body: the rows of a moments' table but its rates, see ``physics.modal_moments``, then
        nine with Phi qd and nine with Phi qdd.
    second: (n, n) scratch for second derivatives of the strain energy of the bodies whose energy is a polynomial.
    point: (N_COMPOSITE,) a wrench alone, as a row of ``body``.
    path: (nv,) the unknowns that move one of two frames; path_mark: whether an unknown is among them.
    path_twist: (nv, 18) of each: twist of F, twist of G, rate of the twist of G against F.
    path_wrench: (nv, 12) change of the wrench between F and G, in F's axes and by turning G's.
    path_rates: (most, nv) change of what the states of a force between frames require, of its own most states.
    jacobian: (rows, nv) rates of the constraint rows per unit velocity.  For a sparse matrix (rows, longest path), and
    ``row_unknown`` has the unknowns of its columns, ``row_count`` many, in the first of rows that join the same frames.
    rate_jacobian: likewise, derivative of the rows' rates, per_x by x and per_v by v.
    cut_of: (bodies,) the first unknown of a cut body, -1 of others.
    move, moved_x, moved_v: (nv,), (nx,), (nv,) a state nearby.
    size_x, size_v: (nv,) sizes of positions and of velocities, of which users' functions are moved by a share.
    out: (nv,) residual.
    blocks: outside of which matrix and rows are zero and stay so.
    """

    origin: FloatArray
    body: FloatArray
    twist: FloatArray
    motion: FloatArray
    wrench: FloatArray
    projection: FloatArray
    edge_of: IntArray
    edge_twist: FloatArray
    edge_motion: FloatArray
    mode_moments: FloatArray
    second: FloatArray
    point: FloatArray
    path: IntArray
    path_mark: IntArray
    path_twist: FloatArray
    path_wrench: FloatArray
    path_rates: FloatArray
    jacobian: FloatArray
    rate_jacobian: FloatArray
    row_unknown: IntArray
    row_count: IntArray
    cut_of: IntArray
    move: FloatArray
    moved_x: FloatArray
    moved_v: FloatArray
    size_x: FloatArray
    size_v: FloatArray
    out: FloatArray
    frame_loads: FloatArray
    frame_load_times: IntArray
    blocks: DiagonalBlocks


def new_tangent_work(
    plan: Plan,
    nv: int,
    *,
    sizes: FloatArray,
    blocks: UnknownBlocks | None = None,
    side_by_side: DiagonalBlocks | None = None,
) -> TangentWork:
    """Allocate the tangent's scratch space for ``plan`` with nv velocities.

    ``sizes``: (2, nv) of positions and of velocities, kept and not copied, for they may change from step to step;
    those of velocities may be zero where there is no derivative by them.  ``blocks``: of a sparse matrix, which has
    other unknowns besides but no prescribed velocities.  ``side_by_side``: the ``diagonal_blocks``, if they are known.
    """
    edge_of, edges = edge_columns(plan)
    most = int(plan.flex[:, at.N_MODES].max(initial=0))
    polynomial = int(plan.flex[plan.flex[:, at.POLYNOMIAL] >= 0, at.N_MODES].max(initial=0))
    loaded = _frame_load_times(plan)
    quaternions = int((plan.tree[:, at.JOINT_TURN] == kinds.TURN_BALL).sum())
    with_states = plan.elements[act_between_frames(plan) & (plan.elements[:, at.EL_V] >= 0)]
    states = max((len(own_links(plan, row)) for row in with_states), default=0)
    own = [moved_unknowns(plan, row) for row in plan.elements[of_surfaces(plan)]]
    states = max([states, *own])
    zeros = np.zeros
    n, longest, m = nv, nv, len(plan.rows)
    cut_of = np.full(len(plan.tree), -1, np.int64)
    if blocks is not None:
        n, longest = blocks.unknowns, blocks.longest_path
        cut_of[blocks.cuts] = [blocks.cut(k) for k in range(len(blocks.cuts))]
    marks = zeros(n, np.int64)
    if blocks is not None:
        marks[plan.driven[:, at.DRIVEN_V]] = 1  # as if they were on the path already
    return TangentWork(
        origin=zeros(6),
        body=zeros((len(plan.tree), N_COMPOSITE)),
        twist=zeros((6, nv)),
        motion=zeros((12, nv)),
        wrench=zeros((6, nv)),
        projection=zeros((9, nv)),
        edge_of=edge_of,
        edge_twist=zeros((6, edges)),
        edge_motion=zeros((12, edges)),
        mode_moments=zeros((M_SECOND_RATES + 9, most)),
        second=zeros((polynomial, polynomial)),
        point=zeros(N_COMPOSITE),
        path=zeros(n, np.int64),
        path_mark=marks,
        path_twist=zeros((n, 18)),
        path_wrench=zeros((n, 12)),
        path_rates=zeros((states, n)),
        jacobian=zeros((m, longest)),
        rate_jacobian=zeros((m, longest)),
        row_unknown=zeros((m if blocks is not None else 0, longest), np.int64),
        row_count=zeros(m, np.int64),
        cut_of=cut_of,
        move=zeros(nv),
        moved_x=zeros(max(nv + quaternions, memories_end(plan), sides_end(plan))),
        moved_v=zeros(nv),
        size_x=sizes[0],
        size_v=sizes[1],
        out=zeros(nv),
        frame_loads=zeros((len(loaded), nv)),
        frame_load_times=loaded,
        blocks=diagonal_blocks(plan) if side_by_side is None else side_by_side,
    )


def edge_columns(plan: Plan) -> tuple[IntArray, int]:
    """(frames,) the first edge column of a deforming frame, -1 of the others; and how many columns there are."""
    edge_of = np.full(len(plan.frames), -1, np.int64)
    edges = 0
    for f in np.flatnonzero(plan.frame_of[:, at.FRAME_MODES] >= 0):
        edge_of[f] = edges
        edges += int(plan.flex[plan.tree[plan.frame_of[f, at.FRAME_BODY], at.FLEX], at.N_MODES])
    return edge_of, edges


def _frame_load_times(plan: Plan) -> IntArray:
    """(k,) rows of ``Plan.times`` of the loads on frames that states set, by their numbers; -1 of those left out."""
    rows = plan.elements[act_between_frames(plan) & (plan.elements[:, at.EL_X] >= 0)]
    times = np.full(int(rows[:, at.EL_X].max(initial=-1)) + 1, -1, np.int64)
    times[rows[:, at.EL_X]] = rows[:, at.EL_TIME]
    return times
