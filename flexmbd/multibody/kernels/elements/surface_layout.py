"""Where the numbers of an elastic surface that touches stand, in ``Plan.data`` and in the scratch space.

Of an element: the place of its surface's table; the numbers of the shape that it touches, and the radius of a sphere
that is its only point, else 0; the coefficient of friction; the place of the table of the other surface, which has that
shape undeformed, or -1; k and p of a law N = k delta^p of one point, in series with the flexibility, or 0.

Of a table: how many patches p and modes n; a ball about the centroids, its centre (3) and radius (m); how far around it
(m) a patch is felt by what touches between the patches; the largest displacement of a patch by each mode (n); centroids
(p, 3); mean displacements by the modes (p, 3, n); residual flexibility (p, p, 3, 3): all in the body's axes.

``work.generalized`` holds vectors of the p patches, of which those after FAR are of the m that are near: their numbers,
forces, gaps under these, ways through the complementarity; rows of the points (the columns below); the matrices C, L;
the weights of the other surface's patches for each, and rows of these; then B and K, for the tangent, and the forces on
the modes, first of the surface, then of the other; last what friction needs.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel

TABLE, SHAPE, POINT_RADIUS, FRICTION, OTHER, LAW, EXPONENT = 0, 1, 5, 6, 7, 8, 9
N_PATCH, N_MODE, CENTRE, RADIUS, SUPPORT, MOST = 0, 1, 2, 5, 6, 7

#: Columns of the row of a point, (3) each, in F's axes but those that begin with OWN, which are in the body's: the
#: normal; the centroid from the body's origin; where it is for the undeformed shape; what the residual flexibility adds
#: by itself, and against the other surface; along what a unit of its normal force pushes the other surface, and the
#: body, see ``surface_forces``; its force, and what that is for the two.
NORMAL, OWN_NORMAL, PLACE, FOOT, OWN_RESIDUAL, APART, PUSH, PULL, FORCED, OWN_FORCE, PUSHED, PULLED, N_POINT = range(
    0, 39, 3
)
#: Vectors of the scratch space, (p,) each.
FAR, PATCH, FORCE, LEFT, INSIDE, ORDER, GAP, N_VECTOR = range(8)
#: Columns of the row of a patch of the other surface, (3) each: how the modes move it, how the residual flexibility;
#: the force on it, or, while C is written, how a unit force on a point moves it.
MODAL, DENT, LOAD, N_OTHER = 0, 3, 6, 9


def surface_scratch(p: int, n: int, p_other: int, n_other: int) -> int:
    """How many numbers of ``work.generalized`` a surface needs, of p patches and n modes, and what it touches."""
    size = 6 + n + n_other
    return (N_VECTOR + N_POINT) * p + 2 * p * p + (p + N_OTHER) * p_other + p * size + size**2 + n + n_other


@kernel
def table_of(plan, row):
    """The place of a surface's table, its number of patches and of modes."""
    t = int(plan.data[row[at.EL_DATA] + TABLE])
    return t, int(plan.data[t + N_PATCH]), int(plan.data[t + N_MODE])


@kernel
def other_of(plan, row):
    """The same of the other surface; 0 patches where it touches a rigid shape."""
    t = int(plan.data[row[at.EL_DATA] + OTHER])
    if t < 0:
        return t, 0, 0
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
def weights_place(p):
    """Where the weights (p, p_other) begin."""
    return (N_VECTOR + N_POINT + 2 * p) * p


@kernel
def others_place(p, p_other):
    """Where the rows of the other surface's patches (p_other, N_OTHER) begin."""
    return (N_VECTOR + N_POINT + 2 * p + p_other) * p


@kernel
def rows_place(p, p_other):
    """Where B begins, of m patches that touch (m, 6 + modes)."""
    return (N_VECTOR + N_POINT + 2 * p + p_other) * p + N_OTHER * p_other


@kernel
def stiffness_place(p, p_other, size):
    """Where K (size, size) begins, size = 6 + modes."""
    return rows_place(p, p_other) + p * size


@kernel
def modal_place(p, p_other, size):
    """Where the forces on the modes (size - 6,) begin."""
    return rows_place(p, p_other) + p * size + size**2


@kernel
def rough_place(p, p_other, size):
    """Where what friction needs begins, see ``surface_friction``."""
    return modal_place(p, p_other, size) + size - 6
