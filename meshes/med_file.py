"""Meshes in Salome's MED files (.med), read by meshio in a process of its own.

Groups of MED are sets of families; meshio 5.3 gives the family of every cell and node and the groups of each family.
Its order of nodes is MED's, in which tetrahedra and hexahedra are mirrored: the same edges have the same middles.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import numpy.typing as npt

from flexmbd.errors import MeshError
from flexmbd.meshes.foreign_mesh import KINDS, ElementBlock, ForeignMesh
from flexmbd.meshes.trial_read import arrays_of

IntArray = npt.NDArray[np.int64]

# A file may name others, of which nothing is read.
_SCRIPT = """
import json
import h5py, meshio, numpy

def check(group):
    for name in group:
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            raise ValueError(f"{group.name}/{name} is a link to elsewhere")
        item = group[name]
        if isinstance(item, h5py.Group):
            check(item)
        elif isinstance(item, h5py.Dataset) and (item.is_virtual or item.external):
            raise ValueError(f"{item.name} has its numbers in another file")

def read(path):
    with h5py.File(path, "r") as file:
        check(file)
    mesh = meshio.read(path, file_format="med")
    found = {"points": numpy.asarray(mesh.points, dtype=float)}
    families = mesh.cell_data.get("cell_tags", [])
    found["kinds"] = numpy.array([block.type for block in mesh.cells])
    for i, block in enumerate(mesh.cells):
        found[f"cells {i}"] = numpy.asarray(block.data, dtype=numpy.int64)
        if len(families) > i:
            found[f"families {i}"] = numpy.asarray(families[i], dtype=numpy.int64)
    if "point_tags" in mesh.point_data:
        found["families"] = numpy.asarray(mesh.point_data["point_tags"], dtype=numpy.int64)
    names = [{str(k): list(v) for k, v in getattr(mesh, what, {}).items()} for what in ("cell_tags", "point_tags")]
    found["names"] = numpy.array(json.dumps(names))
    return found
"""


def read_med(path: Path) -> ForeignMesh:
    """The mesh of a MED file, of which node i + 1 is in row i; not collective.

    Raises:
        MeshError: meshio is not there, or cannot read the file.
    """
    found = arrays_of(path, "meshio", _SCRIPT)
    points = found["points"]
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"{path}: its points have {points.shape[-1]} coordinates, and a solid needs three")
    of_cells, of_points = json.loads(str(found["names"]))
    elements: list[ElementBlock] = []
    sets: dict[str, list[IntArray]] = {}
    start = 1
    for i, kind in enumerate(found["kinds"].tolist()):
        cells = found[f"cells {i}"]
        numbers = np.arange(start, start + len(cells))
        start += len(cells)
        if kind not in KINDS:
            continue
        elements.append(ElementBlock(kind, numbers, cells + 1))
        families = found.get(f"families {i}", np.zeros(len(cells), dtype=np.int64))
        for family, names in of_cells.items():
            for name in names:
                sets.setdefault(name, []).append(numbers[families == int(family)])
    nodes: dict[str, list[IntArray]] = {}
    for family, names in of_points.items():
        for name in names:
            nodes.setdefault(name, []).append(np.flatnonzero(found["families"] == int(family)) + 1)
    return ForeignMesh(
        path,
        np.arange(1, len(points) + 1),
        points,
        elements,
        {name: np.unique(np.concatenate(parts)) for name, parts in sets.items()},
        {name: np.unique(np.concatenate(parts)) for name, parts in nodes.items()},
    )
