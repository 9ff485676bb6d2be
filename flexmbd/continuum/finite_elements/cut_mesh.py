"""Cutting a part: one mesh becomes the regions that may yield and the elastic remainders between them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from flexmbd.brief import brief
from flexmbd.continuum import parallel
from flexmbd.continuum.finite_elements.interface import Interface
from flexmbd.continuum.grid.mesh_division import Cut, Division, PieceSummary, Region, WholeMesh, divide
from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.coupling import Coupling
from flexmbd.errors import MeshError
from flexmbd.given import checked


@dataclass(frozen=True, eq=False)
class CutMesh:
    """The pieces of a part, in their order along it.

    Attributes:
        pieces: by name the meshes: the regions by the names they were given, the connected remainders "rest 1",
            "rest 2" and on.  Groups of the whole mesh are kept as far as they lie in the piece.
        cuts: where they meet.
        summaries: of each piece.
        fragments: cells that a cut separated from their piece, and that were given to the neighbouring one.
    """

    pieces: Mapping[str, TaggedMesh]
    cuts: tuple[Cut, ...]
    summaries: Mapping[str, PieceSummary]
    fragments: int

    __repr__ = brief

    @property
    def yielding(self) -> tuple[str, ...]:
        """Names of the pieces that may yield."""
        return tuple(name for name, one in self.summaries.items() if one.yielding)

    @property
    def elastic(self) -> tuple[str, ...]:
        """Names of the others."""
        return tuple(name for name, one in self.summaries.items() if not one.yielding)

    @checked(error=MeshError)
    def interfaces(self, piece: str, *, coupling: Coupling = Coupling.RIGID) -> list[Interface]:
        """The frames of a piece at its cuts, which lie together with those of its neighbours.

        Args:
            piece: its name.
            coupling: how the frames hold the faces.

        Raises:
            MeshError: there is no such piece.
        """
        if piece not in self.pieces:
            raise MeshError(f"no piece {piece!r}; there are: {', '.join(map(repr, self.pieces))}")
        return [Interface(cut.name, origin=cut.p, coupling=coupling) for cut in self.cuts if piece in cut.pieces]

    def explain(self) -> str:
        """Which parts are which: names, kinds, cells, places, and the cuts between them."""
        width = max(map(len, [*self.pieces, *(cut.name for cut in self.cuts)]))
        lines = [f"{len(self.pieces)} pieces, {len(self.cuts)} cuts"]
        for name, one in self.summaries.items():
            ends = zip("xyz", one.low, one.high, strict=True)
            box = ", ".join(f"{axis} {_shown(a)} to {_shown(b)}" for axis, a, b in ends)
            kind = "may yield" if one.yielding else "elastic"
            lines.append(f"  {name:{width}}  {kind:9}  {one.cells} cells, {box} m")
        for cut in self.cuts:
            centre = ", ".join(map(_shown, cut.p))
            size = f"{cut.facets} facets, {cut.area:.4g} m^2"
            lines.append(f"  {cut.name:{width}}  cut        {size} around ({centre}) m")
        if self.fragments:
            lines.append(f"  {self.fragments} cells that a cut separated went to their neighbours")
        return "\n".join(lines)


def _shown(length: float) -> str:
    return f"{round(length, 12) + 0.0:.4g}"


@checked("mesh", "regions", error=MeshError, agree=parallel.told_to_all)
def cut_mesh(mesh: TaggedMesh, regions: Mapping[str, Region]) -> CutMesh:
    """Cut a part into the regions that may yield and each connected elastic remainder. Collective.

    Cuts run along the faces of cells: a cell is in a region with its middle.  Rank 0 holds the whole mesh for a
    while; every piece is then spread over all ranks.

    Args:
        mesh: the part.
        regions: by name, the regions that may yield, as functions of points (3, n), such as a `Slab`, or names of
            groups of cells; the same on all ranks, each connected, and no two with a cell in common.

    Raises:
        MeshError: on all ranks; a region is empty, unknown, in pieces or all of the mesh, two overlap, a function
            fails, or the name of a cut is one of a facet group.
    """
    comm = mesh.comm
    described = [(name, _described(region)) for name, region in regions.items()]
    parallel.check_same(comm, MeshError, regions=described)
    whole = WholeMesh.of(mesh)
    found: Division | None = None

    def run() -> tuple[tuple[str, ...], tuple[Cut, ...], dict[str, PieceSummary], int]:
        nonlocal found
        found = divide(whole, regions)
        return found.names, found.cuts, found.summaries(), found.fragments

    names, cuts, summaries, fragments = parallel.on_root(comm, run)

    def share(number: int) -> MeshInput:
        if found is None:  # for the type checker: it is called on rank 0 alone
            raise MeshError("no division")
        return found.share(number)

    pieces = {name: spread(comm, from_root(comm, partial(share, i))) for i, name in enumerate(names)}
    return CutMesh(pieces, cuts, summaries, fragments)


def _described(region: Region) -> str:
    return "a function" if callable(region) else repr(region)
