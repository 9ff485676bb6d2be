"""One gmsh session: opened and closed on rank 0, and its model handed to all ranks as a mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from mpi4py import MPI

import gmsh
import numpy as np

from flexmbd.continuum import compat
from flexmbd.continuum.cell_shape import check_cells
from flexmbd.continuum.parallel import on_root
from flexmbd.continuum.tagged_mesh import TaggedMesh
from flexmbd.errors import MeshError

# Everything that shapes a mesh is set, so that what the user set in a session of theirs does not
# change the result; one thread and a fixed seed make it repeatable.
_OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
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
    "Mesh.RecombineAll": 0,
    "Mesh.SecondOrderIncomplete": 0,
    "Mesh.SecondOrderLinear": 0,
    "Mesh.Smoothing": 1,
    "Mesh.SubdivisionAlgorithm": 0,
}

# gmsh's element types that DOLFINx and the forms know, by their gmsh number.
_CELLS = {
    4: "4-node tetrahedra",
    5: "8-node hexahedra",
    11: "10-node tetrahedra",
    12: "27-node hexahedra",
}


def tagged_mesh(comm: MPI.Comm, fill: Callable[[], None]) -> TaggedMesh:
    """Turn a meshed gmsh model into a mesh over all ranks. Collective.

    Row i of the mesh's input is gmsh's node i + 1, or the i-th lowest where its numbers have gaps.

    Args:
        comm: the communicator of the mesh.
        fill: called on rank 0, in a gmsh session with an empty model of our own; leaves it meshed,
            with named physical groups of surfaces.

    Raises:
        MeshError: on all ranks; there are no three-dimensional cells, or of several kinds, or bad
            ones; no named group of surfaces; or a surface is in two.
        Exception: whatever `fill` raised, on all ranks.
    """
    with ExitStack() as stack:

        def fill_and_check() -> tuple[dict[str, int], dict[str, int]]:
            stack.enter_context(_session())
            fill()
            _check_volumes()
            _number_nodes_without_gaps()
            return _surface_groups(), _names(3)

        facet_groups, cell_groups = on_root(comm, fill_and_check)
        mesh, cell_tags, facet_tags = compat.gmsh_model_to_mesh(gmsh.model, comm)
    check_cells(mesh)
    return TaggedMesh(mesh, facet_tags, facet_groups, cell_tags, cell_groups)


def generate(*, h: float, degree: int) -> None:
    """Mesh the current model with cells of size h (m) and geometry of the given degree; rank 0."""
    gmsh.option.setNumber("Mesh.MeshSizeMin", h)
    gmsh.option.setNumber("Mesh.MeshSizeMax", h)
    mesh_model(degree=degree)


def mesh_model(*, degree: int) -> None:
    """Mesh the current model, whose sizes or divisions are set; rank 0.

    Raises:
        MeshError: gmsh gives up.
    """
    try:
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(degree)
    except Exception as error:
        raise MeshError(
            f"gmsh cannot mesh this part: {error}; try another size of cells"
        ) from error


@contextmanager
def _session() -> Iterator[None]:
    """An empty model of our own in gmsh, which is left as it was found."""
    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize([], readConfigFiles=False, interruptible=False)
    found = {name: gmsh.option.getNumber(name) for name in _OPTIONS}
    current = None if ours else gmsh.model.getCurrent()
    try:
        for name, value in _OPTIONS.items():
            gmsh.option.setNumber(name, value)
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


def _check_volumes() -> None:
    """All cells of one kind we know, and each volume in one physical group."""
    kinds = [int(kind) for kind in gmsh.model.mesh.getElementTypes(3)]
    if not kinds:
        raise MeshError("the mesh has no three-dimensional cells")
    if len(kinds) > 1 or kinds[0] not in _CELLS:
        names = ", ".join(gmsh.model.mesh.getElementProperties(kind)[0] for kind in kinds)
        raise MeshError(
            f"the mesh has cells of the kinds {names}; "
            f"all must be of one of these: {', '.join(_CELLS.values())}"
        )
    volumes = [
        tag
        for _, tag in gmsh.model.getEntities(3)
        if len(gmsh.model.mesh.getElements(3, tag)[0]) > 0
    ]
    if not gmsh.model.getPhysicalGroups(3):
        gmsh.model.addPhysicalGroup(3, volumes)
    for volume in volumes:
        groups = gmsh.model.getPhysicalGroupsForEntity(3, volume)
        if len(groups) != 1:
            raise MeshError(
                f"volume {volume} is in {len(groups)} physical groups; each with cells must be in "
                "one, or there must be no physical group of volumes at all"
            )


def _surface_groups() -> dict[str, int]:
    groups = _names(2)
    if not groups:
        raise MeshError(
            "the mesh has no named group of surfaces; in gmsh, give each interface a name: "
            'Physical Surface("name") = {...};'
        )
    for _, surface in gmsh.model.getEntities(2):
        tags = gmsh.model.getPhysicalGroupsForEntity(2, surface)
        if len(tags) > 1:
            names = ", ".join(gmsh.model.getPhysicalName(2, tag) or str(tag) for tag in tags)
            raise MeshError(f"surface {surface} is in several physical groups ({names}), keep one")
    return groups


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
