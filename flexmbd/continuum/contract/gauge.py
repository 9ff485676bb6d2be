"""Shifts of a field that cost no energy, which a form names by `gauge(p)`: those of an electric potential, say.

They are looked at pointwise: the energy's slope along the shift, at any value of the unknown, is zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import ufl

from flexmbd.continuum.contract.hessian import EXACT
from flexmbd.continuum.contract.trial_symbols import FloatArray, TrialSymbols, affine
from flexmbd.given import numbers


def gauge_faults(shifts: Any, density: ufl.core.expr.Expr, unknown: TrialSymbols) -> Iterator[str]:
    """Faults of what `gauge` returned; not collective.

    Args:
        shifts: by name the components of the unknown that one unit shifts.
        density: the strain energy, of the unknown `unknown.u`.
        unknown: the symbols, with the parameters' values.
    """
    shape = unknown.u.ufl_shape
    size = int(np.prod(shape, dtype=int))
    if not isinstance(shifts, Mapping) or not shifts or not all(isinstance(name, str) and name for name in shifts):
        yield f'must return shifts by their names, as {{"potential": (0.0, 0.0, 0.0, 1.0)}}, got {shifts!r:.100}'
        return
    for name, given in shifts.items():
        shift = numbers(given)
        if shift.shape != (size,) or not np.isfinite(shift).all() or not shift.any():
            yield f"the shift {name!r} must be {size} finite numbers, one a component of the unknown, got {given!r:.60}"
        elif shift[unknown.moved].any():
            yield f"the shift {name!r} moves the body: it may have no part in displacements and rotations"
        elif _costs(density, unknown, shift.reshape(shape)):
            yield (
                f"the shift {name!r} is no gauge: it changes the strain energy. A field that is held by its own energy "
                "needs none; of a potential the energy knows the gradient alone"
            )


def _costs(density: ufl.core.expr.Expr, unknown: TrialSymbols, shift: FloatArray) -> bool:
    """Whether the energy has a slope along a shift; False where only a mesh could say."""
    direction = ufl.Argument(unknown.space, 1)
    slope = ufl.algorithms.expand_derivatives(ufl.derivative(density, unknown.u, direction))
    at = {unknown.u: affine(unknown.u.ufl_shape, seed=1)}
    along = unknown.evaluate_expanded(slope, {**at, direction: _uniform(shift)})
    # what a field of the same components that is not uniform does to it
    changing = shift[..., None] * affine(shift.shape, seed=2)(1)
    other = unknown.evaluate_expanded(slope, {**at, direction: _of_gradient(shift, changing)})
    if along is None or other is None:
        return False
    return abs(along) > EXACT * (abs(other) + abs(other - along))


def _uniform(value: FloatArray) -> Callable[[int], FloatArray]:
    return lambda depth: value if depth == 0 else np.zeros((*value.shape, *(3,) * depth))


def _of_gradient(value: FloatArray, gradient: FloatArray) -> Callable[[int], FloatArray]:
    def field(depth: int) -> FloatArray:
        if depth == 0:
            return value
        return gradient if depth == 1 else np.zeros((*value.shape, *(3,) * depth))

    return field
