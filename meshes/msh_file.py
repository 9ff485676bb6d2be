"""Meshes read from gmsh's .msh files."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

import gmsh

from flexmbd.continuum.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.meshes import session


def read(path: str | Path, *, comm: MPI.Comm = MPI.COMM_WORLD) -> TaggedMesh:
    """Read a three-dimensional mesh from a .msh file, format 4.1 or 2.2. Collective.

    Facet and cell groups are the named physical groups of surfaces and volumes; volumes need none.

    Args:
        path: read on rank 0; coordinates in m.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; there is no such file, gmsh cannot read it, or the mesh has no
            three-dimensional cells, or of several kinds, or bad ones; no named group of surfaces;
            or a surface is in two.
    """

    def fill() -> None:
        _check_header(Path(path))
        try:
            gmsh.merge(str(path))
        except Exception as error:
            raise MeshError(f"{path}: gmsh cannot read it: {error}") from error

    return session.tagged_mesh(comm, fill)


def _check_header(path: Path) -> None:
    """Gmsh guesses what a file is, and would run a script; only a mesh file is let through."""
    try:
        with path.open("rb") as file:
            start = file.read(1 << 12)
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened: {error.strerror}") from error
    if b"$MeshFormat" not in start:
        raise MeshError(f"{path}: not a gmsh mesh file: it has no $MeshFormat")
