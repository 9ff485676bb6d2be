"""Children on the deforming frames of a reduced body, in the articulated-body recursion.

At its frame's acceleration a, a child requires f = I a + p, its articulated inertia I times a and its bias force p; f
changes the frame's acceleration by -Gamma Gamma^T f, the rows of Gamma being the frame's motion per unit of each mode.
With I = L L^T, where the free direction of a hinge leaves a column of zeros,

    f = p + L S^-1 L^T (a_0 - Gamma Gamma^T p),    S = 1 + L^T Gamma Gamma^T L,

a_0 the acceleration without the wrenches: S, six rows a child, is symmetric with eigenvalues of at least one, and is
all that is factored (Woodbury's identity).  Rotation rows of the modes give rates of the frame's rotation vector theta,
of which J_l(theta) makes angular velocities; so Gamma = J Gamma_0 with Gamma_0 constant, and K = J^T L takes the place
of L.  On a face that turns by finite angles Gamma itself changes with the modes, and J is the identity.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.algebra.so3 import add3, cross3, load3, load9, rotate_back, store3
from flexmbd.multibody.kernels.algebra.spatial import add6, load6, scale6, store6, subtract_outer
from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.forward_dynamics import articulated_layout as to
from flexmbd.multibody.kernels.forward_dynamics.modes import three_sums
from flexmbd.multibody.kernels.physics.frame_modes import modal_sum
from flexmbd.multibody.kernels.physics.modal_moments import COUPLING

# A pivot below this share of the inertia's size before its joint was eliminated is the joint's free direction.
_FREE_PIVOT = 1e-13


@kernel
def interface_modes(aw, slot):
    """Offset of an interface's mode rows in ArticulatedWork.interface_rows."""
    return 6 * aw.bias.shape[1] * slot


@kernel
def _factor_inertia(row, rest, root):
    """Write L (6, 6) of the child's inertia I = L L^T, its largest pivots first; ``rest`` (6, 6) is overwritten.

    With this order the error of leaving out the pivots of free directions is as small as they are.
    """
    _unpack_inertia(row, rest)
    angular = 1.0 / max(row[to.I_SCALE], 1e-300)
    linear = 1.0 / max(row[to.I_SCALE + 1], 1e-300)
    for k in range(6):
        p = 0
        largest = 0.0
        for i in range(6):
            share = rest[i, i] * (angular if i < 3 else linear)
            if share > largest:
                largest = share
                p = i
        over = 1.0 / math.sqrt(rest[p, p]) if largest > _FREE_PIVOT else 0.0
        column = scale6(over, load6(rest[p], 0))
        for i in range(6):
            root[i, k] = over * rest[p, i]
        for i in range(6):
            t = root[i, k]
            rest[i, 0] -= t * column[0]
            rest[i, 1] -= t * column[1]
            rest[i, 2] -= t * column[2]
            rest[i, 3] -= t * column[3]
            rest[i, 4] -= t * column[4]
            rest[i, 5] -= t * column[5]
        rest[p, p] = 0.0


@kernel
def _unpack_inertia(row, out):
    """Write the child's inertia (6, 6)."""
    a, b, m = load6(row, to.I_A), load9(row, to.I_B), load6(row, to.I_M)
    store6(out[0], 0, (a[0], a[1], a[2], b[0], b[1], b[2]))
    store6(out[1], 0, (a[1], a[3], a[4], b[3], b[4], b[5]))
    store6(out[2], 0, (a[2], a[4], a[5], b[6], b[7], b[8]))
    store6(out[3], 0, (b[0], b[3], b[6], m[0], m[1], m[2]))
    store6(out[4], 0, (b[1], b[4], b[7], m[1], m[3], m[4]))
    store6(out[5], 0, (b[2], b[5], b[8], m[2], m[4], m[5]))


@kernel
def _turn_factor(turning, root, turned):
    """Write K = J^T L (6, 6)."""
    for j in range(6):
        angular = rotate_back(turning, (root[0, j], root[1, j], root[2, j]))
        turned[0, j] = angular[0]
        turned[1, j] = angular[1]
        turned[2, j] = angular[2]
        turned[3, j] = root[3, j]
        turned[4, j] = root[4, j]
        turned[5, j] = root[5, j]


@kernel
def _put_mobility(mobility, left, right, schur, s, r):
    """Write block (s, r) of K^T Gamma_0 Gamma_0^T K; ``left`` and ``right`` are K of both interfaces."""
    for j in range(6):
        x0, x1, x2 = right[0, j], right[1, j], right[2, j]
        x3, x4, x5 = right[3, j], right[4, j], right[5, j]
        t0 = t1 = t2 = t3 = t4 = t5 = 0.0
        for i in range(6):
            g = load6(mobility[s + i], r)
            t = g[0] * x0 + g[1] * x1 + g[2] * x2 + g[3] * x3 + g[4] * x4 + g[5] * x5
            t0 += left[i, 0] * t
            t1 += left[i, 1] * t
            t2 += left[i, 2] * t
            t3 += left[i, 3] * t
            t4 += left[i, 4] * t
            t5 += left[i, 5] * t
        schur[s, r + j] = t0
        schur[s + 1, r + j] = t1
        schur[s + 2, r + j] = t2
        schur[s + 3, r + j] = t3
        schur[s + 4, r + j] = t4
        schur[s + 5, r + j] = t5


@kernel
def _factor(schur, size):
    """Replace S - 1, of which the lower triangle counts, by factors of S = U D U^T: U below, 1 / D on the diagonal."""
    for j in range(size):
        pivot = 1.0 + schur[j, j]
        for k in range(j):
            schur[k, j] = schur[j, k] / schur[k, k]  # D U^T above the diagonal
            pivot -= schur[j, k] * schur[k, j]
        over = 1.0 / pivot
        schur[j, j] = over
        for i in range(j + 1, size):
            t = schur[i, j]
            for k in range(j):
                t -= schur[i, k] * schur[k, j]
            schur[i, j] = over * t


@kernel
def _put_response(place, root, turned, coupled, response):
    """Write L^T Y (6, 6): Y y is the frame's acceleration at the acceleration y of B, without wrenches on it."""
    for j in range(6):
        force = (root[3, j], root[4, j], root[5, j])
        t0, t1, t2 = add3((root[0, j], root[1, j], root[2, j]), cross3(place, force))
        t3, t4, t5 = force
        for i in range(6):
            share = turned[i, j]
            c = load6(coupled[i], 0)
            t0 -= share * c[0]
            t1 -= share * c[1]
            t2 -= share * c[2]
            t3 -= share * c[3]
            t4 -= share * c[4]
            t5 -= share * c[5]
        store6(response[j], 0, (t0, t1, t2, t3, t4, t5))


@kernel
def _add_response(response, schur, size, a, b, m):
    """Replace L^T Y by Z = U^-1 L^T Y; return the inertia (a, b, m) with Z^T D^-1 Z."""
    for i in range(size):
        for j in range(i):
            share = schur[i, j]
            for c in range(6):
                response[i, c] -= share * response[j, c]
        z = load6(response[i], 0)
        a, b, m = subtract_outer(a, b, m, z, scale6(-schur[i, i], z))
    return a, b, m


@kernel
def _times(matrix, v):
    """A (6, 6) matrix times six numbers."""
    t0 = t1 = t2 = t3 = t4 = t5 = 0.0
    for j in range(6):
        t0 += matrix[0, j] * v[j]
        t1 += matrix[1, j] * v[j]
        t2 += matrix[2, j] * v[j]
        t3 += matrix[3, j] * v[j]
        t4 += matrix[4, j] * v[j]
        t5 += matrix[5, j] * v[j]
    return t0, t1, t2, t3, t4, t5


@kernel
def add_child_inertia(aw, k, a, b, m):
    """Add to the inertia (a, b, m) of body k that of its children, modes eliminated: Y^T L S^-1 L^T Y.

    Leaves the factors for `child_bias_wrench` and `interface_wrenches`.
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    first = info[to.F_FIRST]
    count = info[to.F_COUNT]
    rotations = aw.table[k, COUPLING : COUPLING + 3]
    for s in range(count):
        o = 6 * s
        row = aw.interface[first + s]
        root = aw.inertia_root[k, o : o + 6]
        turned = aw.turned_root[k, o : o + 6]
        coupled = aw.coupled[k, o : o + 6]
        _factor_inertia(row, aw.scratch6, root)
        _turn_factor(load9(row, to.I_TURN), root, turned)
        modes = interface_modes(aw, first + s)
        for i in range(6):
            # mode rows are translations first, wrenches and accelerations here angular first
            store3(coupled[i], 0, three_sums(aw.interface_rows, modes + n * ((i + 3) % 6), rotations, n))
        _put_response(load3(row, to.I_P), root, turned, coupled, aw.response[k, o : o + 6])
        for r in range(s + 1):
            other = aw.turned_root[k, 6 * r : 6 * r + 6]
            _put_mobility(aw.mobility[k], turned, other, aw.schur[k], o, 6 * r)
    _factor(aw.schur[k], 6 * count)
    return _add_response(aw.response[k], aw.schur[k], 6 * count, a, b, m)


@kernel
def _shift_wrench(aw, k, s):
    """(torque, force) about B of the bias force of the child at interface s, modes eliminated: Y^T p.

    Row 0 of ``aw.load[k]`` gets J^T p.
    """
    row = aw.interface[aw.flex[k, to.F_FIRST] + s]
    torque = load3(row, to.I_TORQUE)
    force = load3(row, to.I_FORCE)
    turn = rotate_back(load9(row, to.I_TURN), torque)
    store3(aw.load[k, 0], 6 * s, turn)
    store3(aw.load[k, 0], 6 * s + 3, force)
    t0, t1, t2 = add3(torque, cross3(load3(row, to.I_P), force))
    f0, f1, f2 = force
    wrench = (turn[0], turn[1], turn[2], force[0], force[1], force[2])
    for i in range(6):
        c = load6(aw.coupled[k, 6 * s + i], 0)
        t0 -= wrench[i] * c[0]
        t1 -= wrench[i] * c[1]
        t2 -= wrench[i] * c[2]
        f0 -= wrench[i] * c[3]
        f1 -= wrench[i] * c[4]
        f2 -= wrench[i] * c[5]
    return (t0, t1, t2), (f0, f1, f2)


@kernel
def _put_free_acceleration(aw, k, s, linear, angular, share):
    """Write the rows of interface s of L^T (a_0 - Gamma Gamma^T p) into row 1 of ``aw.load[k]``.

    linear, angular: acceleration of the modes' translations and rotations there with no wrench.
    """
    row = aw.interface[aw.flex[k, to.F_FIRST] + s]
    o = 6 * s
    wrench = aw.load[k, 0]
    free = aw.load[k, 1]
    size = 6 * aw.flex[k, to.F_COUNT]
    without_wrench = (angular[0], angular[1], angular[2], linear[0], linear[1], linear[2])
    bias = scale6(share, load6(row, to.I_BIAS_ANGULAR))
    for j in range(6):
        free[o + j] = 0.0
    for i in range(6):
        t = without_wrench[i]
        for j in range(size):
            t -= aw.mobility[k, o + i, j] * wrench[j]
        for j in range(6):
            free[o + j] += aw.turned_root[k, o + i, j] * t + aw.inertia_root[k, o + i, j] * bias[i]


@kernel
def child_bias_wrench(aw, k, share):
    """(torque, force) about B that the children of body k require at y = 0, directly and through the modes.

    ``share``: of the children's bias accelerations, zero for a solve with the factors.
    """
    info = aw.flex[k]
    n = info[to.F_MODES]
    acceleration = aw.modal_acceleration[k]
    for j in range(n):
        acceleration[j] = -aw.bias[k, j]
    torque = (0.0, 0.0, 0.0)
    force = torque
    for s in range(info[to.F_COUNT]):
        one, other = _shift_wrench(aw, k, s)
        torque = add3(torque, one)
        force = add3(force, other)
    for s in range(info[to.F_COUNT]):
        linear, angular = modal_sum(aw.interface_rows, interface_modes(aw, info[to.F_FIRST] + s), n, acceleration)
        _put_free_acceleration(aw, k, s, linear, angular, share)
    schur = aw.schur[k]
    free = aw.load[k, 1]
    for i in range(6 * info[to.F_COUNT]):
        t = free[i]
        for j in range(i):
            t -= schur[i, j] * free[j]
        free[i] = t
        t *= schur[i, i]
        z = load6(aw.response[k, i], 0)
        torque = add3(torque, (t * z[0], t * z[1], t * z[2]))
        force = add3(force, (t * z[3], t * z[4], t * z[5]))
    return torque, force


@kernel
def interface_wrenches(aw, k, angular, linear):
    """Write f of all interfaces, at the acceleration (angular, linear) of B, into row 2 of ``aw.load[k]``."""
    info = aw.flex[k]
    size = 6 * info[to.F_COUNT]
    schur = aw.schur[k]
    free = aw.load[k, 1]
    wrench = aw.load[k, 2]
    y0, y1, y2 = angular
    y3, y4, y5 = linear
    for i in range(size):
        z = load6(aw.response[k, i], 0)
        t = free[i] + z[0] * y0 + z[1] * y1 + z[2] * y2 + z[3] * y3 + z[4] * y4 + z[5] * y5
        wrench[i] = schur[i, i] * t
    for i in range(size - 1, -1, -1):
        for j in range(i):
            wrench[j] -= schur[i, j] * wrench[i]
    for s in range(info[to.F_COUNT]):
        row = aw.interface[info[to.F_FIRST] + s]
        o = 6 * s
        f = add6(load6(row, to.I_TORQUE), _times(aw.inertia_root[k, o : o + 6], load6(wrench, o)))
        store6(wrench, o, f)
