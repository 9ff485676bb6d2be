"""Where the numbers of an elastic surface that touches a shape stand, in ``Plan.data`` and in the scratch space.

Of an element: the place of its surface's table; the shape's numbers, and 0, the radius of a point; the coefficient of
friction.  Of a table: how many patches p and modes n; a ball about the centroids, its centre (3) and radius (m); the
largest displacement of a patch by each mode (n); centroids (p, 3); mean displacements by the modes (p, 3, n); residual
flexibility (p, p, 3, 3); areas (p): all in the body's axes.

``work.generalized`` holds of each patch the distance undeformed, then of the m that are near: their numbers, forces,
gaps under these, ways through the complementarity, and rows of the point (its columns below), and the matrices C, L;
for the tangent then B (m, 6 + n) and K (6 + n, 6 + n); last the forces on the modes (n).
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel

TABLE, SHAPE, FRICTION, N_SURFACE = 0, 1, 6, 7
N_PATCH, N_MODE, CENTRE, RADIUS, MOST = 0, 1, 2, 5, 6

#: Columns of the row of a point: the normal out of the shape and the centroid, in F's axes, less d; the normal and the
#: residual displacement in the body's; the direction of its force, see ``surface_forces``.
NORMAL, PLACE, OWN_NORMAL, RESIDUAL, DIRECTION, N_POINT = 0, 3, 6, 9, 12, 15
#: Vectors of the scratch space, (p,) each.
FAR, PATCH, FORCE, LEFT, INSIDE, ORDER, GAP, N_VECTOR = range(8)


def surface_scratch(p: int, n: int) -> int:
    """How many numbers of ``work.generalized`` a surface of p patches needs with n modes."""
    return (N_VECTOR + N_POINT) * p + 2 * p * p + p * (6 + n) + (6 + n) ** 2 + n


@kernel
def table_of(plan, row):
    """The place of a surface's table, its number of patches and of modes."""
    t = int(plan.data[row[at.EL_DATA] + TABLE])
    return t, int(plan.data[t + N_PATCH]), int(plan.data[t + N_MODE])


@kernel
def centroid(p, n, t, i):
    """The place of patch i's centroid in ``Plan.data``."""
    return t + MOST + n + 3 * i


@kernel
def displacements(p, n, t, i):
    """The place of patch i's displacements by the modes (3, n)."""
    return t + MOST + n + 3 * p + 3 * n * i


@kernel
def flexibility(p, n, t, i, j):
    """The place of the flexibility (3, 3) of patch i under forces on patch j."""
    return t + MOST + n + 3 * p + 3 * p * n + 9 * (p * i + j)


@kernel
def points_place(p):
    """Where the rows of the points (p, N_POINT) begin in the scratch space."""
    return N_VECTOR * p


@kernel
def matrix_place(p, which):
    """Where C (0) or L (1) begins, of m near patches (m, m)."""
    return (N_VECTOR + N_POINT + which * p) * p


@kernel
def rows_place(p):
    """Where B begins, of m patches that touch (m, 6 + n)."""
    return (N_VECTOR + N_POINT + 2 * p) * p


@kernel
def stiffness_place(p, n):
    """Where K (6 + n, 6 + n) begins."""
    return (N_VECTOR + N_POINT + 2 * p) * p + p * (6 + n)


@kernel
def modal_place(p, n):
    """Where the forces on the modes (n,) begin."""
    return (N_VECTOR + N_POINT + 2 * p) * p + p * (6 + n) + (6 + n) ** 2
