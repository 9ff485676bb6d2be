"""The motion of a discrete-gradient step and the balance of its momenta, rotations among them.

A rotation of the step is Cayley's map of h times its angular velocity; E is half of it.  Equations:
docs/integrators.md, "Energy-momentum".  ``scratch`` is an ``EnergyMomentumWorkspace``.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    load3,
    quaternion_matrix,
    quaternion_product,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.physics.elasticity import stretch
from flexmbd.multibody.kernels.physics.joints import coordinates_end, is_free, spin_of
from flexmbd.multibody.kernels.reading.plan_entries import (
    driven_place,
    flexible_of,
    joint_of,
    membrane_strains_of,
    modes_of,
)


@kernel
def _load4(x, o):
    return (x[o], x[o + 1], x[o + 2], x[o + 3])


@kernel
def _half_turn(turn):
    """Half of the rotation of Cayley's vector ``turn`` as a unit quaternion, and kappa = 1 / cos(half the angle)."""
    kappa = math.sqrt(1.0 + 0.25 * dot3(turn, turn))
    s = 1.0 / math.sqrt(2.0 * kappa * (kappa + 1.0))
    return (s * (kappa + 1.0), 0.5 * s * turn[0], 0.5 * s * turn[1], 0.5 * s * turn[2]), kappa


@kernel
def _mean_turn(turn, kappa, v):
    """(E + E^T) v / 2, E being half of the step's rotation."""
    return add3(scale3(1.0 / kappa, v), scale3(dot3(turn, v) / (4.0 * kappa * (kappa + 1.0)), turn))


@kernel
def _turn_joint(x, o, turn, x_mid, x_end):
    half, _ = _half_turn(turn)
    middle = quaternion_product(_load4(x, o), half)
    end = quaternion_product(middle, half)
    for k in range(4):
        x_mid[o + k] = middle[k]
        x_end[o + k] = end[k]


@entry_kernel
def place(plan, x, scratch, h):
    """Positions in the middle and at the end of a step of h with velocities ``s.u``, and its increments."""
    for k in range(scratch.u.shape[0]):
        scratch.half_velocity[k] = 0.5 * scratch.u[k]
        scratch.increment[k] = h * scratch.u[k]
    for i in range(plan.tree.shape[0]):
        link = plan.tree[i]
        adds, ox, ov = joint_of(link)
        o = spin_of(link)
        if o >= 0:
            turn = load3(scratch.increment, o)
            _turn_joint(x, ox + adds, turn, scratch.x_mid, scratch.x_end)
            if is_free(link):
                _, kappa = _half_turn(turn)
                # the rotation in the middle keeps the axis that it turns about
                turn_F = rotate(quaternion_matrix(_load4(scratch.x_mid, ox + adds)), turn)
                store3(scratch.increment, ov, _mean_turn(turn_F, kappa, load3(scratch.increment, ov)))
        for k in range(adds):
            scratch.x_mid[ox + k] = x[ox + k] + 0.5 * scratch.increment[ov + k]
            scratch.x_end[ox + k] = x[ox + k] + scratch.increment[ov + k]
        n, qx, qv = modes_of(link, plan.flex)
        for k in range(n):
            scratch.x_mid[qx + k] = x[qx + k] + 0.5 * scratch.increment[qv + k]
            scratch.x_end[qx + k] = x[qx + k] + scratch.increment[qv + k]
    for i in range(plan.driven.shape[0]):
        scratch.x_end[driven_place(plan.driven[i])[0]] = scratch.driven[i, 0]
    for k in range(coordinates_end(plan), x.shape[0]):
        scratch.x_mid[k] = x[k]
        scratch.x_end[k] = x[k]


@kernel
def _orbital(u, o, R, turn, kappa, p):
    """Rate of the step's displacement times momentum p (parent's axes), which the spin loses; in R's axes."""
    return cross3(_mean_turn(turn, kappa, rotate_back(R, load3(u, o))), rotate_back(R, p))


@kernel
def _balance_spin(before, middle, half, torque, h):
    """Spin at the end, and (change of the spatial spin) / h + torque in the axes of the middle."""
    end = sub3(scale3(2.0, middle), before)
    gained = sub3(rotate(half, end), rotate_back(half, before))
    return end, add3(scale3(1.0 / h, gained), torque)


@kernel
def balance_momenta(plan, p, scratch, h):
    """Write ``s.p_end`` = 2 M u - p and ``s.balance`` = (p_end - p) / h + force, turned where joints turn.

    Returns the change of kinetic energy by momenta, u . (p_end - p).
    """
    work = 0.0
    for k in range(p.shape[0]):
        scratch.p_end[k] = 2.0 * scratch.p_mid[k] - p[k]
        scratch.balance[k] = (scratch.p_end[k] - p[k]) / h + scratch.gradient[k]
        work += scratch.u[k] * (scratch.p_end[k] - p[k])
    for i in range(plan.tree.shape[0]):
        adds, ox, shift = joint_of(plan.tree[i])
        o = spin_of(plan.tree[i])
        if o < 0:
            continue
        turn = load3(scratch.increment, o)
        half, kappa = _half_turn(turn)
        E = quaternion_matrix(half)
        torque = load3(scratch.gradient, o)
        if is_free(plan.tree[i]):
            R = quaternion_matrix(_load4(scratch.x_mid, ox + adds))
            start = rotate_back(R, load3(p, shift))
            own = rotate(E, start)
            own_end = sub3(scale3(2.0, rotate_back(R, load3(scratch.p_mid, shift))), own)
            end = rotate(E, own_end)
            u = load3(scratch.u, shift)
            work += dot3(rotate_back(R, u), sub3(own_end, own))
            for k in range(3):
                work -= u[k] * (scratch.p_end[shift + k] - p[shift + k])
            store3(scratch.p_end, shift, rotate(R, end))
            store3(
                scratch.balance,
                shift,
                add3(scale3(1.0 / h, rotate(R, sub3(end, start))), load3(scratch.gradient, shift)),
            )
            mean = scale3(0.5, add3(start, end))
            torque = add3(torque, cross3(_mean_turn(turn, kappa, rotate_back(R, u)), mean))
        end, rest = _balance_spin(load3(p, o), load3(scratch.p_mid, o), E, torque, h)
        store3(scratch.p_end, o, end)
        store3(scratch.balance, o, rest)
    return work


@kernel
def conserve_momenta(plan, p, scratch, h):
    """Write the joints' part of ``s.p_end`` by the momenta's balance: momenta without force are kept to round-off.

    Modal momenta stay those of the velocities: they have no symmetry, and where a step does not resolve a mode the
    balance amplifies the error of Newton's iteration.  Parts that a projection onto loops removed are restored.
    """
    for k in range(p.shape[0]):
        scratch.p_end[k] = 2.0 * scratch.p_mid[k] - p[k]
    for i in range(plan.tree.shape[0]):
        adds, ox, shift = joint_of(plan.tree[i])
        for k in range(shift, shift + adds):
            scratch.p_end[k] = p[k] - h * scratch.gradient[k]
        o = spin_of(plan.tree[i])
        if o < 0:
            continue
        turn = load3(scratch.increment, o)
        half, kappa = _half_turn(turn)
        E = quaternion_matrix(half)
        torque = load3(scratch.gradient, o)
        if is_free(plan.tree[i]):
            R = quaternion_matrix(_load4(scratch.x_mid, ox + adds))
            mean = scale3(0.5, add3(load3(p, shift), load3(scratch.p_end, shift)))
            torque = add3(torque, _orbital(scratch.u, shift, R, turn, kappa, mean))
        spin = sub3(rotate_back(E, load3(p, o)), scale3(h, torque))
        store3(scratch.p_end, o, rotate_back(E, spin))


@kernel
def _strain_gradient(modal, o, q, out):
    """out = C q, the derivatives of the strain q^T C q / 2 whose triangle begins at o."""
    for i in range(q.shape[0]):
        t = modal[o + i] * q[i]
        for j in range(i):
            t += modal[o + j] * q[j]
            out[j] += modal[o + j] * q[i]
        out[i] = t
        o += i + 1


@deferred_kernel()
def average_strain(plan, scratch, h):
    """Make the forces of the modes' second-order strains those of the mean strain, in place of the middle's.

    The mean of a quadratic form's values at both ends is more than its value in the middle by that of half the
    step's motion.  With the mean strain the forces are a discrete gradient of the strain energy as they stand.
    """
    for i in range(plan.tree.shape[0]):
        link = plan.tree[i]
        n, qx, qv = modes_of(link, plan.flex)
        if n == 0:
            continue
        flex = plan.flex[flexible_of(link)]
        for r in range(membrane_strains_of(flex)):
            c, o, _, more = stretch(plan, flex, scratch.half_velocity[qv : qv + n], r)
            force = more * h * h
            _strain_gradient(plan.modal, o, scratch.x_mid[qx : qx + n], scratch.modal_scratch[0, :n])
            for j in range(n):
                scratch.modal_scratch[0, j] += plan.modal[c + j]
                scratch.gradient[qv + j] += force * scratch.modal_scratch[0, j]
                scratch.stored_gradient[qv + j] += force * scratch.modal_scratch[0, j]


@deferred_kernel()
def vary_average_strain(plan, scratch, h):
    """Add h / 2 times the derivative by u of the forces that ``average_strain`` adds to ``s.full_matrix``."""
    for i in range(plan.tree.shape[0]):
        link = plan.tree[i]
        n, qx, qv = modes_of(link, plan.flex)
        if n == 0:
            continue
        flex = plan.flex[flexible_of(link)]
        for r in range(membrane_strains_of(flex)):
            c, o, _, more = stretch(plan, flex, scratch.half_velocity[qv : qv + n], r)
            stiffness = 0.25 * h * h
            _strain_gradient(plan.modal, o, scratch.x_mid[qx : qx + n], scratch.modal_scratch[0, :n])
            _strain_gradient(plan.modal, o, scratch.half_velocity[qv : qv + n], scratch.modal_scratch[1, :n])
            for a in range(n):
                scratch.modal_scratch[0, a] += plan.modal[c + a]
            for a in range(n):
                for b in range(n):
                    scratch.full_matrix[qv + a, qv + b] += (
                        stiffness * h * scratch.modal_scratch[0, a] * scratch.modal_scratch[1, b]
                    )
                for b in range(a + 1):
                    t = stiffness * h * h * more * plan.modal[o + b]
                    scratch.full_matrix[qv + a, qv + b] += t
                    if b < a:
                        scratch.full_matrix[qv + b, qv + a] += t
                o += a + 1


@kernel
def _projected(projector, i, R, v):
    """The projector i, given in the axes that R turns to, times v of R's own axes."""
    w = rotate(R, v)
    m = projector[i]
    return rotate_back(
        R,
        (
            m[0] * w[0] + m[1] * w[1] + m[2] * w[2],
            m[3] * w[0] + m[4] * w[1] + m[5] * w[2],
            m[6] * w[0] + m[7] * w[1] + m[8] * w[2],
        ),
    )


@kernel
def project_out_symmetries(plan, scratch, out):
    """Project motions that energy does not depend on out of the velocities or momenta ``out`` (nv,)."""
    bodies = plan.tree.shape[0]
    for k in range(out.shape[0]):
        out[k] *= scratch.projector[2 * bodies + k, 0]
    for i in range(bodies):
        adds, ox, shift = joint_of(plan.tree[i])
        o = spin_of(plan.tree[i])
        if o < 0:
            continue
        R = quaternion_matrix(_load4(scratch.x_mid, ox + adds))
        store3(out, o, _projected(scratch.projector, 2 * i + 1, R, load3(out, o)))
        if is_free(plan.tree[i]):
            unturned = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
            store3(out, shift, _projected(scratch.projector, 2 * i, unturned, load3(out, shift)))
