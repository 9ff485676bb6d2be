"""Meshes read from files, each by what its name ends in."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from mpi4py import MPI

from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.continuum.parallel import on_root
from flexmbd.errors import MeshError
from flexmbd.meshes import session
from flexmbd.meshes.abaqus_file import read_abaqus
from flexmbd.meshes.cdb_file import read_cdb
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    require_count,
    require_names,
    require_positive,
)
from flexmbd.meshes.foreign_mesh import ForeignMesh
from flexmbd.meshes.h5_file import h5_input
from flexmbd.meshes.med_file import read_med
from flexmbd.meshes.msh_file import foreign_model, merge
from flexmbd.meshes.nastran_file import read_nastran
from flexmbd.meshes.place import Place, check_places, with_places
from flexmbd.meshes.solid_cells import solid_input

_READERS: dict[str, Callable[[Path], ForeignMesh]] = {
    ".inp": read_abaqus,
    ".bdf": read_nastran,
    ".nas": read_nastran,
    ".dat": read_nastran,
    ".blk": read_nastran,
    ".fem": read_nastran,
    ".cdb": read_cdb,
    ".med": read_med,
}


@checked_part
def read(
    path: str | Path,
    *,
    solids: Sequence[str] | None = None,
    cell_groups: Sequence[str] | None = None,
    facet_groups: Sequence[str] | None = None,
    places: Mapping[str, Place] | None = None,
    piece: int | None = None,
    tetrahedra: bool = False,
    scale: float = 1.0,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Read a mesh of solid cells, from .h5 of any. Collective.

    | ends in | what | read by | groups |
    |---|---|---|---|
    | .msh | gmsh, format 4.1 or 2.2 | rank 0 | the named physical groups |
    | .h5 | what `write` has written | each rank its share | those that were written |
    | .inp | Abaqus, CalculiX | rank 0 | sets of elements and nodes, surfaces |
    | .bdf, .nas, .dat, .blk, .fem | Nastran | rank 0 | "property 7" of solids, and of shells on them; "SPC 1", \
"RBE2 50", "RBE3 51", "PLOAD4 3" |
    | .cdb | Ansys, by mapdl-archive | rank 0 | components; "material 1" |
    | .med | Salome, by meshio | rank 0 | groups |

    Args:
        path: of the file; for .h5 on all ranks, else on rank 0.
        solids: names of the groups of cells that make the mesh, as of a file with several bodies; None for all solids.
        cell_groups: names of the groups of cells to take; None for those that do not overlap, small ones first (of
            .msh and .h5 for all).
        facet_groups: of those of facets.
        places: facet groups by place, in m; groups of the file that share facets with them give way, where
            `facet_groups` is None.
        piece: of solids that fall into pieces that share no facet, the one to take, from 1, large ones first.
        tetrahedra: cut all cells into tetrahedra, as wedges, pyramids and meshes of several kinds ask for.
        scale: metres in the file's unit of length: 1e-3 for a file in millimetres. No file says its
            unit.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; there is no such file, it is of no known kind or cannot be read; the
            mesh has no three-dimensional cells, or of several kinds, or bad ones, or falls into pieces;
            a name is not there; no named group below the cells, or two were asked for that overlap; an
            argument is out of range or not the same on all ranks.

    Warns:
        MeshWarning: elements that bear or weigh are left out, or sets are no groups since they overlap.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(scale=scale)
        for name, groups in (("solids", solids), ("cell_groups", cell_groups), ("facet_groups", facet_groups)):
            if groups is not None:
                require_names(name, groups, example='["foot", "pin"]')
        check_places("places", places or {})
        if not isinstance(tetrahedra, bool):
            raise MeshError(f"tetrahedra must be True or False, got {tetrahedra!r}")
        if piece is not None:
            require_count("piece", piece)
        if Path(path).suffix.lower() == ".h5" and (tetrahedra or solids is not None or piece is not None):
            raise MeshError(f"{path}: solids, piece and tetrahedra are for files of other programs, not for .h5")

    check_arguments(comm, arguments, check)
    file = Path(path)
    on_root(comm, lambda: _check_file(file))
    suffix = file.suffix.lower()

    def finished(share: MeshInput) -> TaggedMesh:
        return with_places(spread(comm, share), places or {}, shared="drop" if facet_groups is None else "refuse")

    def of(foreign: ForeignMesh) -> MeshInput:
        return solid_input(
            replace(foreign, points=foreign.points * scale), solids=solids, cell_groups=cell_groups,
            facet_groups=facet_groups, piece=piece, tetrahedra=tetrahedra, named=not places,
        )  # fmt: skip

    def build() -> MeshInput:
        if suffix != ".msh":
            return of(_READERS[suffix](file))
        with session.model():
            merge(file)
            if tetrahedra or solids is not None or piece is not None or not session.is_of_one_kind(3):
                return of(foreign_model(file))
            whole = session.model_input(3, cell_groups=cell_groups, facet_groups=facet_groups, named=not places)
        return replace(whole, points=whole.points * scale)

    if suffix == ".h5":
        share = h5_input(file, comm, cell_groups=cell_groups, facet_groups=facet_groups)
        return finished(replace(share, points=share.points * scale))
    return finished(from_root(comm, build))


def _check_file(path: Path) -> None:
    """Refuse a file that cannot be opened, or is of no known kind."""
    try:
        with path.open("rb") as file:
            file.read(1)
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened: {error.strerror}") from error
    known = (".msh", ".h5", *_READERS)
    if path.suffix.lower() not in known:
        raise MeshError(
            f"{path}: files that end in {path.suffix or 'nothing'} are not known, only those in "
            f"{', '.join(known)}; for a STEP file use from_step"
        )
