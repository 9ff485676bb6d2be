"""Nodes that another program retained, bound to rigid frames: of solids they have three displacements and no rotation.

K, M and D become T^T K T, where T says how each displacement follows the frames: that of a node at x, of a frame at p,
is u + theta x (x - p).  A body that Craig and Bampton's method reduced with these nodes as its boundary is then, to
round-off, the one that it gives with the rigid frames: the fixed-interface modes are the same, and static shapes add.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.superelements.full_matrices import NodeSet, frames_of
from flexmbd.export.superelements.matrix_text import Dof
from flexmbd.export.superelements.superelement_frames import InterfaceNode
from flexmbd.record.groups import FloatArray

#: Which interfaces a reader is given: nodes of six components, or sets of nodes to be bound.
Interfaces = Mapping[str, InterfaceNode | NodeSet]


def node_sets(interfaces: Interfaces | None) -> dict[str, NodeSet]:
    """The interfaces that are sets of nodes."""
    return {name: one for name, one in (interfaces or {}).items() if isinstance(one, NodeSet)}


def single_nodes(interfaces: Interfaces | None) -> dict[str, InterfaceNode]:
    """The others."""
    return {name: one for name, one in (interfaces or {}).items() if isinstance(one, InterfaceNode)}


def bound_nodes(sets: Mapping[str, NodeSet]) -> set[int]:
    """The numbers of all nodes that are bound."""
    return {int(node) for one in sets.values() for node in np.asarray(one.nodes).ravel()}


def with_bound_nodes(
    named: Mapping[str, InterfaceNode],
    matrices: tuple[FloatArray, FloatArray, FloatArray | None],
    order: Mapping[Dof, int],
    sets: Mapping[str, NodeSet],
    places: Mapping[int, FloatArray],
) -> tuple[dict[str, InterfaceNode], tuple[FloatArray, FloatArray, FloatArray | None]]:
    """Bind sets of nodes to frames, where there are any.

    Args:
        named: interfaces of six rows each, which the matrices begin with.
        matrices: K, M and D, with a row for each of ``order``.
        order: row of each node's component, 1 to 3 along and 4 to 6 about the file's axes; other rows are kept.
        sets: by the frames' names, in the file's axes and units.
        places: of the nodes by their numbers.

    Returns:
        All interfaces and the matrices: rows of the interfaces, six each, before those that are kept.

    Raises:
        ExportError: nodes are unknown, in one line, of two sets, or lack a displacement.
    """
    if not sets:
        return dict(named), matrices
    numbers = np.array(sorted(places), dtype=np.int64)
    x = np.array([places[int(number)] for number in numbers]).reshape(-1, 3)
    frames = frames_of(sets, numbers, x, length=1.0)
    n, first = len(order), 6 * len(named)
    T, kept = np.zeros((n, first + 6 * len(frames))), np.ones(n, dtype=bool)
    T[:first, :first], kept[:first] = np.eye(first), False
    for k, (name, frame) in enumerate(frames.items()):
        if frame.weights is not None:
            raise ExportError(
                f"interface {name!r}: nodes that another program retained are bound rigidly; an average of nodes "
                "(Coupling.AVERAGED) is taken of full matrices, by reduce_matrices"
            )
        begin = first + 6 * k
        for row in frame.rows:
            node = int(numbers[row])
            if any((node, c) not in order for c in (1, 2, 3)):
                raise ExportError(f"interface {name!r}: node {node} has not all three displacements in the matrices")
            moved = [order[node, c] for c in (1, 2, 3)]
            T[moved, begin : begin + 3] = np.eye(3)
            T[moved, begin + 3 : begin + 6] = np.cross(np.eye(3), x[row] - frame.p).T
            turned = [c for c in (4, 5, 6) if (node, c) in order]
            for c in turned:
                T[order[node, c], begin + c - 1] = 1.0
            kept[[*moved, *(order[node, c] for c in turned)]] = False
    whole = np.hstack([T, np.eye(n)[:, kept]])
    K, M, D = matrices
    found = whole.T @ K @ whole, whole.T @ M @ whole, None if D is None else whole.T @ D @ whole
    return {**named, **{name: InterfaceNode(frame.p, axes=frame.R) for name, frame in frames.items()}}, found
