"""Hexahedra from a planar mesh of quadrilaterals, extruded in layers.

A part whose profiles at all heights are made of the same planar pieces is meshed without a free mesh
in space: each quadrilateral becomes a column of hexahedra in those layers that its piece is in.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import basix
import gmsh
import numpy as np
import numpy.typing as npt

from flexmbd.continuum.grid.cell_shape import cell_quality
from flexmbd.continuum.grid.mesh_input import MeshInput
from flexmbd.continuum.grid.node_order import NodeOrder, node_permutation
from flexmbd.errors import MeshError
from flexmbd.meshes import session

IntArray = npt.NDArray[np.int64]

# gmsh's numbers of quadrilaterals by the degree of the geometry.
_QUADRILATERAL = {1: 3, 2: 10}

# Ways to a planar mesh: None for pairs of triangles, or by how much triangles are larger than the
# quadrilaterals that they are cut into.
_WAYS = (None, 2.0, 1.5)

# Measure of a cell, by `cell_quality`: good enough not to look further, and of no use.
_GOOD, _USELESS = 0.25, 0.05


@dataclass(frozen=True, eq=False)
class Profile:
    """A planar mesh of quadrilaterals.

    Attributes:
        degree: 1 or 2, of the geometry.
        points: (n, 2) m.
        quads: (m, 4) or (m, 9) rows of points, in basix's order.
        pieces: (m,) gmsh's tag of the surface that each is of.
        curves: by gmsh's tag, (e, 2) vertices of a curve's lines.
    """

    degree: int
    points: npt.NDArray[np.float64]
    quads: IntArray
    pieces: IntArray
    curves: Mapping[int, IntArray]


@dataclass(frozen=True)
class ExtrudedLayer:
    """Part of an extruded solid between two heights.

    Attributes:
        height: m.
        intervals: number of cells along it.
        pieces: gmsh's tags of the profile's surfaces that it consists of.
    """

    height: float
    intervals: int
    pieces: Collection[int]


@dataclass(frozen=True)
class Wall:
    """A facet group: what stands on some curves of the profile.

    Attributes:
        name: of the group.
        curves: gmsh's tags.
        layers: the numbers of the layers where it stands.
    """

    name: str
    curves: Collection[int]
    layers: Collection[int]


def grid_quads(numbers: IntArray, degree: int) -> IntArray:
    """The quadrilaterals of a regular grid of nodes, (m, 4) or (m, 9) in basix's order.

    Args:
        numbers: (degree i + 1, degree j + 1) of the nodes; with the first index and the second as axes the grid is
            right-handed.
        degree: 1 or 2, of the geometry.
    """
    first = [slice(k, numbers.shape[0] - degree + k, degree) for k in range(degree + 1)]
    second = [slice(k, numbers.shape[1] - degree + k, degree) for k in range(degree + 1)]
    rows = np.stack([numbers[a, b].ravel() for b in second for a in first], axis=1)
    return rows[:, _lexicographic("quadrilateral", degree)]


def mesh_profile(*, h: float | None, degree: int) -> Profile:
    """Mesh all surfaces of the model, in the plane z = 0, with quadrilaterals; rank 0, in a session.

    Of several ways of gmsh's the first that gives good cells is taken, or else the best: pairs of
    triangles from a frontal method, which keeps to the boundary best but now and then leaves a
    quadrilateral that is nearly a triangle; or larger triangles cut into three each.

    Args:
        h: size of the cells, m; None where the model prescribes divisions.
        degree: of the geometry.

    Raises:
        MeshError: gmsh gives up, or no way gives quadrilaterals of use.
    """
    if h is None:
        _recombine()
        session.mesh_model(degree=degree, dim=2)
        return _profile(degree)
    best: Profile | None = None
    quality = _USELESS
    for coarser in _WAYS:
        gmsh.model.mesh.clear()
        if coarser is None:
            _recombine()
            gmsh.option.setNumber("Mesh.Algorithm", 8)
            gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)
        else:
            gmsh.model.mesh.removeConstraints()
            gmsh.option.setNumber("Mesh.Algorithm", 6)
            gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 1)
        session.generate(h=h * (coarser or 1.0), degree=degree, dim=2)
        profile = _profile(degree)
        lowest = _lowest_quality(profile)
        if lowest > quality:
            best, quality = profile, lowest
        if quality > _GOOD:
            break
    if best is None:
        raise MeshError(
            "gmsh cannot mesh this profile with quadrilaterals of use; use another h, or "
            'cell="tetrahedron"'
        )
    return best


def _recombine() -> None:
    for _, surface in gmsh.model.getEntities(2):
        gmsh.model.mesh.setRecombine(2, surface)


def _profile(degree: int) -> Profile:
    """The model's mesh, of no quadrilaterals if there are triangles in it."""
    columns = (degree + 1) ** 2
    quads, pieces = [np.empty((0, columns), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    for _, surface in gmsh.model.getEntities(2):
        kinds, _, nodes = gmsh.model.mesh.getElements(2, surface)
        if list(kinds) == [_QUADRILATERAL[degree]]:
            quads.append(nodes[0].reshape(-1, columns).astype(np.int64) - 1)
            pieces.append(np.full(len(quads[-1]), surface, dtype=np.int64))
        else:
            return Profile(degree, np.empty((0, 2)), quads[0], pieces[0], {})
    nodes, x, _ = gmsh.model.mesh.getNodes()
    order = node_permutation("quadrilateral", degree, NodeOrder.GMSH)
    return Profile(
        degree,
        x.reshape(-1, 3)[np.argsort(nodes), :2],
        np.concatenate(quads)[:, order],
        np.concatenate(pieces),
        {
            tag: session.nodes_of(1, tag, vertices_only=True)
            for _, tag in gmsh.model.getEntities(1)
        },
    )


def _lowest_quality(profile: Profile) -> float:
    points = np.column_stack((profile.points, np.zeros(len(profile.points))))
    quality = cell_quality(points[profile.quads], _element("quadrilateral", profile.degree))
    return float(quality.min(initial=1.0)) if len(quality) > 0 else 0.0


def extrude(
    profile: Profile,
    layers: Sequence[ExtrudedLayer],
    *,
    z: float,
    walls: Sequence[Wall],
    rest: str | None = None,
    start: str | None = None,
    end: str | None = None,
    name: str,
) -> MeshInput:
    """Extrude a profile in layers, the lowest first.

    Args:
        profile: the planar mesh.
        layers: from below.
        z: height of the lowest layer's foot, m.
        walls: groups of facets that stand on curves.
        start: name of the group of facets at the lowest height; None if they are of the rest.
        end: of those at the greatest height, likewise.
        rest: of all other facets of the boundary; None if there are none.
        name: of the one group of cells.
    """
    d = profile.degree
    floors = [0, *np.cumsum([layer.intervals for layer in layers])]
    heights = _heights(layers, d, z)
    n = len(profile.points)
    points = np.column_stack(
        (np.tile(profile.points, (len(heights), 1)), np.repeat(heights, n))
    )
    in_plane = np.argsort(_lexicographic("quadrilateral", d))
    cells = []
    for floor, layer in zip(floors, layers, strict=False):
        quads = profile.quads[np.isin(profile.pieces, list(layer.pieces))][:, in_plane]
        for k in range(floor, floor + layer.intervals):
            cells.append(np.hstack([quads + n * (d * k + layer) for layer in range(d + 1)]))
    hexahedra = np.concatenate(cells)[:, _lexicographic("hexahedron", d)]
    used, rows = np.unique(hexahedra, return_inverse=True)
    hexahedra = rows.reshape(hexahedra.shape)
    facets = _boundary(hexahedra)
    level, foot = used[facets] // n, used[facets] % n
    named = [(start, (level == 0).all(axis=1)), (end, (level == len(heights) - 1).all(axis=1))]
    for wall in walls:
        stands = _stands_on(foot, np.concatenate([profile.curves[tag] for tag in wall.curves]), n)
        for i in wall.layers:
            inside = (level >= d * floors[i]) & (level <= d * floors[i + 1])
            named.append((wall.name, stands & inside.all(axis=1)))
    tags = np.zeros(len(facets), dtype=np.int32)
    groups: dict[str, int] = {}
    for group, chosen in named:
        if group is not None:
            tags[chosen] = groups.setdefault(group, len(groups) + 1)
    if rest is not None:
        groups[rest] = len(groups) + 1
        tags[tags == 0] = groups[rest]
    return MeshInput(
        cell="hexahedron",
        degree=d,
        points=points[used],
        cells=hexahedra,
        cell_tags=np.ones(len(hexahedra), dtype=np.int32),
        cell_groups={name: 1},
        facets=facets[tags > 0],
        facet_tags=tags[tags > 0],
        facet_groups=groups,
    )


def _heights(layers: Sequence[ExtrudedLayer], degree: int, z: float) -> npt.NDArray[np.float64]:
    """Heights of all layers of nodes, m."""
    heights = [np.array([z])]
    for layer in layers:
        intervals = degree * layer.intervals
        foot = heights[-1][-1]
        heights.append(foot + layer.height * np.arange(1, intervals + 1) / intervals)
    return np.concatenate(heights)


def _lexicographic(cell: str, degree: int) -> npt.NDArray[np.intp]:
    """Where each of basix's nodes stands in the list that has x fastest."""
    element = _element(cell, degree)
    steps = np.rint(degree * element.points).astype(np.intp)
    return steps @ (degree + 1) ** np.arange(steps.shape[1])


def _element(cell: str, degree: int) -> basix.finite_element.FiniteElement:
    return basix.create_element(
        basix.ElementFamily.P, basix.CellType[cell], degree, basix.LagrangeVariant.equispaced
    )


def _boundary(hexahedra: IntArray) -> IntArray:
    """Vertices of the facets that one cell alone has, (f, 4)."""
    facets = np.concatenate(
        [hexahedra[:, facet] for facet in basix.topology(basix.CellType.hexahedron)[2]]
    )
    _, first, count = np.unique(
        np.sort(facets, axis=1), axis=0, return_index=True, return_counts=True
    )
    return facets[np.sort(first[count == 1])]


def _stands_on(foot: IntArray, lines: IntArray, n: int) -> npt.NDArray[np.bool_]:
    """Which facets stand upright on one of the lines.

    Args:
        foot: (f, 4) the nodes of the plane that the facets' vertices are above.
        lines: (e, 2) nodes of the plane.
        n: number of nodes of the plane.
    """
    low, high = foot.min(axis=1), foot.max(axis=1)
    upright = ((foot == low[:, None]) | (foot == high[:, None])).all(axis=1) & (low < high)
    return upright & np.isin(low * n + high, lines.min(axis=1) * n + lines.max(axis=1))
