"""The body of matrices whose rows are components of Nastran's GRIDs, and SPOINTs: of DMIG, and of OP4 with a deck."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from flexmbd.errors import ExportError
from flexmbd.export.superelements.full_matrices import NodeSet
from flexmbd.export.superelements.matrix_text import Dof
from flexmbd.export.superelements.node_binding import (
    Interfaces,
    bound_nodes,
    node_sets,
    single_nodes,
    with_bound_nodes,
)
from flexmbd.export.superelements.superelement_frames import (
    FileComments,
    InterfaceNode,
    ReadMatrices,
    body_of,
    checked_size,
)
from flexmbd.files.nastran_grids import Grids
from flexmbd.record.groups import FloatArray
from flexmbd.record.reduced_body import ReducedBody

Matrices = tuple[FloatArray, FloatArray, FloatArray | None]


def nastran_body(
    path: str | Path,
    grids: Grids,
    dofs: Sequence[Dof],
    matrices: Matrices,
    *,
    ours: FileComments,
    interfaces: Interfaces | None,
    frame: str | None,
    units: str | None,
) -> ReducedBody:
    """The body of K, M and D.

    Args:
        path: of the file, for messages.
        grids: where they lie and along which axes they move.
        dofs: node and component (0 of SPOINTs) of each row.
        matrices: K, M and D.
        ours: what comments of a file of ours say.
        interfaces: as of `read_dmig`.
        frame: likewise.
        units: likewise.

    Raises:
        ExportError: rows are of no interface; positions or coordinate systems are missing; or as `body_of`.
    """
    sets = node_sets(interfaces)
    named = single_nodes(interfaces) or ({} if sets else dict(ours.interfaces))
    dofs, matrices = _moved(dofs, matrices)
    moved = _components(path, dofs)
    if not named and not sets:
        named = {
            f"grid {node}": InterfaceNode(None, node)
            for node in grids.rows
            if moved.get(node, set()) >= set(range(1, 7))
        }
    order = _order(path, dofs, named, sets)
    rows = [order[dof] for dof in dofs]
    K, M = (_placed(matrix, rows, len(order)) for matrix in matrices[:2])
    D = None if matrices[2] is None else _placed(matrices[2], rows, len(order))
    _check_moved(path, list(order)[: 6 * len(named)], (K, M))
    framed = {one.node for one in named.values()} | bound_nodes(sets)
    try:
        turns = {node: grids.axes(node) for node in framed & set(moved) if node in grids.rows}
        K, M, D = _in_basic_axes((K, M, D), order, turns)
        places = {node: grids.place(node) for node in grids.rows}
    except ValueError as error:
        raise ExportError(f"{path}: {error}") from error
    placed = {
        name: one if one.position is not None else InterfaceNode(places.get(one.node or 0), one.node, one.axes)
        for name, one in named.items()
    }
    bound = bound_nodes(sets)
    free = [(node, c) for node, c in list(order)[6 * len(named) :] if c == 0 or node not in bound]
    placed, (K, M, D) = with_bound_nodes(placed, (K, M, D), order, sets, places)
    K, M, D = _carried(path, (K, M, D), free, grids, frames=list(placed.values()))
    read = ReadMatrices(placed, K, M, D, frame=ours.frame, floating=ours.floating, units=ours.units)
    try:
        return body_of(read, path, interfaces=None, frame=frame, units=units)
    except ExportError as error:
        plain = sorted(node for node in moved if node in grids.rows and not grids.is_turned(node))
        if not plain or not grids.movers.any():
            raise
        raise ExportError(
            f"{error}. GRIDs {', '.join(map(str, plain[:8]))} have no CD, and others have one: where GRDSET gave it to "
            "them, add a line GRDSET,,,,,,CD to the deck"
        ) from error


def _moved(dofs: Sequence[Dof], matrices: Matrices) -> tuple[list[Dof], Matrices]:
    """Rows that have a stiffness or a mass: turns of a solid's nodes have none."""
    K, M, D = matrices
    kept = np.flatnonzero((K != 0.0).any(axis=1) | (M != 0.0).any(axis=1))
    grid = np.ix_(kept, kept)
    return [dofs[row] for row in kept], (K[grid], M[grid], None if D is None else D[grid])


def _components(path: str | Path, dofs: Sequence[Dof]) -> dict[int, set[int]]:
    """Components of each node."""
    moved: dict[int, set[int]] = {}
    for node, component in dofs:
        if component > 6:
            raise ExportError(f"{path}: component {component} of GRID {node}: there are 1 to 6, and 0 of SPOINTs")
        moved.setdefault(node, set()).add(component)
    return moved


def _order(
    path: str | Path, dofs: Sequence[Dof], named: Mapping[str, InterfaceNode], sets: Mapping[str, NodeSet]
) -> dict[Dof, int]:
    """Row of each degree of freedom: six of each interface, then all others by number."""
    nodes = {node for node, _ in dofs}
    order: dict[Dof, int] = {}
    for name, one in named.items():
        if one.node not in nodes:
            raise ExportError(f"{path} has no matrix entries of interface {name!r}, GRID {one.node}")
        if (one.node, 1) in order:
            raise ExportError(f"{path}: interface {name!r} is of GRID {one.node}, and so is another one")
        order |= {(one.node, c): len(order) + c - 1 for c in range(1, 7)}
    for dof in sorted(dofs):
        order.setdefault(dof, len(order))
    checked_size(len(order), path)
    return order


def _placed(matrix: FloatArray, rows: Sequence[int], size: int) -> FloatArray:
    whole = np.zeros((size, size))
    whole[np.ix_(rows, rows)] = matrix
    return whole


def _check_moved(path: str | Path, rows: Sequence[Dof], matrices: tuple[FloatArray, FloatArray]) -> None:
    """Refuse a component of an interface that neither stiffness nor mass knows, by name."""
    for row, (node, component) in enumerate(rows):
        if not any(np.any(matrix[row]) for matrix in matrices):
            raise ExportError(
                f"{path}: component {component} of GRID {node} has neither stiffness nor mass, and an interface has "
                "six components that move: hold it by an RBE2 or RBE3 of several nodes in the reduction, bind nodes "
                "of three components to a frame here (NodeSet), or leave the GRID out of interfaces"
            )


def _in_basic_axes(
    matrices: tuple[FloatArray, FloatArray, FloatArray | None],
    order: Mapping[Dof, int],
    turns: Mapping[int, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Matrices whose rows are along the basic axes, of rows along each node's own.

    Raises:
        ValueError: a node has some directions of its own alone, and is turned.
    """
    K, M, D = matrices
    turned = {node: R for node, R in turns.items() if not np.array_equal(R, np.eye(3))}
    if not turned:
        return K, M, D
    T = np.eye(len(order))
    for node, R in turned.items():
        for components in ((1, 2, 3), (4, 5, 6)):
            rows = [order[node, c] for c in components if (node, c) in order]
            if len(rows) == 3:
                T[np.ix_(rows, rows)] = R
            elif rows:
                raise ValueError(f"GRID {node} moves along some axes of its own coordinate system alone, not all three")
    return T @ K @ T.T, T @ M @ T.T, None if D is None else T @ D @ T.T


def _carried(
    path: str | Path, matrices: Matrices, free: Sequence[Dof], grids: Grids, *, frames: Sequence[InterfaceNode]
) -> Matrices:
    """Let components of GRIDs that are no interface stay free: their motions against the first frame become modes.

    Args:
        path: of the file.
        matrices: rows of the frames, six each, then those of `free`.
        free: nodes with components, 0 of SPOINTs.
        grids: where they lie, and along which axes they move.
        frames: the interfaces, in the basic axes.
    """
    if not any(component for _, component in free):
        return matrices
    T = np.eye(6 * len(frames) + len(free))
    for row, (node, component) in enumerate(free, start=6 * len(frames)):
        if component == 0:
            continue
        if not frames or frames[0].position is None:
            raise ExportError(
                f"{path}: component {component} of GRID {node} is of no interface of six components; name the GRID "
                "among the interfaces, bind it to a frame (NodeSet), or couple it to one (RBE2, RBE3) before the "
                "reduction"
            )
        try:
            R, arm = grids.axes(node), grids.place(node) - np.asarray(frames[0].position)
        except ValueError as error:
            raise ExportError(
                f"{path}: component {component} of GRID {node} is of no interface, and its place is unknown: {error}"
            ) from error
        axis = R[:, (component - 1) % 3]
        if component > 3:
            T[row, 3:6] = axis
        else:
            T[row, :3], T[row, 3:6] = axis, np.cross(arm, axis)
    K, M, D = matrices
    return T.T @ K @ T, T.T @ M @ T, None if D is None else T.T @ D @ T
