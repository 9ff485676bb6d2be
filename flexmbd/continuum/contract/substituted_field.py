"""Other expressions in the place of a function and of its gradient, in a UFL expression."""

from __future__ import annotations

import ufl
from ufl.corealg.multifunction import MultiFunction


class SubstitutedField(MultiFunction):
    """Puts other expressions for a function and its gradient, in an expression without other derivatives of it.

    For `ufl.corealg.map_dag.map_expr_dag`, after `ufl.algorithms.expand_derivatives`.
    """

    def __init__(self, u: ufl.Coefficient, value: ufl.core.expr.Expr, gradient: ufl.core.expr.Expr) -> None:
        """Of the function u; not collective."""
        super().__init__()
        self._u, self._value, self._gradient = u, value, gradient

    expr = MultiFunction.reuse_if_untouched

    def terminal(self, o: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """A terminal that is not the function."""
        return o

    def coefficient(self, o: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The function, or another one."""
        return self._value if o == self._u else o

    def grad(self, o: ufl.core.expr.Expr) -> ufl.core.expr.Expr:
        """The gradient of the function, or of another one."""
        return self._gradient if o.ufl_operands[0] == self._u else o
