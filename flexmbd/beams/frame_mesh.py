"""A frame of beams: named points, beams between them by group, and the nodes that divide the beams.

The same frame is meshed for finite elements (`flexmbd.meshes.frame`) and lumped for discrete ones.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from numbers import Integral

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import MeshError, SceneError
from flexmbd.files.memory import available_memory
from flexmbd.given import numbers
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Point = Sequence[float]
Beam = tuple[str, str] | tuple[str, Point, str]
"""Names of the two ends; between them, of an arc of a circle, a place (m) that it goes through."""

# What is kept of one element at least, bytes: its node's place, its direction, two numbers.
_ELEMENT = 64


@dataclass(frozen=True, eq=False)
class FrameMesh:
    """The nodes and elements of a frame of beams.

    Attributes:
        x: (n, 3) m, the nodes: the named points first, in their order, then those inside the beams.
        names: (n,) of the nodes: of the points, then "group.k" or "group i.k" for the k-th node inside the
            group's one or i-th beam, counted from 1 and from its start.
        points: how many of the nodes are named points.
        elements: (m, 2) rows of nodes, from each beam's start to its end.
        middles: (m, 3) m, the middle of each element on its beam's axis.
        groups: names of the groups.
        group: (m,) which of them each element is in.
    """

    x: FloatArray
    names: tuple[str, ...]
    points: int
    elements: IntArray
    middles: FloatArray
    groups: tuple[str, ...]
    group: IntArray

    def node(self, place: str | ArrayLike) -> int:
        """The number of a node by its name, or by where it is.

        Args:
            place: a name, or (3,) m.

        Raises:
            SceneError: there is no node there; the message names the nearest one.
        """
        names, x = self.names, self.x
        if isinstance(place, str):
            if place not in names:
                both = names[: self.points], names[self.points :]
                known, inner = (", ".join(map(repr, some)) for some in both)
                raise SceneError(f"no node {place!r}; the points are: {known}; inside the beams: {inner or 'none'}")
            return names.index(place)
        at = numbers(place)
        if at.shape != (3,) or not np.isfinite(at).all():
            raise SceneError(f"a place must be a node's name or three finite coordinates in m, got {place!r}")
        distance = np.linalg.norm(x - at, axis=1)
        nearest = int(distance.argmin())
        if not distance[nearest] <= SAME_PLACE * np.linalg.norm(np.ptp(x, axis=0)):
            raise SceneError(
                f"{at.tolist()} m is not a node, and loads and joints go to nodes alone; the nearest is "
                f"{names[nearest]!r} at {x[nearest].tolist()} m, {distance[nearest]:.6g} m away: load that, or make "
                "the place a point of the frame"
            )
        return nearest


def mesh_frame(
    points: Mapping[str, Point],
    beams: Mapping[str, Sequence[Beam]],
    *,
    divisions: int | Mapping[str, int],
) -> FrameMesh:
    """Divide the beams of a frame into elements of equal length, and check that they are one frame.

    Args:
        points: by name, (3,) m; beams join where they share a point, and nowhere else.
        beams: by the name of a group, its beams; all of a group have one section.
        divisions: elements a beam; one number, or one by group.

    Raises:
        MeshError: names what is at fault: points or nodes that coincide, a point that is not finite, in no
            beam, or on a beam it does not end; a beam between unknown points, or given twice; an arc that
            is none; divisions that are not positive whole numbers; a frame in pieces.
    """
    places = {name: _place(f"point {name!r}", value) for name, value in points.items()}
    _check_beams(places, beams)
    counts = _counts(beams, divisions)
    x, names = list(places.values()), list(places)
    rows, middles, group = [], [], []
    for number, (title, members) in enumerate(beams.items()):
        for i, beam in enumerate(members):
            n = counts[title]
            at = _along(beam, places, np.linspace(0.0, 1.0, 2 * n + 1))
            inner = list(range(len(x), len(x) + n - 1))
            nodes = [names.index(beam[0]), *inner, names.index(str(beam[-1]))]
            x += list(at[2:-1:2])
            one = title if len(members) == 1 else f"{title} {i + 1}"
            names += [f"{one}.{k}" for k in range(1, n)]
            rows += list(pairwise(nodes))
            middles += list(at[1::2])
            group += [number] * n
    mesh = FrameMesh(
        np.array(x), tuple(names), len(places), np.array(rows), np.array(middles), tuple(beams), np.array(group)
    )
    _check_nodes(mesh)
    return mesh


def _place(what: str, value: object) -> FloatArray:
    try:
        x = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        x = np.empty(0)
    if x.shape != (3,) or not np.isfinite(x).all():
        raise MeshError(f"{what} must be three finite coordinates in m, got {value!r}")
    return x


def _check_beams(places: Mapping[str, FloatArray], beams: Mapping[str, Sequence[Beam]]) -> None:
    """Refuse a list of beams that does not fit the points."""
    if not any(len(members) for members in beams.values()):
        raise MeshError('a frame needs beams: {"group": [("a", "b"), ...]}')
    size = _size(places)
    used: set[str] = set()
    straight: dict[frozenset[str], str] = {}
    for title, members in beams.items():
        if len(members) == 0:
            raise MeshError(f"group {title!r} has no beams; leave it out")
        for beam in members:
            what = f"beam {beam!r} of group {title!r}"
            if not isinstance(beam, tuple | list) or len(beam) not in (2, 3):
                raise MeshError(f'{what} must be ("start", "end") or ("start", (x, y, z), "end")')
            for name in (beam[0], beam[-1]):
                if name not in places:
                    known = ", ".join(map(repr, places))
                    raise MeshError(f"{what}: there is no point {name!r}; the points are: {known}")
            if beam[0] == beam[-1]:
                raise MeshError(f"{what} ends where it starts; divide a ring into two arcs")
            used |= {str(beam[0]), str(beam[-1])}
            if len(beam) == 2:
                ends = frozenset(beam)
                if ends in straight:
                    raise MeshError(f"{what} is there already, in group {straight[ends]!r}; give each beam once")
                straight[ends] = title
                _check_clear(what, (str(beam[0]), str(beam[1])), places, size)
    if unused := [name for name in places if name not in used]:
        raise MeshError(f"point {unused[0]!r} is in no beam; leave it out, or join it to one")


def _size(places: Mapping[str, FloatArray]) -> float:
    every = np.array(list(places.values()))
    return float(np.linalg.norm(np.ptp(every, axis=0))) if len(every) else 0.0


def _check_clear(what: str, ends: tuple[str, str], places: Mapping[str, FloatArray], size: float) -> None:
    """Refuse a straight beam without length, or with a point on it that is not one of its ends."""
    start, end = places[ends[0]], places[ends[1]]
    along = end - start
    length = float(np.linalg.norm(along))
    if not length > SAME_PLACE * size:
        raise MeshError(f"points {ends[0]!r} and {ends[1]!r} coincide at {start.tolist()} m; make them one point")
    for name, x in places.items():
        part = (x - start) @ along / length**2
        if name not in ends and 0.0 < part < 1.0:
            if np.linalg.norm(x - start - part * along) <= SAME_PLACE * size:
                raise MeshError(f"point {name!r} lies on {what} and is not joined to it; divide the beam there")


def _counts(beams: Mapping[str, Sequence[Beam]], divisions: int | Mapping[str, int]) -> dict[str, int]:
    """Elements a beam of each group."""
    if isinstance(divisions, Mapping):
        if set(divisions) != set(beams):
            raise MeshError(
                f"divisions are given for {', '.join(map(repr, divisions)) or 'no group'}; give one number, or one "
                f"for each group of beams: {', '.join(map(repr, beams))}"
            )
        counts = dict(divisions)
    else:
        counts = dict.fromkeys(beams, divisions)
    for title, count in counts.items():
        if isinstance(count, bool) or not isinstance(count, Integral) or int(count) <= 0:
            raise MeshError(f"divisions of group {title!r} must be a positive whole number, got {count!r}")
    total, free = sum(int(count) * len(beams[title]) for title, count in counts.items()), available_memory()
    if free is not None and total * _ELEMENT > free:
        raise MeshError(f"divisions makes {total:.3g} elements, more than memory holds ({free / 1e9:.3g} GB are free)")
    return {title: int(count) for title, count in counts.items()}


def _along(beam: Beam, places: Mapping[str, FloatArray], s: NDArray[np.floating]) -> FloatArray:
    """(k, 3) m, the places on a beam at these parts of its length."""
    start, end = places[beam[0]], places[str(beam[-1])]
    if len(beam) == 2:
        return start + s[:, None] * (end - start)
    through = _place(f"the place that beam {beam!r} goes through", beam[1])
    u, v = through - start, end - start
    normal = np.cross(u, v)
    if not np.linalg.norm(normal) > SAME_PLACE * np.linalg.norm(u) * np.linalg.norm(v):
        raise MeshError(f"beam {beam!r}: its three places lie in a line, through which there is no arc")
    # the centre of the circle through three points
    to_centre = (u @ u * np.cross(v, normal) + v @ v * np.cross(normal, u)) / (2.0 * normal @ normal)
    centre, radius = start + to_centre, np.linalg.norm(to_centre)
    first = -to_centre / radius
    second = np.cross(normal / np.linalg.norm(normal), first)
    turn = np.arctan2((end - centre) @ second, (end - centre) @ first) % (2.0 * np.pi)
    angle = turn * s
    return centre + radius * (np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * second)


def _check_nodes(mesh: FrameMesh) -> None:
    """Refuse nodes in one place, names that stand for two, and a frame in pieces."""
    from scipy.sparse import coo_array  # on need: few scenes have beams
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    x, names = mesh.x, mesh.names
    size = float(np.linalg.norm(np.ptp(x, axis=0)))
    pairs = cKDTree(x).query_pairs(SAME_PLACE * size, output_type="ndarray")
    if len(pairs) > 0:
        a, b = pairs[np.lexsort(pairs.T[::-1])[0]]
        raise MeshError(
            f"nodes {names[a]!r} and {names[b]!r} coincide at {x[a].tolist()} m; make them one point where the "
            "beams join, or choose divisions that keep them apart where they only pass"
        )
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise MeshError(f"a point is called {twice!r}, as a node inside a beam is; choose another name")
    links = coo_array((np.ones(len(mesh.elements)), tuple(mesh.elements.T)), shape=(len(x),) * 2)
    count, piece = connected_components(links, directed=False)
    if count > 1:
        apart = names[int(np.flatnonzero(piece != piece[0])[0])]
        raise MeshError(
            f"the frame falls into {count} pieces: no beams lead from {names[0]!r} to {apart!r}; join them, or make "
            "each a body of its own"
        )
