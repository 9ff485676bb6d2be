"""What the patches of an elastic surface do at each row of a trajectory: gaps, forces, and where."""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.so3 import add3, dot3, load3, rotate, rotate_back, scale3, store3
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.block_view import matrix_view
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact.signed_distance import distance
from flexmbd.multibody.kernels.elements import surface_layout as sl
from flexmbd.multibody.kernels.elements.surface_forces import displaced, press_patches, times_matrix
from flexmbd.multibody.kernels.elements.table import is_of_surface
from flexmbd.multibody.kernels.inverse_dynamics.closure import relative_rates
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics, frame_motion
from flexmbd.multibody.kernels.inverse_dynamics.surface_loads import modes_of

# Columns: the gap, the normal, the force on the patch, its place: vectors in inertial axes.
GAP, NORMAL, FORCE, POINT, N_PATCH = 0, 1, 4, 7, 10


@entry_kernel
def surface_series(plan, work, i, x, v, a, out):
    """out[k, j] of patch j of the surface in row i of ``plan.elements`` at x[k], v[k]; out (nt, p, N_PATCH)."""
    row = plan.elements[i]
    f, g = row[at.EL_F], row[at.EL_G]
    qx, _, n = modes_of(plan, row)
    t, p, _ = sl.table_of(plan, row)
    o = row[at.EL_DATA] + sl.SHAPE
    V = matrix_view(work.generalized, 0, sl.N_VECTOR, p)
    for k in range(x.shape[0]):
        forward_kinematics(plan, work, x[k], v[k], a[k])
        d, R, _, _ = relative_rates(plan, work, f, g)
        q = x[k, qx : qx + n]
        _, count, _ = press_patches(plan, work, row, d, R, q)
        p_F, R_F, _, _, _, _ = frame_motion(plan, work, f)
        for j in range(p):
            place = add3(d, rotate(R, displaced(plan.data, p, n, t, j, q)))
            gap, normal = distance(plan.data, o, place)
            u, own = (0.0, 0.0, 0.0), rotate_back(R, normal)
            for b in range(count):
                c = int(V[sl.ORDER, b])
                _, n_c = distance(plan.data, o, add3(d, rotate(R, displaced(plan.data, p, n, t, int(V[sl.PATCH, c]), q))))
                G = sl.flexibility(p, n, t, j, int(V[sl.PATCH, c]))
                u = add3(u, scale3(V[sl.FORCE, c], times_matrix(plan.data, G, rotate_back(R, n_c))))
            out[k, j, GAP] = gap + dot3(own, u)
            store3(out[k, j], NORMAL, rotate(R_F, normal))
            store3(out[k, j], FORCE, (0.0, 0.0, 0.0))
            store3(out[k, j], POINT, add3(p_F, rotate(R_F, add3(place, rotate(R, u)))))
        for b in range(count):
            c = int(V[sl.ORDER, b])
            j = int(V[sl.PATCH, c])
            out[k, j, GAP] = 0.0
            store3(out[k, j], FORCE, scale3(V[sl.FORCE, c], load3(out[k, j], NORMAL)))


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
            _, _, out[k] = press_patches(plan, work, row, d, R, x[qx : qx + n])
            k += 1
