"""The solids of a foreign mesh and their groups, as an input of flexmbd's."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.node_order import NodeOrder, node_permutation
from flexmbd.errors import MeshError, MeshWarning
from flexmbd.meshes.cell_faces import CORNERS
from flexmbd.meshes.facet_sets import FacetSets, disjoint, rows_of
from flexmbd.meshes.foreign_mesh import ElementBlock, ForeignMesh
from flexmbd.meshes.group_choice import chosen
from flexmbd.meshes.one_piece import one_piece
from flexmbd.meshes.serendipity import complete
from flexmbd.meshes.tetrahedra import EDGES, Cells, cut_cells, cut_faces

IntArray = npt.NDArray[np.int64]

# Those that a mesh can be of.
_WHOLE = (("tetrahedron", 4), ("tetrahedron", 10), ("hexahedron", 8), ("hexahedron", 20), ("hexahedron", 27))


def solid_input(
    foreign: ForeignMesh,
    *,
    solids: Collection[str] | None = None,
    cell_groups: Collection[str] | None = None,
    facet_groups: Collection[str] | None = None,
    piece: int | None = None,
    tetrahedra: bool = False,
    named: bool = True,
) -> MeshInput:
    """The solid elements of a foreign mesh and its groups; not collective.

    Row i of the input is the file's node i + 1, or the i-th lowest where its numbers have gaps.

    Args:
        foreign: what the file holds.
        solids: names of the sets of solids that make the mesh; None for all solids.
        cell_groups: names of the sets of solids to take as groups; None for those that do not overlap.
        facet_groups: names of the surfaces, sets of shells and sets of nodes to take as groups of
            facets; None for those that do not overlap. Sets of nodes without a whole facet, or not taken,
            become groups of vertices.
        piece: of solids that fall into pieces that share no facet, the one to take, from 1, large ones first.
        tetrahedra: cut all cells into tetrahedra.
        named: whether a group of facets or vertices must be there.

    Raises:
        MeshError: there are no solids, or of several kinds; a number is missing or given twice; a
            name is not there; two groups that were asked for share some; there is no group of
            facets or vertices.
    """
    order = np.argsort(foreign.node_numbers, kind="stable")
    numbers = foreign.node_numbers[order]
    _check_numbers(foreign.path, "node", numbers)
    taken = _solids(foreign, solids)
    points = foreign.points[order]
    points, rows = _rows(foreign.path, taken, numbers, points)
    tags, cell_names = _cell_groups(foreign, np.concatenate([one.numbers for one in taken]), cell_groups)
    tags_of = np.split(tags, np.cumsum([len(one.numbers) for one in taken])[:-1])
    blocks = [
        Cells(one.cell, held, mine, one.numbers) for one, held, mine in zip(taken, rows, tags_of, strict=True)
    ]
    blocks = one_piece(foreign.path, points, blocks, piece)
    _check_middles(foreign.path, blocks, numbers, len(points))
    if not tetrahedra:
        _check_kinds(foreign.path, blocks)
    facets = FacetSets(foreign, blocks, numbers)
    found = facets.groups(facet_groups)
    vertices = facets.vertex_groups(without=found)
    if named and not found and not vertices:
        raise MeshError(
            f"{foreign.path}: there is no named set on the surface of the part; give each interface a "
            "surface, a set of nodes or of shell elements, or name it by its place: places={...}"
        )
    if solids is None and piece is None:
        _tell_left_out(foreign, facets.off)
    facet_rows = np.concatenate([np.empty((0, 4), dtype=np.int64), *(facets.faces.rows[at] for at in found.values())])
    facet_tags = np.repeat(np.arange(1, len(found) + 1), [len(at) for at in found.values()])
    if tetrahedra:
        points, cells = cut_cells(points, blocks)
        facet_rows, of = cut_faces(facet_rows)
        facet_tags = facet_tags[of]
    else:
        (only,) = blocks
        points, merged = complete(points, only.rows)
        cells = replace(only, rows=merged)
        facet_rows = facet_rows[:, : 3 if cells.cell == "tetrahedron" else 4]
    degree = 2 if cells.is_curved else 1
    return MeshInput(
        cell=cells.cell,
        degree=degree,
        points=points,
        cells=cells.rows[:, node_permutation(cells.cell, degree, NodeOrder.VTK)],
        cell_tags=cells.tags,
        cell_groups=cell_names,
        facets=facet_rows,
        facet_tags=facet_tags.astype(np.int32),
        facet_groups={name: tag for tag, name in enumerate(found, start=1)},
        vertex_groups=vertices,
        cell_numbers=cells.numbers,
    )


def _solids(foreign: ForeignMesh, solids: Collection[str] | None) -> list[ElementBlock]:
    """The solid elements of the part, a block of each kind."""
    blocks = [one for one in foreign.elements if one.dim == 3 and len(one.numbers) > 0]
    if not blocks:
        others = sorted({one.kind for one in foreign.elements}) + sorted(foreign.beside)
        raise MeshError(
            f"{foreign.path}: the mesh has no three-dimensional cells{', but ' + ', '.join(others) if others else ''}"
        )
    _check_numbers(foreign.path, "element", np.sort(np.concatenate([one.numbers for one in blocks])))
    if solids is not None:
        every = np.concatenate([one.numbers for one in blocks])
        sets = {name: held for name, held in foreign.element_sets.items() if np.isin(every, held).any()}
        taken = np.concatenate([np.empty(0, dtype=np.int64), *chosen("cell", sets, solids, foreign.path).values()])
        kept = [(one, np.isin(one.numbers, taken)) for one in blocks]
        blocks = [ElementBlock(one.kind, one.numbers[mask], one.nodes[mask]) for one, mask in kept if mask.any()]
    kinds = dict.fromkeys(one.kind for one in blocks)
    return [
        ElementBlock(
            kind,
            np.concatenate([one.numbers for one in blocks if one.kind == kind]),
            np.concatenate([one.nodes for one in blocks if one.kind == kind]),
        )
        for kind in kinds
    ]


def _check_kinds(path: Path, blocks: Sequence[Cells]) -> None:
    kinds = [(one.cell, one.rows.shape[1]) for one in blocks]
    if len(kinds) == 1 and kinds[0] in _WHOLE:
        return
    there, known = (
        ", ".join(f"{cell} of {width} nodes" for cell, width in sorted(some)) for some in (kinds, _WHOLE)
    )
    raise MeshError(
        f"{path}: the mesh has cells of the kinds {there}; all must be of one of these: {known}. "
        "tetrahedra=True cuts all into tetrahedra; solids=(...) takes the cells of some sets alone"
    )


def _check_numbers(path: Path, what: str, numbers: IntArray) -> None:
    """Refuse numbers, in ascending order, that are given twice."""
    twice = numbers[1:][numbers[1:] == numbers[:-1]]
    if len(twice) > 0:
        raise MeshError(
            f"{path}: {what} {twice[0]} is given more than once ({len(twice)} such numbers); a file "
            "must hold one part, each number once"
        )


def _check_middles(path: Path, blocks: Sequence[Cells], numbers: IntArray, n: int) -> None:
    """Refuse an edge with two middles and a middle of two edges, of which DOLFINx would ruin its memory."""
    edges: list[IntArray] = [np.empty((0, 3), dtype=np.int64)]
    for one in (one for one in blocks if one.is_curved):
        for i, (a, b) in enumerate(EDGES[one.cell], start=CORNERS[one.cell]):
            edges.append(np.column_stack((np.sort(one.rows[:, [a, b]], axis=1), one.rows[:, i])))
    every = np.concatenate(edges)
    keys, middles = every[:, 0] * n + every[:, 1], every[:, 2]
    order = np.lexsort((middles, keys))
    keys, middles = keys[order], middles[order]
    double = np.flatnonzero((keys[1:] == keys[:-1]) & (middles[1:] != middles[:-1]))
    by_middle = np.lexsort((keys, middles))
    also = np.flatnonzero(
        (middles[by_middle][1:] == middles[by_middle][:-1]) & (keys[by_middle][1:] != keys[by_middle][:-1])
    )
    corner = np.isin(middles, np.concatenate([one.corners.reshape(-1) for one in blocks]))
    called = np.append(numbers, np.zeros(n - len(numbers), dtype=np.int64))
    if len(double) > 0:
        pair = called[middles[double[0] : double[0] + 2]].tolist()
        fault = f"{len(double)} edges have two nodes in their middle, one of them {pair[0]} and {pair[1]}"
    elif len(also) > 0:
        fault = f"{len(also)} nodes are in the middle of two edges, one of them {called[middles[by_middle][also[0]]]}"
    elif corner.any():
        fault = f"node {called[middles[corner.argmax()]]} is in the middle of an edge and a corner"
    else:
        return
    raise MeshError(f"{path}: {fault}; the nodes of some elements are in another order than that of their kind")


def _rows(
    path: Path, solids: Sequence[ElementBlock], numbers: IntArray, points: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], list[IntArray]]:
    """Cells as rows of points; middles that are not there lie halfway, or are those of a neighbour."""
    lacking = [(one.nodes == 0) & (np.arange(one.nodes.shape[1]) >= CORNERS[one.cell]) for one in solids]
    rows = [
        rows_of(path, "node", numbers, np.where(lack, numbers[0], one.nodes))
        for one, lack in zip(solids, lacking, strict=True)
    ]
    if not any(lack.any() for lack in lacking):
        return points, rows
    n = len(points)
    own: dict[tuple[int, int], int] = {}
    for fill in (False, True):
        for one, held, lack in zip(solids, rows, lacking, strict=True):
            for i, (a, b) in enumerate(EDGES[one.cell], start=CORNERS[one.cell]):
                if i < held.shape[1] and (lack.any() or not fill):
                    low_rows, high_rows = np.sort(held[:, [a, b]], axis=1).T
                    for row, (low, high) in enumerate(zip(map(int, low_rows), map(int, high_rows), strict=True)):
                        if not fill and not lack[row, i]:
                            own[low, high] = int(held[row, i])
                        elif fill and lack[row, i]:
                            held[row, i] = own.setdefault((low, high), n + len(own))
    new = sorted((at, edge) for edge, at in own.items() if at >= n)
    where = {at: n + i for i, (at, _) in enumerate(new)}
    for held in rows:
        above = held >= n
        held[above] = [where[int(at)] for at in held[above]]
    middles = points[[edge for _, edge in new]].mean(axis=1) if new else points[:0]
    return np.vstack((points, middles)), rows


def _cell_groups(
    foreign: ForeignMesh, cells: IntArray, names: Collection[str] | None
) -> tuple[npt.NDArray[np.int32], dict[str, int]]:
    inside = {name: np.flatnonzero(np.isin(cells, held)) for name, held in foreign.element_sets.items()}
    inside = {name: rows for name, rows in inside.items() if len(rows) > 0}
    helpers = foreign.helpers
    taken = disjoint("cell", inside, names, path=foreign.path, later=(helpers,), untold=helpers)
    tags = np.zeros(len(cells), dtype=np.int32)
    groups = {name: tag for tag, name in enumerate(taken, start=1)}
    for name, tag in groups.items():
        tags[taken[name]] = tag
    return tags, groups


def _tell_left_out(foreign: ForeignMesh, off: Mapping[str, int]) -> None:
    """Tell of what bears or weighs and is no part of a mesh of solids."""
    beside = [f"{count} {kind}" for kind, count in foreign.beside.items()]
    if off:
        names = ", ".join(map(repr, list(off)[:4])) + (", ..." if len(off) > 4 else "")
        beside.append(f"{sum(off.values())} shells that lie on no solid (of {names})")
    if beside:
        warnings.warn(
            f"{foreign.path}: beside the solids there are {', '.join(beside)}, which are left out; where that is "
            "meant, name the solids: solids=(...)",
            MeshWarning,
            stacklevel=2,
        )
