"""Equal nodes of a UFL expression made one object, for all rooms that take derivatives of what a form's functions give.

UFL compares two nodes that are equal but not the same object down to their leaves, and once more at each node above
them: the time grows as if nothing was shared.  A form that computes a strain in two of its functions gives such nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from ufl.core.expr import Expr

Rebuild: TypeAlias = Callable[[Expr, tuple[Expr, ...]], Expr]
"""What a node becomes, whose operands have become those given."""


def share_nodes(expression: Expr) -> Expr:
    """The expression, in which nodes that UFL takes for equal are the same object; not collective.

    As UFL does where it finds two of them equal, the given expression itself is changed so.
    """
    known: dict[Any, Expr] = {}

    def one(node: Expr, operands: tuple[Expr, ...]) -> Expr:
        if node._ufl_is_terminal_:
            return known.setdefault(node, node)
        node.ufl_operands = operands
        return known.setdefault((type(node), *map(id, operands)), node)

    return rebuild(expression, one)


def rebuild(expression: Expr, node_for: Rebuild) -> Expr:
    """The expression with each node rebuilt once, those below it first; not collective."""
    done: dict[int, Expr] = {}
    waiting = [expression]
    while waiting:
        node = waiting[-1]
        below = [operand for operand in node.ufl_operands if id(operand) not in done]
        if below and id(node) not in done:
            waiting.extend(reversed(below))
            continue
        waiting.pop()
        if id(node) not in done:
            done[id(node)] = node_for(node, tuple(done[id(operand)] for operand in node.ufl_operands))
    return done[id(expression)]
