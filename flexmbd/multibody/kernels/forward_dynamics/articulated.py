"""Forward dynamics in O(bodies): the articulated-body recursion through rigid and flexible bodies.

Outwards: velocities and bias accelerations.  Inwards: articulated inertias and bias forces, each joint being
eliminated on the way.  Outwards again: accelerations (Featherstone 2008, section 7.3; flexible bodies: ``flexible``).
Accelerations are those of material points, so that no term holds the linear velocity; gravity is an acceleration of
the ground.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.deferred import FLAG, deferred_kernel
from flexmbd.multibody.kernels.elements.table import is_between_frames
from flexmbd.multibody.kernels.forward_dynamics.inward import gather_bias_forces, gather_inertia
from flexmbd.multibody.kernels.forward_dynamics.outward import propagate_accelerations, propagate_velocities
from flexmbd.multibody.kernels.forward_dynamics.parallel_hinges import planar_dynamics
from flexmbd.multibody.kernels.inverse_dynamics.closure import load_constraints, load_couplings
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import load_elements, subtract_coordinate_forces
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics


@entry_kernel
def forward_dynamics(plan, work, aw, x, v, a, multipliers):
    """Write the accelerations ``a`` (nv,) of the tree at (x, v): M a = applied - bias - C^T nu.

    ``work.time`` must be up to date; prescribed coordinates must stand in x and v (``residual.drive``),
    their accelerations are taken from there.  Leaves the factors for ``solve_mass``.

    Args:
        plan: the scene.
        work: its scratch space, with the functions of time.
        aw: ``new_articulated_work(plan)``.
        x: (nx,) configuration.
        v: (nv,) velocity.
        a: (nv,) output.
        multipliers: (m,) of the loops' rows (N or N m), or (0,) for none.
    """
    run_forward_dynamics(plan, work, aw, x, v, a, multipliers)


@kernel
def run_forward_dynamics(plan, work, aw, x, v, a, multipliers):
    """``forward_dynamics``, inlined: passing all arrays takes a quarter of a small machine's time."""
    required = aw.required
    for k in range(required.shape[0]):
        required[k] = 0.0
    for i in range(plan.driven.shape[0]):
        a[plan.driven[i, at.DRIVEN_V]] = work.time[plan.driven[i, at.DRIVEN_TIME], 2]
    loaded = False
    if multipliers.shape[0] + plan.elements.shape[0] > 0:
        loaded = _add_applied_loads(plan, work, aw, x, v, multipliers)
    for i in range(plan.forces.shape[0]):
        required[plan.forces[i, at.FORCE_V]] -= work.time[plan.forces[i, at.FORCE_TIME], 0]
    if aw.planar[0] == 1:
        planar_dynamics(plan.gravity, aw, work.body, x, v, a, loaded)
        return
    _accelerate_bodies(plan, work, aw, x, v, a, loaded)


@deferred_kernel()
def _accelerate_bodies(plan, work, aw, x, v, a, loaded):
    """The three passes, for trees that are not of parallel hinges."""
    propagate_velocities(plan, aw, x, v, a)
    gather_inertia(plan, work, aw, v, loaded)
    start = (-plan.gravity[0], -plan.gravity[1], -plan.gravity[2])
    propagate_accelerations(plan, aw, start, v, 1.0, a)


@deferred_kernel(FLAG)
def _add_applied_loads(plan, work, aw, x, v, multipliers):
    """Put the forces of elements and reactions into ``aw.required`` and, if it returns true, the bodies' wrenches.

    Only wrenches between frames need poses in the world.
    """
    required = aw.required
    loaded = multipliers.shape[0] > 0
    for i in range(plan.elements.shape[0]):
        loaded = loaded or is_between_frames(plan.elements[i, at.EL_KIND])
    if loaded:
        forward_kinematics(plan, work, x, v, aw.zeros)
        for i in range(plan.tree.shape[0]):
            for k in range(at.B_F, at.B_T + 3):
                work.body[i, k] = 0.0
        load_elements(plan, work, x, v, required)
        if multipliers.shape[0] > 0:
            load_constraints(plan, work, multipliers, required)
            load_couplings(plan, multipliers, required)
    if plan.elements.shape[0] > 0:
        subtract_coordinate_forces(plan, work, x, v, required)
    return loaded


@entry_kernel
def articulate(plan, work, aw, x):
    """Factor M(x) for ``solve_mass``; arguments as for ``forward_dynamics``."""
    for k in range(aw.required.shape[0]):
        aw.required[k] = 0.0
    propagate_velocities(plan, aw, x, aw.zeros, aw.zeros)
    gather_inertia(plan, work, aw, aw.zeros, False)


@entry_kernel
def solve_mass(plan, work, aw, rhs, out):
    """Write M^-1 times each row of ``rhs`` (k, nv) into ``out`` (k, nv), with the factors at hand.

    Prescribed coordinates stay: their entries of ``rhs`` play no part and those of ``out`` are zero.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        aw: ArticulatedWork of the plan.
        rhs: (k, nv) float64.
        out: (k, nv) float64, output.
    """
    for k in range(rhs.shape[0]):
        for i in range(plan.driven.shape[0]):
            out[k, plan.driven[i, at.DRIVEN_V]] = 0.0
        gather_bias_forces(plan, aw, rhs[k])
        propagate_accelerations(plan, aw, (0.0, 0.0, 0.0), aw.zeros, 0.0, out[k])
