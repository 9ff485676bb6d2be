"""What kinetic energy linear in the rates must be: linear in the unknown as well, and not moved by translations.

With T1(u, v), linear in both, Lagrange's equations have the forces g(w, d) = T1(w, d) - T1(d, w) of the rates w on a
virtual motion d.  They are skew, so that they take no power; what is symmetric in u and v is a rate of change in time,
and makes no force.  It is looked at pointwise, in the fields and their gradients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import ufl

from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract.trial_symbols import TrialSymbols, affine


def gyroscopic_faults(
    terms: Sequence[Any],
    unknown: TrialSymbols,
    rates: ufl.Coefficient,
    *,
    rigid_motion: Callable[..., ufl.core.expr.Expr],
) -> Iterator[str]:
    """What is wrong with gyroscopic terms that are in order otherwise; not collective.

    Args:
        terms: of the unknown `unknown.u` and of ``rates``, on the same space.
        unknown: the symbols, with the parameters' values.
        rates: the symbol of the rates.
        rigid_motion: of the form.
    """
    density = sum((integrand for integrand, _ in terms), ufl.as_ufl(0.0))
    fields = unknown.u, rates
    for one in fields:
        along = ufl.Argument(unknown.space, 1)
        slope = ufl.algorithms.expand_derivatives(ufl.derivative(density, one, along))
        at_rest = ufl.algorithms.expand_derivatives(ufl.replace(density, {one: ufl.zero(one.ufl_shape)}))
        if one in ufl.algorithms.extract_coefficients(slope) or not isinstance(at_rest, ufl.classes.Zero):
            yield "must be linear in u and in v, as p.h * ufl.dot(axis, ufl.cross(turn(v), turn(u))) / 2"
            return
    w, d = affine(rates.ufl_shape, seed=5), affine(rates.ufl_shape, seed=6)
    energy = unknown.evaluate(density, {unknown.u: w, rates: d})
    other = unknown.evaluate(density, {unknown.u: d, rates: w})
    if energy is None or other is None:  # only a mesh could say
        return
    size = abs(energy) + abs(other)
    if size > 0.0 and not abs(energy - other) > EXACT * size:
        yield "is symmetric in u and v, and makes no force: exchanging u and v must change it"
        return
    moved = rigid_motion(unknown.x, ufl.as_vector((0.3, -0.5, 0.2)), ufl.zero(3))
    force = density - _exchanged(density, unknown.u, rates)
    translated = unknown.evaluate(ufl.replace(force, {rates: moved}), {unknown.u: w})
    if translated is not None and not abs(translated) <= EXACT * size:
        yield (
            "acts on translations of the whole body: write it in rotations, as ufl.curl(u) / 2; what turns with the "
            "body's frame, as Coriolis forces do, a machine has by itself"
        )


def _exchanged(density: ufl.core.expr.Expr, u: ufl.Coefficient, v: ufl.Coefficient) -> ufl.core.expr.Expr:
    between = ufl.Coefficient(u.ufl_function_space())
    return ufl.replace(ufl.replace(ufl.replace(density, {u: between}), {v: u}), {between: v})
