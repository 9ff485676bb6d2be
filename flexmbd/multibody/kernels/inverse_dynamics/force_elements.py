"""What the force elements of a scene exert and store; what each does is in the room ``elements``."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, compose, cross3, rotate, rotate_back, scale3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements.frame_states import load_states
from flexmbd.multibody.kernels.elements.state_rates import ON_FRAMES, ON_MODES, put_outputs
from flexmbd.multibody.kernels.elements.table import (
    coordinate_energy,
    coordinate_law,
    element_wrench,
    force_energy,
    frame_energy,
    is_between_frames,
    is_coordinate_law,
    is_of_pairs,
    is_state_equations,
    stores_between_frames,
    stores_of_pairs,
    subtract_force,
)
from flexmbd.multibody.kernels.inverse_dynamics.pair_forces import load_pairs, pairs_energy
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion, load_frame


@deferred_kernel()
def subtract_coordinate_forces(plan, work, x, v, out):
    """Subtract from ``out`` (nv,) the generalised forces of all elements that act on coordinates."""
    for i in range(plan.elements.shape[0]):
        if is_state_equations(plan.elements[i, at.EL_KIND]):
            put_outputs(plan, work, plan.elements[i], x, v, ON_MODES)
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        kind = row[at.EL_KIND]
        if is_coordinate_law(kind):
            k = row[at.EL_V]
            out[k] -= coordinate_law(plan, row, x[row[at.EL_X]], v[k])[0]
        elif not is_between_frames(kind):
            subtract_force(plan, work, row, x, v, out)


@kernel
def relative_rates(plan, work, f, g):
    """d = p_FG_F, R_FG, and the velocity and angular velocity of G against F, all in F's axes."""
    p_F, R_F, v_F, w_F, _, _ = frame_motion(plan, work, f)
    p_G, R_G, v_G, w_G, _, _ = frame_motion(plan, work, g)
    d = rotate_back(R_F, sub3(p_G, p_F))
    back = (R_F[0], R_F[3], R_F[6], R_F[1], R_F[4], R_F[7], R_F[2], R_F[5], R_F[8])
    R = compose(back, R_G)
    rate = sub3(rotate(R, v_G), add3(v_F, cross3(w_F, d)))
    return d, R, rate, sub3(rotate(R, w_G), w_F)


@deferred_kernel()
def load_elements(plan, work, x, v, out):
    """Subtract the wrenches of all elements between frames from those required of both frames' bodies.

    And the rates of the states that some of them have from the torques that these states' links require.
    """
    plan.horizon[1] = 0.0
    for i in range(plan.elements.shape[0]):
        if is_state_equations(plan.elements[i, at.EL_KIND]):
            put_outputs(plan, work, plan.elements[i], x, v, ON_FRAMES)
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if not is_between_frames(row[at.EL_KIND]):
            continue
        if is_of_pairs(row[at.EL_KIND]):
            load_pairs(plan, work, row, out)
            continue
        f, g = row[at.EL_F], row[at.EL_G]
        d, R, rate, spin = relative_rates(plan, work, f, g)
        force, torque = element_wrench(plan, work, row, d, R, rate, spin)
        if row[at.EL_V] >= 0:
            load_states(plan, work, row)
        back = add3(torque, cross3(d, force))
        load_frame(plan, work, f, force, back, out)
        load_frame(
            plan, work, g, rotate_back(R, scale3(-1.0, force)), rotate_back(R, scale3(-1.0, torque)), out
        )


@deferred_kernel(NUMBER)
def elements_energy(plan, work, x):
    """Energy that all elements store (J); ``work`` holds the motion."""
    energy = 0.0
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        kind = row[at.EL_KIND]
        if is_coordinate_law(kind):
            energy += coordinate_energy(plan, row, x[row[at.EL_X]])
        elif stores_between_frames(kind):
            d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            energy += frame_energy(plan, work, row, d, R, rate, spin)
        elif stores_of_pairs(kind):
            energy += pairs_energy(plan, work, row)
        elif not is_between_frames(kind):
            energy += force_energy(plan, work, row, x)
    return energy
