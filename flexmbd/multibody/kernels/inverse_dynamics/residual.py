"""The equations of motion of a scene as one residual (Ambrosio & Nikravesh 1992, eq. 77)."""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.inverse_dynamics.closure import load_constraints, load_couplings
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import load_elements, subtract_coordinate_forces
from flexmbd.multibody.kernels.inverse_dynamics.recursion import (
    backward_forces,
    forward_kinematics,
    write_inertial_wrenches,
)
from flexmbd.multibody.kernels.physics.one_dimensional_inertia import add_shaft_inertias


@entry_kernel
def drive(plan, work, x, v, a):
    """Set the prescribed coordinates, their rates and accelerations from ``work.time``.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration.
        v: (nv,) float64, velocities.
        a: (nv,) float64, accelerations.
    """
    for i in range(plan.driven.shape[0]):
        row = plan.driven[i]
        f = row[at.DRIVEN_TIME]
        x[row[at.DRIVEN_X]] = work.time[f, 0]
        v[row[at.DRIVEN_V]] = work.time[f, 1]
        a[row[at.DRIVEN_V]] = work.time[f, 2]


@entry_kernel
def residual(plan, work, x, v, a, multipliers, out):
    """out = M(x) a + bias(x, v) + elastic - applied + C^T nu, for all generalised velocities.

    ``work.time`` must be up to date.  In the rows of prescribed coordinates ``out`` is the force
    that drives them.  Leaves the kinematics of (x, v, a) in ``work``.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nx,) float64, configuration.
        v: (nv,) float64, velocities.
        a: (nv,) float64, accelerations.
        multipliers: (m,) float64, N or N m, of the constraint rows.
        out: (nv,) float64, N or N m, output.
    """
    for k in range(out.shape[0]):
        out[k] = 0.0
    forward_kinematics(plan, work, x, v, a)
    write_inertial_wrenches(plan, work, x, v, a, out)
    if plan.rows.shape[0] > 0:
        load_constraints(plan, work, multipliers, out)
    if plan.elements.shape[0] > 0:
        load_elements(plan, work, x, v, out)
    backward_forces(plan, work, out)
    add_shaft_inertias(plan.shafts, a, out)
    load_couplings(plan, multipliers, out)
    if plan.elements.shape[0] > 0:
        subtract_coordinate_forces(plan, work, x, v, out)
    for i in range(plan.forces.shape[0]):
        out[plan.forces[i, at.FORCE_V]] -= work.time[plan.forces[i, at.FORCE_TIME], 0]
