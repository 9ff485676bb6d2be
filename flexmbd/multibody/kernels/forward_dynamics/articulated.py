"""Forward dynamics in O(bodies): the articulated-body recursion through rigid and flexible bodies.

Outwards go velocities and what needs no acceleration; inwards each body's inertia and asked
wrench, of which a joint passes on what does not move it; outwards again the accelerations
(theory: Featherstone 2008, section 7.3; flexible bodies: ``articulated_flexible``).  Accelerations
are those of material points, so that no term holds the linear velocity; gravity is an acceleration
of the ground.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base import layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel, part_of_kernel
from flexmbd.multibody.kernels.forward_dynamics.inward import gather_forces, gather_inertia
from flexmbd.multibody.kernels.forward_dynamics.outward import accelerate, move
from flexmbd.multibody.kernels.forward_dynamics.planar import planar_dynamics
from flexmbd.multibody.kernels.inverse_dynamics.closure import load_constraints, load_couplings
from flexmbd.multibody.kernels.inverse_dynamics.elements import load_elements, push_coordinates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward


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


@part_of_kernel
def run_forward_dynamics(plan, work, aw, x, v, a, multipliers):
    """``forward_dynamics`` as text of its caller: to hand over all arrays takes a quarter of a small machine's time."""
    asked = aw.asked
    for k in range(asked.shape[0]):
        asked[k] = 0.0
    for i in range(plan.driven.shape[0]):
        a[plan.driven[i, at.DRIVEN_V]] = work.time[plan.driven[i, at.DRIVEN_TIME], 2]
    loaded = False
    if multipliers.shape[0] + plan.elements.shape[0] + plan.forces.shape[0] > 0:
        loaded = _ask_loads(plan, work, aw, x, v, multipliers)
    if aw.planar[0] == 1:
        planar_dynamics(plan.gravity, aw, work.body, x, v, a, loaded)
        return
    move(plan, aw, x, v, a)
    gather_inertia(plan, work, aw, v, loaded)
    start = (-plan.gravity[0], -plan.gravity[1], -plan.gravity[2])
    accelerate(plan, aw, start, v, 1.0, a)


@kernel
def _ask_loads(plan, work, aw, x, v, multipliers):
    """Add to ``aw.asked`` and, if it returns true, write to the bodies' wrenches what joints, elements and loops ask.

    Only wrenches between frames need poses in the world.
    """
    asked = aw.asked
    loaded = multipliers.shape[0] > 0
    for i in range(plan.elements.shape[0]):
        loaded = loaded or plan.elements[i, at.EL_KIND] in kinds.BETWEEN_FRAMES
    if loaded:
        forward(plan, work, x, v, aw.rest)
        for i in range(plan.tree.shape[0]):
            for k in range(at.B_F, at.B_T + 3):
                work.body[i, k] = 0.0
        load_elements(plan, work, asked)
        if multipliers.shape[0] > 0:
            load_constraints(plan, work, multipliers, asked)
            load_couplings(plan, multipliers, asked)
    if plan.elements.shape[0] > 0:
        push_coordinates(plan, work, x, v, asked)
    for i in range(plan.forces.shape[0]):
        asked[plan.forces[i, at.FORCE_V]] -= work.time[plan.forces[i, at.FORCE_TIME], 0]
    return loaded


@entry_kernel
def articulate(plan, work, aw, x):
    """Factor M(x) for ``solve_mass``; arguments as for ``forward_dynamics``."""
    for k in range(aw.asked.shape[0]):
        aw.asked[k] = 0.0
    move(plan, aw, x, aw.rest, aw.rest)
    gather_inertia(plan, work, aw, aw.rest, False)


@entry_kernel
def solve_mass(plan, work, aw, rhs, out):
    """Write M^-1 times each row of ``rhs`` (k, nv) into ``out`` (k, nv), with the factors at hand.

    Prescribed coordinates stay: their entries of ``rhs`` play no part and those of ``out`` are zero.
    """
    for k in range(rhs.shape[0]):
        for i in range(plan.driven.shape[0]):
            out[k, plan.driven[i, at.DRIVEN_V]] = 0.0
        gather_forces(plan, aw, rhs[k])
        accelerate(plan, aw, (0.0, 0.0, 0.0), aw.rest, 0.0, out[k])
