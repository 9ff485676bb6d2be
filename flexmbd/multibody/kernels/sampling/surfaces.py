"""What the patches of an elastic surface do at each row of a trajectory: gaps, forces, and where."""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, rotate, scale3, store3, sub3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import entry_kernel, kernel
from flexmbd.multibody.kernels.base.lanes import padded
from flexmbd.multibody.kernels.contact.contact_law import way_to_middle
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import find_gaps, point_depth, press_patches
from flexmbd.multibody.kernels.elements.surface_groups import group_of, residual_in_group
from flexmbd.multibody.kernels.elements.surface_points import displacement, mean_of, move_others, place_point
from flexmbd.multibody.kernels.elements.surface_residual import clear_others, own_residual
from flexmbd.multibody.kernels.elements.table import is_of_surface
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.pressed_surfaces import (
    APART,
    member_forces,
    modes_of,
    other_modes_of,
    press_group,
    role,
)
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics, frame_motion

# Columns: the gap, the normal, the force on the patch, its place: vectors in inertial axes.
GAP, NORMAL, FORCE, POINT, N_PATCH = 0, 1, 4, 7, 10


@kernel
def _press(plan, work, row, d, R, x, q, q_other):
    """On how many slots there are near patches, how many touch, and whether they give way with those of others."""
    if role(plan, row) == 0 or press_group(plan, work, group_of(plan, row), x) == APART:
        m, count, _ = press_patches(plan, work, row, d, R, q, q_other)
        return m, count, False
    m, count, _ = member_forces(plan, work, row, d, R, x)
    return m, count, True


@entry_kernel
def surface_series(plan, work, i, x, v, a, w, out, others_force):
    """out[k, j] of patch j of the surface in row i of ``plan.elements`` at x[k], v[k]; out (nt, p, N_PATCH).

    ``w``: scratch, `padded_size` of the patches of the other surface.  ``others_force`` (nt, p_other), zeros: the
    normal forces on these, by the weights with which they feel the patches (N).
    """
    row = plan.elements[i]
    f, g = row[at.EL_F], row[at.EL_G]
    qx, _, n = modes_of(plan, row)
    rx, _, n_other = other_modes_of(plan, row)
    t, p, _ = sl.table_of(plan, row)
    _, size, _ = sl.other_of(plan, row)
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
    points = matrix_view(work.generalized, sl.points_place(p), padded(p), sl.N_POINT)
    others = matrix_view(work.generalized, sl.others_place(p, size), sl.N_OTHER, padded(size))
    weights = matrix_view(work.generalized, sl.weights_place(p), padded(p), padded(size))
    group = group_of(plan, row)
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v[k], a[k])
        d, R, _, _ = relative_rates(plan, work, f, g)
        q, q_other = x[k, qx : qx + n], x[k, rx : rx + n_other]
        m, count, in_group = _press(plan, work, row, d, R, x[k], q, q_other)
        if count == 0 and not in_group:
            clear_others(others, sl.DENT)
        move_others(plan, work, row, q_other)
        p_F, R_F, _, _, _, _ = frame_motion(plan, work, f)
        for j in range(p):
            arm = add3(sl.centroid(plan.data, p, n, t, j), displacement(plan.data, p, n, t, j, q))
            arm = rotate(R, arm)
            gap, normal, _ = place_point(plan, row, d, arm, w, others)
            u = residual_in_group(plan, work, row, group, j) if in_group else own_residual(plan, work, row, j, m)
            u = rotate(R, u)
            apart = sub3(u, mean_of(others, sl.DENT, w)) if gap < math.inf else u
            out[k, j, GAP] = gap + dot3(normal, apart)
            store3(out[k, j], NORMAL, rotate(R_F, normal))
            store3(out[k, j], FORCE, (0.0, 0.0, 0.0))
            touching = sub3(add3(add3(d, arm), u), scale3(plan.data[row[at.EL_DATA] + sl.POINT_RADIUS], normal))
            store3(out[k, j], POINT, add3(p_F, rotate(R_F, touching)))
        for b in range(count):
            c = int(V[sl.ORDER, b])
            j = int(V[sl.PATCH, c])
            out[k, j, GAP] = 0.0
            if plan.data[row[at.EL_DATA] + sl.LAW] > 0.0:
                out[k, j, GAP] = -point_depth(plan, row, V[sl.FORCE, c])[0]
            pull = rotate(R_F, load3(points[c], sl.PULL))
            store3(out[k, j], NORMAL, scale3(1.0 / math.sqrt(dot3(pull, pull)), pull))
            store3(out[k, j], FORCE, rotate(R_F, load3(points[c], sl.PULLED)))
            pressed = dot3(load3(out[k, j], NORMAL), load3(out[k, j], FORCE))
            for e in range(size):
                others_force[k, e] += weights[c, e] * pressed


@entry_kernel
def surface_depth_series(plan, work, elements, x, v, out):
    """out[k, j] (nt, n): how far surface ``elements[j]`` is pressed in at x[k], over the way to the shape's middle.

    Of its deepest patch, as the modes move it; otherwise as ``depth_series``.
    """
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v, v)
        for e in range(elements.shape[0]):
            row = plan.elements[elements[e]]
            qx, _, n = modes_of(plan, row)
            rx, _, n_other = other_modes_of(plan, row)
            _, p, _ = sl.table_of(plan, row)
            V = matrix_view(work.generalized, 0, sl.N_VECTOR, padded(p))
            d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            m, _, _ = find_gaps(plan, work, row, d, R, x[k, qx : qx + n], x[k, rx : rx + n_other], 0.0)
            deepest = 0.0
            for j in range(m):
                deepest = max(deepest, -V[sl.GAP, j])
            out[k, e] = deepest / way_to_middle(plan.data, row[at.EL_DATA] + sl.SHAPE)


@entry_kernel
def surface_overlaps(plan, work, x, v, out):
    """out (k,): the least gap (m) of the undeformed patches of each elastic surface at x, less the modes' reach."""
    forward_kinematics(plan, work, x, v, v)
    k = 0
    for i in range(plan.elements.shape[0]):
        row = plan.elements[i]
        if is_of_surface(row[at.EL_KIND]):
            qx, _, n = modes_of(plan, row)
            d, R, _, _ = relative_rates(plan, work, row[at.EL_F], row[at.EL_G])
            rx, _, n_other = other_modes_of(plan, row)
            _, _, out[k] = find_gaps(plan, work, row, d, R, x[qx : qx + n], x[rx : rx + n_other], 0.0)
            k += 1
