"""Convex polytopes that are checked: closed, convex, outwards, faces with an area, those in one plane as one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load when they are asked for
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_list, numbers, shown
from flexmbd.multibody.kernels.contact.finding.shape_table import FEATURE_BITS
from flexmbd.round_off import SEVEN_DIGITS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MOST = 2**FEATURE_BITS  # vertices, and edges, whose numbers fit into a contact's id


@dataclass(frozen=True, eq=False)
class Polytope:
    """A convex polytope; ``polytope`` and ``hull`` make it.

    Attributes:
        vertices: (v, 3) m.
        faces: vertices of each, counterclockwise seen from outside.
        normals: (f, 3) outwards.
        edges: (e, 4) two vertices, the face that runs from the first to the second, and the other one.
    """

    vertices: FloatArray
    faces: tuple[tuple[int, ...], ...]
    normals: FloatArray
    edges: IntArray

    @property
    def middle(self) -> FloatArray:
        """(3,) m, of the box along the axes that contains it."""
        return 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))


def polytope(vertices: ArrayLike, faces: Sequence[Sequence[int]], *, what: str = "a polytope") -> Polytope:
    """Return the polytope of vertices (v, 3) m and faces, each its vertices counterclockwise as seen from outside.

    Neighbouring faces in one plane become one.  Round-off is a millionth of its size, as of vertices from a file.

    Raises:
        SceneError: it is not closed, not convex, inverted, has faces that are not flat or have no area, or too many
            vertices or edges; ``what`` is its name in the message.
    """
    points = _checked_vertices(vertices, what)
    loops = _checked_loops(faces, len(points), what)
    size = float(np.ptp(points, axis=0).max())
    same = SEVEN_DIGITS * size
    owners = _owners(loops, what)
    middle = points.mean(axis=0)
    areas = [_area(points[list(loop)]) for loop in loops]
    for number, (loop, area) in enumerate(zip(loops, areas, strict=True)):
        longest = max(np.linalg.norm(points[i] - points[j]) for i, j in _sides(loop))
        if not np.linalg.norm(area) > same * longest:
            raise SceneError(f"{what}: face {number}, of vertices {list(loop)}, has no area; leave it out")
    volume = sum(area @ (points[list(loop)].mean(axis=0) - middle) for loop, area in zip(loops, areas, strict=True)) / 3
    if not volume > 0.0:
        raise SceneError(
            f"{what}: it is inverted, its faces run clockwise as seen from outside; reverse the order of their vertices"
        )
    normals = np.array([area / np.linalg.norm(area) for area in areas])
    for number, (loop, normal) in enumerate(zip(loops, normals, strict=True)):
        heights = (points - points[list(loop)].mean(axis=0)) @ normal
        if np.abs(heights[list(loop)]).max() > same:
            raise SceneError(f"{what}: face {number} is not flat by {np.abs(heights[list(loop)]).max():.3g} m")
        if heights.max() > same:
            raise SceneError(
                f"{what}: it is not convex, vertex {int(heights.argmax())} is {heights.max():.3g} m beyond face "
                f"{number}; take ConvexPolytope(frame, vertices), their hull, or divide it into convex parts"
            )
    return _merged(points, loops, owners, same, what)


def hull(vertices: ArrayLike, *, what: str = "a polytope") -> Polytope:
    """Return the convex hull of points (v, 3) m.

    Raises:
        SceneError: they are fewer than four or lie in a plane, or the hull has too many vertices.
    """
    points = _checked_vertices(vertices, what)
    size = float(np.ptp(points, axis=0).max())
    flat = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[2] if size > 0.0 else 0.0
    if not flat > SEVEN_DIGITS * size:
        raise SceneError(f"{what}: its vertices lie in a plane, on a line or in a point; it needs a volume")
    try:
        found = scipy.spatial.ConvexHull(points)
    except scipy.spatial.QhullError as error:
        raise SceneError(f"{what}: qhull finds no hull of its vertices: {str(error).splitlines()[0]}") from None
    used, renumbered = np.unique(found.simplices, return_inverse=True)
    points = points[used]
    loops = []
    for triangle, plane in zip(renumbered.reshape(-1, 3), found.equations, strict=True):
        i, j, k = (int(one) for one in triangle)
        outwards = np.cross(points[j] - points[i], points[k] - points[i]) @ plane[:3] > 0.0
        loops.append((i, j, k) if outwards else (i, k, j))
    return _merged(points, loops, _owners(loops, what), SEVEN_DIGITS * size, what)


def _checked_vertices(vertices: ArrayLike, what: str) -> FloatArray:
    points = numbers(vertices)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 4:
        found = points.shape or shown(vertices)
        raise SceneError(f"{what}: vertices must be numbers (v, 3) m, four or more, got {found}")
    if not np.isfinite(points).all():
        raise SceneError(f"{what}: vertex {int(np.argmin(np.isfinite(points).all(axis=1)))} is not finite")
    return points


def _checked_loops(faces: object, count: int, what: str) -> list[tuple[int, ...]]:
    if not is_list(faces) or not isinstance(faces, Iterable):
        raise SceneError(f"{what}: faces must be lists of whole numbers, those of their vertices, got {shown(faces)}")
    loops: list[tuple[int, ...]] = []
    for loop in faces:
        values = numbers(loop)
        if values.ndim != 1 or not (np.isfinite(values).all() and (values == np.floor(values)).all()):
            raise SceneError(
                f"{what}: face {len(loops)} must be a list of whole numbers, those of its vertices, got {shown(loop)}"
            )
        loops.append(tuple(int(i) for i in values))
    for number, loop in enumerate(loops):
        if len(loop) < 3 or len(set(loop)) < len(loop):
            raise SceneError(f"{what}: face {number} has three or more different vertices, got {list(loop)}")
        if not all(0 <= i < count for i in loop):
            raise SceneError(f"{what}: face {number} has a vertex that there is not, got {list(loop)} of {count}")
    missing = set(range(count)) - {i for loop in loops for i in loop}
    if missing:
        raise SceneError(f"{what}: vertex {min(missing)} is on no face; leave it out, or take the hull of the vertices")
    return loops


def _sides(loop: Sequence[int]) -> list[tuple[int, int]]:
    return [(loop[k - 1], loop[k]) for k in range(len(loop))]


def _owners(loops: Sequence[Sequence[int]], what: str) -> dict[tuple[int, int], int]:
    """Which face runs from one vertex to another."""
    owners: dict[tuple[int, int], int] = {}
    for number, loop in enumerate(loops):
        for side in _sides(loop):
            if side in owners:
                raise SceneError(
                    f"{what}: faces {owners[side]} and {number} both run from vertex {side[0]} to {side[1]}; "
                    "neighbours run along their edge in opposite directions"
                )
            owners[side] = number
    for i, j in owners:
        if (j, i) not in owners:
            raise SceneError(f"{what}: it is not closed, the edge from vertex {i} to {j} has one face only")
    return owners


def _area(corners: FloatArray) -> FloatArray:
    """The vector of a polygon's area (m^2)."""
    arms = corners - corners[0]
    return 0.5 * np.cross(arms[1:-1], arms[2:]).sum(axis=0)


def _merged(
    points: FloatArray, loops: Sequence[Sequence[int]], owners: dict[tuple[int, int], int], same: float, what: str
) -> Polytope:
    """The polytope with neighbouring faces in one plane as one, and without the vertices that these leave."""
    group = _planes(points, loops, owners, same)
    after: dict[int, dict[int, int]] = {}  # of each plane's border: from vertex to vertex
    for (i, j), number in owners.items():
        if group[owners[j, i]] != group[number]:
            after.setdefault(group[number], {})[i] = j
    about: dict[int, int] = {}
    for border in after.values():
        for i in border:
            about[i] = about.get(i, 0) + 1
    kept = sorted(i for i, planes in about.items() if planes >= 3)
    place = {i: k for k, i in enumerate(kept)}
    faces = []
    for border in after.values():
        start = next(i for i in border if i in place)
        loop, at = [start], border[start]
        while at != start:
            loop.append(at)
            at = border[at]
        faces.append(tuple(place[i] for i in loop if i in place))
    vertices = np.ascontiguousarray(points[kept])
    areas = np.array([_area(vertices[list(face)]) for face in faces])
    final = _owners(faces, what)
    edges = np.array([(i, j, number, final[j, i]) for (i, j), number in final.items() if i < j], np.int64)
    if max(len(vertices), len(edges)) >= _MOST:
        raise SceneError(
            f"{what}: {len(vertices)} vertices and {len(edges)} edges; fewer than {_MOST} of each can touch"
        )
    if len(vertices) - len(edges) + len(faces) != 2:
        raise SceneError(f"{what}: its faces are not one closed surface, but several, or one that covers itself")
    return Polytope(vertices, tuple(faces), areas / np.linalg.norm(areas, axis=1)[:, None], edges)


def _planes(
    points: FloatArray, loops: Sequence[Sequence[int]], owners: dict[tuple[int, int], int], same: float
) -> list[int]:
    """The number of each face's plane: neighbours whose vertices lie in the plane of the largest face share it."""
    areas = np.array([_area(points[list(loop)]) for loop in loops])
    sizes = np.linalg.norm(areas, axis=1)
    group = [-1] * len(loops)
    for first in map(int, np.argsort(-sizes, kind="stable")):
        if group[first] >= 0:
            continue
        normal, origin = areas[first] / sizes[first], points[loops[first][0]]
        group[first] = first
        waiting = [first]
        while waiting:
            for i, j in _sides(loops[waiting.pop()]):
                other = owners[j, i]
                if group[other] < 0 and np.abs((points[list(loops[other])] - origin) @ normal).max() <= same:
                    group[other] = first
                    waiting.append(other)
    return group
