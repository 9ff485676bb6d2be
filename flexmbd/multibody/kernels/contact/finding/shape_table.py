"""The arrays of a set of shapes that may touch, the scratch space of finding where, and the points found.

A bounded shape is a convex polytope, its *core*, with a radius about it: a sphere's core is a point, a capsule's a
segment, a box's a cube that is stretched.  Cores of one form stand once; a shape has its core's scale along each axis.
Unbounded shapes, half spaces, hollow ones and cylinders without ends, are told by their kind (``signed_distance``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import FloatArray, IntArray

#: The kind of a polytope, beside those of ``signed_distance``.
POLYTOPE = 7

#: Columns of ``Cores.head``: where a core's vertices, faces and edges begin, and how many there are.
FIRST_VERTEX, VERTICES, FIRST_FACE, FACES, FIRST_EDGE, EDGES = range(6)

#: Cores that every table has: a point, a segment from -1 to 1 along z, a cube from -1 to 1; then those of polytopes.
POINT, SEGMENT, CUBE = range(3)

#: How a point's id tells its features: of which kind (2 bits), and one or two numbers of vertices or edges (10 bits).
VERTEX_OF_A, VERTEX_OF_B, TWO_EDGES = 1, 2, 3
FEATURE_BITS = 10
ID_BITS = 2 + 2 * FEATURE_BITS

#: Most shapes of a table: two of them and the features fit into an id.
MOST_SHAPES = 2 ** ((62 - ID_BITS) // 2)

#: Most points of a pair.
MOST_POINTS = 8


@dataclass(frozen=True, eq=False)
class Cores(ArrayStruct):
    """Convex polytopes; numbers of vertices, faces and edges are counted within each.

    head: (c, 6) see FIRST_VERTEX; vertices: (v, 3) m, of POINT, SEGMENT and CUBE without a unit.  normals: (f, 3) of
    faces, outwards.  face_at: (f + 1,) where in ``corners`` and ``sides`` (l,) a face's vertices stand,
    counterclockwise seen from outside, and the edge from each to the next.  edges: (e, 4) two vertices,
    two faces; -1 of a segment.
    around_at: (v + 1,) where in ``around`` the faces about a vertex stand.
    """

    head: IntArray
    vertices: FloatArray
    normals: FloatArray
    face_at: IntArray
    corners: IntArray
    sides: IntArray
    edges: IntArray
    around_at: IntArray
    around: IntArray


@dataclass(frozen=True, eq=False)
class ShapeTable(ArrayStruct):
    """n shapes on bodies, constant while a machine runs.

    numbers: (4 n,) kind and sizes of each (``signed_distance``).  core, scale: (n,), (n, 3) its core, -1 of none, and
    the core's scale (m).  radius: (n,) m about the core.  bound: (n,) m, radius of the sphere about its centre that
    contains it; infinite of unbounded shapes.  body: (n,) its body, -1 of the ground.  place, turn: (n, 3) m, (n, 9)
    its centre and its axes by rows, on the body.  bounded, unbounded: numbers of the shapes of either sort.
    group: (n,) and law: (g, g) symmetric, number of the law by which shapes of two groups touch, -1: they do not.
    excluded: sorted a n + b of pairs of shapes, a < b, that do not touch, whatever their groups.
    """

    numbers: FloatArray
    core: IntArray
    scale: FloatArray
    radius: FloatArray
    bound: FloatArray
    body: IntArray
    place: FloatArray
    turn: FloatArray
    bounded: IntArray
    unbounded: IntArray
    group: IntArray
    law: IntArray
    excluded: IntArray
    cores: Cores


@dataclass(frozen=True, eq=False)
class FindingWork(ArrayStruct):
    """Scratch of finding; what ``find_contacts`` leaves here is for it alone, but for ``needed``.

    needed: (2,) how many near pairs and how many points there were.
    """

    needed: IntArray
    centre: FloatArray
    turn: FloatArray
    velocity: FloatArray
    spin: FloatArray
    boxes: FloatArray
    tree: FloatArray
    keys: IntArray
    spare_keys: IntArray
    order: IntArray
    spare_order: IntArray
    counts: IntArray
    pairs: IntArray
    spare_pairs: IntArray
    vertices_a: FloatArray
    vertices_b: FloatArray
    polygon_a: FloatArray
    polygon_b: FloatArray
    names_a: IntArray
    names_b: IntArray
    candidates: FloatArray
    features: IntArray


@dataclass(frozen=True, eq=False)
class ContactPoints(ArrayStruct):
    """Points where shapes touch or may touch within the step, in the order of their shapes.

    shapes, bodies: (k, 2) of a and b, a < b; body -1 is the ground.  position_a, position_b: (k, 3) m, on the surface
    of each, in the world.  normal: (k, 3) unit vector from b to a: position_a - position_b = gap normal.  gap: (k,) m,
    negative where they overlap.  id: (k,) of the two shapes and of the vertex or the edges that touch.  law: (k,).
    """

    shapes: IntArray
    bodies: IntArray
    position_a: FloatArray
    position_b: FloatArray
    normal: FloatArray
    gap: FloatArray
    id: IntArray
    law: IntArray


def new_finding_work(table: ShapeTable, *, pairs: int = 0) -> FindingWork:
    """Allocate scratch for ``table``, with room for so many near pairs, at least some for each shape."""
    n, bounded = len(table.core), len(table.bounded)
    head = table.cores.head
    vertices, longest = int(head[:, VERTICES].max()), int(np.diff(table.cores.face_at).max())
    candidates = max(vertices, 4 * longest) + 8
    capacity = max(pairs, 8 * n)
    leaves = 1 << max(bounded - 1, 0).bit_length()

    def whole(*shape: int) -> IntArray:
        return np.zeros(shape, np.int64)

    return FindingWork(
        needed=whole(2), centre=np.zeros((n, 3)), turn=np.zeros((n, 9)), velocity=np.zeros((n, 3)),
        spin=np.zeros((n, 3)), boxes=np.zeros((n, 6)), tree=np.zeros((2 * leaves, 6)), keys=whole(bounded),
        spare_keys=whole(bounded), order=whole(bounded), spare_order=whole(bounded), counts=whole(max(256, n) + 1),
        pairs=whole(capacity, 2), spare_pairs=whole(capacity, 2), vertices_a=np.zeros((vertices, 3)),
        vertices_b=np.zeros((vertices, 3)), polygon_a=np.zeros((longest, 3)), polygon_b=np.zeros((longest, 3)),
        names_a=whole(longest, 2), names_b=whole(longest, 2), candidates=np.zeros((candidates, 10)),
        features=whole(candidates),
    )  # fmt: skip


def new_contact_points(capacity: int) -> ContactPoints:
    """Allocate room for so many points."""
    two, three = np.zeros((capacity, 2), np.int64), np.zeros((capacity, 3))
    one, whole = np.zeros(capacity), np.zeros(capacity, np.int64)
    return ContactPoints(two, two.copy(), three, three.copy(), three.copy(), one, whole, whole.copy())
