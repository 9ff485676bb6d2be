"""Series over a whole trajectory: frames, energies and driving forces, compiled."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    load3,
    load9,
    rotate,
    scale3,
    store3,
    store9,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.inverse_dynamics.canonical import body_momentum, first_moment_of
from flexmbd.multibody.kernels.inverse_dynamics.closure import constraints
from flexmbd.multibody.kernels.inverse_dynamics.force_elements import elements_energy
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics, frame_motion
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.elasticity import elastic_energy
from flexmbd.multibody.kernels.physics.gyroscopic import rotor_momentum
from flexmbd.multibody.kernels.physics.one_dimensional_inertia import shaft_energy
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times


@entry_kernel
def frame_series(plan, work, f, x, v, a, out):
    """out[k] = p_WF_W (3), R_WF (9), velocity (3), angular velocity (3), acceleration (3).

    The last three are those of the frame's origin or axes, in world axes.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        f: int64, row of Plan.frames.
        x: (nt, nx) float64, configurations.
        v: (nt, nv) float64, velocities.
        a: (nt, nv) float64, accelerations.
        out: (nt, 21) float64, output.
    """
    g = load3(plan.gravity, 0)
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v[k], a[k])
        p, R, velocity, spin, acceleration, _ = frame_motion(plan, work, f)
        row = out[k]
        store3(row, 0, p)
        store9(row, 3, R)
        store3(row, 12, rotate(R, velocity))
        store3(row, 15, rotate(R, spin))
        store3(row, 18, add3(rotate(R, acceleration), g))


@entry_kernel
def body_series(plan, work, x, v, a, out):
    """out[k, i] of the axes of link i as ``frame_series`` has it of a frame; all links in one pass.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nt, nx) float64, configurations.
        v: (nt, nv) float64, velocities.
        a: (nt, nv) float64, accelerations.
        out: (nt, links, 21) float64, output.
    """
    g = load3(plan.gravity, 0)
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v[k], a[k])
        for i in range(plan.tree.shape[0]):
            body = work.body[i]
            row = out[k, i]
            R = load9(body, at.B_R)
            store3(row, 0, load3(body, at.B_P))
            store9(row, 3, R)
            store3(row, 12, rotate(R, load3(body, at.B_V)))
            store3(row, 15, rotate(R, load3(body, at.B_W)))
            store3(row, 18, add3(rotate(R, load3(body, at.B_A)), g))


@kernel
def _kinetic_energy(plan, work, i, x, v, none, scratch):
    """Kinetic energy of body i, half of velocity times momentum; its work row holds its momentum afterwards."""
    row = work.body[i]
    velocity = load3(row, at.B_V)
    body_momentum(plan, work, i, x, v, none, row, scratch)
    kinetic = 0.5 * (dot3(velocity, load3(row, at.B_F)) + dot3(load3(row, at.B_W), load3(row, at.B_T)))
    tree = plan.tree[i]
    if tree[at.FLEX] >= 0:
        first = tree[at.MODAL_V]
        for j in range(first, first + plan.flex[tree[at.FLEX], at.N_MODES]):
            kinetic += 0.5 * v[j] * scratch[j]
    return kinetic


@kernel
def _moment_of_mass(plan, work, i, x):
    """First moment of mass (kg m) of body i about the inertial origin, in inertial axes."""
    row = work.body[i]
    about_origin = rotate(load9(row, at.B_R), first_moment_of(plan, i, x))
    return add3(scale3(plan.rigid[i, at.MASS], load3(row, at.B_P)), about_origin)


@entry_kernel
def energy_series(plan, work, x, v, none, scratch, out):
    """out[k] = kinetic, elastic, gravitational energy of the machine, and its springs' (J).

    ``none`` is (nv,) zeros, ``scratch`` (nv,).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nt, nx) float64, configurations.
        v: (nt, nv) float64, velocities.
        none: (nv,) float64, zeros.
        scratch: (nv,) float64.
        out: (nt, 4) float64, J, output.
    """
    g = load3(plan.gravity, 0)
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v[k], none)
        for i in range(plan.tree.shape[0]):
            out[k, 0] += _kinetic_energy(plan, work, i, x[k], v[k], none, scratch)
            tree = plan.tree[i]
            if tree[at.FLEX] >= 0:
                flex = plan.flex[tree[at.FLEX]]
                q = x[k][tree[at.MODAL_X] : tree[at.MODAL_X] + flex[at.N_MODES]]
                out[k, 1] += elastic_energy(plan, flex, q)
            out[k, 2] -= dot3(g, _moment_of_mass(plan, work, i, x[k]))
        out[k, 0] += shaft_energy(plan.shafts, v[k])
        if plan.elements.shape[0] > 0:
            out[k, 3] += elements_energy(plan, work, x[k])


@entry_kernel
def momentum_series(plan, work, x, v, none, scratch, out):
    """out[k] = first moment of mass (kg m), momentum (N s) and angular momentum (N m s) of the machine.

    All about the inertial origin, in inertial axes.  ``none`` is (nv,) zeros, ``scratch`` (nv,).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nt, nx) float64, configurations.
        v: (nt, nv) float64, velocities.
        none: (nv,) float64, zeros.
        scratch: (nv,) float64.
        out: (nt, 9) float64, output.
    """
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v[k], none)
        moment, linear, angular = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for i in range(plan.tree.shape[0]):
            moment = add3(moment, _moment_of_mass(plan, work, i, x[k]))
            row = work.body[i]
            body_momentum(plan, work, i, x[k], v[k], none, row, scratch)
            R = load9(row, at.B_R)
            l_W = rotate(R, load3(row, at.B_F))
            linear = add3(linear, l_W)
            angular = add3(angular, add3(rotate(R, load3(row, at.B_T)), cross3(load3(row, at.B_P), l_W)))
            tree = plan.tree[i]
            if tree[at.FLEX] >= 0 and plan.flex[tree[at.FLEX], at.GYROSCOPIC] >= 0:
                flex = plan.flex[tree[at.FLEX]]
                q = x[k][tree[at.MODAL_X] : tree[at.MODAL_X] + flex[at.N_MODES]]
                angular = add3(angular, rotate(R, rotor_momentum(plan.modal, flex, q)))
        store3(out[k], 0, moment)
        store3(out[k], 3, linear)
        store3(out[k], 6, angular)


@entry_kernel
def force_series(plan, work, t, x, v, a, multipliers, out):
    """out[k] = generalised forces that the motion requires beyond the loops' reactions.

    ``plan.forces`` must be empty: what remains is what applied and driving forces supply.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        t: (nt,) float64, s.
        x: (nt, nx) float64, configurations.
        v: (nt, nv) float64, velocities.
        a: (nt, nv) float64, accelerations.
        multipliers: (nt, m) float64, N or N m, of the constraint rows.
        out: (nt, nv) float64, output.
    """
    for k in range(x.shape[0]):
        if plan.times.shape[0] > 0:
            evaluate_times(plan, t[k], work.time)
        residual(plan, work, x[k], v[k], a[k], multipliers[k], out[k])


@entry_kernel
def row_residuals(plan, work, t, x, rest, scratch, out):
    """out (nt, rows), m or rad: the residual of each row, its magnitude, at each configuration x (nt, nx) at t (nt,).

    ``rest`` is (nv,) zeros, ``scratch`` (3, rows).

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        t: (nt,) float64, s.
        x: (nt, nx) float64, configurations.
        rest: (nv,) float64, zeros.
        scratch: (3, rows) float64.
        out: (nt, rows) float64, output.
    """
    timed = False
    for i in range(plan.rows.shape[0]):
        timed = timed or plan.rows[i, at.ROW_TIME] >= 0
    for k in range(x.shape[0]):
        if timed:
            evaluate_times(plan, t[k], work.time)
        forward_kinematics(plan, work, x[k], rest, rest)
        constraints(plan, work, scratch[0], scratch[1], scratch[2])
        for i in range(scratch.shape[1]):
            out[k, i] = abs(scratch[0, i])


@entry_kernel
def constraint_rates(plan, work, x, velocities, rest, scratch, out):
    """out (nt, k, m): rates of the rows by each of the velocities (k, nv), at each configuration x (nt, nx).

    ``rest`` is (nv,) zeros, ``scratch`` (4, m).  What prescribed motions add is left out.

    Args:
        plan: Plan, the compiled scene.
        work: Work, its work arrays.
        x: (nt, nx) float64, configurations.
        velocities: (k, nv) float64.
        rest: (nv,) float64, zeros.
        scratch: (4, m) float64.
        out: (nt, k, m) float64, output.
    """
    for n in range(x.shape[0]):
        forward_kinematics(plan, work, x[n], rest, rest)
        constraints(plan, work, scratch[0], scratch[3], scratch[2])  # rates of prescribed rows
        for k in range(velocities.shape[0]):
            forward_kinematics(plan, work, x[n], velocities[k], rest)
            constraints(plan, work, scratch[0], scratch[1], scratch[2])
            for i in range(out.shape[2]):
                out[n, k, i] = scratch[1, i] - scratch[3, i]
