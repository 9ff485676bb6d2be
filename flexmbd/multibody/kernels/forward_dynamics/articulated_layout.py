"""Constants of a plan for the articulated-body recursion, and its work arrays.

A rigid body is re-expressed in the frame G of its inboard joint, so that a joint is a turn about z
and a shift along z; a flexible body stays in its body frame B, for its modes are given there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from flexmbd.multibody.kernels.algebra.so3 import compose, load3, load9, rotate_back, scale3, store3, store9, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray, Plan
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel

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
# MULTI_DOF: more coordinates.  PLAIN and ALIGNED take 1 / 1.89 of the time of TURNED, of ten links
# (benchmarks/skipping.py).
PLAIN, ALIGNED, TURNED, MULTI_DOF = range(4)

# Columns of ArticulatedWork.constant: position of F in the parent, mass integrals about the body's own origin
# (mass, first moment, inertia tensor), turn and shift per unit of the joint's coordinate, a shaft's inertia on it.
C_P, C_MASS, C_FIRST, C_INERTIA, C_TURN, C_SHIFT, C_SHAFT, N_CONSTANT = 0, 3, 4, 7, 13, 14, 15, 16

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


_IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_SYMMETRIC = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # places of a tensor's entries among six


@dataclass(frozen=True, eq=False)
class ArticulatedWork(ArrayStruct):
    """Constants and scratch of the articulated-body recursion of one plan.

    link, constant, axes: the tree re-expressed, one row a body.  row, pose, gathered: scratch of each.
    subspace (k, 2, 6, 6), force (k, 2, 6): S and U of joints of several coordinates, a row each; u and 1/D.
    flex, body: flexible bodies.  interface_frame: plan.frames row of each interface.
    table (f, 15, n): moments of the deformed bodies, see ``physics.modal_moments``.
    interface_rows: (interfaces * 6 n,) of each interface its translations and rotations per unit of each mode of its
    body; n is that of the body with the most. Those of faces that turn by finite angles change with the modes.
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
    interface_rows: FloatArray
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
    pose = np.zeros((count, N_POSE))
    _place_bodies(plan, links, constants, axes, pose)  # whose forms follow, and are not looked at here
    level = (axes[:, X_R : X_R + 9] == _IDENTITY).all(axis=1).tolist()
    shafts = {int(v): 0.0 for v in plan.shafts[:, at.SHAFT_V]}
    for v, inertia in plan.shafts:
        shafts[int(v)] += float(inertia)
    laid = []
    for i, tree in enumerate(rows):
        adds, size = tree[at.JOINT_ADDS], tree[at.JOINT_SIZE]
        slot = slot_of.get(tree[at.FRAME_PARENT], -1)
        if size <= 1:
            if size == 1:  # a pair of one coordinate turns and slides about z alone
                turn, _, _, shift = plan.data[tree[at.JOINT_DATA] :][:4]
                constants[i, C_TURN], constants[i, C_SHIFT] = turn, shift
                constants[i, C_SHAFT] = shafts.get(tree[at.JOINT_V], 0.0)
            subspace_row = -1
            form = ALIGNED if level[i] and slot < 0 else TURNED
            freedoms = 0 if tree[at.JOINT_V] in driven else size
            hinge = freedoms == 1 and constants[i, C_TURN] == 1.0 and constants[i, C_SHIFT] == 0.0
            if form == ALIGNED and hinge and i not in flex_of and i not in apart and not constants[i, C_SHAFT]:
                form = PLAIN
        else:
            form, subspace_row, freedoms = MULTI_DOF, multi_dof, size
            multi_dof += 1
        laid.append((
            tree[at.PARENT], form, tree[at.JOINT_X], tree[at.JOINT_V], freedoms, flex_of.get(i, -1), slot,
            subspace_row, adds,
        ))  # fmt: skip
    links = np.array(laid, np.int64).reshape(-1, N_LINK)
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
        pose=pose,
        gathered=zeros((count, N_GATHERED)),
        subspace=_ball_subspaces(links, multi_dof),
        force=zeros((multi_dof, 2, 6)),
        flex=flex,
        body=zeros((len(flex), N_BODY)),
        interface=zeros((len(interface_frames), N_INTERFACE)),
        interface_frame=np.array(interface_frames, np.int64),
        interface_rows=_interface_rows(plan, interface_frames, modes),
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
    """ArticulatedWork.subspace with the rows of S that turn a ball, which are constant."""
    subspace = np.zeros((count, 2, 6, 6))
    for link in links[(links[:, SUBSPACE] >= 0) & (links[:, ADDS] < links[:, FREEDOMS])]:
        for k in range(link[ADDS], link[FREEDOMS]):
            subspace[link[SUBSPACE], 0, k, k - link[ADDS]] = 1.0
    return subspace


def _is_planar(links: IntArray, constants: FloatArray) -> bool:
    """Whether every joint is a free hinge along the axes of a rigid parent, or any free hinge on the ground."""
    hinges = (constants[:, C_TURN] == 1.0) & (constants[:, C_SHIFT] == 0.0) & (links[:, FREEDOMS] == 1)
    hinges &= constants[:, C_SHAFT] == 0.0
    aligned = (links[:, FORM] <= ALIGNED) | (links[:, PARENT] < 0)
    return bool((hinges & aligned & (links[:, FLEX] < 0) & (links[:, INTERFACE] < 0)).all())


def _flexible_bodies(plan: Plan) -> tuple[IntArray, list[int]]:
    """Rows of ArticulatedWork.flex, and the frames of all interfaces body by body."""
    rows: list[list[int]] = []
    frames: list[int] = []
    for i in map(int, np.flatnonzero(plan.tree[:, at.FLEX] >= 0)):
        tree = plan.tree[i]
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


def _interface_rows(plan: Plan, frames: list[int], most: int) -> FloatArray:
    """ArticulatedWork.interface_rows, as at zero modal coordinates."""
    rows = np.zeros((len(frames), 6 * most))
    for row, f in zip(rows, frames, strict=True):
        body, o = plan.frame_of[f, at.FRAME_BODY], plan.frame_of[f, at.FRAME_MODES]
        size = 6 * int(plan.flex[plan.tree[body, at.FLEX], at.N_MODES])
        row[:size] = plan.modal[o : o + size]
    return rows.ravel()


def refit(plan: Plan, aw: ArticulatedWork) -> bool:
    """Bring the constants up to date with other masses and places of frames in ``plan``.

    False where the recursion then takes other ways through the joints, so that it needs new arrays; nothing else of the
    plan may have changed.
    """
    return int(_place_bodies(plan, aw.link, aw.constant, aw.axes, aw.pose)) == 0


@kernel
def _transposed(m):
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@kernel
def _is_identity(m, tolerance):
    largest = max(abs(m[0] - 1.0), abs(m[4] - 1.0), abs(m[8] - 1.0))
    for k in (1, 2, 3, 5, 6, 7):
        largest = max(largest, abs(m[k]))
    return largest <= tolerance


@kernel
def _write_body(plan, i, constant, axes):
    """Rows of ``constant`` and ``axes`` of body i; whether F lies along the axes of what carries it."""
    tree = plan.tree[i]
    frame = plan.frames[tree[at.FRAME_CHILD]]
    own_p, own_R = load3(frame, at.FRAME_P), load9(frame, at.FRAME_R)
    store3(axes, X_OWN_P, own_p)
    store9(axes, X_OWN_R, own_R)
    if tree[at.FLEX] < 0:
        _write_inertia(plan.rigid[i], own_p, own_R, constant)
    else:
        _write_inertia(plan.rigid[i], (0.0, 0.0, 0.0), _IDENTITY, constant)
    frame = plan.frames[tree[at.FRAME_PARENT]]
    p, R = load3(frame, at.FRAME_P), load9(frame, at.FRAME_R)
    parent = tree[at.PARENT]
    if parent >= 0 and plan.tree[parent, at.FLEX] < 0:
        carrier = plan.frames[plan.tree[parent, at.FRAME_CHILD]]
        carrier_R = load9(carrier, at.FRAME_R)
        p = rotate_back(carrier_R, sub3(p, load3(carrier, at.FRAME_P)))
        R = compose(_transposed(carrier_R), R)
        if _is_identity(R, 1e-15):  # it is, but for rounding
            R = _IDENTITY
    store3(constant, C_P, p)
    store9(axes, X_R, R)
    return _is_identity(R, 0.0)


@kernel
def _write_inertia(rigid, p, R, constant):
    """Mass, first moment and inertia tensor of a row of Plan.rigid about p, in axes R."""
    mass = rigid[at.MASS]
    first = load3(rigid, at.FIRST_MOMENT)
    x, y, z = p
    u, v, w = first
    # second moments about p, by Steiner's theorem
    xx = rigid[at.SECOND_MOMENT] - 2.0 * u * x + mass * x * x
    xy = rigid[at.SECOND_MOMENT + 1] - u * y - v * x + mass * x * y
    xz = rigid[at.SECOND_MOMENT + 2] - u * z - w * x + mass * x * z
    yy = rigid[at.SECOND_MOMENT + 3] - 2.0 * v * y + mass * y * y
    yz = rigid[at.SECOND_MOMENT + 4] - v * z - w * y + mass * y * z
    zz = rigid[at.SECOND_MOMENT + 5] - 2.0 * w * z + mass * z * z
    second = compose(_transposed(R), compose((xx, xy, xz, xy, yy, yz, xz, yz, zz), R))
    trace = second[0] + second[4] + second[8]
    constant[C_MASS] = mass
    store3(constant, C_FIRST, rotate_back(R, sub3(first, scale3(mass, p))))
    store3(constant, C_INERTIA, (trace - second[0], -second[1], -second[2]))
    store3(constant, C_INERTIA + 3, (trace - second[4], -second[5], trace - second[8]))


@entry_kernel
def _place_bodies(plan, link, constant, axes, pose):
    """Write the constants of all bodies: F in the parent's frame of reference, mass integrals, G in the body.

    ``pose`` gets the places of hinges, which ``parallel_hinges`` leaves as they are.  Returns how many joints of one
    coordinate are not along, or are, the axes of a rigid parent as their forms in ``link`` say.
    """
    others = 0
    for i in range(plan.tree.shape[0]):
        level = _write_body(plan, i, constant[i], axes[i])
        store3(pose[i], P_P, load3(constant[i], C_P))
        if link[i, FORM] != MULTI_DOF and link[i, INTERFACE] < 0 and level != (link[i, FORM] <= ALIGNED):
            others += 1
    return others


@entry_kernel
def _place_body(plan, i, constant, axes):
    _write_body(plan, i, constant, axes)


def body_about_joint(plan: Plan, i: int) -> tuple[float, FloatArray, FloatArray]:
    """Mass, first moment (3,) and inertia tensor (3, 3) of rigid body i about its inboard joint's G, in G's axes."""
    constant, axes = np.zeros(N_CONSTANT), np.zeros(N_AXES)
    _place_body(plan, i, constant, axes)
    return float(constant[C_MASS]), constant[C_FIRST:C_INERTIA], constant[C_INERTIA:C_TURN][_SYMMETRIC]
