"""What the force elements of a scene exert and store; what each does is in the room ``elements``."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, rotate_back, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
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
    is_of_surface,
    is_state_equations,
    stores_between_frames,
    stores_of_pairs,
    subtract_force,
)
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.pair_forces import load_pairs, pairs_energy
from flexmbd.multibody.kernels.inverse_dynamics.recursion import load_frame
from flexmbd.multibody.kernels.inverse_dynamics.surface_loads import load_surface, stored_by_surface


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
        if is_of_surface(row[at.EL_KIND]):
            load_surface(plan, work, row, x, v, out)
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
        elif is_of_surface(kind):
            energy += stored_by_surface(plan, work, row, x)
        elif not is_between_frames(kind):
            energy += force_energy(plan, work, row, x)
    return energy
