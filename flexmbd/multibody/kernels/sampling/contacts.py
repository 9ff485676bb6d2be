"""What a contact does at each row of a trajectory: its gap, its force, how it slides, and where."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import (
    add3,
    cross3,
    dot3,
    load3,
    rotate,
    rotate_back,
    scale3,
    store3,
    sub3,
)
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact.contact_law import way_to_middle
from flexmbd.multibody.kernels.contact.normal_force import RADIUS
from flexmbd.multibody.kernels.contact.signed_distance import distance
from flexmbd.multibody.kernels.elements.contact_wrench import centre_motion, law_numbers
from flexmbd.multibody.kernels.elements.table import element_wrench
from flexmbd.multibody.kernels.impulses.touching import nearest_point, relative_velocity
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import (
    forward_kinematics,
    frame_motion,
    load_frame,
    propagate_wrench,
)

# Columns: the gap, the normal, the force on the sphere, its sliding velocity, the point: all in inertial axes.
GAP, NORMAL, FORCE, SLIDING, POINT, N_CONTACT = 0, 1, 4, 7, 10, 13


@entry_kernel
def contact_series(plan, work, i, t, x, v, a, out):
    """out[k] of the contact in row i of ``plan.elements`` at t[k] (s), x[k], v[k]; out (nt, N_CONTACT)."""
    row = plan.elements[i]
    f, g = row[at.EL_F], row[at.EL_G]
    o = law_numbers(plan, row)
    for k in range(x.shape[0]):
        work.time[plan.times.shape[0], 0] = t[k]
        forward_kinematics(plan, work, x[k], v[k], a[k])
        d, R, rate, spin = relative_rates(plan, work, f, g)
        force, _ = element_wrench(plan, work, row, d, R, rate, spin)
        _, place, speed = centre_motion(plan, o, d, R, rate, spin)
        gap, n = distance(plan.data, o, place)
        arm = scale3(-plan.data[o + RADIUS], n)
        sliding = add3(speed, cross3(spin, arm))
        sliding = sub3(sliding, scale3(dot3(n, sliding), n))
        p, R_F, _, _, _, _ = frame_motion(plan, work, f)
        out[k, GAP] = gap - plan.data[o + RADIUS]
        store3(out[k], NORMAL, rotate(R_F, n))
        store3(out[k], FORCE, rotate(R_F, force))
        store3(out[k], SLIDING, rotate(R_F, sliding))
        store3(out[k], POINT, add3(p, rotate(R_F, add3(place, arm))))


@entry_kernel
def depth_series(plan, work, elements, x, v, out):
    """out[k, j] (nt, n): how far contact ``elements[j]`` is pressed in at x[k], over the way to the shape's middle.

    0 where it does not touch, and of shapes without a middle; v (nv,): any velocities.
    """
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v, v)
        for j in range(elements.shape[0]):
            row = plan.elements[elements[j]]
            o = law_numbers(plan, row)
            d, R, rate, spin = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            _, place, _ = centre_motion(plan, o, d, R, rate, spin)
            depth = plan.data[o + RADIUS] - distance(plan.data, o, place)[0]
            way = way_to_middle(plan.data, o)
            out[k, j] = depth / way if depth > 0.0 else 0.0


@entry_kernel
def hard_contact_series(plan, work, i, x, v, a, out):
    """As ``contact_series`` of a hard contact in row i; its FORCE is left to who solved for it."""
    row = plan.elements[i]
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v[k], a[k])
        point, normal, gap = nearest_point(plan, work, row)
        slip = relative_velocity(plan, work, row[at.EL_F], row[at.EL_G], point)
        out[k, GAP] = gap
        store3(out[k], NORMAL, normal)
        store3(out[k], SLIDING, sub3(slip, scale3(dot3(normal, slip), normal)))
        store3(out[k], POINT, point)


@entry_kernel
def add_point_loads(plan, work, x, rows, frames, points, forces, scratch, rest, out):
    """Add the generalised forces of forces[i] (N, inertial axes) at points[i] (m) on row frames[i] of ``plan.frames``.

    To out[rows[i]] (nv,), at x[rows[i]]; ``scratch`` (nv,) is written to, ``rest`` (nv,) zeros.
    """
    for i in range(rows.shape[0]):
        f, r = frames[i], rows[i]
        forward_kinematics(plan, work, x[r], rest, rest)
        for k in range(scratch.shape[0]):
            scratch[k] = 0.0
        for b in range(plan.tree.shape[0]):
            store3(work.body[b], at.B_F, (0.0, 0.0, 0.0))
            store3(work.body[b], at.B_T, (0.0, 0.0, 0.0))
        p, R, _, _, _, _ = frame_motion(plan, work, f)
        force, arm = load3(forces[i], 0), sub3(load3(points[i], 0), p)
        load_frame(plan, work, f, rotate_back(R, force), rotate_back(R, cross3(arm, force)), scratch)
        for b in range(plan.tree.shape[0] - 1, -1, -1):
            propagate_wrench(plan, work, b, scratch)
        for k in range(scratch.shape[0]):
            out[r, k] += scratch[k]
