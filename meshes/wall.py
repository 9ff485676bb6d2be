"""A surface of quadrilaterals thickened to a wall of bricks, whose third edges go through the thickness."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from flexmbd.continuum import parallel
from flexmbd.continuum.compat import geometry_degree
from flexmbd.continuum.grid.mesh_blocks import mesh_blocks
from flexmbd.continuum.grid.mesh_input import MeshInput, from_root
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, spread
from flexmbd.errors import MeshError, described
from flexmbd.given import is_number, shown
from flexmbd.meshes.dimension import check_arguments, checked_part, require_count

Points = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
Thickness = float | Callable[[Points], Points]

#: The facet groups of the wall's faces, on the side of the normals and on the other.
TOP, BOTTOM = "top", "bottom"

# Corners of a quadrilateral in basix's order, around it.
_AROUND = (0, 1, 3, 2)

# Directions in which the normals at a node differ by less than this say nothing of a fold.
_NO_FOLD = 0.3

# Of a wall that is folded back on itself the two halves would pass through each other.
_SHARPEST = np.cos(np.radians(165.0))


@checked_part
def wall(
    part: TaggedMesh,
    thickness: float | Callable[[Points], Points],
    *,
    offset: float = 0.0,
    layers: int = 1,
    normals: Callable[[Points], Points] | None = None,
) -> TaggedMesh:
    """Thicken a surface of quadrilaterals, for `forms.solid_shell` and other solids. Collective.

    The wall has the surface's cell groups, and as facet groups its edges, by their names, "top" on the side of the
    normals and "bottom". Normals are turned to one side, that of the first cell's. At a fold the wall is mitred, so
    that it keeps its thickness.

    Args:
        part: of quadrilaterals of degree 1, as `sheet` makes them and `read` reads them.
        thickness: m; or a function of points (3, n) in m that gives it at each (n,).
        offset: of the wall's middle from the surface, along the normal, in thicknesses: 0.5 where the surface is
            the wall's bottom.
        layers: number of bricks through the thickness.
        normals: function of points (3, n) in m that gives a curved surface's own normals (3, n) there, of any length,
            to either side. None: those of the cells, which at the rim lean by half the angle that a cell bends, so
            that a plane of symmetry is missed.

    Raises:
        MeshError: on all ranks; a thickness that is not positive, cells that are no quadrilaterals, a surface that
            branches, has one side only or is folded back on itself, bricks that would be turned inside out.
    """

    def check() -> None:
        if normals is not None and not callable(normals):
            raise MeshError(f"normals must be a function of points (3, n) that gives (3, n), got {shown(normals)}")
        if not callable(thickness) and not (is_number(thickness) and 0.0 < thickness < np.inf):
            raise MeshError(f"the thickness of a wall must be a positive, finite length in m, got {shown(thickness)}")
        if not (is_number(offset) and abs(offset) < np.inf):
            raise MeshError(f"offset must be a finite number of thicknesses, got {shown(offset)}")
        require_count("layers", layers)
        if part.dim != 2 or part.mesh.topology.cell_name() != "quadrilateral" or geometry_degree(part.mesh) != 1:
            raise MeshError(
                f"a wall is made of a surface of quadrilaterals of degree 1, got {part.mesh.topology.cell_name()}s of "
                f"degree {geometry_degree(part.mesh)}; let the mesher recombine triangles"
            )
        if taken := {TOP, BOTTOM} & set(part.facet_groups):
            raise MeshError(f"the surface has edges called {taken.pop()!r}, as a face of the wall is; rename them")

    check_arguments(part.comm, {"thickness": thickness, "offset": offset, "layers": layers}, check)
    blocks = dict(mesh_blocks(part))
    arrays: dict[str, Any] = {
        name: blocks[name] if name.startswith("facet") else parallel.gather_rows(part.comm, blocks[name])
        for name in ("points", "cells", "cell_tags", "facets", "facet_tags")
    }
    groups = dict(part.cell_groups), {name: tag for tag, name in enumerate(part.facet_groups, start=1)}
    tags = {tag: groups[1][name] for name, tag in part.facet_groups.items()}

    def build() -> MeshInput:
        surface = _Surface.of(arrays["points"], arrays["cells"], arrays["facets"], normals)
        return _thickened(surface, arrays["cell_tags"], [tags[tag] for tag in arrays["facet_tags"].tolist()],
                          groups, thickness, offset, layers)  # fmt: skip

    return spread(part.comm, from_root(part.comm, build))


@dataclass(frozen=True, eq=False)
class _Surface:
    """A surface with normals to one side.

    Attributes:
        points: (n, 3) m.
        cells: (m, 4) corners around each cell, anticlockwise about the normals.
        edges: (e, 2) of groups.
        director: (n, 3) by which a wall of 1 m goes from its middle to its top at each node, times two.
    """

    points: Points
    cells: IntArray
    edges: IntArray
    director: Points

    @classmethod
    def of(
        cls, points: Points, cells: IntArray, edges: IntArray, normals: Callable[[Points], Points] | None
    ) -> _Surface:
        turned = _turned(points, cells[:, _AROUND])
        director = _directors(points, turned)
        return cls(points, turned, edges, director if normals is None else _given(points, director, normals))


def _thickened(
    surface: _Surface,
    cell_tags: npt.NDArray[np.int32],
    edge_tags: list[int],
    groups: tuple[dict[str, int], dict[str, int]],
    thickness: Thickness,
    offset: float,
    layers: int,
) -> MeshInput:
    """The bricks, layer by layer from below."""
    x, n = surface.points, len(surface.points)
    deep = _thicknesses(x, thickness)[:, None] * surface.director
    places = np.concatenate([x + (offset - 0.5 + k / layers) * deep for k in range(layers + 1)])
    # basix lists the corners of a brick x fastest, z slowest
    flat = surface.cells[:, _AROUND]
    bricks = np.concatenate([np.hstack([flat + k * n, flat + (k + 1) * n]) for k in range(layers)])
    _refuse_inverted(places, bricks, len(flat))
    upright = np.concatenate([
        np.hstack([surface.edges + k * n, surface.edges + (k + 1) * n]) for k in range(layers)
    ])  # fmt: skip
    named = {**groups[1], TOP: len(groups[1]) + 1, BOTTOM: len(groups[1]) + 2}
    tags = [edge_tags * layers, [named[TOP]] * len(flat), [named[BOTTOM]] * len(flat)]
    return MeshInput(
        "hexahedron", 1, places, bricks, np.tile(cell_tags, layers).astype(np.int32), groups[0],
        np.concatenate([upright, flat + layers * n, flat]), np.concatenate(tags).astype(np.int32), named,
    )  # fmt: skip


def _turned(points: Points, cells: IntArray) -> IntArray:
    """Cells (m, 4), corners around, all turned as the first one of each connected part."""
    ends = np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)
    key = ends.min(axis=1) * len(points) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.r_[True, key[order][1:] != key[order][:-1]])
    count = np.diff(np.r_[first, len(key)])
    if count.max() > 2:
        place = points[ends[order[first[count.argmax()]]]].mean(axis=0)
        raise MeshError(
            f"the surface branches: {count.max()} cells meet at the edge around {place.tolist()} m; make a wall of "
            "each part and bond them"
        )
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in cells]
    for k in first[count == 2].tolist():
        i, j = order[k], order[k + 1]
        alike = bool((ends[i] == ends[j]).all())
        neighbours[i // 4].append((j // 4, alike))
        neighbours[j // 4].append((i // 4, alike))
    flipped = np.full(len(cells), -1)
    for start in range(len(cells)):
        if flipped[start] >= 0:
            continue
        flipped[start], front = 0, [start]
        while front:
            cell = front.pop()
            for other, alike in neighbours[cell]:
                wanted = flipped[cell] ^ int(alike)
                if flipped[other] < 0:
                    flipped[other] = wanted
                    front.append(other)
                elif flipped[other] != wanted:
                    raise MeshError(
                        f"the surface has one side only: around {points[cells[other]].mean(axis=0).tolist()} m its "
                        "normals cannot be turned to one side; cut it open"
                    )
    return np.where(flipped[:, None] == 1, cells[:, ::-1], cells)


def _directors(points: Points, cells: IntArray) -> Points:
    """(n, 3) of which the part along each normal (1) around a node is one; of least length."""
    corner = points[cells]
    ahead, back = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    normal = np.cross(ahead, back)
    size = np.linalg.norm(normal, axis=2, keepdims=True)
    if not size.min() > 0.0:
        raise MeshError(f"a cell around {corner[size.min(axis=(1, 2)).argmin()].mean(axis=0).tolist()} m has no area")
    normal /= size
    tensor, total = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3))
    np.add.at(tensor, cells, normal[..., :, None] * normal[..., None, :])
    np.add.at(total, cells, normal)
    values, axes = np.linalg.eigh(tensor)
    kept = values > _NO_FOLD**2 * values[:, -1:]
    along = np.einsum("nij,ni->nj", axes, total)
    director = np.einsum("nij,nj->ni", axes, np.where(kept, along / np.where(kept, values, 1.0), 0.0))
    across = np.einsum("mki,mki->mk", director[cells], normal) / np.linalg.norm(director[cells], axis=2)
    worst = np.unravel_index(across.argmin(), across.shape)
    if not across[worst] > np.sqrt(0.5 * (1.0 + _SHARPEST)):
        raise MeshError(
            f"the surface is folded back on itself at {points[cells[worst]].tolist()} m; make a wall of each part and "
            "bond them"
        )
    return np.asarray(director)


def _given(points: Points, director: Points, normals: Callable[[Points], Points]) -> Points:
    """(n, 3) unit normals as they are given, to the side of the directors."""
    found = _values(normals, "normals", points)
    if found.shape != (3, len(points)) or not np.isfinite(found).all():
        raise MeshError(f"normals must give (3, {len(points)}) finite numbers for as many points, got {shown(found)}")
    length = np.linalg.norm(found, axis=0)
    along = np.einsum("in,ni->n", found, director)
    if not (abs(along) > 0.5 * length * np.linalg.norm(director, axis=1)).all():
        raise MeshError(
            f"normals: at {points[abs(along).argmin()].tolist()} m the normal that was given lies more than 60 degrees "
            "off that of the cells"
        )
    return np.asarray((np.copysign(1.0, along) / length * found).T)


def _values(function: Callable[[Points], Points], what: str, points: Points) -> Points:
    """What a user's function gives at points (n, 3)."""
    try:
        return np.asarray(function(points.T), dtype=np.float64)
    except Exception as error:
        raise MeshError(f"{what}: the function of points failed: {described(error)}") from error


def _thicknesses(points: Points, thickness: Thickness) -> Points:
    if not callable(thickness):
        return np.full(len(points), float(thickness))
    found = _values(thickness, "the thickness of a wall", points)
    if found.shape != (len(points),) or not (np.isfinite(found).all() and found.min() > 0.0):
        raise MeshError(
            f"the thickness of a wall must give ({len(points)},) positive lengths (m) for points (3, {len(points)}), "
            f"got {shown(found)}"
        )
    return found


def _refuse_inverted(places: Points, bricks: IntArray, per_layer: int) -> None:
    """Refuse bricks whose edges at a corner are no right-handed three."""
    corner = places[bricks].reshape(-1, 2, 2, 2, 3)  # z, y, x
    edges = [np.diff(corner, axis=3 - k) for k in range(3)]
    x, y, z = (np.repeat(edge, 2, axis=3 - k) for k, edge in enumerate(edges))
    volume = np.einsum("...i,...i->...", np.cross(x, y), z).reshape(len(bricks), -1).min(axis=1)
    if not volume.min() > 0.0:
        place = places[bricks[volume.argmin()]].mean(axis=0)
        raise MeshError(
            f"the wall turns {np.count_nonzero(volume <= 0.0)} of {len(bricks)} bricks inside out, the first around "
            f"{place.tolist()} m: it is thicker there than the surface's bend leaves room for; take a thinner wall, an "
            "offset to the outside of the bend, or smaller cells"
        )
