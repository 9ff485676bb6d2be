"""A box with a regular grid of cells, of one material or in layers."""

from __future__ import annotations

from collections.abc import Sequence

from mpi4py import MPI

import gmsh
import numpy as np

from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError
from flexmbd.meshes import session
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    require_cell,
    require_counts,
    require_degree,
    require_names,
    require_positive,
)

_AXES = "xyz"


@checked_part
def block(
    length: float,
    width: float,
    height: float,
    *,
    divisions: tuple[int, int, int],
    layers: Sequence[str] = ("block",),
    cell: str = "hexahedron",
    degree: int = 1,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the box [0, length] x [-width/2, width/2] x [-height/2, height/2] regularly. Collective.

    Facet groups: "x_min", "x_max", "y_min", "y_max", "z_min", "z_max"; cell groups: the layers.

    Args:
        length: along x, m.
        width: along y, m.
        height: along z, m.
        divisions: number of equal intervals along x, y and z.
        layers: names of equally high layers from z_min up, each a cell group of its own, for parts
            of several materials; two of them may not have the same name, and the intervals along z
            must be a multiple of their number.
        cell: "hexahedron", one in each box of the grid, or "tetrahedron", six in each.
        degree: degree of the geometry, 1 or 2.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; an argument is out of range, or not the same on all ranks.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(length=length, width=width, height=height)
        require_degree(degree)
        require_counts("divisions", divisions, number=3)
        require_cell(cell)
        _check_layers(layers, divisions[2])

    check_arguments(comm, arguments, check)
    unit = session.working_unit(length, width, height)
    length, width, height = (x / unit for x in (length, width, height))

    def fill() -> None:
        fill_box(
            (length, width, height),
            divisions=divisions,
            layers=layers,
            recombine=cell == "hexahedron",
        )
        for name, tags in faces().items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        session.mesh_model(degree=degree)

    return session.tagged_mesh(comm, fill, unit=unit)


def fill_box(
    size: tuple[float, float, float],
    *,
    divisions: tuple[int, int, int],
    layers: Sequence[str],
    recombine: bool,
) -> None:
    """Make the box of `block` with its cell groups and a regular grid; on rank 0, in a session.

    Args:
        size: along x, y and z, m.
        divisions: number of equal intervals along x, y and z.
        layers: their names, from below.
        recombine: hexahedra rather than tetrahedra.
    """
    length, width, height = size
    high = height / len(layers)
    # boxes rather than extrusions: with these the triangles of the faces fit the tetrahedra
    boxes = [
        (3, gmsh.model.occ.addBox(0.0, -width / 2, i * high - height / 2, length, width, high))
        for i in range(len(layers))
    ]
    pieces = [[box] for box in boxes]
    if len(boxes) > 1:
        _, pieces = gmsh.model.occ.fragment(boxes[:1], boxes[1:])
    gmsh.model.occ.synchronize()
    volumes = [piece[0][1] for piece in pieces]
    for name, volume in zip(layers, volumes, strict=True):
        gmsh.model.addPhysicalGroup(3, [volume], name=name)
    in_each = (divisions[0], divisions[1], divisions[2] // len(layers))
    for _, edge in gmsh.model.getEntities(1):
        low, high = gmsh.model.getBoundingBox(1, edge)[:3], gmsh.model.getBoundingBox(1, edge)[3:]
        axis = max(range(3), key=lambda i: high[i] - low[i])
        gmsh.model.mesh.setTransfiniteCurve(edge, int(in_each[axis]) + 1)
    for _, face in gmsh.model.getEntities(2):
        gmsh.model.mesh.setTransfiniteSurface(face)
        if recombine:
            gmsh.model.mesh.setRecombine(2, face)
    for volume in volumes:
        gmsh.model.mesh.setTransfiniteVolume(volume)


def faces() -> dict[str, list[int]]:
    """Surfaces of the model's axis-parallel box by the names of `block`; on rank 0, in a session."""
    surfaces = [tag for _, tag in gmsh.model.getEntities(2)]
    centres = np.array([gmsh.model.occ.getCenterOfMass(2, tag) for tag in surfaces])
    named = {}
    for axis, name in enumerate(_AXES):
        # no centre of another surface lies as far out
        low, high = centres[:, axis].min(), centres[:, axis].max()
        for end, place in (("min", low), ("max", high)):
            outside = abs(centres[:, axis] - place) < 1e-6 * (high - low)
            named[f"{name}_{end}"] = [surfaces[i] for i in np.flatnonzero(outside)]
    return named


def _check_layers(layers: Sequence[str], along_z: int) -> None:
    require_names("layers", layers, example='["steel", "rubber"]')
    if len(layers) == 0 or len(set(layers)) < len(layers):
        raise MeshError(f"layers must be at least one name, and no two alike, got {layers!r}")
    if along_z % len(layers) != 0:
        raise MeshError(
            f"divisions along z must be a multiple of the {len(layers)} layers, got {along_z}"
        )
