"""Second derivatives of an energy density at a point, by the values of a field and of its gradient there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import ufl

from flexmbd.continuum.contract.trial_symbols import GDIM, FloatArray, TrialSymbols

#: Round-off of second derivatives, of their eigenvalues, and of sums over some hundred entries with stiffness ratios of
#: up to some thousand; relative.
EXACT = 1e-10


class SecondDerivative:
    """Of a density by the unknown."""

    def __init__(self, density: ufl.core.expr.Expr, unknown: TrialSymbols) -> None:
        """Carry the derivatives out; not collective.

        Args:
            density: of `unknown.u`.
            unknown: the symbols, with the parameters' values.
        """
        u = unknown.u
        self._unknown = unknown
        self._along, self._across = ufl.Argument(unknown.space, 1), ufl.Argument(unknown.space, 2)
        second = ufl.derivative(ufl.derivative(density, u, self._along), u, self._across)
        self._second = ufl.algorithms.expand_derivatives(second)

    @property
    def is_constant(self) -> bool:
        """Whether it is the same for every field: the density is quadratic."""
        return self._unknown.u not in ufl.algorithms.extract_coefficients(self._second)

    def along(self, field: Callable[[int], FloatArray], motion: Callable[[int], FloatArray]) -> float:
        """Twice along a motion, at a field; NaN where it has no finite value, or only a mesh has one."""
        fields = {self._unknown.u: field, self._along: motion, self._across: motion}
        value = self._unknown.evaluate_expanded(self._second, fields)
        return value if value is not None and np.isfinite(value) else np.nan

    def at(self, field: Callable[[int], FloatArray]) -> FloatArray | None:
        """(n, n) at a field, by its components, then by those of its gradient; None where only a mesh has a value."""
        shape = self._unknown.u.ufl_shape
        basis = [_unit(shape, k) for k in range(int(np.prod(shape, dtype=int)) * (1 + GDIM))]
        hessian = np.zeros((len(basis), len(basis)))
        for i, one in enumerate(basis):
            for j, other in enumerate(basis[: i + 1]):
                fields = {self._unknown.u: field, self._along: one, self._across: other}
                value = self._unknown.evaluate_expanded(self._second, fields)
                if value is None:
                    return None
                hessian[i, j] = hessian[j, i] = value
        return hessian


def is_semidefinite(matrix: FloatArray) -> bool:
    """Whatever the units of its rows: scaled to a diagonal of ones."""
    diagonal = np.diag(matrix)
    if not np.isfinite(matrix).all() or (diagonal < 0.0).any():
        return False
    d = np.where(diagonal > 0.0, diagonal, 1.0) ** -0.5
    return bool(np.linalg.eigvalsh(d[:, None] * matrix * d)[0] >= -EXACT * len(matrix))


def _unit(shape: tuple[int, ...], k: int) -> Callable[[int], FloatArray]:
    """A field whose value at the point, or whose gradient there, has one component, the k-th of both, that is one."""
    size = int(np.prod(shape, dtype=int))
    value, gradient = np.zeros(size), np.zeros(size * GDIM)
    (value if k < size else gradient)[k if k < size else k - size] = 1.0
    parts = [value.reshape(shape), gradient.reshape((*shape, GDIM))]
    return lambda depth: parts[depth] if depth < 2 else np.zeros((*shape, *(GDIM,) * depth))
