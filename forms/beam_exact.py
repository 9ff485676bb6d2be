"""Geometrically exact spatial beam whose sections may turn any number of times; for bodies with history.

The beam of `beam_timoshenko`, Reissner's and Simo's: with R the rotation of a section, r the axis, ' the
derivative along its initial length,

    (R n)' + f = 0,   (R m)' + r' x R n + c = 0,   gamma = R^T r' - r_0',   kappa = axial(R^T R'),

n and m linear in gamma and kappa by the section's stiffness. There the unknown is a rotation from rest,
with a singularity at half a turn; here R = exp(theta) Q: Q is the rotation that the last accepted step
ended with, which is history at the quadrature points as its curvature is, and theta (rad) the rotation
since, about axes in space. The unknown is the sum of all such steps' theta: no rotation itself, but a
constant one of all sections never strains the beam, however large. A step may be up to half a turn.

A dead moment is the gradient of no potential of theta; in equilibrium about a fixed axis, as in a plane,
the force of the unknown is the moment itself. Strains depend on the steps by the square of their size
times the element's, as the increments are interpolated. Straight and curved axes; the mass is that of
rest, in the sections' own axes. Assumptions, elements and integration are those of `beam_timoshenko`.

References: Simo & Vu-Quoc 1986, doi:10.1016/0045-7825(86)90079-4; Reissner 1981, doi:10.1007/BF00946983;
Ibrahimbegovic 1995, doi:10.1016/0045-7825(95)00724-F (rotation vectors by increments).
"""

from __future__ import annotations

import ufl
from ufl.core.expr import Expr

from flexmbd.forms import beam_timoshenko as timoshenko
from flexmbd.forms._shared import degrees
from flexmbd.forms.beam_timoshenko import Parameters as Parameters
from flexmbd.forms.beam_timoshenko import Quadrature as Quadrature
from flexmbd.forms.beam_timoshenko import Reference as Reference
from flexmbd.forms.beam_timoshenko import element as element
from flexmbd.forms.beam_timoshenko import kinetic_energy as kinetic_energy
from flexmbd.forms.beam_timoshenko import motion as motion
from flexmbd.forms.beam_timoshenko import reference as reference
from flexmbd.forms.beam_timoshenko import rigid_motion as rigid_motion
from flexmbd.forms.beam_timoshenko import section_inertia as section_inertia

CELLS = ("interval",)

# L2 order of the displacement by element degree.
ORDER = {1: 2, 2: 3}

# Gradients and integrals refer to the initial configuration.
REFERENCE = "INITIAL"

# Terms of the series below: to round-off at a quarter of a turn, to 1e-9 at half a turn.
_TERMS = 10

# Square of the largest rotation in a step, rad^2.
_HALF_TURN = float(ufl.pi) ** 2


def state(p: Parameters) -> Expr:
    """History at rest, (13,): quaternion of Q, kappa (1/m), theta (rad) and its derivative (rad/m).

    The last two are of the sum of steps. kappa is along the mesh's axes, turned back by Q.
    """
    return ufl.as_vector([1.0, *[0.0] * 12])


def residual(u: Expr, v: Expr, state: Expr, p: Parameters) -> list[tuple[Expr, Quadrature]]:
    """Virtual work per initial length, J/m, of the resultants on the strains of v: the energy's derivative."""
    gamma, kappa, _ = _strains(u, state, p)
    energy = (ufl.inner(_stretching(p, gamma), gamma) + ufl.inner(_bending(p, kappa), kappa)) / 2
    return [(ufl.derivative(energy, u, v), _rule(u))]


def update(u: Expr, state: Expr, p: Parameters) -> Expr:
    """History at the end of a step, (13,)."""
    _, _, new = _strains(u, state, p)
    return new


def stress(u: Expr, state: Expr, p: Parameters) -> Expr:
    """Resultants in the section's axes, (6,): forces along t, y, z (N), moments about them (N m)."""
    gamma, kappa, _ = _strains(u, state, p)
    return ufl.as_vector([*_stretching(p, gamma), *_bending(p, kappa)])


def scaled_yield(p: Parameters, factor: float) -> Parameters:
    """The same: nothing yields."""
    return p


def energies(u: Expr, state: Expr, p: Parameters) -> dict[str, tuple[Expr, Quadrature]]:
    """Strain energy per initial length, J/m."""
    gamma, kappa, _ = _strains(u, state, p)
    energy = (ufl.inner(_stretching(p, gamma), gamma) + ufl.inner(_bending(p, kappa), kappa)) / 2
    return {"elastic": (energy, _rule(u))}


def _strains(u: Expr, state: Expr, p: Parameters) -> tuple[Expr, Expr, Expr]:
    """gamma and kappa in the section's axes at rest, and the history that follows."""
    axes = timoshenko._axes(u, p)
    move, turn = timoshenko._parts(u)
    d_move, d_turn = timoshenko._along(move, axes[0]), timoshenko._along(turn, axes[0])
    quaternion, kappa, turned, d_turned = (
        [state[i] for i in range(start, end)] for start, end in ((0, 4), (4, 7), (7, 10), (10, 13))
    )
    theta, d_theta = turn - ufl.as_vector(turned), d_turn - ufl.as_vector(d_turned)
    square = ufl.dot(theta, theta)
    # a trial far off must not make the series explode
    bounded = ufl.min_value(square, _HALF_TURN)
    sine, cosine, third = (_series(bounded, first) for first in (1, 2, 3))

    def back(v: Expr) -> Expr:
        """exp(-theta) v - v."""
        once = ufl.cross(theta, v)
        return cosine * ufl.cross(theta, once) - sine * once

    scalar, vector = quaternion[0], ufl.as_vector(quaternion[1:])

    def further_back(v: Expr) -> Expr:
        """Q^T v - v."""
        once = ufl.cross(vector, v)
        return 2 * ufl.cross(vector, once) - 2 * scalar * once

    # R^T r' - r_0', r_0' left out of the sum: less cancellation at small strain
    first = back(axes[0] + d_move)
    gamma = d_move + first + further_back(axes[0] + d_move + first)
    across = ufl.cross(theta, d_theta)
    since = d_theta - cosine * across + third * ufl.cross(theta, across)
    bent = ufl.as_vector(kappa) + since + further_back(since)
    new = ufl.as_vector([*_multiplied(theta, square, scalar, vector), *bent, *turn, *d_turn])
    return timoshenko._components(gamma, axes), timoshenko._components(bent, axes), new


def _series(square: Expr, first: int) -> Expr:
    """Sum of (-square)^k / (2 k + first)!: of sin x / x, (1 - cos x) / x^2 and (x - sin x) / x^3 for 1, 2, 3."""
    factorial = 1.0
    for i in range(2, 2 * (_TERMS - 1) + first + 1):
        factorial *= i
    total = ufl.as_ufl(1.0 / factorial)
    for k in range(_TERMS - 1, 0, -1):
        factorial /= (2 * k + first) * (2 * k + first - 1)
        total = 1.0 / factorial - square * total
    return total


def _multiplied(theta: Expr, square: Expr, scalar: Expr, vector: Expr) -> list[Expr]:
    """The quaternion of exp(theta) times that of Q, of length one."""
    half = _series(square / 4, 1) / 2 * theta
    real = 1 - square / 4 * _series(square / 4, 2)
    first = real * scalar - ufl.dot(half, vector)
    rest = real * vector + scalar * half + ufl.cross(half, vector)
    length = ufl.sqrt(first**2 + ufl.dot(rest, rest))
    # not a number: a step of more is refused, and tried again in parts
    length = ufl.conditional(ufl.lt(square, _HALF_TURN), length, ufl.sqrt(-square))
    return [first / length, *(rest[i] / length for i in range(3))]


def _rule(u: Expr) -> Quadrature:
    """As many Gauss points as the element has degree, against locking."""
    n, _ = degrees(u)
    return Quadrature(2 * n - 2)


def _stretching(p: Parameters, gamma: Expr) -> Expr:
    return ufl.elem_mult(timoshenko._stretching(p), gamma)


def _bending(p: Parameters, kappa: Expr) -> Expr:
    return timoshenko._bending(p) * kappa
