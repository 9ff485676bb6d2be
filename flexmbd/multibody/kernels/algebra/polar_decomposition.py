"""The rotation R in the polar decomposition F = R U of a face's motion, and its derivatives: how a face turns a frame.

With V = F R^T = R U R^T, which is symmetric, and D = tr(V) 1 - V, a motion with the rate F' turns by the angular
velocity w, in the axes that R turns to, of

    D w = 2 axial(skew(F' R^T)),

the skew part of F' R^T = [w] V + R U' R^T, as [w] V + V [w] = [D w]: smooth as long as U is positive definite.  F and
its derivatives are 9-tuples, row by row; X : Y is sum X_ij Y_ij.
"""

from __future__ import annotations

from flexmbd.multibody.kernels.algebra.jacobian_derivatives import add9, scale9, skew
from flexmbd.multibody.kernels.algebra.so3 import compose, compose_back, cross3, dot3, rotate, scale3, sub3
from flexmbd.multibody.kernels.base.compiling import kernel

# Newton's iteration converges quadratically, so the step after one of this size leaves round-off alone.
_LAST_STEP = 1e-8
_MOST_STEPS = 60
_UNIT = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@kernel
def sub9(a, b):
    """A - B."""
    return add9(a, scale9(-1.0, b))


@kernel
def twice_axial(m):
    """Twice the axial vector of skew(M): its product with any g is M : [g]."""
    return (m[7] - m[5], m[2] - m[6], m[3] - m[1])


@kernel
def symmetric6(m):
    """s with s . e = M : E for symmetric E, e its components xx yy zz yz xz xy."""
    return (m[0], m[4], m[8], m[5] + m[7], m[2] + m[6], m[1] + m[3])


@kernel
def face_matrix(turn, strain):
    """[turn] + S, S of its components xx yy zz yz xz xy."""
    xx, yy, zz, yz, xz, xy = strain
    return (
        xx, xy - turn[2], xz + turn[1],
        xy + turn[2], yy, yz - turn[0],
        xz - turn[1], yz + turn[0], zz,
    )  # fmt: skip


@kernel
def face_motion(turn, strain):
    """F = 1 + [turn] + S."""
    return add9(_UNIT, face_matrix(turn, strain))


@kernel
def determinant(m):
    """det M."""
    return dot3((m[0], m[1], m[2]), cross3((m[3], m[4], m[5]), (m[6], m[7], m[8])))


@kernel
def _cofactors(m):
    """det(M) M^-T, row by row."""
    x = cross3((m[3], m[4], m[5]), (m[6], m[7], m[8]))
    y = cross3((m[6], m[7], m[8]), (m[0], m[1], m[2]))
    z = cross3((m[0], m[1], m[2]), (m[3], m[4], m[5]))
    return (x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2])


@kernel
def polar_rotation(F):
    """R of F = R U, det F > 0, by Newton's iteration X = (X + X^-T) / 2 (Higham 1986)."""
    R = F
    for _ in range(_MOST_STEPS):
        cofactors = _cofactors(R)
        over = 1.0 / dot3((R[0], R[1], R[2]), (cofactors[0], cofactors[1], cofactors[2]))
        closer = add9(scale9(0.5, R), scale9(0.5 * over, cofactors))
        step = 0.0
        for k in range(9):
            step = max(step, abs(closer[k] - R[k]))
        R = closer
        if not step > _LAST_STEP:
            break
    return R


@kernel
def _transposed(m):
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@kernel
def _trace_less(m):
    """tr(M) 1 - M."""
    trace = m[0] + m[4] + m[8]
    return (trace - m[0], -m[1], -m[2], -m[3], trace - m[4], -m[5], -m[6], -m[7], trace - m[8])


@kernel
def polar_solver(F, R):
    """D^-1, symmetric."""
    V = compose_back(F, R)
    xy, xz, yz = 0.5 * (V[1] + V[3]), 0.5 * (V[2] + V[6]), 0.5 * (V[5] + V[7])
    cofactors = _cofactors((V[4] + V[8], -xy, -xz, -xy, V[0] + V[8], -yz, -xz, -yz, V[0] + V[4]))
    det = (V[4] + V[8]) * cofactors[0] - xy * cofactors[1] - xz * cofactors[2]
    return scale9(1.0 / det, cofactors)


@kernel
def polar_spin(solver, R, rate):
    """w for the rate F'."""
    return rotate(solver, twice_axial(compose_back(rate, R)))


@kernel
def polar_spin_rate(solver, F, R, rate, rate2, spin):
    """w' for F' and F''; ``spin``: w."""
    W = skew(spin)
    turning = compose_back(rate, R)
    V_rate = sub9(turning, compose(compose_back(F, R), W))
    own = sub9(compose_back(rate2, R), compose(turning, W))  # R'^T = -R^T [w]
    return rotate(solver, sub3(twice_axial(own), rotate(_trace_less(V_rate), spin)))


@kernel
def polar_torque(solver, R, torque):
    """B with X : B = torque . (w for the rate X): the torque as forces along the entries of F."""
    return compose(skew(rotate(solver, torque)), R)


@kernel
def polar_derivatives(F, R, rate, rate2, spin, spin_rate):
    """What `polar_column` needs beside the solver: R^T, R'^T, R''^T, D', D'' for F' and F''."""
    W = skew(spin)
    R1 = compose(W, R)
    R2 = compose(add9(skew(spin_rate), compose(W, W)), R)
    V1 = add9(compose_back(rate, R), compose_back(F, R1))
    V2 = add9(add9(compose_back(rate2, R), scale9(2.0, compose_back(rate, R1))), compose_back(F, R2))
    return _transposed(R), _transposed(R1), _transposed(R2), _trace_less(V1), _trace_less(V2)


@kernel
def polar_column(solver, derivatives, X):
    """The small turn phi by a constant change X of F per unit, and its first two time derivatives."""
    R, R1, R2, D1, D2 = derivatives
    phi = rotate(solver, twice_axial(compose(X, R)))
    phi1 = rotate(solver, sub3(twice_axial(compose(X, R1)), rotate(D1, phi)))
    rest = sub3(twice_axial(compose(X, R2)), rotate(D2, phi))
    phi2 = rotate(solver, sub3(rest, scale3(2.0, rotate(D1, phi1))))
    return phi, phi1, phi2


@kernel
def polar_torque_derivative(solver, F, R, torque, rate, spin):
    """B with X : B = torque . (derivative along X of w for the constant rate F'); ``spin``: w at F."""
    g = rotate(solver, torque)
    gw = dot3(g, spin)
    N = (
        g[0] * spin[0] - gw, 0.5 * (g[0] * spin[1] + g[1] * spin[0]), 0.5 * (g[0] * spin[2] + g[2] * spin[0]),
        0.5 * (g[0] * spin[1] + g[1] * spin[0]), g[1] * spin[1] - gw, 0.5 * (g[1] * spin[2] + g[2] * spin[1]),
        0.5 * (g[0] * spin[2] + g[2] * spin[0]), 0.5 * (g[1] * spin[2] + g[2] * spin[1]), g[2] * spin[2] - gw,
    )  # fmt: skip
    # X turns R by phi, which takes F' R^T to F' R^T [phi]^T and V to X R^T - V [phi]
    turned = twice_axial(compose(_transposed(compose_back(rate, R)), skew(g)))
    swept = twice_axial(compose(_transposed(compose_back(F, R)), N))
    back = rotate(solver, (turned[0] + swept[0], turned[1] + swept[1], turned[2] + swept[2]))
    return compose(sub9(N, skew(back)), R)
