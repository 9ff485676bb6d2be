"""Sets of a foreign file as groups of facets and vertices of its solids."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.errors import MeshError, MeshWarning
from flexmbd.meshes.cell_faces import CORNERS, FACES, FaceTable, faces_of, padded
from flexmbd.meshes.foreign_mesh import ForeignMesh
from flexmbd.meshes.group_choice import chosen
from flexmbd.meshes.tetrahedra import Cells

IntArray = npt.NDArray[np.int64]


def rows_of(path: Path, what: str, ascending: IntArray, requested: IntArray) -> IntArray:
    """Where numbers stand in an ascending list.

    Raises:
        MeshError: one is not there.
    """
    rows = np.searchsorted(ascending, requested)
    rows[rows == len(ascending)] = 0
    missing = requested[ascending[rows] != requested]
    if len(missing) > 0:
        raise MeshError(f"{path}: {what} {missing[0]} is used and not given; the file is not complete")
    return rows.astype(np.int64)


def disjoint(
    kind: str, found: Mapping[str, IntArray], names: Collection[str] | None, *, path: Path,
    later: Sequence[Collection[str]], untold: Collection[str],
) -> dict[str, IntArray]:  # fmt: skip
    """The sets that become groups, of which no two share a member.

    Args:
        kind: "cell" or "facet".
        found: members of each set.
        names: those that were asked for; None for as many as do not overlap, small ones first.
        path: of the file, for messages.
        later: sets that give way to all others, those of the last collection last.
        untold: sets of which nothing is said where they give way.

    A set that holds a smaller one whole gives way to it untold: PrePoMax and gmsh write such.

    Raises:
        MeshError: sets that were asked for overlap, or are not there.
    """
    asked = chosen(kind, found, names, path)
    if names is not None:
        for one, other in combinations(asked, 2):
            if shared := len(np.intersect1d(asked[one], asked[other])):
                raise MeshError(
                    f"{path}: the sets {one!r} and {other!r} share {shared} {kind}s, and a {kind} is in one group "
                    f"only; name those to take: {kind}_groups=({one!r}, ...)"
                )
        return asked
    rank = {name: i for i, group in enumerate(later, start=1) for name in group}
    order = sorted(asked, key=lambda name: (rank.get(name, 0), len(asked[name])))
    taken: dict[str, IntArray] = {}
    union: IntArray = np.empty(0, dtype=np.int64)
    lost = []
    for name in order:
        inside = np.isin(asked[name], union)
        if not inside.any():
            taken[name] = asked[name]
            union = np.concatenate((union, asked[name]))
        elif name not in untold and any(_cross(asked[name], other) for other in taken.values()):
            lost.append(name)
    if lost:
        warnings.warn(
            f"{path}: {', '.join(map(repr, lost[:4]))}{', ...' if len(lost) > 4 else ''} share some {kind}s with other "
            f"sets and are no groups; name those to take: {kind}_groups=({lost[0]!r}, ...)",
            MeshWarning,
            stacklevel=2,
        )
    return {name: taken[name] for name in asked if name in taken}


def _cross(one: IntArray, other: IntArray) -> bool:
    """Whether each of two sets has members that the other has not, and both share some."""
    shared = len(np.intersect1d(one, other))
    return 0 < shared < min(len(one), len(other))


class FacetSets:
    """The sets of a file as facets or vertices of its solids."""

    def __init__(self, foreign: ForeignMesh, blocks: Sequence[Cells], numbers: IntArray) -> None:
        """Args: the file; its solids; the numbers of its nodes, ascending."""
        self._foreign, self._blocks, self._numbers = foreign, blocks, numbers
        self.faces = FaceTable([faces_of(one.cell, one.corners) for one in blocks], len(numbers))
        self._is_vertex = np.zeros(len(numbers), dtype=bool)
        for one in blocks:
            self._is_vertex[one.corners] = True
        self._nodes = {name: np.isin(numbers, held) for name, held in foreign.node_sets.items()}
        self.off: dict[str, int] = {}  # shells that lie on no solid, by the set

    def groups(self, names: Collection[str] | None) -> dict[str, IntArray]:
        """Numbers of the faces of each group."""
        foreign, path = self._foreign, self._foreign.path
        shells = {}
        for name in foreign.element_sets:
            lying, off = self._shells(name)
            if off:
                self.off[name] = off
                if names is not None and name in names and len(lying) > 0:
                    raise MeshError(
                        f"{path}: {off} of the {off + len(lying)} shells of the set {name!r} lie on no face of the "
                        "solids; mesh both together, or take another set"
                    )
            elif len(lying) > 0:
                shells[name] = lying
        outer = self.faces.rows[self.faces.is_outer]
        nodes = {}
        for name, inside in self._nodes.items():
            whole = inside[outer].all(axis=1) | (inside[outer[:, :3]].all(axis=1) & (outer[:, 3] < 0))
            if whole.any():
                nodes[name] = np.flatnonzero(self.faces.is_outer)[whole]
        found = dict(nodes) | shells
        for name in (*foreign.faces, *foreign.surfaces):
            if names is None or name in names:
                if len(held := self._surface(name, asked=names is not None)):
                    found[name] = held
            else:
                found.setdefault(name, np.empty(0, dtype=np.int64))
        order = [*foreign.surfaces, *foreign.faces, *shells, *nodes]
        found = {name: found[name] for name in dict.fromkeys(order) if name in found}
        only_nodes = [name for name in nodes if name not in shells and name not in {*foreign.faces, *foreign.surfaces}]
        return disjoint(
            "facet", found, names, path=path, later=(only_nodes, foreign.helpers), untold=(*nodes, *foreign.helpers)
        )

    def vertex_groups(self, *, without: Collection[str]) -> dict[str, IntArray]:
        """The sets of nodes that are not groups of facets, as vertices."""
        held = {
            name: np.flatnonzero(inside & self._is_vertex)[:, None]
            for name, inside in self._nodes.items()
            if name not in without
        }
        return {name: rows for name, rows in held.items() if len(rows) > 0}

    def _shells(self, name: str) -> tuple[IntArray, int]:
        """Faces that the shells of a set of elements lie on, and how many lie on none."""
        held = self._foreign.element_sets[name]
        found: list[IntArray] = [np.empty(0, dtype=np.int64)]
        off = 0
        for one in self._foreign.elements:
            inside = np.isin(one.numbers, held) if one.dim == 2 else np.zeros(1, dtype=bool)
            if inside.any():
                vertices = one.nodes[inside, : CORNERS[one.cell]]
                at = self.faces.numbers(padded(self._known(vertices)))
                found.append(at[at >= 0])
                off += int(np.count_nonzero(at < 0))
        return np.unique(np.concatenate(found)), off

    def _known(self, nodes: IntArray) -> IntArray:
        """Rows of nodes, -1 for those below zero."""
        rows = rows_of(self._foreign.path, "node", self._numbers, np.where(nodes < 0, self._numbers[0], nodes))
        return np.where(nodes < 0, -1, rows)

    def _surface(self, name: str, *, asked: bool) -> IntArray:
        """The faces of a surface; those that are on no solid of the part are left out where none was asked for."""
        path = self._foreign.path
        if name in self._foreign.faces:
            at = self.faces.numbers(self._known(self._foreign.faces[name]))
            if asked and (at < 0).any():
                raise MeshError(f"{path}: {np.count_nonzero(at < 0)} faces of {name!r} are on no solid of the part")
            return np.unique(at[at >= 0])
        rows: list[IntArray] = [np.empty((0, 4), dtype=np.int64)]
        every = np.unique(np.concatenate([one.numbers for one in self._foreign.elements]))
        for held, label in self._foreign.surfaces[name]:
            rows_of(path, "element", every, held)
            for one in self._blocks:
                inside = np.isin(one.numbers, held)
                if inside.any():
                    faces = FACES[one.cell]
                    if label not in {f"S{i}" for i in range(1, len(faces) + 1)}:
                        raise MeshError(
                            f"{path}: surface {name!r} has the face {label!r}; a {one.cell} has the faces S1 to "
                            f"S{len(faces)}"
                        )
                    rows.append(padded(one.corners[inside][:, list(faces[int(label[1:]) - 1])]))
        found = np.unique(self.faces.numbers(np.concatenate(rows)))
        if len(found) == 0 and asked:
            raise MeshError(f"{path}: surface {name!r} is empty")
        return found
