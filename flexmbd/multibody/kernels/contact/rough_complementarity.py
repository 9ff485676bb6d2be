"""Contact with Coulomb's friction: forces at points whose gaps and slips follow from all of them.

Of point k the force y_k = (N, T1, T2) and the gap and slip r_k = b_k + sum_j C_kj y_j: N >= 0, gap >= 0, one of both
zero; |T| <= mu N, and T against the slip with mu N where there is any.  Solved by Newton's method on the projections
N = (N - rho gap)+, T = the disc of mu N's nearest to T - rho slip (Alart & Curnier 1991), from sweeps of these
point by point where it does not come near.
"""

from __future__ import annotations

import math

from flexmbd.multibody.kernels.base.compiling import kernel
from flexmbd.multibody.kernels.base.native import factor, solve
from flexmbd.round_off import EQUAL, ROUND_OFF

_STEPS, _ROUNDS, _SWEEPS = 25, 4, 60


@kernel
def _shares(C, k):
    """rho of the gap and of the slip of point k."""
    o = 3 * k
    return 1.0 / C[o, o], 2.0 / (C[o + 1, o + 1] + C[o + 2, o + 2])


@kernel
def write_slips(C, b, y, r):
    """r = b + C y."""
    for i in range(b.shape[0]):
        t = b[i]
        for j in range(b.shape[0]):
            t += C[i, j] * y[j]
        r[i] = t


@kernel
def pressed_point(C, r, y, mu, k):
    """Of point k: N and the slip's force before projection, its size, and the bound mu N."""
    o = 3 * k
    of_gap, of_slip = _shares(C, k)
    pushed = y[o] - of_gap * r[o]
    t1, t2 = y[o + 1] - of_slip * r[o + 1], y[o + 2] - of_slip * r[o + 2]
    return pushed, t1, t2, math.sqrt(t1 * t1 + t2 * t2), mu * max(y[o], 0.0)


@kernel
def weights_of(C, r, y, mu, k):
    """What the residual of point k changes by with its gap, and by rows (4) with its slip."""
    of_gap, of_slip = _shares(C, k)
    pushed, t1, t2, size, most = pressed_point(C, r, y, mu, k)
    if not pushed > 0.0:
        return 0.0, (0.0, 0.0, 0.0, 0.0)
    if size <= most:
        return of_gap, (of_slip, 0.0, 0.0, of_slip)
    c, e1, e2 = of_slip * most / size, t1 / size, t2 / size
    return of_gap, (c * (1.0 - e1 * e1), -c * e1 * e2, -c * e1 * e2, c * (1.0 - e2 * e2))


@kernel
def _write_system(C, r, y, mu, J, res):
    """The residual, and its derivatives by y."""
    n = y.shape[0]
    for k in range(n // 3):
        o = 3 * k
        of_gap, of_slip = _shares(C, k)
        pushed, t1, t2, size, most = pressed_point(C, r, y, mu, k)
        by_gap, by_slip = weights_of(C, r, y, mu, k)
        for j in range(n):
            J[o, j] = by_gap * C[o, j]
            J[o + 1, j] = by_slip[0] * C[o + 1, j] + by_slip[1] * C[o + 2, j]
            J[o + 2, j] = by_slip[2] * C[o + 1, j] + by_slip[3] * C[o + 2, j]
        if not pushed > 0.0:
            for c in range(3):
                J[o + c, o + c] = 1.0
                res[o + c] = y[o + c]
            continue
        res[o] = of_gap * r[o]
        if size <= most:
            res[o + 1], res[o + 2] = of_slip * r[o + 1], of_slip * r[o + 2]
            continue
        e1, e2, share = t1 / size, t2 / size, most / size
        res[o + 1], res[o + 2] = y[o + 1] - most * e1, y[o + 2] - most * e2
        J[o + 1, o + 1] += 1.0 - share * (1.0 - e1 * e1)
        J[o + 1, o + 2] += share * e1 * e2
        J[o + 2, o + 1] += share * e1 * e2
        J[o + 2, o + 2] += 1.0 - share * (1.0 - e2 * e2)
        if most > 0.0:
            J[o + 1, o] -= mu * e1
            J[o + 2, o] -= mu * e2


@kernel
def _sweep(C, b, y, mu):
    """Point by point what its own gap and slip say."""
    n = y.shape[0]
    for k in range(n // 3):
        o = 3 * k
        of_gap, of_slip = _shares(C, k)
        for c in range(3):
            r = b[o + c]
            for j in range(n):
                r += C[o + c, j] * y[j]
            if c == 0:
                y[o] = max(0.0, y[o] - of_gap * r)
            else:
                y[o + c] -= of_slip * r
        size, most = math.sqrt(y[o + 1] * y[o + 1] + y[o + 2] * y[o + 2]), mu * y[o]
        if size > most:
            y[o + 1] *= most / size
            y[o + 2] *= most / size


@kernel
def _largest(a):
    found = 0.0
    for i in range(a.shape[0]):
        found = max(found, abs(a[i]))
    return found


@kernel
def solve_rough(lapack, C, b, mu, y, r, res, J, pivot, sizes):
    """Write the forces y (3 m,) and r; whether they were found.

    y begins where the solution may be; res (1, 3 m) and J (3 m, 3 m) are scratch, J is left as the factors of the
    residual's derivatives by y.  C (3 m, 3 m), b (3 m,): see the module.
    """
    for turn in range(_ROUNDS):
        before = math.inf
        for _ in range(_STEPS):
            write_slips(C, b, y, r)
            _write_system(C, r, y, mu, J, res[0])
            now = _largest(res[0])
            if factor(lapack, J, pivot, sizes) != 0:
                break
            if now <= EQUAL * _largest(y) and (now <= ROUND_OFF * _largest(y) or not now < 0.1 * before):
                return True
            before = now
            solve(lapack, J, pivot, sizes, res)
            for i in range(y.shape[0]):
                y[i] -= res[0, i]
        for i in range(y.shape[0]):
            if not math.isfinite(y[i]):
                y[i] = 0.0
        for _ in range(_SWEEPS * (turn + 1)):
            _sweep(C, b, y, mu)
    return False
