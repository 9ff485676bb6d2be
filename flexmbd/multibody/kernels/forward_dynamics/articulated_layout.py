"""Constants of a plan for the articulated-body recursion, and its work arrays.

A rigid body is re-expressed in the frame G of its inboard joint, so that a joint is a turn about z
and a shift along z; a flexible body stays in its body frame B, for its modes are given there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan

# Columns of ArticulatedWork.link, one row a body of the tree.
PARENT = 0  # row of the parent, -1 the ground
FORM = 1  # how the joint is eliminated, below
JOINT_X = 2  # first entry of the joint in x
JOINT_V = 3  # first entry of the joint in v
FREEDOMS = 4  # coordinates that are eliminated: 0 for a fixed or prescribed joint
FLEX = 5  # row of ArticulatedWork.flex, -1 for a rigid body
INTERFACE = 6  # row of ArticulatedWork.interface where the parent's frame deforms, else -1
SUBSPACE = 7  # row of ArticulatedWork.subspace, -1 for a joint of one coordinate or none
ADDS = 8  # coordinates of the joint that add; MULTI_DOF with none is a ball
N_LINK = 9

# FORM.  PLAIN: a hinge with F along the parent's axes, on a rigid body that carries no child but the next row.
# ALIGNED: one coordinate at most, F along the axes of a rigid parent.  TURNED: one coordinate at most.
# MULTI_DOF: more coordinates.
PLAIN, ALIGNED, TURNED, MULTI_DOF = range(4)

# Columns of ArticulatedWork.constant: position of F in the parent, mass integrals about the body's own origin
# (mass, first moment, inertia tensor), turn and shift per unit of the joint's coordinate.
C_P, C_MASS, C_FIRST, C_INERTIA, C_TURN, C_SHIFT, N_CONSTANT = 0, 3, 4, 7, 13, 14, 16

# Columns of ArticulatedWork.axes: axes of F in the parent, position and axes of G in the body.
X_R, X_OWN_P, X_OWN_R, N_AXES = 0, 9, 12, 21

# Columns of ArticulatedWork.row: cosine and sine of the joint; angular velocity of the body; linear acceleration of
# bias acceleration of G, in G's axes; U, 1/D and u of a joint of one coordinate.
R_COS, R_SIN, R_SPIN, R_BIAS, R_U, R_D, R_FORCE, N_ROW = 0, 1, 2, 5, 8, 14, 15, 16

# Columns of ArticulatedWork.pose, not of PLAIN bodies: axes and position of G in the parent (of the frame that
# deforms where there is one); angular bias acceleration of G; of a flexible body the acceleration of
# B that needs none of G, in B; acceleration of the body (angular, linear).
P_R, P_P, P_BIAS, P_OWN_BIAS, P_ANGULAR, P_LINEAR, N_POSE = 0, 9, 12, 15, 18, 21, 24

# Columns of ArticulatedWork.gathered: A, B, M and the bias force of the children, summed.
G_A, G_B, G_M, G_TORQUE, G_FORCE, N_GATHERED = 0, 6, 15, 21, 24, 27

# Columns of ArticulatedWork.flex: modes, row in Plan.flex and Plan.tree, first interface, how many.
F_MODES, F_FLEX, F_BODY, F_FIRST, F_COUNT, N_FLEXIBLE = range(6)

# Columns of ArticulatedWork.body, one row a flexible body: its rigid inertia and bias wrench in B.
B_INERTIA, B_FIRST, B_TORQUE, B_FORCE, N_BODY = 0, 6, 9, 12, 15

# Columns of ArticulatedWork.interface: pose of the deformed frame in B, the matrix that takes the rate of its
# rotation vector to its angular velocity, its bias acceleration in B (angular, linear), articulated inertia and
# bias force of the child there (in B's axes about the frame), the acceleration of the frame; size of the inertia's
# rotation and translation blocks before the joint is eliminated, of which round-off is a share.
I_P, I_R, I_TURN, I_BIAS_ANGULAR, I_BIAS_LINEAR = 0, 3, 12, 21, 24
I_A, I_B, I_M, I_TORQUE, I_FORCE, I_ANGULAR, I_LINEAR, I_SCALE, N_INTERFACE = (
    27, 33, 42, 48, 51, 54, 57, 60, 62,
)  # fmt: skip


_IDENTITY = np.eye(3)
_UPPER = np.triu_indices(3)
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # places of a tensor's entries among six


@dataclass(frozen=True, eq=False)
class ArticulatedWork(ArrayStruct):
    """Constants and scratch of the articulated-body recursion of one plan.

    link, constant, axes: the tree re-expressed, one row a body.  row, pose, gathered: scratch of each.
    subspace (k, 3, 6, 6), force (k, 6): S, U, D of joints of several coordinates, and u.
    flex, body: flexible bodies.  interface_frame: plan.frames row of each interface.
    table (f, 15, n): moments of the deformed bodies, see ``physics.modal_moments``.
    bias, modal_acceleration (f, n): modal bias forces; accelerations of the modes without interface wrenches.
    inertia_root, turned_root, coupled, response (f, 6 c, 6), mobility, schur (f, 6 c, 6 c), load (f, 3, 6 c): children
    on c frames that deform, see ``interface_elimination``: L, K, Gamma_0 C^T, Z; Gamma_0 Gamma_0^T, factors of S;
    scratch.  scratch6: (6, 6).
    required: (nv,) generalised forces, with the opposite sign, of elements, joint forces and couplings.
    zeros: (nv,).  planar: (1,) whether all hinges are parallel, see ``parallel_hinges``.
    """

    link: IntArray
    constant: FloatArray
    axes: FloatArray
    row: FloatArray
    pose: FloatArray
    gathered: FloatArray
    subspace: FloatArray
    force: FloatArray
    flex: IntArray
    body: FloatArray
    interface: FloatArray
    interface_frame: IntArray
    table: FloatArray
    bias: FloatArray
    modal_acceleration: FloatArray
    inertia_root: FloatArray
    turned_root: FloatArray
    coupled: FloatArray
    response: FloatArray
    mobility: FloatArray
    schur: FloatArray
    load: FloatArray
    scratch6: FloatArray
    required: FloatArray
    zeros: FloatArray
    planar: IntArray


def new_articulated_work(plan: Plan) -> ArticulatedWork:
    """Re-express ``plan`` for the articulated-body recursion and allocate its scratch space."""
    count = len(plan.tree)
    links = np.zeros((count, N_LINK), np.int64)
    constants = np.zeros((count, N_CONSTANT))
    axes = np.zeros((count, N_AXES))
    flex, interface_frames = _flexible_bodies(plan)
    flex_of = {int(row[F_BODY]): k for k, row in enumerate(flex)}
    slot_of = {f: k for k, f in enumerate(interface_frames)}
    driven = set(map(int, plan.driven[:, at.DRIVEN_V]))
    rows: Any = plan.tree.tolist()
    apart = {tree[at.PARENT] for i, tree in enumerate(rows) if tree[at.PARENT] != i - 1}
    multi_dof = 0
    _place_bodies(plan, constants, axes)
    level = (axes[:, X_R : X_R + 9].reshape(-1, 3, 3) == _IDENTITY).all(axis=(1, 2)).tolist()
    for i, tree in enumerate(rows):
        adds, size = tree[at.JOINT_ADDS], tree[at.JOINT_SIZE]
        slot = slot_of.get(tree[at.FRAME_PARENT], -1)
        if size <= 1:
            if size == 1:  # a pair of one coordinate turns and slides about z alone
                turn, _, _, shift = plan.data[tree[at.JOINT_DATA] :][:4]
                constants[i, C_TURN], constants[i, C_SHIFT] = turn, shift
            subspace_row = -1
            form = ALIGNED if level[i] and slot < 0 else TURNED
            freedoms = 0 if tree[at.JOINT_V] in driven else size
            hinge = freedoms == 1 and constants[i, C_TURN] == 1.0 and constants[i, C_SHIFT] == 0.0
            if form == ALIGNED and hinge and i not in flex_of and i not in apart:
                form = PLAIN
        else:
            form, subspace_row, freedoms = MULTI_DOF, multi_dof, size
            multi_dof += 1
        links[i] = [
            tree[at.PARENT], form, tree[at.JOINT_X], tree[at.JOINT_V], freedoms, flex_of.get(i, -1), slot,
            subspace_row, adds,
        ]  # fmt: skip
    modes = int(flex[:, F_MODES].max(initial=0))
    coupled, mobility = _frame_moments(plan, flex, interface_frames)
    wide = mobility.shape[1]
    nv = len(plan.free) + len(plan.driven)
    zeros = np.zeros
    return ArticulatedWork(
        link=links,
        constant=constants,
        axes=axes,
        row=zeros((count, N_ROW)),
        pose=_resting_poses(constants),
        gathered=zeros((count, N_GATHERED)),
        subspace=_ball_subspaces(links, multi_dof),
        force=zeros((multi_dof, 6)),
        flex=flex,
        body=zeros((len(flex), N_BODY)),
        interface=zeros((len(interface_frames), N_INTERFACE)),
        interface_frame=np.array(interface_frames, np.int64),
        table=zeros((len(flex), at.N_MOMENTS, modes)),
        bias=zeros((len(flex), modes)),
        modal_acceleration=zeros((len(flex), modes)),
        inertia_root=zeros((len(flex), wide, 6)),
        turned_root=zeros((len(flex), wide, 6)),
        coupled=coupled,
        response=zeros((len(flex), wide, 6)),
        mobility=mobility,
        schur=zeros((len(flex), wide, wide)),
        load=zeros((len(flex), 3, wide)),
        scratch6=zeros((6, 6)),
        required=zeros(nv),
        zeros=zeros(nv),
        planar=np.array([_is_planar(links, constants)], np.int64),
    )


def _ball_subspaces(links: IntArray, count: int) -> FloatArray:
    """ArticulatedWork.subspace with the columns of S that turn a ball, which are constant."""
    subspace = np.zeros((count, 3, 6, 6))
    for link in links[links[:, SUBSPACE] >= 0]:
        for k in range(link[ADDS], link[FREEDOMS]):
            subspace[link[SUBSPACE], 0, k - link[ADDS], k] = 1.0
    return subspace


def _resting_poses(constants: FloatArray) -> FloatArray:
    """ArticulatedWork.pose with the places of hinges, which ``parallel_hinges`` leaves as they are."""
    pose = np.zeros((len(constants), N_POSE))
    pose[:, P_P : P_P + 3] = constants[:, C_P : C_P + 3]
    return pose


def _is_planar(links: IntArray, constants: FloatArray) -> bool:
    """Whether every joint is a free hinge along the axes of a rigid parent, or any free hinge on the ground."""
    hinges = (constants[:, C_TURN] == 1.0) & (constants[:, C_SHIFT] == 0.0) & (links[:, FREEDOMS] == 1)
    aligned = (links[:, FORM] <= ALIGNED) | (links[:, PARENT] < 0)
    return bool((hinges & aligned & (links[:, FLEX] < 0) & (links[:, INTERFACE] < 0)).all())


def _flexible_bodies(plan: Plan) -> tuple[IntArray, list[int]]:
    """Rows of ArticulatedWork.flex, and the frames of all interfaces body by body."""
    rows: list[list[int]] = []
    frames: list[int] = []
    for i, tree in enumerate(plan.tree):
        if tree[at.FLEX] < 0:
            continue
        carriers = [int(f) for f in plan.tree[plan.tree[:, at.PARENT] == i, at.FRAME_PARENT]]
        deforming = [f for f in carriers if plan.frame_of[f, at.FRAME_MODES] >= 0]
        modes = int(plan.flex[tree[at.FLEX], at.N_MODES])
        rows.append([modes, int(tree[at.FLEX]), i, len(frames), len(deforming)])
        frames.extend(deforming)
    return np.array(rows, np.int64).reshape(-1, N_FLEXIBLE), frames


def _frame_moments(plan: Plan, flex: IntArray, frames: list[int]) -> tuple[FloatArray, FloatArray]:
    """ArticulatedWork.coupled, its columns of translation, and ArticulatedWork.mobility."""
    wide = 6 * int(flex[:, F_COUNT].max(initial=0))
    coupled, mobility = np.zeros((len(flex), wide, 6)), np.zeros((len(flex), wide, wide))
    for k, row in enumerate(flex):
        n, first, size = int(row[F_MODES]), int(row[F_FIRST]), 6 * int(row[F_COUNT])
        force = int(plan.flex[row[F_FLEX], at.MODAL_FIRST])
        offsets = [int(plan.frame_of[f, at.FRAME_MODES]) for f in frames[first : first + row[F_COUNT]]]
        modes = [plan.modal[o : o + 6 * n].reshape(2, 3, n)[::-1].reshape(6, n) for o in offsets]
        motion = np.concatenate([np.zeros((0, n)), *modes])
        coupled[k, :size, 3:] = motion @ plan.modal[force : force + 3 * n].reshape(3, n).T
        mobility[k, :size, :size] = motion @ motion.T
    return coupled, mobility


def _place_bodies(plan: Plan, constants: FloatArray, axes: FloatArray) -> None:
    """Fill the constants of all bodies: F in the parent's frame of reference, mass integrals, G in the body."""
    parents, flexible = plan.tree[:, at.PARENT], plan.tree[:, at.FLEX] >= 0
    p, R = _frames(plan, plan.tree[:, at.FRAME_PARENT])
    own_p, own_R = _frames(plan, plan.tree[:, at.FRAME_CHILD])
    carried = np.flatnonzero((parents >= 0) & ~flexible[parents])
    carriers = parents[carried]
    back = own_R[carriers].transpose(0, 2, 1)
    p[carried] = _turned(back, p[carried] - own_p[carriers])
    turned = back @ R[carried]
    turned[np.abs(turned - _IDENTITY).max(axis=(1, 2), initial=0.0) < 1e-15] = _IDENTITY  # it is, but for rounding
    R[carried] = turned
    mass, first, tensor = _about_joints(plan.rigid[: len(plan.tree)], own_p, own_R, ~flexible)
    constants[:, :3], constants[:, 3], constants[:, 4:7] = p, mass, first
    constants[:, 7:C_TURN] = tensor[:, _UPPER[0], _UPPER[1]]
    axes[:, :9], axes[:, 9:12], axes[:, 12:] = R.reshape(-1, 9), own_p, own_R.reshape(-1, 9)


def body_about_joint(plan: Plan, i: int) -> tuple[float, FloatArray, FloatArray]:
    """Mass, first moment (3,) and inertia tensor (3, 3) of rigid body i about its inboard joint's G, in G's axes."""
    p, R = _frames(plan, plan.tree[i : i + 1, at.FRAME_CHILD])
    mass, first, tensor = _about_joints(plan.rigid[i : i + 1], p, R, np.ones(1, bool))
    return float(mass[0]), first[0], tensor[0]


def _about_joints(
    rigid: FloatArray, p: FloatArray, R: FloatArray, moved: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Masses (k,), first moments (k, 3) and inertia tensors (k, 3, 3) of rows of Plan.rigid.

    Where ``moved`` they are about G, at p (k, 3) with axes R (k, 3, 3) in the body, and in its axes; else as given.
    """
    mass, first = rigid[:, at.MASS], rigid[:, at.FIRST_MOMENT : at.SECOND_MOMENT]
    second = rigid[:, at.SECOND_MOMENT :][:, _SYMMETRIC]
    arm = np.where(moved[:, None], p, 0.0)
    turn = np.where(moved[:, None, None], R, _IDENTITY)
    back = turn.transpose(0, 2, 1)
    cross = first[:, :, None] * arm[:, None, :]
    second = second - cross - cross.transpose(0, 2, 1) + mass[:, None, None] * (arm[:, :, None] * arm[:, None, :])
    second = back @ second @ turn
    traces = second[:, 0, 0] + second[:, 1, 1] + second[:, 2, 2]
    return mass, _turned(back, first - mass[:, None] * arm), traces[:, None, None] * _IDENTITY - second


def _turned(R: FloatArray, vectors: FloatArray) -> FloatArray:
    """Vectors (k, 3) turned by R (k, 3, 3)."""
    return (R @ vectors[:, :, None])[:, :, 0]


def _frames(plan: Plan, rows: IntArray) -> tuple[FloatArray, FloatArray]:
    """Positions (k, 3) and axes (k, 3, 3) of frames in their undeformed bodies."""
    found = plan.frames[rows]
    return found[:, :3].copy(), found[:, 3:].reshape(-1, 3, 3).copy()
