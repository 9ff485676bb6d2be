"""Force elements: laws on joint coordinates and wrenches between two frames, and what they store.

A law on a coordinate gives a force or torque on it.  An element between frames F and G gives the
force on G at G's origin and the torque on G, in F's axes, from the motion of G against F in F's
axes: d = p_FG_F, R = R_FG and their rates; F gets the opposite.
"""

from __future__ import annotations

import math

import numpy as np

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    compose,
    cross3,
    dot3,
    left_jacobian_inverse,
    left_jacobian_inverse_transposed,
    load3,
    rotate,
    rotate_back,
    rotation_vector,
    scale3,
    sub3,
)
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.base.native import call_law, call_state
from flexmbd.multibody.kernels.inverse_dynamics.recursion import frame_motion, load_frame
from flexmbd.multibody.kernels.physics.constraint_laws import row_value, row_wrench, wrap
from flexmbd.multibody.kernels.physics.energies import add_energy_gradient, energy_of
from flexmbd.multibody.kernels.physics.time_functions import piecewise

_ZERO = (0.0, 0.0, 0.0)
_LEAST = 1e-150  # a length that is none


@kernel
def _contact(stiffness, transition, depth):
    """Elastic force, its slope and energy at a depth > 0: quadratic up to ``transition``, then linear."""
    if depth < transition:
        slope = stiffness * depth / transition
        return 0.5 * slope * depth, slope, slope * depth * depth / 6.0
    past = depth - 0.5 * transition
    return stiffness * past, stiffness, 0.5 * stiffness * (past * past + transition * transition / 12.0)


@kernel
def _stop(stiffness, damping, transition, depth, rate):
    """Force against a depth that grows at ``rate``, and its derivatives by both; none pulls."""
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    share = 1.0 + damping * rate
    if share <= 0.0:
        return 0.0, 0.0, 0.0
    force, slope, _ = _contact(stiffness, transition, depth)
    return force * share, slope * share, force * damping


@kernel
def _friction(data, o, rate):
    """The regularised friction force and its derivative by the rate."""
    ratio = rate / data[o + 3]
    fade = math.exp(-ratio * ratio)
    excess = data[o + 1] - data[o]
    size = data[o] + excess * fade
    sign = math.tanh(rate / data[o + 2])
    slope = size * (1.0 - sign * sign) / data[o + 2] - 2.0 * excess * fade * ratio / data[o + 3] * sign
    return -size * sign - data[o + 4] * rate, -slope - data[o + 4]


@entry_kernel
def coordinate_law(plan, row, x, rate):
    """Force on a coordinate x (rad or m) and its derivatives by x and its rate: any of COORDINATE_LAWS."""
    data = plan.data
    o = row[at.EL_DATA]
    kind = row[at.EL_KIND]
    if kind == kinds.ON_SPRING:
        return -data[o] * (x - data[o + 1]) - data[o + 2] * rate, -data[o], -data[o + 2]
    if kind == kinds.ON_CHARACTERISTIC:
        force, slope, _ = piecewise(data, o + 2, row[at.EL_COUNT], x - data[o])
        return -force - data[o + 1] * rate, -slope, -data[o + 1]
    if kind == kinds.ON_STOP:
        low, low_x, low_v = _stop(data[o + 2], data[o + 3], data[o + 4], data[o] - x, -rate)
        high, high_x, high_v = _stop(data[o + 2], data[o + 3], data[o + 4], x - data[o + 1], rate)
        return low - high, -low_x - high_x, -low_v - high_v
    force, slope = _friction(data, o, rate)
    return force, 0.0, slope


@kernel
def _coordinate_energy(plan, row, x):
    """Energy that a law on a coordinate stores (J)."""
    data = plan.data
    o = row[at.EL_DATA]
    kind = row[at.EL_KIND]
    if kind == kinds.ON_SPRING:
        return 0.5 * data[o] * (x - data[o + 1]) ** 2
    if kind == kinds.ON_CHARACTERISTIC:
        pieces = row[at.EL_COUNT]
        potential = o + 4 + pieces + int(data[o + 2]) * pieces
        return piecewise(data, potential, pieces, x - data[o])[0]
    if kind == kinds.ON_STOP:
        depth = max(data[o] - x, x - data[o + 1])
        return _contact(data[o + 2], data[o + 4], depth)[2] if depth > 0.0 else 0.0
    return 0.0


@kernel
def _finite(values):
    total = 0.0  # a sum is finite but where a value is not, or where they are beyond all use
    for k in range(values.shape[0]):
        total += abs(values[k])
    return np.isfinite(total)


@kernel
def _user_law(plan, work, i, x, rate):
    """Force of the user's law of row i; NaN and ``plan.flag`` where it is not finite.

    Where the trial state itself is not finite the law is not called.
    """
    if plan.flag[0] != 0 or not np.isfinite(x + rate):
        return np.nan
    force = call_law(plan.elements[i, at.EL_ADDRESS], work.time[plan.times.shape[0], 0], x, rate)
    if plan.flag[0] == 0 and not np.isfinite(force):
        plan.flag[0] = kinds.FLAG_ELEMENT + i
    return force


@kernel
def _subtract_user_forces(plan, work, i, x, v, out):
    """Subtract the forces of the user's function of row i from ``out`` (nv,); NaN and flag as in `_user_law`."""
    force = work.generalized
    for k in range(force.shape[0]):
        force[k] = np.nan
    if plan.flag[0] == 0 and _finite(x) and _finite(v):
        call_state(plan.elements[i, at.EL_ADDRESS], work.time[plan.times.shape[0], 0], x, v, force)
        if plan.flag[0] == 0 and not _finite(force):
            plan.flag[0] = kinds.FLAG_ELEMENT + i
    for k in range(force.shape[0]):
        out[k] -= force[k]


@deferred_kernel()
def subtract_coordinate_forces(plan, work, x, v, out):
    """Subtract from ``out`` (nv,) the generalised forces of all elements that act on coordinates."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        kind = row[at.EL_KIND]
        k = row[at.EL_V]
        if kind in kinds.COORDINATE_LAWS:
            out[k] -= coordinate_law(plan, row, x[row[at.EL_X]], v[k])[0]
        elif kind == kinds.ON_FUNCTION:
            out[k] -= _user_law(plan, work, i, x[row[at.EL_X]], v[k])
        elif kind == kinds.ON_MODES:
            factor = work.time[row[at.EL_TIME], 0]
            for j in range(row[at.EL_COUNT]):
                out[k + j] -= factor * plan.data[row[at.EL_DATA] + j]
        elif kind == kinds.ON_STATE:
            _subtract_user_forces(plan, work, i, x, v, out)
        elif kind == kinds.ON_ENERGY:
            add_energy_gradient(plan, row, x, out)


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


@kernel
def _six_dot(data, o, a, b):
    return (
        data[o] * a[0] + data[o + 1] * a[1] + data[o + 2] * a[2]
        + data[o + 3] * b[0] + data[o + 4] * b[1] + data[o + 5] * b[2]
    )


@kernel
def six_times(data, o, a, b):
    """The row-major 6 x 6 matrix data[o:] times (a, b)."""
    return (
        (_six_dot(data, o, a, b), _six_dot(data, o + 6, a, b), _six_dot(data, o + 12, a, b)),
        (_six_dot(data, o + 18, a, b), _six_dot(data, o + 24, a, b), _six_dot(data, o + 30, a, b)),
    )


@kernel
def penalty_reaction(plan, work, row, d, R, rate, spin):
    """A penalised row's value and rate, its reaction in place of a multiplier, and its unit wrench."""
    held = plan.penalties[row[at.EL_COUNT]]
    o = row[at.EL_DATA]
    force, torque = row_wrench(plan.data, held, d, R)
    value = row_value(plan.data, held, d, R)
    speed = dot3(force, rate) + dot3(torque, spin)
    f = held[at.ROW_TIME]
    if f >= 0:
        speed -= work.time[f, 1]
        value -= work.time[f, 0]
        if held[at.ROW_KIND] == kinds.ROW_ANGLE:
            value = wrap(value)
    return value, speed, plan.data[o] * value + plan.data[o + 1] * speed, force, torque


@entry_kernel
def element_wrench(plan, work, row, d, R, rate, spin):
    """Force on G at G's origin and torque on G, in F's axes, of an element between frames.

    A bushing's is the derivative of u^T K u / 2 + (dissipation) du^T C du / 2 with u = (d, log R):
    the work of its torque is that on log R, through the inverse Jacobian of the exponential.
    """
    data = plan.data
    o = row[at.EL_DATA]
    kind = row[at.EL_KIND]
    if kind == kinds.BETWEEN_SPRING:
        length = max(math.sqrt(dot3(d, d)), _LEAST)
        pull = data[o] * (length - data[o + 1]) + data[o + 2] * dot3(d, rate) / length
        return scale3(-pull / length, d), _ZERO
    if kind == kinds.BETWEEN_BUSHING:
        theta = rotation_vector(R)
        force, torque = six_times(data, o, d, theta)
        drag, twist = six_times(data, o + 36, rate, left_jacobian_inverse(theta, spin))
        torque = left_jacobian_inverse_transposed(theta, add3(torque, twist))
        return scale3(-1.0, add3(force, drag)), scale3(-1.0, torque)
    if kind == kinds.BETWEEN_PENALTY:
        _, _, pull, force, torque = penalty_reaction(plan, work, row, d, R, rate, spin)
        return scale3(-pull, force), scale3(-pull, torque)
    if kind == kinds.BETWEEN_INTERIOR:
        wrench = plan.wrenches[row[at.EL_COUNT]]
        return load3(wrench, 0), load3(wrench, 3)
    factor = 1.0 if row[at.EL_TIME] < 0 else work.time[row[at.EL_TIME], 0]
    force = scale3(factor, load3(data, o))
    torque = scale3(factor, load3(data, o + 3))
    if kind == kinds.BETWEEN_GIVEN_G:
        return rotate(R, force), rotate(R, torque)
    return force, torque


@deferred_kernel()
def load_elements(plan, work, out):
    """Subtract the wrenches of all elements between frames from those required of both frames' bodies."""
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if row[at.EL_KIND] not in kinds.BETWEEN_FRAMES:
            continue
        f, g = row[at.EL_F], row[at.EL_G]
        d, R, rate, spin = relative_rates(plan, work, f, g)
        force, torque = element_wrench(plan, work, row, d, R, rate, spin)
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
        o = row[at.EL_DATA]
        if row[at.EL_KIND] in kinds.COORDINATE_LAWS:
            energy += _coordinate_energy(plan, row, x[row[at.EL_X]])
        elif row[at.EL_KIND] == kinds.ON_ENERGY:
            energy += energy_of(plan, row, x)
        elif row[at.EL_KIND] == kinds.BETWEEN_SPRING:
            d, _, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            energy += 0.5 * plan.data[o] * (math.sqrt(dot3(d, d)) - plan.data[o + 1]) ** 2
        elif row[at.EL_KIND] == kinds.BETWEEN_PENALTY:
            d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            value, _, _, _, _ = penalty_reaction(plan, work, row, d, R, rate, spin)
            energy += 0.5 * plan.data[o] * value * value
        elif row[at.EL_KIND] == kinds.BETWEEN_BUSHING:
            d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            theta = rotation_vector(R)
            force, torque = six_times(plan.data, o, d, theta)
            energy += 0.5 * (dot3(force, d) + dot3(torque, theta))
    return energy
