"""What the elastic surfaces of a scene that touch exert and store."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, rotate_back, scale3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.deferred import NUMBER, deferred_kernel
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import press_patches, surface_energy, surface_wrench
from flexmbd.multibody.kernels.elements.surface_friction import remember_patches
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import load_frame


@kernel
def _modes_of_body(plan, f):
    link = plan.tree[plan.frame_of[f, at.FRAME_BODY]]
    n = plan.flex[link[at.FLEX], at.N_MODES] if link[at.FLEX] >= 0 else 0
    return link[at.MODAL_X], link[at.MODAL_V], n


@kernel
def modes_of(plan, row):
    """Where the modes of a surface's body stand in x and in v, and how many there are."""
    if sl.table_of(plan, row)[2] == 0:  # a rigid sphere, on whatever body
        return 0, 0, 0
    return _modes_of_body(plan, row[at.EL_G])


@kernel
def other_modes_of(plan, row):
    """The same of the other surface's; none where there is none."""
    if plan.data[row[at.EL_DATA] + sl.OTHER] < 0.0:
        return 0, 0, 0
    return _modes_of_body(plan, row[at.EL_F])


@deferred_kernel()
def load_surface(plan, work, row, x, v, out):
    """Subtract the forces of a surface from the wrenches required of both bodies, and from ``out`` (nv,) the modes'."""
    f, g = row[at.EL_F], row[at.EL_G]
    qx, qv, n = modes_of(plan, row)
    rx, rv, k = other_modes_of(plan, row)
    d, R, rate, spin = relative_rates(plan, work, f, g)
    force, torque = surface_wrench(
        plan, work, row, (d, R, rate, spin), x[qx : qx + n], v[qv : qv + n], x[rx : rx + k], v[rv : rv + k]
    )
    load_frame(plan, work, f, force, add3(torque, cross3(d, force)), out)
    load_frame(plan, work, g, rotate_back(R, scale3(-1.0, force)), rotate_back(R, scale3(-1.0, torque)), out)
    _, p, _ = sl.table_of(plan, row)
    _, p_other, _ = sl.other_of(plan, row)
    first = sl.modal_place(p, p_other, 6 + n + k)
    for i in range(n):
        out[qv + i] -= work.generalized[first + i]
    for i in range(k):
        out[rv + i] -= work.generalized[first + n + i]


@deferred_kernel(NUMBER)
def stored_by_surface(plan, work, row, x):
    """What a surface stores (J)."""
    qx, _, n = modes_of(plan, row)
    rx, _, k = other_modes_of(plan, row)
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    return surface_energy(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + k])


@deferred_kernel()
def remember_surface(plan, work, row, x, t):
    """Write into the configuration x what a surface with friction remembers at t (s)."""
    qx, _, n = modes_of(plan, row)
    rx, _, k = other_modes_of(plan, row)
    d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
    m, count, _ = press_patches(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + k])
    x[row[at.EL_MEMORY] + at.MEMORY_TIME] = t
    remember_patches(plan, work, row, x, m, count)
