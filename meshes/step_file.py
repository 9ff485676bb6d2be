"""Parts from STEP files."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from mpi4py import MPI

import gmsh
import numpy as np

from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.parallel import on_root
from flexmbd.errors import MeshError, MeshWarning
from flexmbd.meshes import session
from flexmbd.meshes.dimension import (
    check_arguments,
    checked_part,
    require_cell,
    require_count,
    require_degree,
    require_positive,
)
from flexmbd.meshes.step_faces import StepFace, SurfacePoint, point_text, read_faces, volume
from flexmbd.meshes.trial_read import Kind, try_to_read
from flexmbd.meshes.untangle import untangle

# A bracket of our own: a foot with two bolt bores and a lug with a pin bore (data/README.md).
BRACKET = Path(__file__).parent / "data" / "bracket.step"

# The group of all faces without a tag.
_REST = "surface"

# More cells than this are taken for a mistake in the unit or in h.
_MOST_CELLS = 1e7

# Of the part's size: how far a point may lie off its face.
_OFF = 1e-5

# Faces or solids that a message lists.
_LISTED = 12


@dataclass(frozen=True)
class StepPart:
    """What a STEP file holds, before it is meshed.

    Attributes:
        faces: of its boundary; their numbers are their places here, from 1.
        size: sides of its bounding box along x, y, z, m.
        volume: m³.
    """

    faces: tuple[StepFace, ...]
    size: SurfacePoint
    volume: float


Tag: TypeAlias = SurfacePoint | Sequence[SurfacePoint] | Callable[[StepFace], bool]


@checked_part
def from_step(
    path: str | Path,
    *,
    tags: Mapping[str, Tag],
    h: float,
    cell: str = "tetrahedron",
    degree: int = 2,
    scale: float = 1.0,
    solid: int | None = None,
    glue: bool = False,
    curvature: int | None = None,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> TaggedMesh:
    """Mesh the solid of a STEP file. Collective.

    Lengths are converted from the file's unit to metres. A tag chooses faces for a facet group:

    - a point (x, y, z) m on the face, not on its edge; or several such points, for a group of
      several faces (many programs write a bore as two half cylinders);
    - a function of a `StepFace`, True for those of the group, as
      `lambda face: face.radius is not None and abs(face.radius - 0.008) < 1e-6`.

    `step_faces` lists the faces. Facet groups: the tags, and "surface" for all other faces of the
    boundary; cell groups: "part", or with `glue` "solid 1", "solid 2", ...

    Tetrahedra of degree 2 that a curved surface turns inside out are bent to follow it, and where that does not
    help made straighter, one in a hundred at most: they then cut the surface's curve short, which a warning says.
    `quality` tells what was reached.

    Args:
        path: of the file, which is read on rank 0.
        tags: by the names of the facet groups.
        h: size of the cells, m.
        cell: "tetrahedron", or "hexahedron": tetrahedra of twice the size, each cut into four, which
            asks for a smaller h on strongly curved faces.
        degree: degree of the geometry: 2 curves the cells.
        scale: factor on all lengths, for a file whose unit is wrong: 1e-3 if it says metres and was
            drawn in millimetres. `tags`, `h` and the mesh are in true metres.
        solid: of a file with several solids, the number of the one to take, from 1.
        glue: of a file with several solids, take all of them and join them where they touch.
        curvature: cells around a full circle, where these are smaller than h, down to h/20; 12 suits most fillets.
        comm: the communicator of the mesh.

    Raises:
        MeshError: on all ranks; there is no such file, it is not a STEP file, it has no solid or
            several; h does not go with the size of the part, which is given; a tag chooses no face,
            or a face that another one has; an argument is out of range or not the same on all ranks;
            the cells are too big for the part, or cannot follow its curved faces.

    Warns:
        MeshWarning: how many cells are straighter than the surface.
    """
    arguments = dict(locals())

    def check() -> None:
        require_positive(h=h, scale=scale)
        require_cell(cell)
        require_degree(degree)
        if curvature is not None:
            require_count("curvature", curvature)
        if solid is not None:
            require_count("solid", solid)
            if glue:
                raise MeshError("give solid= to take one solid, or glue=True to take all, not both")
        _check_tags(tags)

    check_arguments(comm, arguments, check)

    def build() -> MeshInput:
        volumes = _read_solids(Path(path), scale=scale, solid=solid, glue=glue)
        _check_size(h, scale=scale)
        faces = read_faces(scale)
        _group_faces(faces, tags, scale=scale)
        names = [f"solid {i}" for i in range(1, len(volumes) + 1)] if glue else ["part"]
        for name, parts in zip(names, volumes, strict=True):
            gmsh.model.addPhysicalGroup(3, parts, name=name)
        size = h / scale
        if cell == "hexahedron":
            gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 2)
            size *= 2
        session.generate(h=size, degree=degree, curvature=curvature)
        share = session.model_input(3)
        if degree == 2 and cell == "tetrahedron":
            share = _valid(share, path)
        return replace(share, points=share.points * scale)

    return session.built_mesh(comm, build)


def _valid(share: MeshInput, path: str | Path) -> MeshInput:
    """The same cells, none of them turned inside out by the surface that they follow."""
    share, done = untangle(share)
    n = len(share.cells)
    if done.inverted:
        raise MeshError(
            f"{path}: {done.inverted} of {n} cells are turned inside out by the curved faces that they follow; give "
            "cells that are small where the part is curved, curvature=12, or straight ones, degree=1"
        )
    if done.straightened:
        warnings.warn(
            f"{path}: {done.straightened} of {n} cells are straighter than the surface, which would turn them inside "
            "out; a smaller h, or curvature=12, follows it better",
            MeshWarning,
            stacklevel=2,
        )
    return share


@checked_part
def step_faces(
    path: str | Path, *, scale: float = 1.0, comm: MPI.Comm = MPI.COMM_WORLD
) -> tuple[StepFace, ...]:
    """The faces of the solids in a STEP file, on all ranks. Collective.

    Args:
        path: of the file, which is read on rank 0.
        scale: factor on all lengths, as in `from_step`.
        comm: the ranks.

    Raises:
        MeshError: on all ranks; there is no such file, it is not a STEP file, or has no solid.
    """
    return step_part(path, scale=scale, comm=comm).faces


def step_part(
    path: str | Path,
    *,
    scale: float = 1.0,
    solid: int | None = None,
    glue: bool = False,
    comm: MPI.Comm = MPI.COMM_WORLD,
) -> StepPart:
    """The part in a STEP file, not meshed, on all ranks. Collective.

    Args:
        path: of the file, which is read on rank 0.
        scale: factor on all lengths, as in `from_step`.
        solid: number of the one solid to take; None for all, as they are.
        glue: join them where they touch.
        comm: the ranks.

    Raises:
        MeshError: on all ranks; there is no such file, it is not a STEP file, has no solid, or not that one.
    """
    check_arguments(comm, dict(locals()), lambda: require_positive(scale=scale))

    def read() -> StepPart:
        with session.model():
            if solid is not None or glue:
                _read_solids(Path(path), scale=scale, solid=solid, glue=glue)
            else:
                _import(Path(path))
            low, high = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
            x, y, z = (scale * (high - low)).tolist()
            return StepPart(tuple(read_faces(scale).values()), (x, y, z), volume(scale))

    return on_root(comm, read)


def _check_tags(tags: Mapping[str, Tag]) -> None:
    if not isinstance(tags, Mapping):
        raise MeshError(f"tags must be a dictionary of names and tags, got {tags!r}")
    for name, tag in tags.items():
        if name == _REST:
            raise MeshError(f"the name {_REST!r} is for all faces without a tag; choose another")
        if not callable(tag):
            _points(name, tag)


def _points(name: str, tag: Tag) -> np.ndarray:
    """The points of a tag, (n, 3)."""
    try:
        points = np.atleast_2d(np.asarray(tag, dtype=np.float64))
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise MeshError(
            f"tag {name!r} must be a point (x, y, z), a list of points, or a function of a face, "
            f"got {tag!r}"
        )
    return points


def _import(path: Path) -> list[int]:
    """Read a file into the model, in metres; its volumes."""
    try:
        with path.open("rb") as file:
            start = file.read(1 << 10)
    except OSError as error:
        raise MeshError(f"{path}: cannot be opened: {error.strerror}") from error
    if not start.lstrip().startswith(b"ISO-10303-21"):
        raise MeshError(f"{path}: not a STEP file: it does not begin with ISO-10303-21")
    try_to_read(path, Kind.STEP)
    try:
        found = gmsh.model.occ.importShapes(str(path), format="step")
    except Exception as error:
        raise MeshError(f"{path}: gmsh cannot read it: {error}") from error
    gmsh.model.occ.synchronize()
    volumes = [tag for dim, tag in found if dim == 3]
    if not volumes:
        held = f"{len(gmsh.model.getEntities(2))} faces" if found else "no shapes"
        raise MeshError(
            f"{path}: there is no solid in it, but {held}; in the CAD program, close the surfaces "
            "and export a solid body"
        )
    return volumes


def _read_solids(path: Path, *, scale: float, solid: int | None, glue: bool) -> list[list[int]]:
    """Read a file, and keep its one solid, one of several, or all of them; the volumes of each."""
    volumes = _import(path)
    if solid is not None:
        if solid > len(volumes):
            raise MeshError(f"{path}: solid is {solid}, and there are {_count(volumes)} in it")
        others = [(3, tag) for i, tag in enumerate(volumes, start=1) if i != solid]
        gmsh.model.occ.remove(others, recursive=True)
        gmsh.model.occ.synchronize()
        return [[volumes[solid - 1]]]
    if len(volumes) == 1:
        return [volumes]
    if not glue:
        solids = "; ".join(
            f"{i}: {_size(gmsh.model.getBoundingBox(3, tag), scale)} around "
            f"{point_text([scale * x for x in gmsh.model.occ.getCenterOfMass(3, tag)])} m"
            for i, tag in enumerate(volumes[:_LISTED], start=1)
        )
        raise MeshError(
            f"{path}: there are {_count(volumes)} in it: {solids}"
            f"{'; ...' if len(volumes) > _LISTED else ''}. Take one with solid=1, ..., join those "
            "that touch with glue=True, or fuse them in the CAD program"
        )
    shapes = [(3, tag) for tag in volumes]
    _, pieces = gmsh.model.occ.fragment(shapes[:1], shapes[1:])
    gmsh.model.occ.synchronize()
    taken: set[int] = set()
    kept = []
    for piece in pieces:  # where two overlap, the place is the first one's
        kept.append([tag for dim, tag in piece if dim == 3 and tag not in taken])
        taken.update(kept[-1])
    return kept


def _count(volumes: list[int]) -> str:
    return f"{len(volumes)} solid{'s' if len(volumes) > 1 else ''}"


def _size(box: Sequence[float], scale: float) -> str:
    sides = (scale * (high - low) for low, high in zip(box[:3], box[3:], strict=True))
    return " x ".join(f"{side:.4g}" for side in sides) + " m"


def _check_size(h: float, *, scale: float) -> None:
    """Refuse cells much too big or small for the part, as when one of the units is wrong."""
    box = gmsh.model.getBoundingBox(-1, -1)
    largest = scale * max(high - low for low, high in zip(box[:3], box[3:], strict=True))
    cells = volume(scale / h) * 6 * math.sqrt(2)
    if cells > _MOST_CELLS:
        fault = f"cells of h = {h:g} m are too small, there would be about {cells:.1g} of them"
    elif h > largest / 2:
        fault = f"cells of h = {h:g} m are too big"
    else:
        return
    raise MeshError(
        f"{fault}: the part measures {_size(box, scale)}. If that is not its true size the file says "
        "another unit than it was drawn in: give scale=, as scale=0.001 for millimetres that are "
        "taken for metres; else give another h"
    )


def _group_faces(faces: Mapping[int, StepFace], tags: Mapping[str, Tag], *, scale: float) -> None:
    """Make the groups of faces, the tags' and that of the rest."""
    group_of: dict[int, str] = {}
    for name, tag in tags.items():
        if callable(tag):
            chosen = [face for face, shown in faces.items() if tag(shown)]
        else:
            chosen = _faces_at(name, _points(name, tag), faces, scale=scale)
        if not chosen:
            every = "; ".join(str(face) for face in list(faces.values())[:_LISTED])
            more = "; ..." if len(faces) > _LISTED else ""
            raise MeshError(
                f"tag {name!r} chooses none of the {len(faces)} faces, which are: {every}{more}"
            )
        for face in chosen:
            if face in group_of:
                raise MeshError(
                    f"tags {group_of[face]!r} and {name!r} both choose this face: {faces[face]}; "
                    "a face can be in one group only"
                )
            group_of[face] = name
        gmsh.model.addPhysicalGroup(2, chosen, name=name)
    rest = [face for face in faces if face not in group_of]
    if rest:
        gmsh.model.addPhysicalGroup(2, rest, name=_REST)


def _faces_at(
    name: str, points: np.ndarray, faces: Mapping[int, StepFace], *, scale: float
) -> list[int]:
    """The faces that points lie on, each on one."""
    box = np.array(gmsh.model.getBoundingBox(-1, -1)).reshape(2, 3)
    off = _OFF * scale * float(np.linalg.norm(box[1] - box[0]))
    chosen = []
    for point in points:
        probe = gmsh.model.occ.addPoint(*(point / scale))
        distance = {tag: scale * gmsh.model.occ.getDistance(0, probe, 2, tag)[0] for tag in faces}
        gmsh.model.occ.remove([(0, probe)])
        near = [tag for tag in faces if distance[tag] <= off]
        if len(near) == 0:
            nearest = min(distance, key=lambda tag: distance[tag])
            raise MeshError(
                f"tag {name!r}: the point {point_text(point)} m lies on no face; the nearest, "
                f"{distance[nearest]:.3g} m away, is this: {faces[nearest]}. The part measures "
                f"{_size(box.reshape(-1).tolist(), scale)}"
            )
        if len(near) > 1:
            raise MeshError(
                f"tag {name!r}: the point {point_text(point)} m lies on {len(near)} faces; give one that "
                "is not on their common edge"
            )
        if near[0] not in chosen:
            chosen.append(near[0])
    return chosen
