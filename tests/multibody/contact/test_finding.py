"""Where shapes touch, against distances and depths by hulls of Minkowski differences, and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.multibody.contact.polytopes import hull, polytope
from flexmbd.multibody.contact.shape_tables import shape_table
from flexmbd.multibody.contact.shapes import corners, ends
from flexmbd.multibody.kernels.contact.finding.find_contacts import (
    NOT_FINITE,
    TOO_SMALL,
    contact_points,
    find_contacts,
    make_room,
)
from flexmbd.multibody.kernels.contact.finding.shape_table import new_contact_points, new_finding_work

TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.2, 0.9, 0.1], [0.3, 0.3, 0.8]])
SPREAD = np.random.default_rng(5).standard_normal((14, 3))
ROCK = 0.6 * SPREAD / np.linalg.norm(SPREAD, axis=1)[:, None] * [1.0, 0.8, 0.6]
SIDES = (1.0, 0.8, 0.6)


class Bodies:
    """Shapes, each on a body of its own but for those on the ground, and where the bodies are."""

    def __init__(self):
        self.scene = fm.System()
        self.shapes, self.number = [], {id(self.scene.ground): -1}

    def add(self, kind, *sizes, ground=False, p=(0.0, 0.0, 0.0), R=None):
        body = self.scene.ground if ground else self.scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
        self.number.setdefault(id(body), len(self.number) - 1)
        self.shapes.append(kind(body.frame(p=p) if R is None else body.frame(p=p, R=R), *sizes))
        return len(self.shapes) - 1

    def table(self, **more):
        return shape_table(self.shapes, body_of=lambda body: self.number[id(body)], **more)


def found(table, x, R, *, v=None, w=None, h=0.0, margin=0.0):
    """The points, as arrays by their names."""
    x, R = np.ascontiguousarray(x, float), np.ascontiguousarray(R, float)
    still = np.zeros_like(x)
    count, out = contact_points(
        table, x, R, velocities=still if v is None else v, spins=still if w is None else w, h=h, margin=margin
    )
    assert count >= 0
    return {name: value[:count].copy() for name, value in out.fields().items()}


def pair_of(one, other):
    bodies = Bodies()
    for shape in (one, other):
        bodies.add(*shape)
    return bodies


def core_of(shape):
    """Vertices of what a shape is about, in its frame, and its radius."""
    if isinstance(shape, contact.Box):
        return corners(shape), 0.0
    if isinstance(shape, contact.Capsule):
        return ends(shape), shape.radius
    if isinstance(shape, contact.ConvexPolytope):
        return shape.polytope.vertices, 0.0
    return np.zeros((1, 3)), shape.radius if isinstance(shape, contact.Sphere) else 0.0


def signed_distance(a, b):
    """Of the hulls of two sets of vertices, and the direction from b to a: by their Minkowski difference."""
    d = (a[:, None] - b[None]).reshape(-1, 3)
    if len(a) < 3 and len(b) < 3:
        at = lsq_linear(np.column_stack((a[-1] - a[0], b[0] - b[-1])), b[0] - a[0], (0.0, 1.0), tol=1e-15).x
        nearest = (a[0] + at[0] * (a[-1] - a[0]) - b[0] - at[1] * (b[-1] - b[0]))[None]
    else:
        whole = ConvexHull(d)
        best = whole.equations[:, 3].argmax()
        if whole.equations[best, 3] <= 0.0:
            return whole.equations[best, 3], -whole.equations[best, :3]
        nearest = np.concatenate([nearest_of_triangle(d[one]) for one in whole.simplices])
    lengths = np.linalg.norm(nearest, axis=1)
    return lengths.min(), nearest[lengths.argmin()] / lengths.min()


def nearest_of_triangle(p):
    """Places of a triangle among which that nearest to the origin is: on its sides, and within it if it is there."""
    side = np.roll(p, -1, axis=0) - p
    t = np.clip(-(p * side).sum(axis=1) / (side**2).sum(axis=1), 0.0, 1.0)
    places = p + t[:, None] * side
    n = np.cross(side[0], side[1])
    foot = n * (n @ p[0]) / (n @ n)
    within = (np.cross(side, foot - p) @ n >= 0.0).all()
    return np.vstack((places, foot)) if within else places


def from_core(place, core):
    """Distance of a place from a point or a segment."""
    along = core[-1] - core[0]
    t = np.clip((place - core[0]) @ along / max(along @ along, 1e-300), 0.0, 1.0)
    return np.linalg.norm(place - core[0] - t * along)


def same_points(one, other, names=("position_a", "position_b")):
    """Whether two sets of points are the same in whatever order, with their gaps."""
    first = np.column_stack([one[names[0]], one[names[1]], one["gap"]])
    second = np.column_stack([other["position_a"], other["position_b"], other["gap"]])
    off = np.abs(first[:, None] - second[None]).max(axis=2)
    return len(first) == len(second) and (len(first) == 0 or max(off.min(axis=0).max(), off.min(axis=1).max()) < 1e-7)


SOLIDS = {
    "box": (contact.Box, SIDES),
    "small box": (contact.Box, (0.1, 0.1, 0.1)),
    "plate": (contact.Box, (2.0, 1.5, 0.02)),
    "tetrahedron": (contact.ConvexPolytope, TETRAHEDRON),
    "rock": (contact.ConvexPolytope, ROCK),
    "capsule": (contact.Capsule, 0.2, 0.9),
    "sphere": (contact.Sphere, 0.3),
    "vertex": (contact.Vertex,),
}
PAIRS = [(a, b) for i, a in enumerate(SOLIDS) for b in list(SOLIDS)[i:] if {a, b} != {"vertex"}]


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_the_least_gap_is_the_signed_distance(one, other):
    """Of bodies at random, apart and overlapping; all points lie on both bodies, one gap apart along the normal."""
    random = np.random.default_rng(7)
    bodies = pair_of(SOLIDS[one], SOLIDS[other])
    table = bodies.table()
    cores = [core_of(shape) for shape in bodies.shapes]
    depths = []
    for _ in range(30):
        x = np.array([[0.0, 0.0, 0.0], random.uniform(0.2, 1.4) * random.standard_normal(3)]) + 3.0
        R = Rotation.random(2, random_state=random).as_matrix()
        points = found(table, x, R, margin=5.0)
        a, b = (core[0] @ turn.T + place for core, turn, place in zip(cores, R, x, strict=True))
        radii = cores[0][1] + cores[1][1]
        distance, normal = signed_distance(a, b)
        depths.append(distance)
        least = points["gap"].argmin()
        assert points["gap"][least] == pytest.approx(distance - radii, abs=1e-9)
        if distance > 1e-3:
            assert points["normal"][least] == pytest.approx(normal, abs=1e-7)
        assert np.linalg.norm(points["normal"], axis=1) == pytest.approx(1.0, abs=1e-12)
        apart = points["position_a"] - points["position_b"]
        assert apart == pytest.approx(points["gap"][:, None] * points["normal"], abs=1e-12)
        for own, name, radius in ((a, "position_a", cores[0][1]), (b, "position_b", cores[1][1])):
            for place in points[name]:
                if len(own) > 3:
                    assert (ConvexHull(own).equations @ [*place, 1.0]).max() < 1e-6
                else:
                    assert from_core(place, own) < radius + 1e-9
            if len(own) < 4:
                assert from_core(points[name][least], own) == pytest.approx(radius, abs=1e-9)
        assert len(set(points["id"])) == len(points["id"]) <= 8
    assert max(depths) > 0.0


ALIGNED = {
    "box": SOLIDS["box"],
    "cube": (contact.Box, (1.0, 1.0, 1.0)),
    "capsule": (contact.Capsule, 0.2, 0.8),
    "octahedron": (contact.ConvexPolytope, 0.6 * np.vstack((np.eye(3), -np.eye(3)))),
    "prism": (
        contact.ConvexPolytope,
        np.array([(0.5 * np.cos(k), 0.5 * np.sin(k), z) for k in np.arange(12) * np.pi / 6 for z in (-0.3, 0.3)]),
    ),
}


@pytest.mark.parametrize(("one", "other"), [(a, b) for i, a in enumerate(ALIGNED) for b in list(ALIGNED)[i:]])
def test_aligned_bodies(one, other):
    """Faces, edges and corners that lie along and on each other, exactly and almost."""
    random = np.random.default_rng(6)
    bodies = pair_of(ALIGNED[one], ALIGNED[other])
    table = bodies.table()
    cores = [core_of(shape) for shape in bodies.shapes]
    for size in (0.0, 1e-15, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3):
        for step in (np.pi / 2, np.pi / 4):
            for _ in range(2):
                off = size * random.standard_normal((3, 3))
                x = np.array([np.zeros(3), 0.1 * random.integers(-12, 13, 3) + off[2]])
                R = Rotation.from_euler("xyz", step * random.integers(0, 8, (2, 3)) + off[:2]).as_matrix()
                points = found(table, x, R, margin=5.0)
                a, b = (core[0] @ turn.T + place for core, turn, place in zip(cores, R, x, strict=True))
                distance, _ = signed_distance(a, b)
                assert points["gap"].min() == pytest.approx(distance - cores[0][1] - cores[1][1], abs=2e-8)
                assert len(set(points["id"])) == len(points["id"]) <= 8


def heap(count, random, *, kinds=tuple(SOLIDS), density=1.0):
    bodies = Bodies()
    for k in range(count):
        kind, *sizes = SOLIDS[kinds[k % len(kinds)]]
        turn = Rotation.random(random_state=random).as_matrix()
        bodies.add(kind, *sizes, p=0.1 * random.standard_normal(3), R=turn)
    side = (count / density) ** (1.0 / 3.0)
    x = random.uniform(0.0, side, (count, 3))
    return bodies, x, Rotation.random(count, random_state=random).as_matrix()


def test_the_sweep_misses_no_pair():
    """What is found among many is what is found of each pair alone, in their order, also where bodies move."""
    random = np.random.default_rng(3)
    bodies, x, R = heap(32, random)
    bodies.add(contact.HalfSpace, ground=True)
    bodies.add(contact.HollowSphere, 3.0, ground=True, p=(1.5, 1.5, 1.5))
    bodies.add(contact.Cylinder, 0.5, ground=True, p=(1.5, 1.5, 1.5))
    n = len(bodies.shapes)
    v, w = random.standard_normal((2, 32, 3))
    laws = np.full((n, n), 3)
    laws[32:, 32:] = -1
    table = bodies.table(groups=np.arange(n), laws=laws)
    for h in (0.0, 0.1):
        every = found(table, x, R, v=v, w=w, h=h, margin=0.02)
        assert (np.diff(every["id"] >> 22) >= 0).all()
        counted = 0
        for a in range(32):
            for b in range(a + 1, n):
                laws = np.full((n, n), -1)
                laws[a, b] = laws[b, a] = 3
                alone = found(table.replace(law=laws), x, R, v=v, w=w, h=h, margin=0.02)
                mine = (every["shapes"] == [a, b]).all(axis=1)
                for name in ("position_a", "position_b", "normal", "gap", "id", "bodies"):
                    assert (alone[name] == every[name][mine]).all()
                assert (alone["law"] == 3).all()
                counted += mine.sum()
        assert counted == len(every["gap"]) > 60


def test_near_pairs_are_those_of_brute_force():
    """By bounding boxes of many bodies of very different sizes, one of them far away."""
    random = np.random.default_rng(11)
    bodies = Bodies()
    n = 300
    sizes = 10.0 ** random.uniform(-2.0, 1.0, (n, 3))
    for side in sizes:
        bodies.add(contact.Box, tuple(side))
    table = bodies.table()
    x = random.uniform(0.0, 20.0, (n, 3))
    x[-1] = 1e7
    R = Rotation.random(n, random_state=random).as_matrix()
    work, out = new_finding_work(table, pairs=n * n), new_contact_points(16 * n)
    still = np.zeros((n, 3))
    assert find_contacts(table, x, R, still, still, 0.0, 0.0, work, out) != NOT_FINITE
    got = {tuple(pair) for pair in work.pairs[: work.needed[0]].tolist()}
    half = np.abs(R) @ (0.5 * sizes)[:, :, None]
    low, high = x - half[:, :, 0], x + half[:, :, 0]
    meets = (low[:, None] <= high[None]).all(axis=2) & (low[None] <= high[:, None]).all(axis=2)
    wanted = {(int(a), int(b)) for a, b in np.argwhere(meets) if a < b}
    assert wanted == got
    assert len(wanted) > 500


def test_what_flies_fast_is_seen_before_it_is_beyond():
    bodies = pair_of(SOLIDS["plate"], SOLIDS["small box"])
    x, R = np.array([[0.0, 0.0, 0.0], [0.1, 0.2, 5.0]]), np.stack([np.eye(3)] * 2)
    v = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1000.0]])
    assert len(found(bodies.table(), x, R, v=v, h=1e-3)["gap"]) == 0
    points = found(bodies.table(), x, R, v=v, h=0.01)
    assert points["gap"] == pytest.approx([4.94] * 4)
    assert len(found(bodies.table(), x, R, v=v + 1.0 - v, h=0.01)["gap"]) == 0  # they go the same way


@pytest.mark.parametrize("size", [1.0, 1e3, 1e-3])
def test_rigid_motions_sizes_and_the_order_of_shapes_are_immaterial(size):
    random = np.random.default_rng(1)
    bodies, x, R = heap(40, random, kinds=("box", "rock", "capsule", "plate"), density=2.0)
    other, scaled = Bodies(), Bodies()
    for shape in bodies.shapes:
        p, turn = shape.frame.p_BF_B, shape.frame.R_BF
        numbers = {
            contact.Box: lambda s: (tuple(size * one for one in s.sides),),
            contact.Capsule: lambda s: (size * s.radius, size * s.length),
            contact.ConvexPolytope: lambda s: (size * np.asarray(s.vertices),),
        }
        scaled.add(type(shape), *numbers[type(shape)](shape), p=size * p, R=turn)
    for shape in bodies.shapes[::-1]:
        sizes = {
            contact.Box: lambda s: (s.sides,),
            contact.Capsule: lambda s: (s.radius, s.length),
            contact.ConvexPolytope: lambda s: (s.vertices,),
        }
        other.add(type(shape), *sizes[type(shape)](shape), p=shape.frame.p_BF_B, R=shape.frame.R_BF)
    before = found(bodies.table(), x, R, margin=0.05)
    turn, shift = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix(), np.array([2.0, -3.0, 5.0])
    after = found(scaled.table(), size * (x @ turn.T + shift), turn @ R, margin=size * 0.05)
    assert (before["id"] == after["id"]).all()
    assert after["gap"] == pytest.approx(size * before["gap"], abs=1e-11 * size)
    assert after["position_a"] == pytest.approx(size * (before["position_a"] @ turn.T + shift), abs=1e-7 * size)
    assert after["normal"] == pytest.approx(before["normal"] @ turn.T, abs=1e-7)
    swapped = found(other.table(), x[::-1], R[::-1], margin=0.05)
    assert len(before["gap"]) > 60
    assert same_points(before, swapped, names=("position_b", "position_a"))


@pytest.mark.parametrize("aside", [(0.0, 0.0), (1e-12, -1e-13), (0.31, 0.13), (0.0, 0.27)])
@pytest.mark.parametrize("turn", [0.0, 1e-13, 0.2, 0.8])
def test_stacked_boxes_touch_at_the_corners_of_their_overlap(aside, turn):
    """Area and centre of the overlap polygon, by cutting one rectangle with the other."""
    bodies = pair_of((contact.Box, (1.0, 0.8, 0.6)), (contact.Box, (1.0, 0.8, 0.6)))
    x = np.array([[5.0, 1.0, 0.0], [5.0 + aside[0], 1.0 + aside[1], 0.6 - 1e-5]])
    R = np.stack([np.eye(3), Rotation.from_euler("z", turn).as_matrix()])
    points = found(bodies.table(), x, R, margin=1e-3)
    assert points["gap"] == pytest.approx(-1e-5, abs=1e-12)
    assert points["normal"] == pytest.approx(np.tile([0.0, 0.0, -1.0], (len(points["gap"]), 1)), abs=1e-12)
    assert points["position_a"][:, 2] == pytest.approx(0.3, abs=1e-12)
    assert points["position_b"][:, 2] == pytest.approx(0.3 - 1e-5, abs=1e-12)
    square = np.array([[-0.5, -0.4], [0.5, -0.4], [0.5, 0.4], [-0.5, 0.4]])
    other = square @ R[1, :2, :2].T + aside
    expected = clipped(other, square)
    assert len(points["gap"]) == (4 if turn < 1e-3 else len(np.unique(np.round(expected, 7), axis=0)))
    corners_found = ConvexHull(points["position_a"][:, :2] - x[0, :2])
    assert corners_found.volume == pytest.approx(ConvexHull(expected).volume, abs=1e-9)
    for place in points["position_a"][:, :2] - x[0, :2]:
        assert np.linalg.norm(expected - place, axis=1).min() < 1e-9


def test_ids_last_where_corners_lie_on_each_other():
    """Of a stack of equal boxes that is a little disturbed, by more than round-off or less."""
    bodies = pair_of((contact.Box, SIDES), (contact.Box, SIDES))
    table = bodies.table()
    random = np.random.default_rng(4)
    names = set()
    for size in (0.0, 1e-15, 1e-13, 1e-11, 1e-9, 1e-8):
        for _ in range(10):
            x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.6]]) + size * random.standard_normal((2, 3))
            R = Rotation.from_rotvec(size * random.standard_normal((2, 3))).as_matrix()
            points = found(table, x, R, margin=1e-3)
            assert len(points["gap"]) == 4
            names.add(tuple(sorted(points["id"].tolist())))
    assert len(names) == 1


def clipped(polygon, window):
    """Sutherland and Hodgman's."""
    for k in range(len(window)):
        a, d = window[k], window[(k + 1) % len(window)] - window[k]
        inside = [d[0] * (p[1] - a[1]) - d[1] * (p[0] - a[0]) for p in polygon]
        kept = []
        for i in range(len(polygon)):
            p, q, s, t = polygon[i - 1], polygon[i], inside[i - 1], inside[i]
            if (s >= 0.0) != (t >= 0.0):
                kept.append(p + s / (s - t) * (q - p))
            if t >= 0.0:
                kept.append(q)
        polygon = np.array(kept)
    return polygon


def test_points_move_without_jumps_as_a_box_rocks():
    """Each point has one next to it a little later; those near the reach, which come and go, aside.

    A corner that passes over a border becomes two crossings of edges, which begin as one.
    """
    bodies = pair_of((contact.Box, SIDES), (contact.Box, SIDES))
    table = bodies.table()
    steps = np.linspace(0.1, 1.0, 3601)
    x = np.array([[0.0, 0.0, 0.0], [0.12, 0.07, 0.63]])
    before, farthest, kept = None, 0.0, []
    for t in steps:
        angles = 0.03 * np.sin(6.0 * t), 0.025 * np.sin(9.0 * t + 0.3), 1.2 * t
        R = np.stack([np.eye(3), Rotation.from_euler("xyz", angles).as_matrix()])
        points = found(table, x, R, margin=0.04)
        now = np.column_stack((points["position_a"], points["position_b"], 0.3 * points["normal"]))
        if before is not None:
            apart = np.linalg.norm(now[:, None] - before[0][None], axis=2)
            here, there = points["gap"] < 0.039, before[1] < 0.039
            farthest = max(farthest, apart[here].min(axis=1).max(), apart[:, there].min(axis=0).max())
            kept.append(len(before[2] & set(points["id"].tolist())) / len(points["id"]))
        before = now, points["gap"], set(points["id"].tolist())
    assert farthest < 5e-3  # the crossing of edges that are almost along each other is the fastest
    assert np.mean(kept) > 0.99


def test_a_polytope_with_a_box_s_vertices_is_that_box():
    box = contact.Box(fm.System().ground.frame(), SIDES)
    random = np.random.default_rng(2)
    pairs = [
        (pair_of((contact.Box, SIDES), one), pair_of((contact.ConvexPolytope, corners(box)), two))
        for one, two in [
            (SOLIDS["box"], (contact.ConvexPolytope, corners(box))),
            (SOLIDS["capsule"], SOLIDS["capsule"]),
            (SOLIDS["sphere"], SOLIDS["sphere"]),
            (SOLIDS["rock"], SOLIDS["rock"]),
        ]
    ]
    for one, two in pairs:
        for _ in range(40):
            x = np.array([np.zeros(3), random.uniform(0.3, 0.9) * random.standard_normal(3)])
            R = Rotation.random(2, random_state=random).as_matrix()
            first, second = found(one.table(), x, R, margin=0.3), found(two.table(), x, R, margin=0.3)
            assert same_points(first, second)


def test_round_and_hollow_and_flat():
    """Closed forms: a capsule that lies, a box in a corner, balls in hollows, capsules that cross and lie along."""
    bodies = Bodies()
    floor = bodies.add(contact.HalfSpace, ground=True)
    bodies.add(contact.Capsule, 0.2, 1.0)
    lying = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    points = found(bodies.table(), [[0.0, 0.0, 0.19]], [lying], margin=0.0)
    assert floor == 0
    assert points["gap"] == pytest.approx([-0.01, -0.01])
    assert sorted(points["position_b"][:, 0]) == pytest.approx([-0.5, 0.5])
    assert points["normal"] == pytest.approx(np.tile([0.0, 0.0, -1.0], (2, 1)))  # from b, the capsule, to a

    for kind, gap in ((contact.HollowSphere, 1.0 - math.hypot(0.3, 0.5) - 0.4), (contact.HollowCylinder, 0.1)):
        bodies = Bodies()
        bodies.add(contact.Sphere, 0.4)
        bodies.add(kind, 1.0, ground=True)
        points = found(bodies.table(), [[0.5, 0.0, 0.3]], [np.eye(3)], margin=1.0)
        assert points["gap"] == pytest.approx([gap])

    bodies = pair_of((contact.Capsule, 0.2, 2.0), (contact.Capsule, 0.3, 1.0))
    x = np.array([[0.0, 0.0, 0.0], [0.49, 0.0, 0.1]])
    points = found(bodies.table(), x, [np.eye(3)] * 2, margin=0.0)
    assert points["gap"] == pytest.approx([-0.01] * 2)
    assert sorted(points["position_a"][:, 2]) == pytest.approx([-0.4, 0.6])
    points = found(bodies.table(), x, [np.eye(3), Rotation.from_euler("x", 1e-3).as_matrix()], margin=0.0)
    assert 2 <= len(points["gap"]) <= 3
    assert np.ptp(points["position_a"][:, 2]) == pytest.approx(1.0, abs=1e-5)
    points = found(bodies.table(), x, [np.eye(3), Rotation.from_euler("x", 1.0).as_matrix()], margin=0.0)
    assert points["gap"] == pytest.approx([-0.01])
    assert points["normal"] == pytest.approx(np.array([[-1.0, 0.0, 0.0]]))

    bodies = Bodies()
    bodies.add(contact.Cylinder, 0.5, ground=True, p=(0.0, 0.0, -70.0))
    bodies.add(contact.Box, SIDES)
    points = found(bodies.table(), [[0.95, 0.1, 3.0]], [np.eye(3)], margin=0.0)
    assert points["gap"] == pytest.approx([-0.05] * 2)
    assert sorted(points["position_b"][:, 2]) == pytest.approx([2.7, 3.3])


def test_room_and_numbers_and_who_may_touch():
    random = np.random.default_rng(9)
    bodies, x, R = heap(60, random, kinds=("box",), density=4.0)
    table = bodies.table()
    work, out = new_finding_work(table), new_contact_points(4)
    work = work.replace(pairs=work.pairs[:5].copy(), spare_pairs=work.spare_pairs[:5].copy())
    still = np.zeros_like(x)
    calls = 0
    while (count := find_contacts(table, x, R, still, still, 0.0, 0.01, work, out)) == TOO_SMALL:
        work, out = make_room(table, work, out)
        calls += 1
    assert calls == 2
    assert count == work.needed[1] > 100
    every = found(table, x, R, margin=0.01)
    assert (every["gap"] == out.gap[:count]).all()
    pairs = np.unique(every["shapes"], axis=0)
    some = [(int(b), int(a)) for a, b in pairs[::2]]
    left = np.unique(found(bodies.table(excluded=some), x, R, margin=0.01)["shapes"], axis=0)
    assert left.tolist() == pairs[1::2].tolist()
    groups = np.arange(60) % 2
    crossed = found(bodies.table(groups=groups, laws=[[-1, 5], [5, -1]]), x, R, margin=0.01)
    assert (groups[crossed["shapes"]].sum(axis=1) == 1).all()
    assert (crossed["law"] == 5).all()
    assert len(crossed["gap"]) == (groups[every["shapes"]].sum(axis=1) == 1).sum()
    x[7, 1] = np.nan
    assert find_contacts(table, x, R, still, still, 0.0, 0.01, work, out) == NOT_FINITE


def test_wrong_tables_are_refused():
    bodies = Bodies()
    bodies.add(contact.HalfSpace, ground=True)
    bodies.add(contact.Cylinder, 0.1)
    with pytest.raises(SceneError, match=r"HalfSpace on .* and Cylinder on .*: two shapes without bounds"):
        bodies.table()
    assert len(bodies.table(groups=[0, 1], laws=[[0, -1], [-1, 0]]).core) == 2
    with pytest.raises(SceneError, match="symmetric"):
        bodies.table(groups=[0, 1], laws=[[0, -1], [0, 0]])
    with pytest.raises(SceneError, match="groups are between 0 and 0"):
        bodies.table(groups=[0, 1], laws=[[0]])


CUBE = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
POINTS = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])


def test_a_polytope_touches_a_half_space_by_its_corners_as_a_box_does():
    """In the world of smooth laws."""
    ends_at = []
    for kind, sizes in ((contact.Box, SIDES), (contact.ConvexPolytope, 0.5 * (2.0 * POINTS - 1.0) * SIDES)):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        body = scene.add(fm.RigidBody(10.0, (1.0, 1.0, 1.0)))
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position = (0.0, 0.0, 0.6, 0.9, 0.3, 0.3, 0.1)
        floor, law = contact.HalfSpace(scene.ground.frame()), contact.PowerLaw.bearing(100.0, depth=0.01)
        scene.touch(floor, kind(body.frame(), sizes), law)
        ends_at.append(scene.simulate(0.3, rtol=1e-5).position(body.frame())[-1])
    assert ends_at[0] == pytest.approx(ends_at[1], abs=1e-9)
    with pytest.raises(SceneError, match="no such pair is known yet"):
        scene.touch(contact.Sphere(scene.ground.frame(), 1.0), kind(body.frame(), sizes), law)


def test_polytopes_are_checked():
    frame = fm.System().ground.frame()
    made = contact.ConvexPolytope(frame, POINTS, CUBE)
    assert len(made.polytope.faces) == 6
    assert len(made.polytope.edges) == 12
    triangles = [[f[0], f[k], f[k + 1]] for f in CUBE for k in (1, 2)]
    assert len(contact.ConvexPolytope(frame, POINTS, triangles).polytope.faces) == 6
    assert len(hull([*POINTS, (0.5, 0.5, 0.5), (0.5, 0.0, 0.0), (0.5, 0.5, 0.0)]).vertices) == 8
    for vertices, faces, message in [
        (POINTS, CUBE[:-1], "not closed, the edge from vertex"),
        (POINTS, [loop[::-1] for loop in CUBE], "inverted"),
        (POINTS, [CUBE[0][::-1], *CUBE[1:]], "both run from vertex"),
        (np.vstack((POINTS, [0.5, 0.5, 0.5])), [*CUBE[:-1], *([1, 5, 8], [5, 7, 8], [7, 3, 8], [3, 1, 8])],
         "not convex, vertex"),
        (POINTS + 0.1 * (np.arange(8) == 7)[:, None], CUBE, "not flat"),
        (POINTS, [*CUBE, [0, 9, 1]], "a vertex that there is not"),
        (POINTS, [*CUBE[:-1], [1, 5, 5, 3]], "three or more different vertices"),
        (np.vstack((POINTS, [2.0, 0.0, 0.0])), CUBE, "vertex 8 is on no face"),
        (np.vstack((POINTS, [0.5, 0.0, 0.0])),
         [*CUBE[:2], [0, 8, 4, 5, 1], *CUBE[3:4], [0, 2, 6, 4], [0, 4, 8], CUBE[5]], "face 5, .* has no area"),
        (POINTS, 5, "faces must be lists of whole numbers, those of their vertices, got 5"),
        (POINTS, [[0, 1.5, 2]], "face 0 must be a list of whole numbers"),
        (POINTS, [[0, "a", 2]], "face 0 must be a list of whole numbers"),
        ("abc", None, "four or more"),
        (POINTS[:4], None, "lie in a plane"),
        (POINTS[:3], None, "four or more"),
        (np.full((5, 3), np.nan), None, "not finite"),
    ]:  # fmt: skip
        with pytest.raises(SceneError, match=f"ConvexPolytope on ground.*{message}"):
            contact.ConvexPolytope(frame, vertices, faces)
    with pytest.raises(SceneError, match="fewer than 1024"):
        hull(Rotation.random(400, random_state=1).as_matrix()[:, 0])
    assert polytope(TETRAHEDRON, [(0, 2, 1), (0, 1, 3), (1, 2, 3), (2, 0, 3)]).normals.shape == (4, 3)
