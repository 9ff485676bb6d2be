"""Conditions on a dissipation function: convex, least where nothing moves, and zero for rigid motions.

Rayleigh's function R(v) of the rates gives the viscous forces dR/dv; their power dR/dv . v is not negative for any v
if R is convex and least at v = 0.  It is looked at pointwise, in the rates and their gradients, for the values that
the parameters have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any

import numpy as np
import ufl

from flexmbd.continuum.contract.hessian import EXACT, SecondDerivative, is_semidefinite
from flexmbd.continuum.contract.trial_symbols import FloatArray, TrialSymbols, affine, slope_at_rest

# Rates at which the curvature along a motion is looked at, 1/s: every decade of what a body could do in any units.
_DECADES = tuple(10.0**k for k in range(-12, 13))

# A curvature that differs from that at rest by more than this share of it: the rate matters there.
_CHANGED = 0.5

_NOT_CONVEX = "is not convex: some rates would gain energy by it; check the signs and ranges of the viscosities"


def dissipation_faults(
    terms: Sequence[Any], unknown: TrialSymbols, *, rigid_motion: Callable[..., ufl.core.expr.Expr]
) -> Iterator[str]:
    """Faults of a dissipation whose terms are in order; not collective.

    Args:
        terms: of the rates `unknown.u`.
        unknown: the symbols, with the parameters' values.
        rigid_motion: of the form.
    """
    density = sum((integrand for integrand, _ in terms), ufl.as_ufl(0.0))
    v = unknown.u
    size = unknown.evaluate(density, {v: affine(v.ufl_shape, seed=3)})
    if size is None:  # only a mesh could say
        return
    at_rest = unknown.evaluate(density, {v: affine(v.ufl_shape, seed=None)})
    turned = rigid_motion(unknown.x, ufl.as_vector((0.3, -0.5, 0.2)), ufl.as_vector((-0.7, 0.4, 0.6)))
    rigid = unknown.evaluate(ufl.replace(density, {v: turned}), {})
    if at_rest != 0.0:
        yield f"must be zero where nothing moves, is {at_rest:.3g}"
    elif slope_at_rest(density, unknown):
        yield "must have no part linear in the rates, which is a force where nothing moves"
    elif rigid is not None and not abs(rigid) <= EXACT * abs(size):
        yield (
            "a rigid motion dissipates: write it in rates of strain. Damping against the surroundings is a force of "
            "the scene"
        )
    else:
        yield from _convexity_faults(density, unknown)


def check_values(form: Any, cell: str, degree: int, *, parameters: Any) -> list[str]:
    """The same of a form that keeps the contract, for the values of other parameters; not collective."""
    module: ModuleType = form
    unknown = TrialSymbols(module, cell, degree, parameters=parameters)
    terms = form.dissipation(unknown.u, unknown.parameters)
    return list(dissipation_faults(terms, unknown, rigid_motion=form.rigid_motion))


def _convexity_faults(density: ufl.core.expr.Expr, unknown: TrialSymbols) -> Iterator[str]:
    shape = unknown.u.ufl_shape
    second = SecondDerivative(density, unknown)
    rates = [affine(shape, seed=None)]
    if not second.is_constant:
        motion = affine(shape, seed=4)
        curvatures = np.array([second.along(_scaled(motion, rate), motion) for rate in (0.0, *_DECADES)])
        # what is left of sums that cancel is no curvature
        if (curvatures < -EXACT * np.fmax.accumulate(abs(curvatures))).any():
            yield _NOT_CONVEX
            return
        rates += [_scaled(motion, rate) for rate in _rates_of_change(curvatures)]
    for rate in rates:
        hessian = second.at(rate)
        if hessian is None:
            return
        if not is_semidefinite(hessian):
            yield _NOT_CONVEX
            return


def _rates_of_change(curvatures: FloatArray) -> Sequence[float]:
    """The first decade in which the function departs from a quadratic one, and those beside it, 1/s.

    Args:
        curvatures: second derivatives along a motion, at rest and at its multiples by the decades.
    """
    rest, moving = curvatures[0], curvatures[1:]
    departs = np.flatnonzero(abs(moving - rest) > _CHANGED * abs(rest))
    first = int(departs[0]) if len(departs) else len(_DECADES) - 1
    return _DECADES[max(first - 1, 0) : first + 2]


def _scaled(field: Callable[[int], FloatArray], factor: float) -> Callable[[int], FloatArray]:
    return lambda depth: factor * field(depth)
