"""What the elastic surfaces of a scene that touch exert and store."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, rotate_back, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import press_patches, surface_energy, surface_wrench
from flexmbd.multibody.kernels.elements.surface_friction import remember_patches
from flexmbd.multibody.kernels.elements.surface_groups import group_of, stored_by_contacts
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.pressed_surfaces import (
    APART,
    is_of_group,
    member_forces,
    modes_of,
    other_modes_of,
    press_group,
    role,
)
from flexmbd.multibody.kernels.inverse_dynamics.recursion import load_frame


@kernel
def _press(plan, work, row, d, R, x):
    qx, _, n = modes_of(plan, row)
    rx, _, k = other_modes_of(plan, row)
    return press_patches(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + k])


@kernel
def _load(plan, work, row, motion, v, pressed, out):
    """Subtract the forces of a surface whose patches were pressed."""
    f, g = row[at.EL_F], row[at.EL_G]
    _, qv, n = modes_of(plan, row)
    _, rv, k = other_modes_of(plan, row)
    d, R, _, _ = motion
    force, torque = surface_wrench(plan, work, row, motion, v[qv : qv + n], v[rv : rv + k], pressed)
    load_frame(plan, work, f, force, add3(torque, cross3(d, force)), out)
    load_frame(plan, work, g, rotate_back(R, scale3(-1.0, force)), rotate_back(R, scale3(-1.0, torque)), out)
    _, p, _ = sl.table_of(plan, row)
    _, p_other, _ = sl.other_of(plan, row)
    first = sl.modal_place(p, p_other, 6 + n + k)
    for i in range(n):
        out[qv + i] -= work.generalized[first + i]
    for i in range(k):
        out[rv + i] -= work.generalized[first + n + i]


@deferred_kernel()
def _load_group(plan, work, g, x, v, out):
    apart = press_group(plan, work, g, x) == APART
    for e in range(plan.elements.shape[0]):
        row = plan.elements[e]
        if is_of_group(plan, row, g):
            motion = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            if apart:
                pressed = _press(plan, work, row, motion[0], motion[1], x)
            else:
                pressed = member_forces(plan, work, row, motion[0], motion[1], x)
            _load(plan, work, row, motion, v, pressed, out)


@deferred_kernel()
def load_surface(plan, work, row, x, v, out):
    """Subtract the forces of a surface from the wrenches required of both bodies, and from ``out`` (nv,) the modes'.

    Of a group the first one's row does so for all.
    """
    part = role(plan, row)
    if part == 0:
        motion = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
        _load(plan, work, row, motion, v, _press(plan, work, row, motion[0], motion[1], x), out)
    elif part == 1:
        _load_group(plan, work, group_of(plan, row), x, v, out)


@kernel
def _stored_alone(plan, work, row, x):
    qx, _, n = modes_of(plan, row)
    rx, _, k = other_modes_of(plan, row)
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    return surface_energy(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + k])


@deferred_kernel(NUMBER)
def stored_by_surface(plan, work, row, x):
    """What a surface stores (J), or the first of a group for all."""
    part = role(plan, row)
    if part == 2:
        return 0.0
    if part == 0:
        return _stored_alone(plan, work, row, x)
    g, energy = group_of(plan, row), 0.0
    count = press_group(plan, work, g, x)
    if count != APART:
        return stored_by_contacts(plan, work, g, count) if count >= 0 else math.nan
    for e in range(plan.elements.shape[0]):
        if is_of_group(plan, plan.elements[e], g):
            energy += _stored_alone(plan, work, plan.elements[e], x)
    return energy


@deferred_kernel()
def remember_surface(plan, work, row, x, t):
    """Write into the configuration x what a surface with friction remembers at t (s)."""
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    m, count, _ = _press(plan, work, row, d, R, x)
    x[row[at.EL_MEMORY] + at.MEMORY_TIME] = t
    remember_patches(plan, work, row, x, m, count)
