"""The machine in canonical form: momenta p = M(x) v, the forces that change them, and stored energy.

With the kinetic energy T = v^T M(x) v / 2 and the potential V the equations are

    dp/dt = dT/dx - dV/dx + loads                     (coordinates that add)
    d(R p)/dt = R (dT/dx - dV/dx + loads)             (rotations: R = R_FG, p and d/dx in body axes)

where the derivatives of T hold v fixed; for a free joint they hold the linear velocity fixed in
body axes.  All are got in O(bodies): momenta go inwards as wrenches do, and what a joint's motion
changes in T is seen at the joint alone, from the momentum of all that lies beyond it.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.jacobian_derivatives import left_jacobian_torque_derivative
from flexmbd.multibody.kernels.algebra.polar_decomposition import face_matrix, polar_torque, polar_torque_derivative
from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    left_jacobian_transposed,
    load3,
    load9,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.inverse_dynamics.closure import load_constraints, load_couplings
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import (
    elements_energy,
    load_elements,
    subtract_coordinate_forces,
)
from flexmbd.multibody.kernels.inverse_dynamics.recursion import (
    backward_forces,
    face_of,
    forward_kinematics,
    frame_motion,
    load_rotors,
)
from flexmbd.multibody.kernels.physics.elasticity import elastic_energy, elastic_forces
from flexmbd.multibody.kernels.physics.face_modes import add_face_forces, add_translation_forces, strain_sum
from flexmbd.multibody.kernels.physics.frame_modes import modal_sum
from flexmbd.multibody.kernels.physics.inertial_forces import add_rigid_wrench, rigid_second_moment
from flexmbd.multibody.kernels.physics.joints import is_free, joint_force, joint_motion
from flexmbd.multibody.kernels.physics.one_dimensional_inertia import add_shaft_inertias
from flexmbd.multibody.kernels.physics.reduced_inertia import deformed_first_moment, flexible_inertia

_ZERO = (0.0, 0.0, 0.0)


@kernel
def body_momentum(plan, work, i, x, v, none, row, out):
    """Write the momentum of body i about its origin as its wrench, and its modal momenta.

    The momentum is the wrench that the velocities would require as accelerations from rest.
    """
    w = load3(row, at.B_W)
    store3(row, at.B_DW, w)
    store3(row, at.B_A, load3(row, at.B_V))
    store3(row, at.B_W, _ZERO)
    tree = plan.tree[i]
    if tree[at.FLEX] < 0:
        rigid = plan.rigid[i]
        first = load3(rigid, at.FIRST_MOMENT)
        add_rigid_wrench(rigid[at.MASS], first, rigid_second_moment(rigid), row)
    else:
        _modal_momentum(plan, work, i, x, v, none, row, out)
    store3(row, at.B_W, w)


@deferred_kernel()
def _modal_momentum(plan, work, i, x, v, none, row, out):
    """``body_momentum`` of flexible body i, whose work row is that of a body at rest."""
    tree = plan.tree[i]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    q, turning = x[qx : qx + n], kinds.ROTATING
    flexible_inertia(plan, work.moments, i, q, none[:n], v[qv : qv + n], turning, row, out[qv : qv + n])


@entry_kernel
def momenta(plan, work, x, v, none, out):
    """out = M(x) v; ``none`` is (nv,) zeros.  Leaves the kinematics of (x, v) in ``work``.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration.
        v: (nv,) float64, velocities.
        none: (nv,) float64, zeros.
        out: (nv,) float64, output.
    """
    forward_kinematics(plan, work, x, v, none)
    for i in range(plan.tree.shape[0]):
        body_momentum(plan, work, i, x, v, none, work.body[i], out)
    backward_forces(plan, work, out)
    add_shaft_inertias(plan.shafts, v, out)


@kernel
def first_moment_of(plan, i, x):
    """First moment of mass of body i, deformed, about its origin in its axes."""
    first = load3(plan.rigid[i], at.FIRST_MOMENT)
    tree = plan.tree[i]
    if tree[at.FLEX] >= 0:
        qx = tree[at.MODAL_X]
        first = deformed_first_moment(plan, i, x[qx : qx + plan.flex[tree[at.FLEX], at.N_MODES]])
    return first


@entry_kernel
def potential_energy(plan, work, x):
    """Gravitational, strain and springs' energy (J) at x, whose kinematics ``work`` must hold.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration.
    """
    g = load3(plan.gravity, 0)
    energy = 0.0
    for i in range(plan.tree.shape[0]):
        row = work.body[i]
        mass = plan.rigid[i, at.MASS]
        moment = rotate(load9(row, at.B_R), first_moment_of(plan, i, x))
        energy -= mass * dot3(g, load3(row, at.B_P)) + dot3(g, moment)
        tree = plan.tree[i]
        if tree[at.FLEX] >= 0:
            flex = plan.flex[tree[at.FLEX]]
            energy += elastic_energy(plan, flex, x[tree[at.MODAL_X] : tree[at.MODAL_X] + flex[at.N_MODES]])
    if plan.elements.shape[0] > 0:
        energy += elements_energy(plan, work, x)
    return energy


@entry_kernel
def write_potential(plan, work, x, out):
    """out[0] = `potential_energy`.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration.
        out: (1,) float64, output.
    """
    out[0] = potential_energy(plan, work, x)


@kernel
def _write_momenta(plan, work, x, v, half, none, wrench, p, out):
    """Write each body's momentum into ``wrench`` and ``p``, and its weight as the required wrench.

    ``half`` is v / 2, ``none`` zeros.  ``out`` gets the modes' part of -dT/dx + dV/dx + damping.
    ``work`` must hold the kinematics of (x, v).
    """
    g = load3(plan.gravity, 0)
    for i in range(plan.tree.shape[0]):
        tree = plan.tree[i]
        row = work.body[i]
        body_momentum(plan, work, i, x, v, none, row, p)
        for k in range(6):
            wrench[i, k] = row[at.B_F + k]
        weight = rotate_back(load9(row, at.B_R), scale3(-1.0, g))
        if tree[at.FLEX] >= 0:
            _write_modal_gradient(plan, work, i, x, v, half, none, weight, out)
        store3(row, at.B_F, scale3(plan.rigid[i, at.MASS], weight))
        store3(row, at.B_T, cross3(first_moment_of(plan, i, x), weight))
        if tree[at.FLEX] >= 0 and plan.flex[tree[at.FLEX], at.GYROSCOPIC] >= 0:
            load_rotors(plan, work, i, x, v, out)


@deferred_kernel()
def _write_modal_gradient(plan, work, i, x, v, half, none, weight, out):
    """The part of the modes of flexible body i in ``_write_momenta``; ``weight``: of a unit mass, required."""
    tree = plan.tree[i]
    row = work.body[i]
    flex = plan.flex[tree[at.FLEX]]
    n = flex[at.N_MODES]
    qx = tree[at.MODAL_X]
    qv = tree[at.MODAL_V]
    # -dT/dq is the modal force that the motion requires with all of v held, with half of the Coriolis force
    store3(row, at.B_DW, _ZERO)
    store3(row, at.B_A, add3(cross3(load3(row, at.B_W), load3(row, at.B_V)), weight))
    force = out[qv : qv + n]
    q, turning = x[qx : qx + n], kinds.ROTATING
    flexible_inertia(plan, work.moments, i, q, half[qv : qv + n], none[:n], turning, row, force)
    scratch = work.generalized[qv : qv + n]
    elastic_forces(plan.modal, flex, q, v[qv : qv + n], scratch, force)


@kernel
def _pass_momentum(plan, work, f, v, l_F, h_F, wrench, p, out):
    """Hand momentum at frame f (about its origin, in its axes) to its body: wrench, modes, and dT/dq."""
    b = plan.frame_of[f, at.FRAME_BODY]
    if b < 0:
        return
    row = work.frame[f]
    R_BF = load9(row, at.F_R)
    l_B = rotate(R_BF, l_F)
    h_B = rotate(R_BF, h_F)
    place = load3(row, at.F_P)
    if plan.frame_of[f, at.FRAME_MODES] >= 0:
        _pass_momentum_to_modes(plan, work, f, v, l_B, h_B, p, out)
    row = wrench[b]
    store3(row, 0, add3(load3(row, 0), l_B))
    store3(row, 3, add3(load3(row, 3), add3(h_B, cross3(place, l_B))))


@deferred_kernel()
def _pass_momentum_to_modes(plan, work, f, v, l_B, h_B, p, out):
    """The part of the modes in ``_pass_momentum`` at a frame that deforms, momenta in the body's axes."""
    if plan.frame_of[f, at.FRAME_STRAIN] >= 0:
        _pass_momentum_to_face(plan, work, f, v, l_B, h_B, p, out)
        return
    row = work.frame[f]
    b = plan.frame_of[f, at.FRAME_BODY]
    o = plan.frame_of[f, at.FRAME_MODES]
    body = work.body[b]
    w = load3(body, at.B_W)
    speed = add3(load3(body, at.B_V), add3(cross3(w, load3(row, at.F_P)), load3(row, at.F_V)))
    spin = add3(w, load3(row, at.F_W))
    theta = load3(row, at.F_THETA)
    tree = plan.tree[b]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    qv = tree[at.MODAL_V]
    _, rate = modal_sum(plan.modal, o, n, v[qv : qv + n])
    turn = left_jacobian_transposed(theta, h_B)
    slide = cross3(w, l_B)
    twist = sub3(
        left_jacobian_transposed(theta, add3(cross3(speed, l_B), cross3(spin, h_B))),
        rotate(left_jacobian_torque_derivative(theta, h_B), rate),
    )
    modal = plan.modal
    for k in range(n):
        t0, t1, t2 = modal[o + k], modal[o + n + k], modal[o + 2 * n + k]
        r0, r1, r2 = modal[o + 3 * n + k], modal[o + 4 * n + k], modal[o + 5 * n + k]
        p[qv + k] += t0 * l_B[0] + t1 * l_B[1] + t2 * l_B[2] + r0 * turn[0] + r1 * turn[1] + r2 * turn[2]
        out[qv + k] += t0 * slide[0] + t1 * slide[1] + t2 * slide[2] + r0 * twist[0] + r1 * twist[1] + r2 * twist[2]


@deferred_kernel()
def _pass_momentum_to_face(plan, work, f, v, l_B, h_B, p, out):
    """`_pass_momentum_to_modes` at a frame that its face turns."""
    row = work.frame[f]
    b = plan.frame_of[f, at.FRAME_BODY]
    o = plan.frame_of[f, at.FRAME_MODES]
    body = work.body[b]
    tree = plan.tree[b]
    n = plan.flex[tree[at.FLEX], at.N_MODES]
    own_p, own = p[tree[at.MODAL_V] : tree[at.MODAL_V] + n], out[tree[at.MODAL_V] : tree[at.MODAL_V] + n]
    qd = v[tree[at.MODAL_V] : tree[at.MODAL_V] + n]
    w, relative = load3(body, at.B_W), load3(row, at.F_W)
    speed = add3(load3(body, at.B_V), add3(cross3(w, load3(row, at.F_P)), load3(row, at.F_V)))
    spun = add3(cross3(speed, l_B), cross3(add3(w, relative), h_B))
    F, R, solver = face_of(plan, work, f)
    _, theta_rate = modal_sum(plan.modal, o, n, qd)
    rate = face_matrix(theta_rate, strain_sum(plan.modal, plan.frame_of[f, at.FRAME_STRAIN], n, qd))
    add_translation_forces(plan.modal, o, n, l_B, own_p)
    add_face_forces(plan.modal, o, n, 1.0, polar_torque(solver, R, h_B), own_p)
    add_translation_forces(plan.modal, o, n, cross3(w, l_B), own)
    add_face_forces(plan.modal, o, n, 1.0, polar_torque(solver, R, spun), own)
    add_face_forces(plan.modal, o, n, -1.0, polar_torque_derivative(solver, F, R, h_B, rate, relative), own)


@kernel
def _propagate_momenta(plan, work, v, wrench, p, part, out):
    """Carry the momenta inwards: the joints' into ``p``, and -dT/dx added to ``out``.

    ``part`` is (6,) scratch.  ``work`` must hold the kinematics of v.
    """
    for i in range(plan.tree.shape[0] - 1, -1, -1):
        tree = plan.tree[i]
        row = work.body[i]
        kind = tree[at.JOINT_TURN]
        adds = tree[at.JOINT_ADDS]
        o = tree[at.JOINT_DATA]
        child = plan.frames[tree[at.FRAME_CHILD]]
        R_BG = load9(child, at.FRAME_R)
        l_B = load3(wrench[i], 0)
        h_G = rotate_back(R_BG, sub3(load3(wrench[i], 3), cross3(load3(child, at.FRAME_P), l_B)))
        l_G = rotate_back(R_BG, l_B)
        R_FG = load9(row, at.B_JOINT_R)
        place = load3(row, at.B_JOINT_P)
        l_F = rotate(R_FG, l_G)
        h_F = add3(rotate(R_FG, h_G), cross3(place, l_F))
        joint_force(kind, adds, plan.data, o, l_F, h_G, p, tree[at.JOINT_V])
        # the velocity that the joint passes on turns with it, and changes as it slides
        _, _, v_F, w_F, _, _ = frame_motion(plan, work, tree[at.FRAME_PARENT])
        moving = add3(v_F, cross3(w_F, place))
        if not is_free(tree):
            moving = add3(moving, joint_motion(kind, adds, plan.data, o, v, tree[at.JOINT_V])[0])
        passed = rotate_back(R_FG, moving)
        turn = add3(cross3(passed, l_G), cross3(rotate_back(R_FG, w_F), h_G))
        for k in range(6):
            part[k] = 0.0
        joint_force(kind, adds, plan.data, o, cross3(w_F, l_F), turn, part, 0)
        for k in range(tree[at.JOINT_SIZE]):
            out[tree[at.JOINT_V] + k] += part[k]
        _pass_momentum(plan, work, tree[at.FRAME_PARENT], v, l_F, h_F, wrench, p, out)


@entry_kernel
def canonical(plan, work, x, v, half, none, multipliers, wrench, part, p, out):
    """p = M(x) v and out = -dT/dx + dV/dx - loads + C^T nu (see the module's text).

    ``work.time`` must be up to date.  Leaves the kinematics of (x, v) in ``work``.

    x, v: (nx,), (nv,) configuration and velocity.  half, none: (nv,) v / 2 and zeros.
    multipliers: (m,) nu of the constraint rows.  wrench, part: (bodies, 6) and (6,) scratch.  p, out: (nv,) output.
    """
    for k in range(out.shape[0]):
        out[k] = 0.0
    forward_kinematics(plan, work, x, v, none)
    _write_momenta(plan, work, x, v, half, none, wrench, p, out)
    if plan.rows.shape[0] > 0:
        load_constraints(plan, work, multipliers, out)
    if plan.elements.shape[0] > 0:
        load_elements(plan, work, x, v, out)
    backward_forces(plan, work, out)
    load_couplings(plan, multipliers, out)
    _propagate_momenta(plan, work, v, wrench, p, part, out)
    add_shaft_inertias(plan.shafts, v, p)
    if plan.elements.shape[0] > 0:
        subtract_coordinate_forces(plan, work, x, v, out)
    for i in range(plan.forces.shape[0]):
        out[plan.forces[i, at.FORCE_V]] -= work.time[plan.forces[i, at.FORCE_TIME], 0]
