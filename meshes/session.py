"""One gmsh session: opened and closed on rank 0, and its model handed to all ranks as a mesh."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

from mpi4py import MPI

import basix
import gmsh
import numpy as np
import numpy.typing as npt

from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.node_order import NodeOrder, node_permutation
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.errors import MeshError
from flexmbd.meshes.group_choice import chosen

IntArray = npt.NDArray[np.int64]
Tags = npt.NDArray[np.int32]

# Everything that shapes a mesh is set, so that what the user set in a session of theirs does not
# change the result; one thread and a fixed seed make it repeatable.
_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Geometry.OCCAutoFix": 1,
    "Geometry.OCCFixDegenerated": 0,
    "Geometry.OCCFixSmallEdges": 0,
    "Geometry.OCCFixSmallFaces": 0,
    "Geometry.OCCMakeSolids": 0,
    "Geometry.OCCScaling": 1,
    "Geometry.OCCSewFaces": 0,
    "Mesh.Algorithm": 6,
    "Mesh.Algorithm3D": 1,
    "Mesh.ElementOrder": 1,
    "Mesh.HighOrderOptimize": 0,
    "Mesh.MaxNumThreads1D": 1,
    "Mesh.MaxNumThreads2D": 1,
    "Mesh.MaxNumThreads3D": 1,
    "Mesh.MeshSizeExtendFromBoundary": 1,
    "Mesh.MeshSizeFactor": 1,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.MeshSizeFromPoints": 1,
    "Mesh.MeshSizeMax": 1e22,
    "Mesh.MeshSizeMin": 0,
    "Mesh.Optimize": 1,
    "Mesh.OptimizeNetgen": 0,
    "Mesh.RandomFactor": 1e-9,
    "Mesh.RandomFactor3D": 1e-12,
    "Mesh.RandomSeed": 1,
    "Mesh.RecombinationAlgorithm": 1,
    "Mesh.RecombineAll": 0,
    "Mesh.SecondOrderIncomplete": 0,
    "Mesh.SecondOrderLinear": 0,
    "Mesh.Smoothing": 1,
    "Mesh.SubdivisionAlgorithm": 0,
}

# How much smaller than h cells may become that follow the curvature.
_FINEST = 20.0

_UNIT = "Geometry.OCCTargetUnit"  # that the lengths of CAD files are converted to

# gmsh's element types that DOLFINx and the forms know: by their number the cell, the degree of its
# geometry, how a person calls them, and the cell's dimension.
_CELLS = {
    1: ("interval", 1, "2-node lines", 1),
    8: ("interval", 2, "3-node lines", 1),
    2: ("triangle", 1, "3-node triangles", 2),
    9: ("triangle", 2, "6-node triangles", 2),
    3: ("quadrilateral", 1, "4-node quadrilaterals", 2),
    10: ("quadrilateral", 2, "9-node quadrilaterals", 2),
    4: ("tetrahedron", 1, "4-node tetrahedra", 3),
    5: ("hexahedron", 1, "8-node hexahedra", 3),
    11: ("tetrahedron", 2, "10-node tetrahedra", 3),
    12: ("hexahedron", 2, "27-node hexahedra", 3),
}
_ENTITIES = ("point", "curve", "surface", "volume")
_DIMENSIONS = ("zero", "one", "two", "three")


def working_unit(*lengths: float) -> float:
    """The unit, a power of two in m, in which the longest of some lengths is at least 1/4 and below 1/2.

    Tolerances of gmsh (1e-8) and OpenCASCADE (1e-7) are absolute.  A part that is built in this unit gets the same
    mesh whatever its size and the user's unit of length, and is scaled back without rounding.
    """
    return math.ldexp(1.0, math.frexp(max(lengths))[1] + 1)


def tagged_mesh(
    comm: MPI.Comm, fill: Callable[[], None], *, dim: int = 3, unit: float = 1.0
) -> TaggedMesh:
    """Turn a meshed gmsh model into a mesh over all ranks. Collective.

    Row i of the mesh's input is gmsh's node i + 1, or the i-th lowest where its numbers have gaps.
    The groups of cells, facets, edges and vertices are gmsh's named physical groups of the
    dimensions from `dim` down to points.

    Args:
        comm: the communicator of the mesh.
        fill: called on rank 0, in a gmsh session with an empty model of our own; leaves it meshed,
            with a named physical group of surfaces, curves or points.
        dim: dimension of the cells: 3 for a solid, 2 for a shell, 1 for a line.
        unit: of the lengths in the model, m.

    Raises:
        MeshError: on all ranks; there are no cells of that dimension, or of several kinds, or bad
            ones; the mesh falls into pieces; no named group below the cells; or a volume or surface
            (of a shell a surface or curve) is in two.
        Exception: whatever `fill` raised, on all ranks.
    """

    def read() -> MeshInput:
        fill()
        return model_input(dim)

    return built_mesh(comm, read, unit=unit)


def built_mesh(
    comm: MPI.Comm, build: Callable[[], MeshInput], *, unit: float = 1.0
) -> TaggedMesh:
    """Spread an input that is built with gmsh over all ranks. Collective.

    Args:
        comm: the communicator of the mesh.
        build: called on rank 0, in a gmsh session with an empty model of our own.
        unit: of the lengths in the input that is built, m.

    Raises:
        MeshError: on all ranks; as `flexmbd.continuum.grid.tagged_mesh.spread`.
        Exception: whatever `build` raised, on all ranks.
    """
    def run() -> MeshInput:
        with model():
            try:
                built = build()
            except Exception as error:
                if type(error) is not Exception:  # which gmsh alone raises
                    raise
                raise MeshError(f"gmsh cannot build this part: {error}; see whether its sizes fit together") from error
        return replace(built, points=unit * built.points)

    return spread(comm, from_root(comm, run))


def generate(*, h: float, degree: int, dim: int = 3, curvature: int | None = None) -> None:
    """Mesh the current model with cells of size h, in its unit, and geometry of the given degree; rank 0.

    With `curvature`, so many around a full circle where h is larger than that.
    """
    gmsh.option.setNumber("Mesh.MeshSizeMin", h if curvature is None else h / _FINEST)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", curvature or 0)
    gmsh.option.setNumber("Mesh.MeshSizeMax", h)
    mesh_model(degree=degree, dim=dim)


def mesh_model(*, degree: int, dim: int = 3) -> None:
    """Mesh the current model, whose sizes or divisions are set, with cells of dimension `dim`; rank 0.

    Raises:
        MeshError: gmsh gives up.
    """
    try:
        gmsh.model.mesh.generate(dim)
        for _, entity in gmsh.model.getEntities(dim):
            if len(gmsh.model.mesh.getElementTypes(dim, entity)) == 0:
                # later versions of gmsh only warn in their log, and the part would lack a piece
                raise RuntimeError(f"no cells in {_ENTITIES[dim]} {entity}")
        gmsh.model.mesh.setOrder(degree)
    except Exception as error:
        raise MeshError(
            f"gmsh cannot mesh this part: {error}; try another size of cells"
        ) from error


def lies_on_cylinder(surface: int, axis: tuple[float, float], radius: float) -> bool:
    """Does a surface lie on the cylinder about the parallel of z through a point? Rank 0, in a session.

    Args:
        surface: gmsh's tag.
        axis: x and y, in the unit of the model.
        radius: in that unit.
    """
    low, high = gmsh.model.getParametrizationBounds(2, surface)
    grid = [low[i] + (high[i] - low[i]) * part for part in (0.1, 0.35, 0.8) for i in range(2)]
    points = gmsh.model.getValue(2, surface, grid).reshape(-1, 3)
    distance = np.hypot(points[:, 0] - axis[0], points[:, 1] - axis[1])
    return bool((abs(distance - radius) < 1e-6 * radius).all())


@contextmanager
def model() -> Iterator[None]:
    """A session with an empty model of our own in gmsh, which is left as it was found; rank 0."""
    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
    found = {name: gmsh.option.getNumber(name) for name in _OPTIONS}
    unit = gmsh.option.getString(_UNIT)
    current = None if ours else gmsh.model.getCurrent()
    try:
        for name, value in _OPTIONS.items():
            gmsh.option.setNumber(name, value)
        gmsh.option.setString(_UNIT, "M")
        gmsh.model.add("flexmbd")
        yield
    finally:
        if ours:
            gmsh.finalize()
        else:
            gmsh.model.remove()
            gmsh.model.setCurrent(current)
            for name, value in found.items():
                gmsh.option.setNumber(name, value)
            gmsh.option.setString(_UNIT, unit)


def model_input(
    dim: int,
    *,
    cell_groups: Collection[str] | None = None,
    facet_groups: Collection[str] | None = None,
    named: bool = True,
) -> MeshInput:
    """All of the current model, whose nodes are renumbered if they have gaps; rank 0, in a session.

    Args:
        dim: dimension of the cells.
        cell_groups: names of the physical groups of cells to take; None for all.
        facet_groups: of those of facets.
        named: whether a group below the cells must be there.

    Raises:
        MeshError: as `tagged_mesh` says, or a name is not there.
    """
    kind = _cell_kind(dim)
    names = [_names(below) for below in range(dim + 1)]
    names[dim] = chosen("cell", names[dim], cell_groups)
    names[dim - 1] = chosen("facet", names[dim - 1], facet_groups)
    if named and not any(names[:dim]):
        below = _ENTITIES[dim - 1]
        raise MeshError(
            f"the mesh has no named group of {below}s; in gmsh, give each interface a name: "
            f'Physical {below.title()}("name") = {{...}};'
        )
    _number_nodes_without_gaps()
    cell, degree, _, _ = _CELLS[kind]
    nodes, x, _ = gmsh.model.mesh.getNodes()
    cells, cell_tags, numbers = _cells(dim, _taken(names[dim], cell_groups))
    width = len(basix.topology(basix.CellType[cell])[-2][0])
    facets, facet_tags = _facets(dim - 1, _taken(names[dim - 1], facet_groups), width=width)
    edges, vertices = (
        {name: _group(below, tag) for name, tag in names[below].items()} if below < dim - 1 else {}
        for below in (1, 0)
    )
    return MeshInput(
        cell=cell,
        degree=degree,
        points=x.reshape(-1, 3)[np.argsort(nodes)],
        cells=cells[:, node_permutation(cell, degree, NodeOrder.GMSH)],
        cell_tags=cell_tags,
        cell_groups=names[dim],
        facets=facets,
        facet_tags=facet_tags,
        facet_groups=names[dim - 1],
        edge_groups=edges,
        vertex_groups=vertices,
        cell_numbers=numbers,
    )


def _taken(groups: Mapping[str, int], names: Collection[str] | None) -> set[int] | None:
    """Their tags, or None for all groups, those without a name too."""
    return None if names is None else set(groups.values())


def is_of_one_kind(dim: int) -> bool:
    """Whether the cells are of one kind that `model_input` takes, or there are none; rank 0, in a session."""
    kinds = [int(kind) for kind in gmsh.model.mesh.getElementTypes(dim)]
    return len(kinds) == 0 or (len(kinds) == 1 and kinds[0] in _CELLS)


def _cell_kind(dim: int) -> int:
    """gmsh's number of the one kind of cells there is, if it is one we know."""
    kinds = [int(kind) for kind in gmsh.model.mesh.getElementTypes(dim)]
    if not kinds:
        raise MeshError(
            f"the mesh has no {_DIMENSIONS[dim]}-dimensional cells; where gmsh has physical groups it "
            f"writes only what is in one: give the {_ENTITIES[dim]}s one too, or set Mesh.SaveAll = 1"
        )
    if len(kinds) > 1 or kinds[0] not in _CELLS:
        names = ", ".join(gmsh.model.mesh.getElementProperties(kind)[0] for kind in kinds)
        known = ", ".join(text for _, _, text, cell_dim in _CELLS.values() if cell_dim == dim)
        raise MeshError(
            f"the mesh has cells of the kinds {names}; all must be of one of these: {known}"
        )
    return kinds[0]


def _cells(dim: int, taken: set[int] | None) -> tuple[IntArray, Tags, IntArray]:
    """Cells, as rows of points in gmsh's order, their tags and gmsh's numbers of them."""
    grouped = len(gmsh.model.getPhysicalGroups(dim)) > 0 and taken is None
    rows, tags, numbers = [], [], []
    for _, entity in gmsh.model.getEntities(dim):
        cells = nodes_of(dim, entity)
        if len(cells) == 0:
            continue
        groups = _groups_of(dim, entity, taken)
        if len(groups) > 1 or (grouped and len(groups) == 0):
            kind = _ENTITIES[dim]
            raise MeshError(
                f"{kind} {entity} is in {len(groups)} physical groups; each with cells must be in "
                f"one, or there must be no physical group of {kind}s at all; read can be told which "
                "groups to take: cell_groups=(...)"
            )
        rows.append(cells)
        tags.append(np.full(len(cells), groups[0] if groups else 0, dtype=np.int32))
        numbers.append(gmsh.model.mesh.getElements(dim, entity)[1][0].astype(np.int64))
    return np.concatenate(rows), np.concatenate(tags), np.concatenate(numbers)


def _groups_of(dim: int, entity: int, taken: set[int] | None) -> list[int]:
    """The physical groups of an entity that are taken."""
    groups = gmsh.model.getPhysicalGroupsForEntity(dim, entity).tolist()
    return [tag for tag in groups if taken is None or tag in taken]


def _facets(dim: int, taken: set[int] | None, *, width: int) -> tuple[IntArray, Tags]:
    """Vertices of the facets in physical groups, as rows of points, and their tags."""
    rows, tags = [np.empty((0, width), dtype=np.int64)], [np.empty(0, dtype=np.int32)]
    for _, entity in gmsh.model.getEntities(dim):
        groups = _groups_of(dim, entity, taken)
        if len(groups) == 0:
            continue
        if len(groups) > 1:
            names = ", ".join(gmsh.model.getPhysicalName(dim, tag) or str(tag) for tag in groups)
            raise MeshError(
                f"{_ENTITIES[dim]} {entity} is in several physical groups ({names}), keep one, or "
                "tell read which to take: facet_groups=(...)"
            )
        facets = nodes_of(dim, entity, vertices_only=True)
        if len(facets) > 0 and facets.shape[1] != width:
            raise MeshError(
                f"{_ENTITIES[dim]} {entity} is meshed with facets of {facets.shape[1]} vertices, and "
                f"those of the cells have {width}; mesh both together"
            )
        rows.append(facets.reshape(-1, width))
        tags.append(np.full(len(facets), groups[0], dtype=np.int32))
    return np.concatenate(rows), np.concatenate(tags)


def _group(dim: int, tag: int) -> IntArray:
    """Vertices of the elements of a physical group, as rows of points."""
    rows = [np.empty((0, dim + 1), dtype=np.int64)]
    for entity in gmsh.model.getEntitiesForPhysicalGroup(dim, tag):
        rows.append(nodes_of(dim, entity, vertices_only=True).reshape(-1, dim + 1))
    return np.concatenate(rows)


def nodes_of(dim: int, entity: int, *, vertices_only: bool = False) -> IntArray:
    """Nodes or vertices of an entity's elements, as rows of points; on rank 0, in a session.

    Raises:
        MeshError: the elements are of several kinds.
    """
    kinds, _, nodes = gmsh.model.mesh.getElements(dim, entity)
    if len(kinds) == 0:
        return np.empty((0, 0), dtype=np.int64)
    if len(kinds) > 1:
        names = ", ".join(gmsh.model.mesh.getElementProperties(kind)[0] for kind in kinds)
        raise MeshError(f"{_ENTITIES[dim]} {entity} has elements of the kinds {names}; keep one")
    _, _, _, columns, _, vertices = gmsh.model.mesh.getElementProperties(kinds[0])
    rows: IntArray = nodes[0].reshape(-1, columns).astype(np.int64) - 1
    return rows[:, :vertices] if vertices_only else rows


def _names(dim: int) -> dict[str, int]:
    """Tags of the named physical groups of a dimension."""
    tags: dict[str, int] = {}
    for _, tag in gmsh.model.getPhysicalGroups(dim):
        name = gmsh.model.getPhysicalName(dim, tag)
        if name in tags:
            raise MeshError(f"two physical groups of dimension {dim} have the name {name!r}")
        if name:
            tags[name] = tag
    return tags


def _number_nodes_without_gaps() -> None:
    """DOLFINx takes nodes numbered from 1 only; their order is kept."""
    nodes = np.sort(gmsh.model.mesh.getNodes()[0])
    if nodes[-1] != len(nodes):
        gmsh.model.mesh.renumberNodes(nodes, np.arange(1, len(nodes) + 1))
