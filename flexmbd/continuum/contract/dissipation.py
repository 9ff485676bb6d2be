"""What a dissipation function must be: convex, least where nothing moves, and zero for rigid motions.

Rayleigh's function R(v) of the rates gives the viscous forces dR/dv; their power dR/dv . v is not negative for any v
if R is convex and least at v = 0.  It is looked at pointwise, in the rates and their gradients, for the values that
the parameters have.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from types import ModuleType
from typing import Any

import ufl

from flexmbd.continuum.contract.hessian import EXACT, SecondDerivative, is_semidefinite
from flexmbd.continuum.contract.trial_symbols import FloatArray, TrialSymbols, affine, slope_at_rest

# Rates at which a function that is not quadratic is tried, 1/s.
_RATES = (1e-3, 1.0, 1e3)


def dissipation_faults(
    terms: Sequence[Any], unknown: TrialSymbols, *, rigid_motion: Callable[..., ufl.core.expr.Expr]
) -> Iterator[str]:
    """What is wrong with a dissipation whose terms are in order; not collective.

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
        rates += [_scaled(affine(shape, seed=4), rate) for rate in _RATES]
    for rate in rates:
        hessian = second.at(rate)
        if hessian is None:
            return
        if not is_semidefinite(hessian):
            yield "is not convex: some rates would gain energy by it; check the signs and ranges of the viscosities"
            return


def _scaled(field: Callable[[int], FloatArray], factor: float) -> Callable[[int], FloatArray]:
    return lambda depth: factor * field(depth)
