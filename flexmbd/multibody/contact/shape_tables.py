"""The table of shapes by which contacts are found (``kernels.contact.finding``), of shapes on bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.contact.polytopes import Polytope, polytope
from flexmbd.multibody.contact.shapes import (
    Box,
    Capsule,
    ConvexPolytope,
    Cylinder,
    Sphere,
    TouchShape,
    Vertex,
    corners,
)
from flexmbd.multibody.contact.table_shape import refuse_table
from flexmbd.multibody.kernels.contact.finding.shape_table import (
    CUBE,
    MOST_SHAPES,
    POINT,
    POLYTOPE,
    SEGMENT,
    Cores,
    ShapeTable,
)
from flexmbd.multibody.kernels.contact.signed_distance import SPHERE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def shape_table(
    shapes: Sequence[TouchShape],
    *,
    body_of: Callable[[Body], int],
    groups: Sequence[int] | None = None,
    laws: ArrayLike | None = None,
    excluded: Iterable[tuple[int, int]] = (),
) -> ShapeTable:
    """Return the table of some shapes.

    Args:
        shapes: n of them.
        body_of: the number of a body, as of rows of positions; -1 of the ground.
        groups: (n,) the group of each; None: all are of group 0.
        laws: (g, g) the number of the law by which shapes of two groups touch, -1 where they do not; None: law 0 by
            all.  Shapes on one body never touch.
        excluded: pairs of numbers of shapes that do not touch, whatever their groups.

    Raises:
        SceneError: laws are not symmetric or too few; a shape on a frame that deforms; two shapes without bounds are
            to touch; too many shapes.
    """
    n = len(shapes)
    group = np.zeros(n, np.int64) if groups is None else np.array(groups, np.int64)
    law = np.zeros((1, 1), np.int64) if laws is None else np.array(laws, np.int64)
    if group.shape != (n,) or law.ndim != 2 or law.shape[0] != law.shape[1] or (law != law.T).any():
        raise SceneError(f"groups are ({n},) and laws (g, g), symmetric; got {group.shape} and {law.shape}")
    if n and not (0 <= group.min() and group.max() < len(law)):
        raise SceneError(f"groups are between 0 and {len(law) - 1}, for which there are laws; got {group.max()}")
    if n > MOST_SHAPES:
        raise SceneError(f"{n} shapes that may touch: at most {MOST_SHAPES}")
    for shape in shapes:
        if shape.frame.modes is not None:
            raise SceneError(
                f"{type(shape).__name__} on {shape.frame.label}: shapes whose contacts are found among many are on "
                "rigid bodies, and this frame deforms"
            )
    rows = _Rows()
    for shape in shapes:
        rows.add(shape)
    body = np.array([body_of(shape.frame.body) for shape in shapes], np.int64)
    unbounded = np.array([not np.isfinite(one) for one in rows.bound], bool)
    _refuse_endless_pairs(shapes, np.flatnonzero(unbounded), body, group, law)
    keys = {min(a, b) * n + max(a, b) for a, b in excluded}
    return ShapeTable(
        numbers=np.concatenate([np.zeros(0), *rows.numbers]),
        core=np.array(rows.core, np.int64),
        scale=np.array(rows.scale, float).reshape(n, 3),
        radius=np.array(rows.radius, float),
        bound=np.array(rows.bound, float),
        body=body,
        place=np.array(rows.place, float).reshape(n, 3),
        turn=np.array([shape.frame.R_BF for shape in shapes], float).reshape(n, 9),
        bounded=np.flatnonzero(~unbounded),
        unbounded=np.flatnonzero(unbounded),
        group=group,
        law=law,
        excluded=np.array(sorted(keys), np.int64),
        cores=cores(rows.forms),
    )


def _refuse_endless_pairs(
    shapes: Sequence[TouchShape], unbounded: IntArray, body: IntArray, group: IntArray, law: IntArray
) -> None:
    """Raise SceneError where two shapes without bounds are to touch."""
    for at, a in enumerate(unbounded):
        for b in unbounded[at + 1 :]:
            if body[a] != body[b] and law[group[a], group[b]] >= 0:
                one, other = shapes[a], shapes[b]
                raise SceneError(
                    f"{type(one).__name__} on {one.frame.label} and {type(other).__name__} on {other.frame.label}: two "
                    "shapes without bounds do not touch; put them in groups that do not"
                )


class _Rows:
    """What the table has of each shape, as they come."""

    def __init__(self) -> None:
        self.numbers: list[FloatArray] = []
        self.core: list[int] = []
        self.scale: list[Any] = []
        self.radius: list[float] = []
        self.bound: list[float] = []
        self.place: list[FloatArray] = []
        self.forms: list[Polytope] = []
        self._known: dict[int, int] = {}

    def add(self, shape: TouchShape) -> None:
        """Append a shape.

        Raises:
            SceneError: spheres alone touch it.
        """
        refuse_table(shape)
        core, radius, bound = -1, 0.0, np.inf
        scale: FloatArray = np.ones(3)
        offset: FloatArray = np.zeros(3)
        if isinstance(shape, Vertex):
            core, bound = POINT, 0.0
        elif isinstance(shape, Sphere):
            core, radius = POINT, shape.radius
            bound = radius
        elif isinstance(shape, Capsule):
            half = 0.5 * shape.length
            core, scale, radius = SEGMENT, np.array([1.0, 1.0, half]), shape.radius
            bound = half + radius
        elif isinstance(shape, Cylinder):
            core, radius = SEGMENT, shape.radius
        elif isinstance(shape, Box):
            core, scale = CUBE, np.abs(corners(shape)[0])
            bound = float(np.linalg.norm(scale))
        elif isinstance(shape, ConvexPolytope):
            core = self._form(shape.polytope)
            offset = shape.polytope.middle
            bound = float(np.linalg.norm(shape.polytope.vertices - offset, axis=1).max())
        of_point = np.array([SPHERE, 0.0, 0.0, 0.0])
        of_polytope = np.array([POLYTOPE, 0.0, 0.0, 0.0])
        if isinstance(shape, Vertex):
            self.numbers.append(of_point)
        else:
            self.numbers.append(of_polytope if isinstance(shape, ConvexPolytope) else shape.numbers())
        self.core.append(core)
        self.scale.append(scale)
        self.radius.append(radius)
        self.bound.append(bound)
        self.place.append(shape.frame.p_BF_B + shape.frame.R_BF @ offset)

    def _form(self, form: Polytope) -> int:
        """The number of a polytope's core; shapes that share it share that."""
        if id(form) not in self._known:
            self._known[id(form)] = CUBE + 1 + len(self.forms)
            self.forms.append(form)
        return self._known[id(form)]


def cores(forms: Sequence[Polytope]) -> Cores:
    """Return a point, a segment, a cube and these polytopes, about their middles, as arrays."""
    none = np.zeros((0, 3))
    point = Polytope(np.zeros((1, 3)), (), none, np.zeros((0, 4), np.int64))
    segment = Polytope(np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]), (), none, np.array([[0, 1, -1, -1]]))
    every = [point, segment, cube(), *forms]
    head: list[tuple[int, ...]] = []
    face_at, around_at = [0], [0]
    corner_list, side_list, around = list[int](), list[int](), list[int]()
    vertices = faces = edges = 0
    for form in every:
        head.append((vertices, len(form.vertices), faces, len(form.faces), edges, len(form.edges)))
        vertices, faces, edges = vertices + len(form.vertices), faces + len(form.faces), edges + len(form.edges)
        number = {frozenset(edge[:2].tolist()): k for k, edge in enumerate(form.edges)}
        for face in form.faces:
            corner_list += face
            side_list += [number[frozenset((face[k], face[(k + 1) % len(face)]))] for k in range(len(face))]
            face_at.append(len(corner_list))
        for vertex in range(len(form.vertices)):
            around += [k for k, face in enumerate(form.faces) if vertex in face]
            around_at.append(len(around))

    def whole(values: Any) -> IntArray:
        return np.array(values, np.int64)

    return Cores(
        head=whole(head),
        vertices=np.concatenate([form.vertices - form.middle for form in every]),
        normals=np.concatenate([form.normals for form in every]),
        face_at=whole(face_at),
        corners=whole(corner_list),
        sides=whole(side_list),
        edges=np.concatenate([whole(form.edges) for form in every]),
        around_at=whole(around_at),
        around=whole(around),
    )


def cube() -> Polytope:
    """Return the cube from -1 to 1 along each axis."""
    signs = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    bits = (4, 2, 1)
    faces = []
    for k in range(3):
        i, j = bits[(k + 1) % 3], bits[(k + 2) % 3]
        loop = (0, i, i + j, j)
        faces += [tuple(bits[k] + one for one in loop), loop[::-1]]
    return polytope(signs, faces)
