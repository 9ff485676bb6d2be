"""Surfaces of triangles: distances by brute force and closed forms, one normal across edges, balls that roll."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.solid import unit_ball
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.contact.signed_distance import SHAPE_NUMBERS, gradient_variation


@entry_kernel
def vary(data, p, dp, out):
    dn = gradient_variation(data, 0, (p[0], p[1], p[2]), (dp[0], dp[1], dp[2]))
    for k in range(3):
        out[k] = dn[k]


TURN = Rotation.from_rotvec((0.3, -0.8, 0.5)).as_matrix()


def ground():
    return fm.System().ground.frame()


def probed(surface, points):
    """Distances (n,) and gradients (n, 3)."""
    found = surface._distances(np.atleast_2d(np.asarray(points, dtype=float)), surface.table)
    return found[:, 0], found[:, 1:]


def grid(x, y, z):
    """Points (m n, 3) and triangles of a grid of corners (m, n); the diagonals alternate."""
    m, n = np.shape(x)
    points = np.stack([x, y, z], axis=2).reshape(-1, 3)
    rows = np.arange(m * n).reshape(m, n)
    triangles = []
    for i in range(m - 1):
        for j in range(n - 1):
            a, b, c, d = rows[i, j], rows[i + 1, j], rows[i + 1, j + 1], rows[i, j + 1]
            triangles += [(a, b, c), (a, c, d)] if (i + j) % 2 else [(a, b, d), (b, c, d)]
    return points, np.array(triangles)


def tube(around, along=4, radius=1.0, length=1.0):
    """A tube about z, open at its ends, that faces inwards."""
    angle, z = np.linspace(0.0, 2.0 * np.pi, around + 1), np.linspace(-0.5, 0.5, along + 1) * length
    a, h = np.meshgrid(angle, z, indexing="ij")
    points, triangles = grid(radius * np.cos(a), radius * np.sin(a), h)
    points[-(along + 1) :] = points[: along + 1]  # to the bit
    return points, triangles[:, ::-1]


def to_triangles(p, x):
    """Brute force: the least distance of p from triangles (t, 3, 3)."""
    a, b, c = x[:, 0], x[:, 1], x[:, 2]
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1)[:, None]
    height = np.einsum("ti,ti->t", p - a, n)
    foot = p - height[:, None] * n
    inside = np.ones(len(x), dtype=bool)
    least = np.full(len(x), np.inf)
    for one, other in ((a, b), (b, c), (c, a)):
        edge = other - one
        inside &= np.einsum("ti,ti->t", np.cross(edge, foot - one), n) >= 0.0
        t = np.clip(np.einsum("ti,ti->t", p - one, edge) / np.einsum("ti,ti->t", edge, edge), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(one + t[:, None] * edge - p, axis=1))
    return np.where(inside, np.abs(height), least).min()


def is_inside(p, x):
    """By the solid angle."""
    a, b, c = np.moveaxis(x - p, 1, 0)
    la, lb, lc = (np.linalg.norm(one, axis=1) for one in (a, b, c))
    top = np.einsum("ti,ti->t", a, np.cross(b, c))
    dots = [np.einsum("ti,ti->t", *pair) for pair in ((a, b), (b, c), (c, a))]
    return np.arctan2(top, la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb).sum() > np.pi


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_flat_facets_are_as_far_as_by_brute_force(size):
    points, triangles = unit_ball(7, 9)
    points = size * (points * (1.0, 0.6, 0.3)) @ TURN.T
    surface = contact.TriangleSurface(ground(), points, triangles, crease_angle=0.0)
    p = np.random.default_rng(1).uniform(-1.2, 1.2, (300, 3)) * size
    p[:150] *= 0.4
    x = points[triangles]
    expected = [to_triangles(one, x) * (-1.0 if is_inside(one, x) else 1.0) for one in p]
    assert (np.array(expected) < 0.0).sum() > 20
    assert surface.signed_distance(p) == pytest.approx(expected, abs=1e-13 * size)


def test_a_box_of_triangles_is_the_box():
    shape = fm.Shape.box((0.8, 0.6, 0.4))
    surface = contact.TriangleSurface.of_shape(ground(), shape)
    p = np.random.default_rng(3).uniform(-0.7, 0.7, (300, 3))
    q = np.abs(p) - (0.4, 0.3, 0.2)
    expected = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)
    assert surface.signed_distance(p) == pytest.approx(expected, abs=1e-14)
    assert surface.numbers()[2] == pytest.approx(0.2, rel=0.02)  # half the thickness


def test_a_ball_of_triangles_comes_near_the_sphere_by_the_third_order_and_its_normals_by_the_second():
    def fault(rings):
        surface = contact.TriangleSurface(ground(), *unit_ball(rings, 2 * rings))
        p = np.random.default_rng(4).normal(size=(200, 3))
        p /= np.linalg.norm(p, axis=1)[:, None]
        far, n = probed(surface, 1.1 * p)
        return np.abs(far - 0.1).max(), np.abs(n - p).max()

    coarse, fine = fault(24), fault(48)
    assert coarse[0] < 1e-4
    assert fine[0] < coarse[0] / 8.0
    assert fine[1] < coarse[1] / 4.0


def test_a_tube_of_triangles_is_next_to_the_cylinder():
    surface = contact.TriangleSurface(ground(), *tube(100), open=True)
    angle = np.linspace(0.1, 6.0, 200)
    p = np.stack([0.9 * np.cos(angle), 0.9 * np.sin(angle), np.linspace(-0.2, 0.2, 200)], axis=1)
    far, n = probed(surface, p)
    assert np.abs(far - 0.1).max() < 5e-7
    assert n == pytest.approx(p * (-1.0, -1.0, 0.0) / 0.9, abs=5e-5)


def hill():
    """A smooth irregular surface, to the eye."""
    rng = np.random.default_rng(8)
    a, b = np.meshgrid(np.linspace(0.0, 1.0, 9), np.linspace(0.0, 1.0, 8), indexing="ij")
    a[1:-1, 1:-1] += 0.03 * rng.normal(size=(7, 6))
    b[1:-1, 1:-1] += 0.03 * rng.normal(size=(7, 6))
    return grid(a, b, 0.1 * np.sin(3.0 * a) * np.cos(4.0 * b))


def test_the_normal_does_not_jump_from_triangle_to_triangle():
    """Along a line above a surface without creases it changes in proportion to how far one goes."""
    points, triangles = hill()

    def jump(crease, n):
        surface = contact.TriangleSurface(ground(), points, triangles, crease_angle=crease, open=True)
        x, y = np.linspace(0.2, 0.8, n), np.linspace(0.3, 0.75, n)
        p = np.stack([x, y, 0.1 * np.sin(3.0 * x) * np.cos(4.0 * y) + 1e-3], axis=1)
        return np.linalg.norm(np.diff(probed(surface, p)[1], axis=0), axis=1).max()

    assert jump(0.5, 20001) < 0.11 * jump(0.5, 2001) < 1e-2
    assert jump(0.0, 20001) > 0.1


def test_gradients_are_those_of_differences():
    points, triangles = hill()
    surface = contact.TriangleSurface(ground(), points, triangles, open=True)
    rng = np.random.default_rng(6)
    p = np.column_stack([rng.uniform(0.1, 0.9, (60, 2)), np.zeros(60)])
    p[:, 2] = 0.1 * np.sin(3.0 * p[:, 0]) * np.cos(4.0 * p[:, 1]) + rng.uniform(-0.05, 0.05, 60)
    h, n = 1e-6, probed(surface, p)[1]
    for k, axis in enumerate(np.eye(3)):
        slope = (probed(surface, p + h * axis)[0] - probed(surface, p - h * axis)[0]) / (2.0 * h)
        assert n[:, k] == pytest.approx(slope, abs=1e-7)


def test_what_the_gradient_changes_by_is_as_by_differences():
    points, triangles = hill()
    shapes = [
        contact.TriangleSurface(ground(), points, triangles, open=True),
        contact.TriangleSurface.of_shape(ground(), fm.Shape.cylinder(0.3, 0.5), crease_angle=0.4),
    ]
    rng = np.random.default_rng(9)
    for surface in shapes:
        data = np.concatenate([[surface._kind, SHAPE_NUMBERS, 0.0, 0.0], surface.table.values])
        compared = 0
        for _ in range(60):
            p, dp, h = rng.uniform(-0.5, 0.9, 3), rng.normal(size=3), 1e-6
            (far,), _ = probed(surface, p)
            ahead, back = probed(surface, p + h * dp)[1][0], probed(surface, p - h * dp)[1][0]
            if np.abs(ahead - back).max() > 1e-3 or abs(far) < 1e-3:
                continue
            out = np.zeros(3)
            vary(data, p, dp, out)
            assert out == pytest.approx((ahead - back) / (2.0 * h), abs=1e-4 / min(1.0, abs(far)))
            compared += 1
        assert compared > 40


def test_a_sharp_rim_between_curved_and_flat_triangles_is_the_circle():
    surface = contact.TriangleSurface.of_shape(ground(), fm.Shape.cylinder(0.3, 0.5))
    angle = np.linspace(0.0, 6.0, 50)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(50)], axis=1)
    beyond = 0.33 * circle + [0.0, 0.0, 0.29]
    assert surface.signed_distance(beyond) == pytest.approx(0.05, abs=1e-6)
    assert surface.signed_distance(0.2 * circle + [0.0, 0.0, 0.26]) == pytest.approx(0.01, abs=1e-14)
    assert surface.signed_distance(0.31 * circle) == pytest.approx(0.01, abs=1e-6)
    assert surface.signed_distance(0.29 * circle) == pytest.approx(-0.01, abs=1e-6)


def test_what_is_beside_a_rim_is_not_behind_the_surface():
    points = np.array([(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 1.0, 0.0), (0.0, 1.0, 0.0)]) @ TURN.T
    sheet = contact.TriangleSurface(ground(), points, [(0, 1, 2), (0, 2, 3)], open=True)
    deep = 1e-3
    beside = np.array([(2.1, 0.5, -deep), (2.1, 1.2, -deep), (-0.3, -0.1, -deep), (1.0, -0.2, -deep), (0.4, 1.1, deep)])
    way = np.linalg.norm(beside - np.clip(beside, 0.0, [2.0, 1.0, 0.0]), axis=1)
    assert sheet.signed_distance(beside @ TURN.T) == pytest.approx(way, abs=1e-12)
    under = np.array([(2.0, 0.5, -deep), (2.0, 1.0, -deep), (0.0, 0.0, -deep), (1.0, 0.4, -deep)])  # flush with it too
    assert sheet.signed_distance(under @ TURN.T) == pytest.approx(-deep, abs=1e-12)


def rolled(build, *, crease=0.5, friction=True, turned=TURN):
    """The share of its kinetic energy that a ball loses on a surface in turned axes."""
    r, mass = 0.05, 2.0
    points, triangles, start, velocity, spin, load, pull, end = build(r, mass)
    scene = fm.System(gravity=tuple(turned @ pull))
    at = scene.ground.frame(R=turned)
    inertia = 0.4 * mass * r**2
    body = scene.add(fm.RigidBody(mass, (inertia, inertia, inertia)), name="ball")
    free = scene.connect(fm.joint.Free(), at, body.frame())
    free.position, free.velocity = (*start, 1.0, 0.0, 0.0, 0.0), (*velocity, *spin)
    law = contact.PowerLaw.bearing(load, depth=1e-6, restitution=0.5, speed=1e-3)
    rough = contact.Friction(0.3, stiffness=load / 1e-6, damping=0.2 * np.sqrt(load / 1e-6 * mass), load=load)
    surface = contact.TriangleSurface(at, points, triangles, crease_angle=crease, open=True)
    scene.touch(surface, contact.Sphere(body.frame(), r), law, friction=rough if friction else None)
    run = scene.simulate(end, rtol=1e-8)
    speeds = np.linalg.norm(run.velocity(body.frame()), axis=1)
    return 1.0 - (speeds[-1] / speeds[0]) ** 2


def plane(r, mass):
    rng = np.random.default_rng(2)
    a, b = np.meshgrid(np.linspace(0.0, 5.0, 51), np.linspace(-0.2, 0.2, 5), indexing="ij")
    a[1:-1, 1:-1] += 0.02 * rng.normal(size=(49, 3))
    points, triangles = grid(a, b, 0.0 * a)
    load = 9.81 * mass
    return points, triangles, (0.1, 0.013, r - 1e-6), (2.0, 0.0, 0.0), (0.0, 2.0 / r, 0.0), load, (0.0, 0.0, -9.81), 2.3


def drum(r, mass):
    points, triangles = tube(100, radius=0.5, length=0.2)
    rho, v = 0.5 - r + 1e-6, 2.0
    load = mass * v**2 / rho
    end = 2.0 * np.pi * rho / v
    return points, triangles, (rho, 0.0, 0.012), (0.0, v, 0.0), (0.0, 0.0, -v / r), load, (0.0,) * 3, end


@pytest.mark.parametrize("build", [plane, drum])
def test_a_ball_that_rolls_over_a_hundred_facets_keeps_its_energy(build):
    assert abs(rolled(build)) < 1e-6


def test_a_ball_that_rolls_along_a_line_of_corners_keeps_its_energy():
    def along(r, mass):
        given = drum(r, mass)
        return *given[:2], (given[2][0], 0.0, 0.0), *given[3:]

    assert abs(rolled(along, friction=False)) < 1e-6


def test_a_box_of_triangles_and_an_extruded_square_throw_a_ball_as_the_box_does():
    """A ball that spins falls beside the edge, and over it."""
    square = [(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)]
    ends = []
    for build in (
        lambda ground: contact.Box(ground.frame(), (0.4, 0.4, 0.4)),
        lambda ground: contact.TriangleSurface.of_shape(ground.frame(), fm.Shape.box((0.4, 0.4, 0.4))),
        lambda ground: contact.Profile(ground.frame(R=[[0, 1, 0], [0, 0, 1], [1, 0, 0]]), square),
    ):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        body = scene.add(fm.RigidBody(1.0, (4e-3, 4e-3, 4e-3)), name="ball")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position, free.velocity = (0.15, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0), (0.3, 0.1, 0.0, 1.0, 5.0, 2.0)
        rough = contact.Friction(0.3, stiffness=1e5, damping=50.0, load=10.0)
        law = contact.PowerLaw(k=1e5, restitution=0.6)
        scene.touch(build(scene.ground), contact.Sphere(body.frame(), 0.1), law, friction=rough)
        ends.append(scene.simulate(0.5, rtol=1e-8).position(body.frame())[-1])
    assert ends[0][0] > 0.3
    assert ends[1] == pytest.approx(ends[0], abs=1e-6)
    assert ends[2] == pytest.approx(ends[0], abs=1e-6)


def test_facets_that_stay_flat_brake_it():
    assert rolled(drum, crease=0.0, friction=False) > 1e-4


def refused(said, points, triangles, **named):
    with pytest.raises(SceneError, match=said):
        contact.TriangleSurface(ground(), points, triangles, **named)


def test_surfaces_that_enclose_nothing_are_refused():
    box = fm.Shape.box((1.0, 1.0, 1.0))
    x, rows = box.points, box.triangles
    refused("is open: 3 edges", x, rows[1:])
    refused("faces inwards", x, rows[:, ::-1])
    refused("do not agree which side is out", x, np.vstack([rows[:1, ::-1], rows[1:]]))
    third = np.vstack([rows, [[*rows[0, :2], 8]]])
    refused("more than two triangles", np.vstack([x, [[5.0, 0.0, 0.0]]]), third)
    refused("have no area", np.vstack([x, [0.5 * (x[rows[0, 0]] + x[rows[0, 1]])]]), third)
    refused("have no area", x, np.vstack([rows, [[0, 0, 1]]]))
    refused("finite numbers of shape", x[:, :2], rows)
    refused("whole numbers of shape", x, rows[:, :2])
    refused("name points 0 to 7", x, rows + 1)
    refused("crease_angle must be", x, rows, crease_angle=2.0)
    refused("open must be", x, rows, open=1)
    assert contact.TriangleSurface(ground(), x, rows[1:], open=True).numbers()[2] == 0.0
    with pytest.raises(SceneError, match="points must be finite"):
        contact.TriangleSurface(ground(), x, rows).signed_distance([1.0, 2.0, 3.0])


def test_contacts_of_one_surface_share_its_table_and_their_laws_vary():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    surface = contact.TriangleSurface.of_shape(scene.ground.frame(), fm.Shape.box((2.0, 2.0, 1.0)))
    bodies = []
    for i in range(3):
        body = scene.add(fm.RigidBody(1.0, (1e-3, 1e-3, 1e-3)), name=f"ball {i}")
        slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(p=(0.3 * i - 0.3, 0.1, 0.55)), body.frame())
        slide.position = 0.1
        bodies.append(body)
    law = contact.PowerLaw(k=1e5, p=1.5, restitution=0.6)
    pairs = scene.touch(surface, [contact.Sphere(body.frame(), 0.05) for body in bodies], law)
    machine = scene.compile(parameters={"law": fm.parameter.OfForce(pairs[0], "law")})
    run = machine.simulate(t_end=0.3, law=contact.PowerLaw(k=1e4, p=1.5, restitution=0.6))
    least = [run.position(body.frame())[:, 2].min() for body in bodies]
    assert least[1] == pytest.approx(least[2], abs=1e-4)
    assert 0.5 < least[0] < least[1] < 0.55
    size = surface.table.values.size
    assert size < len(scene.compile().scene.plan.data) < 1.5 * size


def test_hertz_is_refused_by_its_name():
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    surface = contact.TriangleSurface.of_shape(scene.ground.frame(), fm.Shape.box((1.0, 1.0, 1.0)))
    with pytest.raises(SceneError, match="take PowerLaw"):
        scene.touch(surface, contact.Sphere(body.frame(), 0.1), contact.Hertz(E=2e11))


@pytest.mark.parametrize("rtol", [1e-2, 1e-8])
@pytest.mark.parametrize("kind", ["triangles", "profile"])
def test_nothing_fast_passes_through_a_thin_plate(kind, rtol):
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (0.13, 3.0, 0.07, 1.0, 0.0, 0.0, 0.0), (0.0, -100.0, 0.0, 0.0, 0.0, 0.0)
    frame = scene.ground.frame()
    if kind == "profile":
        plate = contact.Profile(frame, [(-1.0, -0.005), (1.0, -0.005), (1.0, 0.005), (-1.0, 0.005)])
    else:
        plate = contact.TriangleSurface.of_shape(frame, fm.Shape.box((2.0, 0.01, 2.0)))
    law = contact.PowerLaw(k=1e9, p=1.5, restitution=0.5, speed=100.0)
    scene.touch(plate, contact.Sphere(body.frame(), 0.01), law)
    run = scene.simulate(0.05, rtol=rtol, integrator=fm.ExplicitRungeKutta())
    assert run.velocity(body.frame())[-1] == pytest.approx([0.0, 50.0, 0.0], abs=1.0 if rtol > 1e-3 else 1e-2)
