"""The value of a UFL expression at one point, without a mesh.

UFL evaluates expressions itself, but walks into a shared part once for every time it is used, which
takes minutes for the third derivative of an energy with rotations; here every part is evaluated once.
Division by zero and the like give infinity or NaN, as compiled code does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.special
import ufl
from ufl import classes

from flexmbd.continuum.contract.shared_nodes import share_nodes

Array: TypeAlias = npt.NDArray[np.float64]

Terminals: TypeAlias = Mapping[Any, Callable[[int], Array]]
"""For a function or a class of geometric quantities: its value, or that number of times its gradient."""


class NoValueError(Exception):
    """Only a mesh could give the expression a value."""


def evaluate(expression: ufl.core.expr.Expr, terminals: Terminals) -> float:
    """Value of a scalar expression whose derivatives are not yet carried out.

    Args:
        expression: without free indices.
        terminals: values of the functions, arguments and geometric quantities in it.

    Raises:
        NoValueError: a part of it is not among the terminals, or cannot be evaluated.
    """
    return evaluate_expanded(ufl.algorithms.expand_derivatives(share_nodes(expression)), terminals)


def evaluate_expanded(expression: ufl.core.expr.Expr, terminals: Terminals) -> float:
    """The same of an expression whose derivatives are carried out, as is cheaper for many values."""
    values: dict[ufl.core.expr.Expr, Array] = {}
    with np.errstate(all="ignore"):
        for part in ufl.corealg.traversal.unique_post_traversal(expression):
            values[part] = _value(part, [values.get(operand) for operand in part.ufl_operands], terminals)
    return float(values[expression])


def _value(part: Any, operands: list[Any], terminals: Terminals) -> Array:
    """Its axes are those of the tensor, then those of the free indices in UFL's order."""
    if part in terminals or type(part) in terminals:
        return terminals[part if part in terminals else type(part)](0)
    for kind in type(part).__mro__:
        if kind in _RULES:
            return np.asarray(_RULES[kind](part, operands), dtype=float)
    if isinstance(part, classes.Grad):
        depth = 0
        while isinstance(part, classes.Grad):
            (part,), depth = part.ufl_operands, depth + 1
        if part in terminals:
            return terminals[part](depth)
    if isinstance(part, (classes.MultiIndex, classes.Label)):
        return np.empty(0)
    raise NoValueError(type(part).__name__)


def _constant(part: Any, operands: list[Any]) -> Any:
    shape = (*part.ufl_shape, *part.ufl_index_dimensions)
    if isinstance(part, classes.Zero):
        return np.zeros(shape)
    if isinstance(part, classes.Identity):
        return np.eye(len(part.ufl_shape) and part.ufl_shape[0])
    if isinstance(part, classes.PermutationSymbol):
        return np.cross(np.eye(3)[:, None], np.eye(3)[None])
    return float(part)


def _spread(part: Any, operands: list[Any]) -> list[Array]:
    """Scalar operands with an axis for each free index of the whole."""
    spread = []
    for operand, values in zip(part.ufl_operands, operands, strict=True):
        own = operand.ufl_free_indices
        sizes = dict(zip(own, operand.ufl_index_dimensions, strict=True))
        tensor = np.shape(values)[: len(operand.ufl_shape)]
        spread.append(np.reshape(values, (*tensor, *(sizes.get(i, 1) for i in part.ufl_free_indices))))
    return spread


def _product(part: Any, operands: list[Any]) -> Any:
    left, right = _spread(part, operands)
    return left * right


def _division(part: Any, operands: list[Any]) -> Any:
    numerator, denominator = _spread(part, operands)
    return numerator / denominator


def _power(part: Any, operands: list[Any]) -> Any:
    return np.power(*operands)


def _indexed(part: Any, operands: list[Any]) -> Any:
    tensor, indices = part.ufl_operands
    labels = _labels(part, tensor)
    values = operands[0]
    for index in reversed(range(len(indices))):
        if isinstance(indices[index], classes.FixedIndex):
            values = np.take(values, int(indices[index]), axis=index)
    axes = [labels[i.count()] for i in indices if isinstance(i, classes.Index)]
    axes += [labels[i] for i in tensor.ufl_free_indices]
    return np.einsum(values, axes, [labels[i] for i in part.ufl_free_indices])


def _component_tensor(part: Any, operands: list[Any]) -> Any:
    scalar, indices = part.ufl_operands
    labels = _labels(part, scalar)
    out = [labels[i] for i in (*(index.count() for index in indices), *part.ufl_free_indices)]
    return np.einsum(operands[0], [labels[i] for i in scalar.ufl_free_indices], out)


def _labels(part: Any, tensor: Any) -> dict[int, int]:
    """Small numbers for the indices of a tensor with a multi-index, as einsum wants them."""
    multi = [index.count() for index in part.ufl_operands[1] if isinstance(index, classes.Index)]
    return {index: label for label, index in enumerate({*tensor.ufl_free_indices, *multi})}


def _index_sum(part: Any, operands: list[Any]) -> Any:
    summand, (index,) = part.ufl_operands
    axis = len(summand.ufl_shape) + summand.ufl_free_indices.index(index.count())
    return np.sum(operands[0], axis=axis)


def _conditional(part: Any, operands: list[Any]) -> Any:
    chosen, other = operands[1:]
    return chosen if operands[0] else other


_MATH = {
    "sqrt": np.sqrt,
    "exp": np.exp,
    "ln": np.log,
    "cos": np.cos,
    "sin": np.sin,
    "tan": np.tan,
    "acos": np.arccos,
    "asin": np.arcsin,
    "atan": np.arctan,
    "cosh": np.cosh,
    "sinh": np.sinh,
    "tanh": np.tanh,
    "erf": scipy.special.erf,
}

_RULES: dict[type, Callable[[Any, list[Any]], Any]] = {
    classes.ConstantValue: _constant,
    classes.Sum: lambda part, operands: operands[0] + operands[1],
    classes.Product: _product,
    classes.Division: _division,
    classes.Power: _power,
    classes.Abs: lambda part, operands: np.abs(operands[0]),
    classes.MinValue: lambda part, operands: np.minimum(*operands),
    classes.MaxValue: lambda part, operands: np.maximum(*operands),
    classes.MathFunction: lambda part, operands: _MATH[part._name](operands[0]),
    classes.Atan2: lambda part, operands: np.arctan2(*operands),
    classes.Conj: lambda part, operands: operands[0],
    classes.Real: lambda part, operands: operands[0],
    classes.Variable: lambda part, operands: operands[0],
    classes.Indexed: _indexed,
    classes.ComponentTensor: _component_tensor,
    classes.ListTensor: lambda part, operands: np.stack(operands),
    classes.IndexSum: _index_sum,
    classes.Conditional: _conditional,
    classes.EQ: lambda part, operands: operands[0] == operands[1],
    classes.NE: lambda part, operands: operands[0] != operands[1],
    classes.LT: lambda part, operands: operands[0] < operands[1],
    classes.GT: lambda part, operands: operands[0] > operands[1],
    classes.LE: lambda part, operands: operands[0] <= operands[1],
    classes.GE: lambda part, operands: operands[0] >= operands[1],
    classes.AndCondition: lambda part, operands: bool(operands[0]) and bool(operands[1]),
    classes.OrCondition: lambda part, operands: bool(operands[0]) or bool(operands[1]),
    classes.NotCondition: lambda part, operands: not operands[0],
}
