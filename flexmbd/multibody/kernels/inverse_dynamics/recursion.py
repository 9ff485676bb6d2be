"""The recursion over the tree: kinematics outwards, inverse dynamics inwards, both O(bodies).

Forward: pose, velocity and acceleration of every body frame through rigid and flexible parents
(Anthonis & Ramon 2003, eq. 1-6; Ambrosio & Nikravesh 1992, eq. 69-70).  Backward: the generalised forces
that the motion requires (eq. 71), a wrench on a flexible parent's interface going into its modes.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.polar_decomposition import (
    face_matrix,
    face_motion,
    polar_rotation,
    polar_solver,
    polar_spin,
    polar_spin_rate,
    polar_torque,
)
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    compose_back,
    cross3,
    exp_rotation,
    left_jacobian,
    left_jacobian_rate,
    left_jacobian_transposed,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    store9,
    sub3,
)
from flexmbd.multibody.kernels.algebra.spatial import load6, store6
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.physics.elasticity import elastic_forces
from flexmbd.multibody.kernels.physics.face_modes import add_face_forces, add_translation_forces, strain_sum
from flexmbd.multibody.kernels.physics.frame_modes import add_frame_forces, modal_sum
from flexmbd.multibody.kernels.physics.gyroscopic import rotor_forces
from flexmbd.multibody.kernels.physics.inertial_forces import add_rigid_wrench, rigid_second_moment
from flexmbd.multibody.kernels.physics.joints import joint_force, joint_motion, joint_pose
from flexmbd.multibody.kernels.physics.reduced_inertia import flexible_inertia


@deferred_kernel()
def deform_frame(plan, work, f, x, v, a):
    """Write pose and motion of a frame, which deforms, against its body into its work row.

    The modes turn the frame by exp(theta), theta = Psi_r q; its angular velocity J_l(theta)
    d theta/dt is exact, so that forces do the work that the motion shows.
    """
    if plan.frame_of[f, at.FRAME_STRAIN] >= 0:
        _deform_face(plan, work, f, x, v, a)
        return
    o = plan.frame_of[f, at.FRAME_MODES]
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    qx, qv = tree[at.MODAL_X], tree[at.MODAL_V]
    fixed, row = plan.frames[f], work.frame[f]
    shift, theta = modal_sum(plan.modal, o, n, x[qx : qx + n])
    velocity, theta_rate = modal_sum(plan.modal, o, n, v[qv : qv + n])
    acceleration, theta_rate2 = modal_sum(plan.modal, o, n, a[qv : qv + n])
    store3(row, at.F_P, add3(load3(fixed, at.FRAME_P), shift))
    store9(row, at.F_R, compose(exp_rotation(theta), load9(fixed, at.FRAME_R)))
    store3(row, at.F_THETA, theta)
    store3(row, at.F_V, velocity)
    store3(row, at.F_W, left_jacobian(theta, theta_rate))
    store3(row, at.F_A, acceleration)
    store3(
        row,
        at.F_DW,
        add3(left_jacobian(theta, theta_rate2), left_jacobian_rate(theta, theta_rate)),
    )


@deferred_kernel()
def _deform_face(plan, work, f, x, v, a):
    """`deform_frame` of a frame that its face turns by the polar rotation of its motion."""
    o = plan.frame_of[f, at.FRAME_MODES]
    s = plan.frame_of[f, at.FRAME_STRAIN]
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    q = x[tree[at.MODAL_X] : tree[at.MODAL_X] + n]
    qd, qdd = v[tree[at.MODAL_V] : tree[at.MODAL_V] + n], a[tree[at.MODAL_V] : tree[at.MODAL_V] + n]
    fixed, row = plan.frames[f], work.frame[f]
    shift, theta = modal_sum(plan.modal, o, n, q)
    velocity, theta_rate = modal_sum(plan.modal, o, n, qd)
    acceleration, theta_rate2 = modal_sum(plan.modal, o, n, qdd)
    strain = strain_sum(plan.modal, s, n, q)
    rate = face_matrix(theta_rate, strain_sum(plan.modal, s, n, qd))
    rate2 = face_matrix(theta_rate2, strain_sum(plan.modal, s, n, qdd))
    F = face_motion(theta, strain)
    R = polar_rotation(F)
    solver = polar_solver(F, R)
    spin = polar_spin(solver, R, rate)
    store3(row, at.F_P, add3(load3(fixed, at.FRAME_P), shift))
    store9(row, at.F_R, compose(R, load9(fixed, at.FRAME_R)))
    store3(row, at.F_THETA, theta)
    store6(row, at.F_STRAIN, strain)
    store3(row, at.F_V, velocity)
    store3(row, at.F_W, spin)
    store3(row, at.F_A, acceleration)
    store3(row, at.F_DW, polar_spin_rate(solver, F, R, rate, rate2, spin))


@kernel
def face_of(plan, work, f):
    """F, R and the solver (`polar_solver`) of a face, from its work row."""
    row = work.frame[f]
    F = face_motion(load3(row, at.F_THETA), load6(row, at.F_STRAIN))
    R = compose_back(load9(row, at.F_R), load9(plan.frames[f], at.FRAME_R))
    return F, R, polar_solver(F, R)


@kernel
def _motion(frame_of, gravity, frames, bodies, f):
    """`frame_motion` from the arrays that it reads: passing whole plans costs more than the computation."""
    row = frames[f]
    deforms = frame_of[f, at.FRAME_MODES] >= 0
    p_BF = load3(row, at.F_P)
    R_BF = load9(row, at.F_R)
    b = frame_of[f, at.FRAME_BODY]
    if b < 0:
        g = load3(gravity, 0)
        zero = (0.0, 0.0, 0.0)
        return p_BF, R_BF, zero, zero, rotate_back(R_BF, scale3(-1.0, g)), zero
    body = bodies[b]
    w = load3(body, at.B_W)
    dw = load3(body, at.B_DW)
    wp = cross3(w, p_BF)
    v = add3(load3(body, at.B_V), wp)
    a = add3(load3(body, at.B_A), add3(cross3(dw, p_BF), cross3(w, wp)))
    if deforms:
        rate = load3(row, at.F_V)
        spin = load3(row, at.F_W)
        v = add3(v, rate)
        a = add3(a, add3(scale3(2.0, cross3(w, rate)), load3(row, at.F_A)))
        dw = add3(dw, add3(load3(row, at.F_DW), cross3(w, spin)))
        w = add3(w, spin)
    R_WB = load9(body, at.B_R)
    p_WF = add3(load3(body, at.B_P), rotate(R_WB, p_BF))
    return (
        p_WF,
        compose(R_WB, R_BF),
        rotate_back(R_BF, v),
        rotate_back(R_BF, w),
        rotate_back(R_BF, a),
        rotate_back(R_BF, dw),
    )


@entry_kernel
def frame_motion(plan, work, f):
    """World pose of frame f and its motion in its own axes.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        f: int64, row of Plan.frames.

    Returns:
        p_WF_W, R_WF, velocity of F's origin, w_WF_F, acceleration of the origin minus gravity,
        angular acceleration; the last four in F's axes.
    """
    return _motion(plan.frame_of, plan.gravity, work.frame, work.body, f)


@entry_kernel
def forward_kinematics(plan, work, x, v, a):
    """Fill the work rows with the pose and motion of all frames and bodies.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration.
        v: (nv,) float64, velocities.
        a: (nv,) float64, accelerations.
    """
    for k in range(work.memory.shape[0]):
        work.memory[k] = x[k]
    for f in range(plan.frames.shape[0]):
        fixed = plan.frames[f]
        row = work.frame[f]
        store3(row, at.F_P, load3(fixed, at.FRAME_P))
        store9(row, at.F_R, load9(fixed, at.FRAME_R))
    if plan.flex.shape[0] > 0:  # a loop of its own, for one that calls through an address is compiled worse
        for f in range(plan.frames.shape[0]):
            if plan.frame_of[f, at.FRAME_MODES] >= 0:
                deform_frame(plan, work, f, x, v, a)
    for i in range(plan.tree.shape[0]):
        tree = plan.tree[i]
        row = work.body[i]
        p_WF, R_WF, v_F, w_F, a_F, dw_F = frame_motion(plan, work, tree[at.FRAME_PARENT])
        turn = tree[at.JOINT_TURN]
        adds = tree[at.JOINT_ADDS]
        o = tree[at.JOINT_DATA]
        ox = tree[at.JOINT_X]
        ov = tree[at.JOINT_V]
        p, R_FG = joint_pose(turn, adds, plan.data, o, x, ox)
        p_dot, w_rel = joint_motion(turn, adds, plan.data, o, v, ov)
        p_ddot, dw_rel = joint_motion(turn, adds, plan.data, o, a, ov)
        for k in range(adds):
            store3(row, at.B_COORDINATE + 3 * k, (x[ox + k], v[ov + k], a[ov + k]))
        store3(row, at.B_JOINT_P, p)
        store9(row, at.B_JOINT_R, R_FG)
        wp = cross3(w_F, p)
        v_G = rotate_back(R_FG, add3(v_F, add3(wp, p_dot)))
        a_G = rotate_back(
            R_FG,
            add3(
                add3(a_F, add3(cross3(dw_F, p), cross3(w_F, wp))),
                add3(scale3(2.0, cross3(w_F, p_dot)), p_ddot),
            ),
        )
        w_FG = rotate_back(R_FG, w_F)
        w_G = add3(w_FG, w_rel)
        dw_G = add3(rotate_back(R_FG, dw_F), add3(dw_rel, cross3(w_FG, w_rel)))
        child = plan.frames[tree[at.FRAME_CHILD]]
        p_BG = load3(child, at.FRAME_P)
        R_BG = load9(child, at.FRAME_R)
        w = rotate(R_BG, w_G)
        dw = rotate(R_BG, dw_G)
        back = cross3(w, p_BG)
        R_WB = compose_back(compose(R_WF, R_FG), R_BG)
        store9(row, at.B_R, R_WB)
        store3(row, at.B_P, sub3(add3(p_WF, rotate(R_WF, p)), rotate(R_WB, p_BG)))
        store3(row, at.B_W, w)
        store3(row, at.B_DW, dw)
        store3(row, at.B_V, sub3(rotate(R_BG, v_G), back))
        store3(row, at.B_A, sub3(rotate(R_BG, a_G), add3(cross3(dw, p_BG), cross3(w, back))))


@kernel
def write_inertial_wrenches(plan, work, x, v, a, out):
    """Write the wrench that each body's inertia requires, and its modal forces into ``out`` (nv,)."""
    for i in range(plan.tree.shape[0]):
        tree = plan.tree[i]
        if tree[at.FLEX] < 0:
            rigid = plan.rigid[i]
            add_rigid_wrench(
                rigid[at.MASS],
                load3(rigid, at.FIRST_MOMENT),
                rigid_second_moment(rigid),
                work.body[i],
            )
        else:
            _write_flexible_wrench(plan, work, i, x, v, a, out)


@deferred_kernel()
def _write_flexible_wrench(plan, work, i, x, v, a, out):
    """``write_inertial_wrenches`` of flexible body i, with its elastic forces."""
    tree = plan.tree[i]
    flex = plan.flex[tree[at.FLEX]]
    n = flex[at.N_MODES]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    q, qd, force = x[qx : qx + n], v[qv : qv + n], out[qv : qv + n]
    flexible_inertia(plan, work.moments, i, q, qd, a[qv : qv + n], tree[at.ROTATION], work.body[i], force)
    elastic_forces(plan.modal, flex, q, qd, work.generalized[qv : qv + n], force)
    if flex[at.GYROSCOPIC] >= 0:
        load_rotors(plan, work, i, x, v, out)


@kernel
def load_rotors(plan, work, i, x, v, out):
    """Add what the rotors inside flexible body i require: to its wrench, and the modal forces to ``out`` (nv,)."""
    tree = plan.tree[i]
    flex = plan.flex[tree[at.FLEX]]
    n = flex[at.N_MODES]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    body = work.body[i]
    w = load3(body, at.B_W)
    moment = rotor_forces(plan.modal, flex, w, x[qx : qx + n], v[qv : qv + n], out[qv : qv + n])
    store3(body, at.B_T, add3(load3(body, at.B_T), moment))


@entry_kernel
def load_frame(plan, work, f, force_F, torque_F, out):
    """Add (force, torque about F's origin; in F's axes) to the wrench required of frame f's body.

    ``out`` gets the modal part; a wrench on the ground is dropped.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        f: int64, row of Plan.frames.
        force_F: three float64, N.
        torque_F: three float64, N m.
        out: (nv,) float64, generalised forces, added to.
    """
    b = plan.frame_of[f, at.FRAME_BODY]
    if b < 0:
        return
    row = work.frame[f]
    body = work.body[b]
    R_BF = load9(row, at.F_R)
    force = rotate(R_BF, force_F)
    torque = rotate(R_BF, torque_F)
    if plan.frame_of[f, at.FRAME_MODES] >= 0:
        _load_modes(plan, work, f, force, torque, out)
    store3(body, at.B_F, add3(load3(body, at.B_F), force))
    store3(
        body,
        at.B_T,
        add3(load3(body, at.B_T), add3(torque, cross3(load3(row, at.F_P), force))),
    )


@deferred_kernel()
def _load_modes(plan, work, f, force, torque, out):
    """Add the modal forces of a wrench on a frame that deforms, in the body's axes, to ``out`` (nv,)."""
    tree = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    qv = tree[at.MODAL_V]
    if plan.frame_of[f, at.FRAME_STRAIN] >= 0:
        _load_face(plan, work, f, n, force, torque, out[qv : qv + n])
        return
    turn = left_jacobian_transposed(load3(work.frame[f], at.F_THETA), torque)
    add_frame_forces(plan.modal, plan.frame_of[f, at.FRAME_MODES], n, force, turn, out[qv : qv + n])


@deferred_kernel()
def _load_face(plan, work, f, n, force, torque, out):
    """`_load_modes` of a frame that its face turns."""
    o = plan.frame_of[f, at.FRAME_MODES]
    _, R, solver = face_of(plan, work, f)
    add_translation_forces(plan.modal, o, n, force, out)
    add_face_forces(plan.modal, o, n, 1.0, polar_torque(solver, R, torque), out)


@kernel
def propagate_wrench(plan, work, i, out):
    """The step of ``backward_forces`` at body i, after those of its children."""
    tree = plan.tree[i]
    row = work.body[i]
    child = plan.frames[tree[at.FRAME_CHILD]]
    R_BG = load9(child, at.FRAME_R)
    force_B = load3(row, at.B_F)
    torque_B = sub3(load3(row, at.B_T), cross3(load3(child, at.FRAME_P), force_B))
    torque_G = rotate_back(R_BG, torque_B)
    R_FG = load9(row, at.B_JOINT_R)
    force_F = rotate(R_FG, rotate_back(R_BG, force_B))
    o = tree[at.JOINT_DATA]
    joint_force(tree[at.JOINT_TURN], tree[at.JOINT_ADDS], plan.data, o, force_F, torque_G, out, tree[at.JOINT_V])
    torque_F = add3(rotate(R_FG, torque_G), cross3(load3(row, at.B_JOINT_P), force_F))
    load_frame(plan, work, tree[at.FRAME_PARENT], force_F, torque_F, out)


@entry_kernel
def backward_forces(plan, work, out):
    """Carry the wrenches inwards and write the joints' generalised forces into ``out``.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        out: (nv,) float64, N or N m, output.
    """
    for i in range(plan.tree.shape[0] - 1, -1, -1):
        propagate_wrench(plan, work, i, out)
