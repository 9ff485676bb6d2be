"""What force elements remember, brought up to date where a machine has arrived."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import brief_entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import deferred_kernel
from flexmbd.multibody.kernels.elements.memory_path import write_memory
from flexmbd.multibody.kernels.elements.table import is_of_surface, write_frame_memory
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.surface_loads import remember_surface


@kernel
def _remember(plan, work, x, v, t):
    """As ``remember``."""
    if work.memory.shape[0] > 0:
        forward_kinematics(plan, work, x, v, v)
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if row[at.EL_MEMORY] < 0:
            continue
        if is_of_surface(row[at.EL_KIND]):
            remember_surface(plan, work, row, x, t)
        elif row[at.EL_F] >= 0:
            d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            write_frame_memory(plan, work, row, x, d, R, rate, spin, t)
        else:
            write_memory(plan, work, row, x, x[row[at.EL_X]] - plan.data[row[at.EL_DATA]], v[row[at.EL_V]], t)


@brief_entry_kernel
def remember(plan, work, x, v, t):
    """Write into x (nx,) what all elements remember at t (s), having come to x, v from what they remembered there.

    Leaves the kinematics of (x, v) in ``work``, where any remembers between frames; accelerations are not known there.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration; its memories are written.
        v: (nv,) float64, velocities.
        t: float64, s.
    """
    _remember(plan, work, x, v, t)


@deferred_kernel()
def remember_step(plan, work, x, v, t):
    """As ``remember``, at the end of a step."""
    _remember(plan, work, x, v, t)
