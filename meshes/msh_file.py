"""Meshes in gmsh's .msh files."""

from __future__ import annotations

from pathlib import Path

import gmsh
import numpy as np
import numpy.typing as npt

from flexmbd.errors import MeshError
from flexmbd.meshes.foreign_mesh import ElementBlock, ForeignMesh
from flexmbd.meshes.trial_read import Kind, try_to_read

IntArray = npt.NDArray[np.int64]

# gmsh's types of elements: meshio's name, and where VTK's nodes stand in gmsh's order, None where all stand alike.
_KINDS: dict[int, tuple[str, list[int] | None]] = {
    2: ("triangle", None),
    3: ("quad", None),
    4: ("tetra", None),
    5: ("hexahedron", None),
    6: ("wedge", None),
    7: ("pyramid", None),
    9: ("triangle6", None),
    10: ("quad9", None),
    11: ("tetra10", [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]),
    12: ("hexahedron27", [*range(9), 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15, 22, 23, 21, 24, 20, 25, 26]),
    13: ("wedge18", [*range(7), 9, 7, 12, 14, 13, 8, 10, 11, 15, 17, 16]),
    14: ("pyramid14", [*range(6), 8, 10, 6, 7, 9, 11, 12, 13]),
    16: ("quad8", None),
    17: ("hexahedron20", [*range(9), 11, 13, 9, 16, 18, 19, 17, 10, 12, 14, 15]),
    18: ("wedge15", [*range(7), 9, 7, 12, 14, 13, 8, 10, 11]),
    19: ("pyramid13", [*range(6), 8, 10, 6, 7, 9, 11, 12]),
}


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


def foreign_model(path: Path) -> ForeignMesh:
    """The current model by gmsh's own numbers, whatever its solids are; on rank 0, in a session.

    Physical groups of volumes and surfaces are sets of elements, of curves and points sets of nodes.

    Raises:
        MeshError: it has solids of a kind that is not known.
    """
    numbers, x, _ = gmsh.model.mesh.getNodes()
    numbers, first = np.unique(numbers.astype(np.int64), return_index=True)
    elements: list[ElementBlock] = []
    of_entity: dict[tuple[int, int], list[IntArray]] = {}
    for dim, entity in (*gmsh.model.getEntities(3), *gmsh.model.getEntities(2)):
        for kind, tags, nodes in zip(*gmsh.model.mesh.getElements(dim, entity), strict=True):
            name, order = _KINDS.get(int(kind), ("", None))
            called, _, _, columns, _, _ = gmsh.model.mesh.getElementProperties(kind)
            if not name:
                raise MeshError(f"{path}: cells of the kind {called} are not known; mesh with order 1 or 2")
            rows = nodes.astype(np.int64).reshape(-1, columns)
            held = tags.astype(np.int64)
            elements.append(ElementBlock(name, held, rows if order is None else rows[:, order]))
            of_entity.setdefault((dim, entity), []).append(held)
    element_sets: dict[str, list[IntArray]] = {}
    node_sets: dict[str, list[IntArray]] = {}
    for dim, tag in gmsh.model.getPhysicalGroups():
        name = gmsh.model.getPhysicalName(dim, tag)
        if name and dim > 1:
            for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
                element_sets.setdefault(name, []).extend(of_entity.get((dim, int(entity)), []))
        elif name:
            held = gmsh.model.mesh.getNodesForPhysicalGroup(dim, tag)[0].astype(np.int64)
            node_sets.setdefault(name, []).append(held)
    return ForeignMesh(
        path,
        numbers,
        x.reshape(-1, 3)[first],
        elements,
        {name: np.concatenate(parts) for name, parts in element_sets.items() if parts},
        {name: np.unique(np.concatenate(parts)) for name, parts in node_sets.items()},
    )
