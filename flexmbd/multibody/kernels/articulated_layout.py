"""What the articulated-body recursion keeps of a plan, and its scratch space.

A rigid body is re-expressed in the frame G of its inboard joint, so that a joint is a turn about z
and a shift along z; a flexible body stays in its body frame B, for its modes are given there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.kernels import layout as at
from flexmbd.multibody.kernels.layout import FloatArray, IntArray, Plan

# Columns of ArticulatedWork.link, one row a body of the tree.
PARENT = 0  # row of the parent, -1 the ground
FORM = 1  # how the joint is eliminated, below
JOINT_X = 2  # first entry of the joint in x
JOINT_V = 3  # first entry of the joint in v
FLEX = 4  # row of ArticulatedWork.flex, -1 for a rigid body
INTERFACE = 5  # row of ArticulatedWork.interface where the parent's frame deforms, else -1
FREEDOMS = 6  # coordinates that yield: 0 for a fixed or prescribed joint
MULTI = 7  # row of ArticulatedWork.subspace, -1 for a joint of one coordinate or none
KIND = 8  # joint kind
N_LINK = 9

# FORM.  ALIGNED: one coordinate at most, and the frame F on a rigid parent has the parent's axes.
# TURNED: one coordinate at most.  SEVERAL: more coordinates.
ALIGNED, TURNED, SEVERAL = range(3)

# Columns of ArticulatedWork.constant: position and axes of F in the parent, mass integrals about
# the body's own origin (mass, first moment, inertia tensor), turn and shift per unit of the joint's
# coordinate, position and axes of G in a flexible body.
C_P, C_R, C_MASS, C_FIRST, C_INERTIA = 0, 3, 12, 13, 16
C_TURN, C_SHIFT, C_OWN_P, C_OWN_R, N_CONSTANT = 22, 23, 24, 27, 36

# Columns of ArticulatedWork.row: cosine and sine of the joint; angular velocity of the body;
# acceleration of G that needs no acceleration of the parent or joint (angular, linear; G's axes);
# U, 1/D and u of a joint of one coordinate; acceleration of the body (angular, linear).
R_COS, R_SIN, R_SPIN, R_BIAS_ANGULAR, R_BIAS_LINEAR = 0, 1, 2, 5, 8
R_U, R_D, R_FORCE, R_ANGULAR, R_LINEAR, N_ROW = 11, 17, 18, 19, 22, 25

# Columns of ArticulatedWork.pose: axes and position of G in the parent (of the frame that deforms
# where there is one), and of a flexible body the acceleration of B that needs none of G, in B.
P_R, P_P, P_BIAS, N_POSE = 0, 9, 12, 15

# Columns of ArticulatedWork.gathered: A, B, M and the wrench that children ask of the body.
G_A, G_B, G_M, G_TORQUE, G_FORCE, N_GATHERED = 0, 6, 15, 21, 24, 27

# Columns of ArticulatedWork.flex: modes, row in Plan.flex and Plan.tree, first interface, how many.
F_MODES, F_FLEX, F_BODY, F_FIRST, F_COUNT, N_FLEXIBLE = 0, 1, 2, 3, 4, 5

# Columns of ArticulatedWork.body, one row a flexible body: its rigid inertia and bias wrench in B.
B_INERTIA, B_FIRST, B_TORQUE, B_FORCE, N_BODY = 0, 6, 9, 12, 15

# Columns of ArticulatedWork.interface: pose of the deformed frame in B, its rotation vector, its
# acceleration in B that needs no other (angular, linear), what the child asks there (inertia,
# wrench; in B's axes about the frame), the acceleration of the frame.
I_P, I_R, I_THETA, I_BIAS_ANGULAR, I_BIAS_LINEAR = 0, 3, 12, 15, 18
I_A, I_B, I_M, I_TORQUE, I_FORCE, I_ANGULAR, I_LINEAR, N_INTERFACE = 21, 27, 36, 42, 45, 48, 51, 54


class ArticulatedWork(NamedTuple):
    """Constants and scratch of the articulated-body recursion of one plan.

    link, constant: the tree re-expressed, one row a body.  row, pose, gathered: scratch of each.
    subspace (k, 3, 6, 6), force (k, 6): S, U, D of joints of several coordinates, and u.
    flex, body: flexible bodies.  interface_frame: plan.frames row of each interface.
    coupling (f, 6, n): torque and force per unit modal acceleration.  weight, bias, ask (f, n):
    inverse modal mass without children; modal forces that the motion asks for; scratch.
    response, stiff (f, 6 c, 6), compliance, inertia, yielding (f, 6 c, 6 c), load (f, 4, 6 c),
    system (6 c, 18 c): elimination of modes that carry children.
    asked: (nv,) generalised forces asked by elements and joint forces.  rest: (nv,) zeros.
    """

    link: IntArray
    constant: FloatArray
    row: FloatArray
    pose: FloatArray
    gathered: FloatArray
    subspace: FloatArray
    force: FloatArray
    flex: IntArray
    body: FloatArray
    interface: FloatArray
    interface_frame: IntArray
    coupling: FloatArray
    weight: FloatArray
    bias: FloatArray
    ask: FloatArray
    response: FloatArray
    stiff: FloatArray
    compliance: FloatArray
    inertia: FloatArray
    yielding: FloatArray
    load: FloatArray
    system: FloatArray
    asked: FloatArray
    rest: FloatArray


def _subspace(kind: int, pitch: float) -> tuple[float, float] | None:
    """Turn and shift per unit of the coordinate, both about z; None for a joint of several coordinates."""
    known = {at.FIXED: (0.0, 0.0), at.REVOLUTE: (1.0, 0.0), at.PRISMATIC: (0.0, 1.0), at.SCREW: (1.0, pitch)}
    return known.get(kind)


def new_articulated_work(plan: Plan) -> ArticulatedWork:
    """Re-express ``plan`` for the articulated-body recursion and allocate its scratch space."""
    count = len(plan.tree)
    links = np.zeros((count, N_LINK), np.int64)
    constants = np.zeros((count, N_CONSTANT))
    flex, interface_frames = _flexible_bodies(plan)
    flex_of = {int(row[F_BODY]): k for k, row in enumerate(flex)}
    slot_of = {f: k for k, f in enumerate(interface_frames)}
    driven = set(plan.driven[:, at.DRIVEN_V])
    several = 0
    for i, tree in enumerate(plan.tree):
        kind = int(tree[at.JOINT])
        _place(plan, i, constants[i], flex_of)
        slot = slot_of.get(int(tree[at.FRAME_PARENT]), -1)
        subspace = _subspace(kind, plan.data[tree[at.JOINT_DATA]])
        if subspace is not None:
            constants[i, C_TURN : C_TURN + 2] = subspace
            level = np.array_equal(constants[i, C_R : C_R + 9].reshape(3, 3), np.eye(3))
            form, multi = ALIGNED if level and slot < 0 else TURNED, -1
            freedoms = 0 if kind == at.FIXED or int(tree[at.JOINT_V]) in driven else 1
        else:
            form, multi, freedoms = SEVERAL, several, 3 if kind == at.SPHERICAL else 6
            several += 1
        links[i] = [
            tree[at.PARENT], form, tree[at.JOINT_X], tree[at.JOINT_V], flex_of.get(i, -1), slot, freedoms, multi, kind
        ]  # fmt: skip
    modes = int(flex[:, F_MODES].max(initial=0))
    wide = 6 * int(flex[:, F_COUNT].max(initial=0))
    nv = len(plan.free) + len(plan.driven)
    zeros = np.zeros
    return ArticulatedWork(
        link=links,
        constant=constants,
        row=zeros((count, N_ROW)),
        pose=zeros((count, N_POSE)),
        gathered=zeros((count, N_GATHERED)),
        subspace=zeros((several, 3, 6, 6)),
        force=zeros((several, 6)),
        flex=flex,
        body=zeros((len(flex), N_BODY)),
        interface=zeros((len(interface_frames), N_INTERFACE)),
        interface_frame=np.array(interface_frames, np.int64),
        coupling=zeros((len(flex), 6, modes)),
        weight=zeros((len(flex), modes)),
        bias=zeros((len(flex), modes)),
        ask=zeros((len(flex), modes)),
        response=zeros((len(flex), wide, 6)),
        stiff=zeros((len(flex), wide, 6)),
        compliance=zeros((len(flex), wide, wide)),
        inertia=zeros((len(flex), wide, wide)),
        yielding=zeros((len(flex), wide, wide)),
        load=zeros((len(flex), 4, wide)),
        system=zeros((wide, 3 * wide)),
        asked=zeros(nv),
        rest=zeros(nv),
    )


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


def _place(plan: Plan, i: int, constant: FloatArray, flex_of: dict[int, int]) -> None:
    """Fill the constants of body i: F in the parent's frame of reference, and its mass integrals."""
    tree, rigid = plan.tree[i], plan.rigid[i]
    p, R = _frame(plan, int(tree[at.FRAME_PARENT]))
    parent = int(tree[at.PARENT])
    if parent >= 0 and parent not in flex_of:
        p_G, R_G = _frame(plan, int(plan.tree[parent, at.FRAME_CHILD]))
        p, R = R_G.T @ (p - p_G), _cleaned(R_G.T @ R)
    own_p, own_R = _frame(plan, int(tree[at.FRAME_CHILD]))
    mass, first = rigid[at.MASS], rigid[at.FIRST_MOMENT : at.SECOND_MOMENT]
    second = np.zeros((3, 3))
    second[np.triu_indices(3)] = rigid[at.SECOND_MOMENT :]
    second += np.triu(second, 1).T
    if i not in flex_of:
        cross = np.outer(first, own_p)
        second = second - cross - cross.T + mass * np.outer(own_p, own_p)
        first, second = own_R.T @ (first - mass * own_p), own_R.T @ second @ own_R
    tensor = np.trace(second) * np.eye(3) - second
    constant[:C_TURN] = [*p, *R.ravel(), mass, *first, *tensor[np.triu_indices(3)]]
    constant[C_OWN_P:] = [*own_p, *own_R.ravel()]


def _frame(plan: Plan, f: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and axes of a frame in its undeformed body."""
    row = plan.frames[f]
    return row[:3].copy(), row[3:12].reshape(3, 3).copy()


def _cleaned(R: FloatArray) -> FloatArray:
    """The identity where R is it but for rounding."""
    return np.eye(3) if np.abs(R - np.eye(3)).max() < 1e-15 else R
