"""A whole mesh on one rank, divided into pieces with faces in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import geometry_degree
from flexmbd.continuum.grid import cell_graph
from flexmbd.continuum.grid.mesh_blocks import mesh_blocks, numbered
from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.predicate import Predicate
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

#: Which cells a region has: those whose middle is where a function of points says, or of named cell groups.
Region = Predicate | str | Sequence[str]


@dataclass(frozen=True)
class Cut:
    """A face where two pieces meet: a facet group of both, with the same nodes at the same places.

    Attributes:
        name: of the group on either side.
        pieces: names of the two.
        p: (3,) m, its centre, in the mesh's axes.
        area: m^2 (of a shell the length of its edges, m).
        facets: how many.
    """

    name: str
    pieces: tuple[str, str]
    p: tuple[float, float, float]
    area: float
    facets: int


@dataclass(frozen=True)
class PieceSummary:
    """The properties of a piece that `CutMesh.explain` prints.

    Attributes:
        yielding: whether it may yield.
        cells: how many.
        low: (3,) m, least coordinates.
        high: (3,) m, largest ones.
    """

    yielding: bool
    cells: int
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class WholeMesh:
    """A whole mesh as its input listed it; on rank 0, empty arrays elsewhere.

    Attributes:
        cell: basix's name of the cells.
        dim: of the cells.
        degree: of the geometry.
        arrays: those of `mesh_blocks`.
        groups: tags by name, of "cell", "facet", "edge" and "vertex".
    """

    cell: str
    dim: int
    degree: int
    arrays: Mapping[str, NDArray]
    groups: Mapping[str, Mapping[str, int]]

    @classmethod
    def of(cls, mesh: TaggedMesh) -> WholeMesh:
        """Gather a mesh. Collective."""
        arrays = {name: parallel.gather_rows(mesh.comm, block) for name, block in mesh_blocks(mesh)}
        return cls(
            mesh.mesh.topology.cell_name(),
            mesh.dim,
            geometry_degree(mesh.mesh),
            {name: np.empty(0) if array is None else array for name, array in arrays.items()},
            {
                "cell": mesh.cell_groups,
                "facet": mesh.facet_groups,
                "edge": numbered(mesh.edge_groups),
                "vertex": numbered(mesh.vertex_groups),
            },
        )

    @property
    def middles(self) -> FloatArray:
        """(m, 3) m, mean of each cell's vertices."""
        vertices = len(cell_graph.entity_table(self.cell, 0))
        return self.arrays["points"][self.arrays["cells"][:, :vertices]].mean(axis=1)

    def chosen(self, name: str, region: Region) -> NDArray[np.bool_]:
        """Which cells a region has (m,)."""
        m = len(self.arrays["cells"])
        if not callable(region):
            groups = [region] if isinstance(region, str) else list(region)
            for group in groups:
                if group not in self.groups["cell"]:
                    there = ", ".join(map(repr, sorted(self.groups["cell"]))) or "none"
                    raise MeshError(f"region {name!r}: the mesh has no cell group {group!r}; it has: {there}")
            return np.isin(self.arrays["cell_tags"], [self.groups["cell"][group] for group in groups])
        try:
            inside = np.asarray(region(self.middles.T))
        except Exception as error:
            raise MeshError(f"region {name!r}: its function raised {type(error).__name__}: {error}") from error
        if inside.shape != (m,) or inside.dtype != np.bool_:
            raise MeshError(
                f"region {name!r}: its function of points (3, n) must return n truth values, got {inside.dtype} "
                f"{inside.shape} for n = {m}"
            )
        return inside


@dataclass(frozen=True, eq=False)
class Division:
    """A mesh divided, on rank 0.

    Attributes:
        whole: the mesh.
        names: of the pieces.
        yielding: names of those that may yield.
        piece: (m,) number of each cell's piece.
        cuts: between them.
        cut_facets: (f, v) of each cut.
        fragments: as in `CutMesh`.
    """

    whole: WholeMesh
    names: tuple[str, ...]
    yielding: tuple[str, ...]
    piece: IntArray
    cuts: tuple[Cut, ...]
    cut_facets: tuple[IntArray, ...]
    fragments: int

    def summaries(self) -> dict[str, PieceSummary]:
        """The summary of each piece."""
        found = {}
        for number, name in enumerate(self.names):
            cells = self.whole.arrays["cells"][self.piece == number]
            x = self.whole.arrays["points"][np.unique(cells)]
            low, high = (tuple(ends.tolist()) for ends in (x.min(axis=0), x.max(axis=0)))
            found[name] = PieceSummary(name in self.yielding, len(cells), low, high)
        return found

    def share(self, number: int) -> MeshInput:
        """All of a piece's mesh, rows of points counted anew in their old order."""
        whole, arrays = self.whole, self.whole.arrays
        mine = self.piece == number
        cells = arrays["cells"][mine]
        used = np.unique(cells)
        facets, facet_tags, facet_groups = self._facets(number)
        tags = arrays["cell_tags"][mine]
        lower = {
            kind: {
                name: np.searchsorted(used, rows)
                for name, tag in whole.groups[kind].items()
                if len(rows := self._held(arrays[array][arrays[f"{kind}_tags"] == tag], number, dim)[0]) > 0
            }
            for kind, array, dim in (("edge", "edges", 1), ("vertex", "vertices", 0))
        }
        return MeshInput(
            cell=whole.cell,
            degree=whole.degree,
            points=arrays["points"][used],
            cells=np.searchsorted(used, cells),
            cell_tags=tags,
            cell_groups={name: tag for name, tag in whole.groups["cell"].items() if (tags == tag).any()},
            facets=np.searchsorted(used, facets),
            facet_tags=facet_tags,
            facet_groups=facet_groups,
            edge_groups=lower["edge"],
            vertex_groups=lower["vertex"],
        )

    def _held(self, rows: IntArray, number: int, dim: int) -> tuple[IntArray, NDArray[np.bool_]]:
        """Those of some entities (e, v) that cells of a piece have, and which they are."""
        held = np.zeros(len(rows), dtype=bool)
        cells = self.whole.arrays["cells"][self.piece == number]
        held[cell_graph.owners(rows, cells, cell_graph.entity_table(self.whole.cell, dim))[0]] = True
        return rows[held], held

    def _facets(self, number: int) -> tuple[IntArray, NDArray[np.int32], dict[str, int]]:
        """Facets in groups, the cuts' among them, their tags and the tags' names."""
        arrays, groups = self.whole.arrays, self.whole.groups["facet"]
        outer, held = self._held(arrays["facets"], number, self.whole.dim - 1)
        tags = arrays["facet_tags"][held]
        named = {name: tag for name, tag in groups.items() if (tags == tag).any()}
        first = max(groups.values(), default=0) + 1
        mine = [i for i, cut in enumerate(self.cuts) if self.names[number] in cut.pieces]
        rows = [outer, *(self.cut_facets[i] for i in mine)]
        new = [np.full(len(self.cut_facets[i]), first + i) for i in mine]
        named |= {self.cuts[i].name: first + i for i in mine}
        return np.concatenate(rows), np.concatenate([tags, *new]).astype(np.int32), named


def divide(whole: WholeMesh, regions: Mapping[str, Region]) -> Division:
    """Cells to pieces, and the cuts; on rank 0."""
    cells, points = whole.arrays["cells"], whole.arrays["points"]
    names = list(regions)
    chosen_labels = _labels(whole, regions)
    pairs = cell_graph.neighbours(cells, whole.cell, whole.dim)
    by_groups = all(not callable(region) for region in regions.values())
    labels = chosen_labels if by_groups else cell_graph.merge_fragments(chosen_labels, pairs, whole.cell)
    count, piece = cell_graph.pieces_of(labels, pairs)
    label = np.zeros(count, dtype=np.int64)
    label[piece] = labels
    sizes = np.bincount(piece, minlength=count)
    for i, name in enumerate(names, start=1):
        several = sizes[label == i]
        if len(several) != 1:
            raise MeshError(
                f"region {name!r} falls into {len(several)} pieces of {', '.join(map(str, several))} cells that share "
                "no facet; give each a name of its own"
            )
    middles = whole.middles
    order = cell_graph.along_part([middles[piece == i].mean(axis=0) for i in range(count)])
    rank = np.argsort(order)
    rests = iter(range(1, count + 1))
    in_order = tuple(names[label[i] - 1] if label[i] else f"rest {next(rests)}" for i in order)
    cuts, facets = _cuts(rank[piece], in_order, pairs, points)
    taken = {cut.name for cut in cuts} & set(whole.groups["facet"])
    if taken or len(set(in_order)) < count:
        raise MeshError(
            f"rename these regions or groups of the mesh, whose names cuts and remainders get: {in_order}, {taken}"
        )
    return Division(whole, in_order, tuple(names), rank[piece], cuts, facets, int((labels != chosen_labels).sum()))


def _labels(whole: WholeMesh, regions: Mapping[str, Region]) -> IntArray:
    """(m,) number of each cell's region, from 1, and 0 for the rest."""
    if not regions:
        raise MeshError("cut_mesh needs a region that may yield")
    labels = np.zeros(len(whole.arrays["cells"]), dtype=np.int64)
    for number, (name, region) in enumerate(regions.items(), start=1):
        inside = whole.chosen(name, region)
        if not inside.any():
            raise MeshError(f"region {name!r}: no cell has its centre in the region")
        if (labels[inside] > 0).any():
            other = list(regions)[int(labels[inside].max()) - 1]
            raise MeshError(f"regions {other!r} and {name!r} have {(labels[inside] > 0).sum()} cells in common")
        labels[inside] = number
    if len(regions) == 1 and labels.all():
        raise MeshError(f"region {next(iter(regions))!r} is all of the mesh: there is nothing to cut")
    return labels


def _cuts(
    piece: IntArray, names: Sequence[str], pairs: cell_graph.Neighbours, points: FloatArray
) -> tuple[tuple[Cut, ...], tuple[IntArray, ...]]:
    """The cuts between pieces, connected ones each by itself, and their facets."""
    between = pairs.take(piece[pairs.a] != piece[pairs.b])
    ends = np.sort(np.column_stack([piece[between.a], piece[between.b]]), axis=1)
    cuts, facets = [], []
    for low, high in np.unique(ends, axis=0):
        rows = between.facets[(ends == (low, high)).all(axis=1)]
        for i, patch in enumerate(cell_graph.patches(rows), start=1):
            several = f" ({i})" if i > 1 else ""
            area, centre = cell_graph.area_and_centre(rows[patch], points)
            p = (float(centre[0]), float(centre[1]), float(centre[2]))
            name = f"{names[low]}/{names[high]}{several}"
            cuts.append(Cut(name, (names[low], names[high]), p, area, len(patch)))
            facets.append(rows[patch])
    return tuple(cuts), tuple(facets)
