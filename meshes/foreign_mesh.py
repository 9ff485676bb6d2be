"""Meshes of other finite element programs, turned into flexmbd's.

Such files number nodes and elements as they like, and name sets of either; a set of elements may hold
solids, shells on their faces, or both.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

import basix
import numpy as np
import numpy.typing as npt

from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.node_order import NodeOrder, node_permutation
from flexmbd.errors import MeshError
from flexmbd.meshes.group_choice import chosen
from flexmbd.meshes.serendipity import complete

IntArray = npt.NDArray[np.int64]

# Kinds of elements, by meshio's names: cell, degree of the geometry, dimension.
KINDS = {
    "tetra": ("tetrahedron", 1, 3),
    "tetra10": ("tetrahedron", 2, 3),
    "hexahedron": ("hexahedron", 1, 3),
    "hexahedron20": ("hexahedron", 2, 3),
    "triangle": ("triangle", 1, 2),
    "triangle6": ("triangle", 2, 2),
    "quad": ("quadrilateral", 1, 2),
    "quad8": ("quadrilateral", 2, 2),
    "quad9": ("quadrilateral", 2, 2),
}

# The faces S1, S2, ... of Abaqus and CalculiX, by the vertices of a cell in VTK's order.
_FACES = {
    "tetrahedron": ("012", "013", "123", "023"),
    "hexahedron": ("0123", "4567", "0145", "1256", "2367", "0347"),
}


@dataclass(frozen=True, eq=False)
class ElementBlock:
    """Elements of one kind.

    Attributes:
        kind: meshio's name.
        numbers: (m,) the file's numbers of them.
        nodes: (m, k) the file's numbers of their nodes, in VTK's order.
    """

    kind: str
    numbers: IntArray
    nodes: IntArray


@dataclass(frozen=True, eq=False)
class ForeignMesh:
    """A file's nodes, elements and sets, by the file's own numbers.

    Attributes:
        path: of the file, for messages.
        node_numbers: (n,) in any order.
        points: (n, 3) coordinates, in the file's unit.
        elements: of one kind each; kinds that are not in `KINDS` are solids that cannot be read.
        element_sets: numbers of elements, by name.
        node_sets: numbers of nodes, by name.
        surfaces: by name, numbers of elements with the label of one face of each, as "S1".
    """

    path: Path
    node_numbers: IntArray
    points: npt.NDArray[np.float64]
    elements: Sequence[ElementBlock]
    element_sets: Mapping[str, IntArray]
    node_sets: Mapping[str, IntArray] = field(default_factory=dict)
    surfaces: Mapping[str, Sequence[tuple[IntArray, str]]] = field(default_factory=dict)


def solid_input(
    foreign: ForeignMesh,
    *,
    cell_groups: Collection[str] | None,
    facet_groups: Collection[str] | None,
) -> MeshInput:
    """The solid elements of a foreign mesh and its groups; not collective.

    Row i of the input is the file's node i + 1, or the i-th lowest where its numbers have gaps.

    Args:
        foreign: what the file holds.
        cell_groups: names of the sets of solids to take; None for all.
        facet_groups: names of the surfaces, sets of shells and sets of nodes to take as groups of
            facets; None for all. Sets of nodes without a whole facet, or not taken, become groups of
            vertices.

    Raises:
        MeshError: there are no solids, or of several kinds; a number is missing or given twice; a
            name is not there; two groups of cells or of facets share some; there is no group of
            facets or vertices.
    """
    _check_names(foreign)
    order = np.argsort(foreign.node_numbers, kind="stable")
    numbers = foreign.node_numbers[order]
    _check_numbers(foreign.path, "node", numbers)
    cells = _solids(foreign)
    cell, degree, _ = KINDS[cells.kind]
    rows = _rows(foreign.path, "node", numbers, cells.nodes)
    corners = rows[:, : len(basix.geometry(basix.CellType[cell]))]
    cell_tags, cell_names = _cell_groups(foreign, cells, cell_groups)
    facets = _FacetSets(foreign, cells, cell, corners, numbers)
    facet_rows, facet_tags, facet_names = facets.groups(facet_groups)
    vertices = facets.vertex_groups(without=facet_names)
    if not facet_names and not vertices:
        raise MeshError(
            f"{foreign.path}: there is no named set on the surface of the part; give each interface a "
            "surface, a set of nodes or of shell elements"
        )
    points, rows = complete(foreign.points[order], rows, cells.kind)
    return MeshInput(
        cell=cell,
        degree=degree,
        points=points,
        cells=rows[:, node_permutation(cell, degree, NodeOrder.VTK)],
        cell_tags=cell_tags,
        cell_groups=cell_names,
        facets=facet_rows,
        facet_tags=facet_tags,
        facet_groups=facet_names,
        vertex_groups=vertices,
        cell_numbers=cells.numbers,
    )


def _check_names(foreign: ForeignMesh) -> None:
    kinds = [one.kind for one in foreign.elements if KINDS.get(one.kind, ("", 0, 3))[2] == 3]
    known = [kind for kind, (_, _, dim) in KINDS.items() if dim == 3]
    if not kinds:
        raise MeshError(f"{foreign.path}: the mesh has no three-dimensional cells")
    if len(set(kinds)) > 1 or kinds[0] not in known:
        raise MeshError(
            f"{foreign.path}: the mesh has cells of the kinds {', '.join(sorted(set(kinds)))}; all must "
            f"be of one of these: {', '.join(known)}"
        )


def _solids(foreign: ForeignMesh) -> ElementBlock:
    """All solid elements, which are of one kind."""
    parts = [one for one in foreign.elements if KINDS[one.kind][2] == 3]
    numbers = np.concatenate([one.numbers for one in parts])
    _check_numbers(foreign.path, "element", np.sort(numbers))
    return ElementBlock(parts[0].kind, numbers, np.concatenate([one.nodes for one in parts]))


def _check_numbers(path: Path, what: str, numbers: IntArray) -> None:
    """Refuse numbers, in ascending order, that are given twice."""
    twice = numbers[1:][numbers[1:] == numbers[:-1]]
    if len(twice) > 0:
        raise MeshError(
            f"{path}: {what} {twice[0]} is given more than once ({len(twice)} such numbers); a file "
            "must hold one part, each number once"
        )


def _rows(path: Path, what: str, numbers: IntArray, requested: IntArray) -> IntArray:
    """Where numbers stand in an ascending list."""
    rows = np.searchsorted(numbers, requested)
    rows[rows == len(numbers)] = 0
    missing = requested[numbers[rows] != requested]
    if len(missing) > 0:
        raise MeshError(f"{path}: {what} {missing[0]} is used and not given; the file is not complete")
    return rows.astype(np.int64)


def _cell_groups(
    foreign: ForeignMesh, cells: ElementBlock, names: Collection[str] | None
) -> tuple[npt.NDArray[np.int32], dict[str, int]]:
    inside = {name: np.isin(cells.numbers, held) for name, held in foreign.element_sets.items()}
    inside = {name: mask for name, mask in inside.items() if mask.any()}
    taken = chosen("cell", inside, names, foreign.path)
    for one, other in combinations(taken, 2):
        if (shared := int((inside[one] & inside[other]).sum())) > 0:
            raise _overlap(foreign.path, "cell", one, other, shared)
    tags = np.zeros(len(cells.numbers), dtype=np.int32)
    groups = {name: tag for tag, name in enumerate(taken, start=1)}
    for name, tag in groups.items():
        tags[inside[name]] = tag
    return tags, groups


def _overlap(path: Path, kind: str, one: str, other: str, shared: int) -> MeshError:
    return MeshError(
        f"{path}: the sets {one!r} and {other!r} share {shared} {kind}s, and a {kind} is in one group "
        f"only; name those to take: {kind}_groups=({one!r}, ...)"
    )


class _FacetSets:
    """The sets of a file as facets or vertices of its solids."""

    def __init__(
        self, foreign: ForeignMesh, cells: ElementBlock, cell: str, corners: IntArray, numbers: IntArray
    ) -> None:
        self._foreign, self._cells, self._cell = foreign, cells, cell
        self._corners, self._numbers = corners, numbers
        self._order = np.argsort(cells.numbers)
        faces = _FACES[cell]
        every = np.concatenate([corners[:, [int(i) for i in face]] for face in faces])
        _, first, count = np.unique(
            np.sort(every, axis=1), axis=0, return_index=True, return_counts=True
        )
        self._boundary = every[np.sort(first[count == 1])]
        self._is_vertex = np.zeros(len(numbers), dtype=bool)
        self._is_vertex[corners] = True
        self._nodes = {name: self._members(held) for name, held in foreign.node_sets.items()}

    def groups(
        self, names: Collection[str] | None
    ) -> tuple[IntArray, npt.NDArray[np.int32], dict[str, int]]:
        """Vertices and tags of the facets of all groups, and the groups' tags."""
        shells = {
            name: rows for name in self._foreign.element_sets if len(rows := self._shells(name)) > 0
        }
        nodes = {
            name: rows
            for name, inside in self._nodes.items()
            if len(rows := self._boundary[inside[self._boundary].all(axis=1)]) > 0
        }
        there = dict.fromkeys([*self._foreign.surfaces, *shells, *nodes])
        found = {}
        for name in chosen("facet", there, names, self._foreign.path):
            if name in self._foreign.surfaces:
                found[name] = self._surface(name)
            else:
                found[name] = shells[name] if name in shells else nodes[name]
        self._check_apart(found)
        width = self._boundary.shape[1]
        rows = np.concatenate([np.empty((0, width), dtype=np.int64), *found.values()])
        tags = np.repeat(np.arange(1, len(found) + 1), [len(part) for part in found.values()])
        return rows, tags.astype(np.int32), {name: tag for tag, name in enumerate(found, start=1)}

    def vertex_groups(self, *, without: Collection[str]) -> dict[str, IntArray]:
        """The sets of nodes that are not groups of facets, as vertices."""
        held = {
            name: np.flatnonzero(inside & self._is_vertex)[:, None]
            for name, inside in self._nodes.items()
            if name not in without
        }
        return {name: rows for name, rows in held.items() if len(rows) > 0}

    def _members(self, held: IntArray) -> npt.NDArray[np.bool_]:
        """Which rows are in a set of nodes, of which some may be of no cell."""
        return np.isin(self._numbers, held)

    def _shells(self, name: str) -> IntArray:
        """Vertices of the shells of a set of elements."""
        width = self._boundary.shape[1]
        held, rows = self._foreign.element_sets[name], [np.empty((0, width), dtype=np.int64)]
        for one in self._foreign.elements:
            cell, _, dim = KINDS[one.kind]
            corners = len(basix.geometry(basix.CellType[cell]))
            inside = np.isin(one.numbers, held)
            if dim != 2 or not inside.any():
                continue
            if corners != width:
                raise MeshError(
                    f"{self._foreign.path}: the set {name!r} has shells of {corners} vertices, and the "
                    f"faces of the cells have {width}; mesh both together"
                )
            vertices = one.nodes[inside, :corners]
            rows.append(_rows(self._foreign.path, "node", self._numbers, vertices))
        return np.concatenate(rows)

    def _surface(self, name: str) -> IntArray:
        """Vertices of the faces of a surface."""
        path, faces = self._foreign.path, _FACES[self._cell]
        rows = [np.empty((0, self._boundary.shape[1]), dtype=np.int64)]
        for held, label in self._foreign.surfaces[name]:
            if label not in {f"S{i}" for i in range(1, len(faces) + 1)}:
                raise MeshError(
                    f"{path}: surface {name!r} has the face {label!r}; a {self._cell} has the faces S1 to "
                    f"S{len(faces)}"
                )
            numbers = self._cells.numbers[self._order]
            cells = self._order[_rows(path, "element", numbers, held)]
            rows.append(self._corners[cells][:, [int(i) for i in faces[int(label[1:]) - 1]]])
        found = np.concatenate(rows)
        if len(found) == 0:
            raise MeshError(f"{path}: surface {name!r} is empty")
        return found

    def _check_apart(self, found: Mapping[str, IntArray]) -> None:
        """Refuse groups that share facets."""
        keys = {
            name: {row.tobytes() for row in np.sort(rows, axis=1)} for name, rows in found.items()
        }
        for one, other in combinations(found, 2):
            if shared := len(keys[one] & keys[other]):
                raise _overlap(self._foreign.path, "facet", one, other, shared)
