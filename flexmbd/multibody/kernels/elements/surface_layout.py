"""Where the numbers of an elastic surface that touches stand, in ``Plan.data`` and in the scratch space.

Of an element: the place of its surface's table; the numbers of the shape that it touches, and the radius of a sphere
that is its only point, else 0; the coefficient of friction; the place of the table of the other surface, which has that
shape undeformed, or -1; k and p of a law N = k delta^p of one point, in series with the flexibility, or 0; where the
group begins with which it gives way (``surface_groups``), or -1, and its number there.

Of a table: how many patches p and modes n; a ball about the centroids, its centre (3) and radius (m); the largest
displacement of a patch by each mode (n); then rows of P = `padded` p numbers, zeros beyond p: centroids (3, P); how far
around them a patch is felt by what touches between the patches, as a form r . M r < 1 (6, P): xx, xy, xz, yy, yz, zz
(1/m^2); mean displacements by the modes (3, n, P); residual flexibility (3, 3, p, P): all in the body's axes.

``work.generalized`` holds vectors of P numbers: FAR of the patches, the others of the m slots of those that are near:
their numbers, forces, gaps under these, ways through the complementarity, vectors in the body's axes; rows of the
points (the columns below); the matrices C, U; the weights of the other surface's patches for each, and vectors of
these; then B and K, for the tangent, and the forces on the modes, first of the surface, then of the other; last what
friction needs.  Slots come by eights of patches that follow each other; of those that are not near the gap is infinite.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.lanes import padded, padded_size

TABLE, SHAPE, POINT_RADIUS, FRICTION, OTHER, LAW, EXPONENT, GROUP, MEMBER = 0, 1, 5, 6, 7, 8, 9, 10, 11
N_PATCH, N_MODE, CENTRE, RADIUS, MOST = 0, 1, 2, 5, 6
N_FORM = 6

#: Columns of the row of a point, (3) each, in F's axes but the residual, which is in the body's: the normal; the
#: centroid from the body's origin; where it is for the undeformed shape; what the residual flexibility adds by itself,
#: and against the other surface; along what a unit of its normal force pushes the other surface, and the body, see
#: ``surface_forces``; its force, and what that is for the two.
NORMAL, PLACE, FOOT, OWN_RESIDUAL, APART, PUSH, PULL, FORCED, PUSHED, PULLED, N_POINT = range(0, 33, 3)
#: Vectors of the scratch space, (P,) each; then (3, P) in the body's axes: normals, centroids, forces, what pulls the
#: body; and by rows (9, P) what the couple of all residuals changes by for a unit of force, see ``surface_stiffness``.
FAR, PATCH, FORCE, LEFT, INSIDE, ORDER, GAP = range(7)
OWN_NORMAL, OWN_PLACE, OWN_FORCE, OWN_PULLED, COUPLE, N_VECTOR = 7, 10, 13, 16, 19, 28
#: Vectors of the other surface's patches, (3, P) each: how the modes move them, how the residual flexibility; the
#: forces on them, or, while C is written, how a unit force on a point moves them.
MODAL, DENT, LOAD, N_OTHER = 0, 3, 6, 9


def surface_scratch(p: int, n: int, p_other: int, n_other: int) -> int:
    """How many numbers of ``work.generalized`` a surface needs, of p patches and n modes, and what it touches."""
    size, P, P_other = 6 + n + n_other, padded_size(p), padded_size(p_other)
    of_points = (N_VECTOR + N_POINT + 2 * P + P_other + padded_size(size)) * P
    return of_points + N_OTHER * P_other + padded_size(size) ** 2 + size - 6


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
def centroids(n, t):
    """The place of the centroids (3, P) in ``Plan.data``."""
    return t + MOST + n


@kernel
def centroid(data, p, n, t, i):
    """Patch i's centroid (m)."""
    o, P = centroids(n, t) + i, padded(p)
    return data[o], data[o + P], data[o + 2 * P]


@kernel
def forms(p, n, t):
    """The place of the forms (6, P)."""
    return centroids(n, t) + 3 * padded(p)


@kernel
def displacements(p, n, t):
    """The place of the displacements by the modes (3, n, P)."""
    return forms(p, n, t) + N_FORM * padded(p)


@kernel
def flexibility(p, n, t, i, j):
    """The place of the flexibility of patch i under forces on patch j; its rows are `apart` there and there."""
    return displacements(p, n, t) + 3 * n * padded(p) + padded(p) * i + j


@kernel
def apart(p):
    """How far from each other the nine numbers of a flexibility stand, row by row."""
    return p * padded(p)


@kernel
def at3(vectors, first, k):
    """Vector k of those (3, P) that begin with a row."""
    return vectors[first, k], vectors[first + 1, k], vectors[first + 2, k]


@kernel
def put3(vectors, first, k, v):
    """Write it."""
    vectors[first, k], vectors[first + 1, k], vectors[first + 2, k] = v


@kernel
def points_place(p):
    """Where the rows of the points (P, N_POINT) begin in the scratch space."""
    return N_VECTOR * padded(p)


@kernel
def matrix_place(p, which):
    """Where C (0), of m slots (m, m), or U (1), see ``complementarity``, begins in the scratch space."""
    P = padded(p)
    return (N_VECTOR + N_POINT + which * P) * P


@kernel
def weights_place(p):
    """Where the weights (P, padded p_other) begin."""
    return matrix_place(p, 2)


@kernel
def others_place(p, p_other):
    """Where the vectors of the other surface's patches (N_OTHER, padded p_other) begin."""
    return matrix_place(p, 2) + padded(p) * padded(p_other)


@kernel
def rows_place(p, p_other):
    """Where B begins, of patches that touch, (P, padded size), size = 6 + modes."""
    return others_place(p, p_other) + N_OTHER * padded(p_other)


@kernel
def stiffness_place(p, p_other, size):
    """Where K (padded size, padded size), of which ``size`` rows and columns count, begins."""
    return rows_place(p, p_other) + padded(p) * padded(size)


@kernel
def modal_place(p, p_other, size):
    """Where the forces on the modes (size - 6,) begin."""
    return stiffness_place(p, p_other, size) + padded(size) * padded(size)


@kernel
def rough_place(p, p_other, size):
    """Where what friction needs begins, see ``surface_friction``."""
    return modal_place(p, p_other, size) + size - 6
