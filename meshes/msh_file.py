"""Meshes in gmsh's .msh files."""

from __future__ import annotations

from pathlib import Path

import gmsh

from flexmbd.errors import MeshError
from flexmbd.meshes.trial_read import Kind, try_to_read


def merge(path: Path) -> None:
    """Read a mesh file into the current model; on rank 0, in a session.

    Raises:
        MeshError: it is no such file, or gmsh cannot read it.
    """
    _check_header(path)
    try_to_read(path, Kind.MSH)
    try:
        gmsh.merge(str(path))
    except Exception as error:
        raise MeshError(f"{path}: gmsh cannot read it: {error}") from error


def _check_header(path: Path) -> None:
    """Gmsh guesses what a file is, and would run a script; only a mesh file is let through."""
    try:
        with path.open("rb") as file:
            start = file.read(1 << 12)
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened: {error.strerror}") from error
    if b"$MeshFormat" not in start:
        raise MeshError(f"{path}: not a gmsh mesh file: it has no $MeshFormat")
