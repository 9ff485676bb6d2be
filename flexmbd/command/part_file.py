"""The part that `flexmbd reduce` starts from: a mesh with named groups, or a STEP file that is meshed here.

Faces of a STEP file get their names by `--tag`; bores that nobody named are bore_1, bore_2, ... by themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mpi4py import MPI

from flexmbd.errors import MeshError
from flexmbd.round_off import SAME_PLACE

if TYPE_CHECKING:
    from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
    from flexmbd.meshes.bores import Bore
    from flexmbd.meshes.step_faces import StepFace
    from flexmbd.meshes.step_file import StepPart, Tag

_STEP = (".step", ".stp")
# Without --size: this part of the longest side, and of the radius of the narrowest bore, but not many more cells.
_SHARE_OF_LENGTH = 1 / 15
_SHARE_OF_RADIUS = 0.7
_MANY_CELLS = 5e4
_TAG_FORMS = "NAME=12,13 (numbers of --list), NAME=radius:0.008 (cylinders, m) or NAME=point:0.1,0,0.02 (m)"


def is_step(path: Path) -> bool:
    """Whether a file is a STEP file by its name."""
    return path.suffix.lower() in _STEP


def mesh_part(
    path: Path,
    *,
    tags: Sequence[str],
    size: float | None,
    scale: float,
    solid: int | None,
    glue: bool,
    degree: int,
    comm: MPI.Comm,
) -> tuple[TaggedMesh, float | None]:
    """Read a mesh, or mesh a STEP file. Collective.

    Args:
        path: of the file.
        tags: texts NAME=WHICH that name faces of a STEP file.
        size: of the cells of a STEP file, m; None: chosen from the part.
        scale: factor on all lengths.
        solid: of a STEP file with several solids, the one to take.
        glue: of such a file, take all and join them.
        degree: of the displacement; curved cells are of degree 2, and straight ones go with 1.
        comm: the communicator of the mesh.

    Returns:
        The mesh, and the size of its cells where they were made here.

    Raises:
        MeshError: on all ranks; a file cannot be read or meshed, a tag names no face, or arguments of STEP files come
            with a mesh.
    """
    from flexmbd.meshes import from_step, read
    from flexmbd.meshes.bores import find_bores
    from flexmbd.meshes.step_file import step_part

    if not is_step(path):
        words = {"--tag": tags, "--size": size is not None, "--solid": solid is not None, "--glue": glue}
        given = [word for word, value in words.items() if value]
        if given:
            raise MeshError(f"{path}: {', '.join(given)} is for STEP files; a mesh has its cells and groups already")
        return read(path, scale=scale, comm=comm), None
    part = step_part(path, scale=scale, solid=solid, glue=glue, comm=comm)
    bores = find_bores(part.faces)
    groups = name_faces(part, bores, tags)
    h = size if size is not None else _default_size(part, bores)
    curved = 1 if degree == 1 else 2
    return from_step(path, tags=groups, h=h, degree=curved, scale=scale, solid=solid, glue=glue, comm=comm), h


def name_faces(part: StepPart, bores: Sequence[Bore], texts: Sequence[str]) -> dict[str, Tag]:
    """The facet groups of a part: those of `--tag`, and bores with none of their faces in one of these.

    Raises:
        MeshError: a text cannot be understood, names no face, or a name is given twice.
    """
    groups: dict[str, Tag] = {}
    taken: set[int] = set()
    for text in texts:
        name, equals, which = (word.strip() for word in text.partition("="))
        if not (name and equals and which):
            raise MeshError(f"--tag {text}: write {_TAG_FORMS}")
        if name in groups:
            raise MeshError(f"--tag {text}: the name {name!r} is given twice; write all its faces in one --tag")
        kind, colon, values = which.partition(":")
        if colon and kind == "point":
            groups[name] = _points(text, values)
            continue
        numbers = _with_radius(text, values, part) if colon and kind == "radius" else _numbers(text, which, part)
        taken.update(numbers)
        groups[name] = _faces_alike([part.faces[number - 1] for number in numbers], part)
    return {**groups, **_free_bores(part, bores, groups, taken)}


def _free_bores(
    part: StepPart, bores: Iterable[Bore], groups: dict[str, Tag], taken: set[int]
) -> dict[str, Tag]:
    """The groups of bores that no tag has; points may lie on any face, and then no bore is named by itself."""
    if any(not callable(tag) for tag in groups.values()):
        return {}
    return {
        bore.name: _faces_alike([part.faces[number - 1] for number in bore.faces], part)
        for bore in bores
        if bore.name not in groups and not taken & set(bore.faces)
    }


def _points(text: str, values: str) -> list[tuple[float, float, float]]:
    points = []
    for point in values.split(";"):
        numbers = [_number(text, word) for word in point.split(",")]
        if len(numbers) != 3:
            raise MeshError(f"--tag {text}: a point has three numbers, as point:0.1,0,0.02 (several: point:...;...)")
        points.append((numbers[0], numbers[1], numbers[2]))
    return points


def _with_radius(text: str, value: str, part: StepPart) -> list[int]:
    radius = _number(text, value)
    found = {
        number: face.radius for number, face in enumerate(part.faces, start=1) if face.radius is not None
    }
    chosen = [number for number, there in found.items() if abs(there - radius) <= 1e-4 * there]
    if not chosen:
        there = ", ".join(f"{one:.6g}" for one in sorted({float(f"{one:.6g}") for one in found.values()})) or "none"
        raise MeshError(f"--tag {text}: no cylinder has that radius (m); there are {there}")
    return chosen


def _numbers(text: str, values: str, part: StepPart) -> list[int]:
    numbers = []
    for word in values.split(","):
        if not word.strip().isdecimal():
            raise MeshError(f"--tag {text}: write {_TAG_FORMS}")
        number = int(word)
        if not 1 <= number <= len(part.faces):
            raise MeshError(f"--tag {text}: there is no face {number}; --list shows faces 1 to {len(part.faces)}")
        numbers.append(number)
    return numbers


def _number(text: str, word: str) -> float:
    try:
        number = float(word)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise MeshError(f"--tag {text}: {word.strip()!r} is not a number")
    return number


def _faces_alike(chosen: Sequence[StepFace], part: StepPart) -> Callable[[StepFace], bool]:
    """A tag for faces by what they are: gmsh's own numbers may change from one reading to the next."""
    near = SAME_PLACE * max(part.size)

    def same(one: StepFace, other: StepFace) -> bool:
        return math.dist(one.centre, other.centre) <= near and abs(one.area - other.area) <= SAME_PLACE * other.area

    return lambda face: any(same(face, other) for other in chosen)


def _default_size(part: StepPart, bores: Sequence[Bore]) -> float:
    largest = min([_SHARE_OF_LENGTH * max(part.size), *(_SHARE_OF_RADIUS * bore.radius for bore in bores)])
    finest = (6 * math.sqrt(2) * part.volume / _MANY_CELLS) ** (1 / 3)
    return float(f"{max(largest, finest):.3g}")


def list_part(path: Path, *, scale: float, comm: MPI.Comm) -> str:
    """A table of the faces of a STEP file, or of the groups of a mesh. Collective.

    Raises:
        MeshError: on all ranks; the file cannot be read.
    """
    from flexmbd.meshes import read
    from flexmbd.meshes.bores import find_bores
    from flexmbd.meshes.step_file import step_part

    if not is_step(path):
        mesh = read(path, scale=scale, comm=comm)
        groups = (("facets", mesh.facet_groups), ("cells", mesh.cell_groups))
        return "\n".join(f"groups of {kind}: {', '.join(sorted(names)) or 'none'}" for kind, names in groups)
    part = step_part(path, scale=scale, comm=comm)
    bores = find_bores(part.faces)
    sides = " x ".join(f"{side:.4g}" for side in part.size)
    lines = [f"{path}: {len(part.faces)} faces, {sides} m, {part.volume:.4g} m³"]
    lines.append(f"  face  {'kind':<9}{'radius or normal':<24}{'centre (m)':<36}{'area (m²)':<12}name")
    named = {number: bore.name for bore in bores for number in bore.faces}
    for number, face in enumerate(part.faces, start=1):
        kind, figure = "curved", ""
        if face.normal is not None:
            kind, figure = "plane", _vector(face.normal)
        elif face.cylinder is not None:
            kind, figure = "cylinder", f"{face.cylinder.radius:.6g} m, {'hollow' if face.cylinder.hollow else 'full'}"
        line = f"{number:>6}  {kind:<9}{figure:<24}{_vector(face.centre):<36}{face.area:<12.4g}{named.get(number, '')}"
        lines.append(line.rstrip())
    lines.append("name others by --tag, as --tag foot=5 or --tag pins=11,12")
    return "\n".join(lines)


def _vector(values: Sequence[float]) -> str:
    return f"({', '.join(f'{round(value, 9) + 0.0:.6g}' for value in values)})"
