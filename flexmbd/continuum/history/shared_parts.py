"""UFL expressions that have parts in common, made to share them as objects.

A form that is a sum of two expressions built apart, as of the forces and the history at a step's end, has equal parts
that are different objects, and FFCx compares such parts again and again, all the way down: a logarithm of a tensor in
both takes for ever.  Parts that are the same object cost nothing, and are computed once.

A quotient becomes a product with the reciprocal, which is such a part: a processor divides ten times slower than it
multiplies, and the inverse of a tensor alone would divide nine times by its determinant.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from ufl.algorithms import expand_derivatives
from ufl.classes import Division, MultiIndex, ScalarValue, Variable
from ufl.core.expr import Expr
from ufl.core.multiindex import FixedIndex

from flexmbd.continuum.contract.shared_nodes import rebuild, share_nodes


def share_parts(expressions: Iterable[Expr]) -> list[Expr]:
    """The same expressions with derivatives carried out and equal parts as one object; not collective.

    Parts with free indices are shared as far as the next part around them that has none.
    """
    known: dict[Any, Expr] = {}

    def one(node: Expr, operands: Sequence[Expr]) -> Expr:
        return _one(node, operands, known)

    return [rebuild(expand_derivatives(share_nodes(expression)), one) for expression in expressions]


def _one(node: Expr, operands: Sequence[Expr], known: dict[Any, Expr]) -> Expr:
    """The one object for a node whose operands are such objects already."""
    if isinstance(node, Variable):
        # a label, of which two are never equal, for derivatives that are done
        return operands[0]
    if isinstance(node, MultiIndex):
        return node
    if node._ufl_is_terminal_:
        return _known(node, known)
    if any(new is not old for new, old in zip(operands, node.ufl_operands, strict=True)):
        node = node._ufl_expr_reconstruct_(*operands)
    if isinstance(node, Division) and not isinstance(node.ufl_operands[0], ScalarValue):
        over, under = node.ufl_operands
        node = over * _known(1 / under, known)
    return _known(node, known)


def _known(node: Expr, known: dict[Any, Expr]) -> Expr:
    """The one object for an expression of such objects; itself where it has free indices."""
    if node._ufl_is_terminal_:
        return known.setdefault(node, node)
    return node if node.ufl_free_indices else known.setdefault(_key(node, {}), node)


def _key(node: Expr, names: dict[int, int]) -> tuple[Any, ...]:
    """What is the same for equal nodes, whatever their bound indices are called."""
    return (type(node), *(_key_of_part(operand, names) for operand in node.ufl_operands))


def _key_of_part(part: Expr, names: dict[int, int]) -> Any:
    if isinstance(part, MultiIndex):
        return tuple(
            ("at", int(index)) if isinstance(index, FixedIndex) else names.setdefault(index.count(), len(names))
            for index in part.indices()
        )
    return _key(part, names) if not part._ufl_is_terminal_ and part.ufl_free_indices else id(part)
