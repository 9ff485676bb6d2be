"""Meshes in Nastran's bulk data (.bdf, .nas, .fem), read by meshio."""

from __future__ import annotations

import io
import re
from collections import Counter
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.errors import MeshError
from flexmbd.meshes.foreign_mesh import KINDS, ElementBlock, ForeignMesh

IntArray = npt.NDArray[np.int64]

# The cards that must all arrive, by what meshio makes of them.
_CARDS = {
    "GRID": ("vertex",),
    "CTETRA": ("tetra", "tetra10"),
    "CHEXA": ("hexahedron", "hexahedron20"),
    "CPENTA": ("wedge", "wedge15"),
    "CPYRA": ("pyramid", "pyramid13"),
    "CTRIA3": ("triangle",),
    "CTRIA6": ("triangle6",),
    "CQUAD4": ("quad",),
    "CQUAD8": ("quad8",),
}
_LINES = ("vertex", "line")

# How many nodes the elements must have.
_NODES = {
    "tetra": 4,
    "tetra10": 10,
    "hexahedron": 8,
    "hexahedron20": 20,
    "triangle": 3,
    "triangle6": 6,
    "quad": 4,
    "quad8": 8,
}


def read_nastran(path: Path) -> ForeignMesh:
    """What the bulk data list; each property is a set of elements "property 7"; not collective.

    Raises:
        MeshError: meshio is not there; the file cannot be read; meshio leaves out some of it; nodes are
            in a coordinate system of their own.
    """
    try:
        import meshio
    except ImportError as error:
        raise MeshError(
            f"{path}: meshio reads Nastran's files, and is not there: pip install 'flexmbd[meshes]'"
        ) from error
    text = _bulk(path)
    try:
        mesh = meshio.read(io.StringIO(text), file_format="nastran")
    except (Exception, SystemExit) as error:  # noqa: BLE001  (meshio asserts, and even ends the process)
        raise MeshError(f"{path}: meshio cannot read it: {type(error).__name__} {error}") from error
    if np.any(mesh.point_data.get("nastran:ref", np.zeros(1)) != 0):
        raise MeshError(
            f"{path}: nodes are given in a coordinate system of their own (CP of GRID), which is not read; "
            "write them in the basic one"
        )
    blocks = [(block.type, block.data, mesh.cells_id[i], i) for i, block in enumerate(mesh.cells)]
    _check_complete(path, text, {"GRID": len(mesh.points)}, [(kind, len(data)) for kind, data, _, _ in blocks])
    owners = mesh.cell_data.get("nastran:ref", [])
    held: dict[str, list[IntArray]] = {}
    elements = []
    for kind, data, numbers, i in blocks:
        if kind in _LINES:
            continue
        if kind in _NODES and data.shape[1] != _NODES[kind]:
            raise MeshError(
                f"{path}: element {numbers[0]} has {data.shape[1]} nodes; a {kind} needs {_NODES[kind]}"
            )
        elements.append(ElementBlock(kind, numbers, mesh.points_id[data]))
        if KINDS.get(kind) is None:
            continue
        if len(owners) != len(blocks) or len(owners[i]) != len(numbers):
            raise MeshError(f"{path}: elements without a property; give each its number")
        for owner in np.unique(owners[i]):
            held.setdefault(f"property {owner}", []).append(numbers[owners[i] == owner])
    sets = {name: np.concatenate(parts) for name, parts in held.items()}
    return ForeignMesh(path, mesh.points_id, _three(path, mesh.points), elements, sets)


def _bulk(path: Path) -> str:
    """The bulk data between the lines that meshio asks for, whether or not the file has them."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened: {error.strerror}") from error
    lines = text.splitlines()
    heads = [line.strip().upper() for line in lines]
    begins = [i for i, head in enumerate(heads) if head.startswith("BEGIN")]
    ends = [i for i, head in enumerate(heads) if head.startswith("ENDDATA")]
    first = begins[0] + 1 if begins else 0
    last = ends[0] if ends else len(lines)
    for card, remedy in (("INCLUDE", "write all into one file"), ("GRDSET", "write it into each GRID")):
        if any(head.startswith(card) for head in heads):
            raise MeshError(f"{path}: {card} is not read; {remedy}")
    bulk = [_with_mark(line) for line in lines[first:last]]
    return "\n".join(["BEGIN BULK", *bulk, "ENDDATA", ""])


def _with_mark(line: str) -> str:
    """A line that goes on with the one before has a mark, without which meshio may leave it out."""
    if line.startswith(","):
        return f"+{line}"
    if line.startswith(" " * 8) and line.strip():
        return f"+{' ' * 7}{line[8:]}"
    return line


def _check_complete(
    path: Path, text: str, read: dict[str, int], blocks: list[tuple[str, int]]
) -> None:
    """Refuse a file of which meshio leaves out some, as cards in fields of 16 columns or in small letters."""
    pattern = re.compile(rf"^({'|'.join(_CARDS)})M?\*?[ ,\t]", re.MULTILINE | re.IGNORECASE)
    there = Counter(match.group(1).upper() for match in pattern.finditer(text))
    for card, kinds in _CARDS.items():
        got = read.get(card, sum(count for kind, count in blocks if kind in kinds))
        if got != there[card]:
            raise MeshError(
                f"{path}: it has {there[card]} cards {card}, and meshio reads {got}; write them in capitals "
                "and in fields of 8 columns or with commas"
            )
    if there["GRID"] == 0:
        raise MeshError(f"{path}: not Nastran bulk data: it has no GRID")


def _three(path: Path, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path}: a GRID needs three coordinates")
    return points
