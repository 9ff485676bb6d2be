"""Beams that touch by spheres and capsules along them: a rope over a drum, a cable on a floor, a ball on a rope."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError

G = 9.81


def rope_section(*, E=1e9, rho=5000.0, radius=2e-3, bending=None):
    """A round rope; ``bending``: its second moments of area (m^4), if they are not those of a solid bar."""
    second = 0.25 * np.pi * radius**4 if bending is None else bending
    return SimpleNamespace(
        E=E, nu=0.3, rho=rho, A=np.pi * radius**2, Iy=second, Iz=second, J=2.0 * second, ky=0.9, kz=0.9, Iyz=0.0,
        orientation=(0.0, 0.0, 1.0),
    )  # fmt: skip


@pytest.mark.parametrize("mu", [0.1, 0.3])
def test_a_rope_that_slides_over_a_drum_pulls_as_eytelwein_s_formula_says(mu):
    """T2 / T1 = exp(mu pi).  Elements are shorter than sqrt(E I / T), as long as it takes a rope to bend."""
    drum, load, radius, speed, rise = 0.1, 10.0, 2e-3, 0.03, 0.05
    points = {"near": (drum, -0.1, 0.0), "right": (drum, 0.0, 0.0)}
    points |= {"left": (-drum, 0.0, 0.0), "far": (-drum, -0.1, 0.0)}
    beams = {"ends": [("near", "right"), ("left", "far")], "wound": [("right", (0.0, drum, 0.0), "left")]}
    section = rope_section(bending=4e-12)
    scene = fm.System()
    rope = fm.ExactBeam(
        points, beams, {"ends": section, "wound": section}, {"ends": 4, "wound": 20}, viscosity=5e-3,
        rotary_inertia={"ends": (1e-6, 1e-6), "wound": (1e-6, 1e-6)},
    )  # fmt: skip
    scene.add(rope, name="rope")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(p=(drum, 0.0, 0.0)), rope.frame("near"))

    def drawn(t):
        """Down, ever faster up to the speed."""
        s = min(t / rise, 1.0)
        way = rise * (s**3 - 0.5 * s**4) + max(t - rise, 0.0)
        return -0.1 - speed * way, -speed * (3.0 * s**2 - 2.0 * s**3), -speed * 6.0 * (s - s**2) / rise

    slide.prescribe(drawn)
    scene.add_force(fm.force.FrameForce(rope.frame("far"), (0.0, -load, 0.0)))
    spheres, _ = contact.spheres_along(rope, "wound", radius)
    rough = contact.Friction(mu, stiffness=1e4, damping=0.5, load=3.0)
    law = contact.PowerLaw(k=1e5, restitution=0.1, speed=1e-2)
    pairs = scene.touch([contact.Cylinder(scene.ground.frame(), drum - radius)], spheres, law, friction=rough)
    assert len(pairs) == 21
    run = scene.simulate(0.2, rtol=1e-4)
    tension = run.resultants(rope)[:, :, 0]
    late = run.t > 0.18
    assert tension[late, 6] == pytest.approx(load, rel=1e-4)
    assert (tension[late, 1] / tension[late, 6]) == pytest.approx(np.exp(mu * np.pi), rel=1.5e-2)


def cable(height, *, length=1.0, divisions=20, k=1e5):
    """A cable above a floor and the contacts of its spheres; k (N/m) per metre."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    section = rope_section(radius=5e-3, rho=2000.0, E=1e7)
    line = scene.add(
        fm.ExactBeam({"a": (0.0, 0.0, height), "b": (length, 0.0, height)}, {"line": [("a", "b")]}, {"line": section},
                     divisions, viscosity=1e-2, rotary_inertia={"line": (1e-6, 1e-6)}),
        name="line",
    )  # fmt: skip
    scene.connect(fm.joint.Free(), scene.ground.frame(), line.frame("a")).position = (0.0, 0.0, height, 1, 0, 0, 0)
    spheres, lengths = contact.spheres_along(line, "line", 5e-3)
    floor = contact.HalfSpace(scene.ground.frame())
    pairs = [
        scene.touch(floor, sphere, contact.PowerLaw(k=k * one, restitution=0.3, speed=0.1))[0]
        for sphere, one in zip(spheres, lengths, strict=True)
    ]
    return scene, section, lengths, pairs


def test_a_cable_that_falls_on_a_floor_lies_on_all_of_its_length():
    scene, section, lengths, pairs = cable(0.01)
    assert lengths.sum() == pytest.approx(1.0, rel=1e-13)
    run = scene.simulate(0.5, rtol=1e-5)
    weight = section.rho * section.A * G
    borne = np.array([one.normal_force[-1] for one in run.contacts(pairs)])
    assert borne == pytest.approx(weight * lengths, rel=1e-6)
    gaps = np.array([one.gap[-1] for one in run.contacts(pairs)])
    assert gaps == pytest.approx(-weight / 1e5, rel=1e-6)


def test_capsules_along_a_beam_carry_a_ball_wherever_it_is():
    """They follow one another without a gap, along an arc too."""
    scene = fm.System()
    bow = fm.ExactBeam(
        {"a": (-1.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}, {"bow": [("a", (0.0, 1.0, 0.0), "b")]},
        {"bow": rope_section()}, 12,
    )  # fmt: skip
    scene.add(bow, name="bow")
    capsules = contact.capsules_along(bow, "bow", 0.02)
    assert len(capsules) == 13
    assert sum(one.length for one in capsules) == pytest.approx(np.pi, rel=1e-3)
    nodes = bow.mesh.x
    places = []
    for one in capsules:
        node = nodes[[part is one.frame.body for part in bow.parts].index(True)]
        middle, along = node + one.frame.p_BF_B, 0.5 * one.length * one.frame.R_BF[:, 2]
        assert np.linalg.det(one.frame.R_BF) == pytest.approx(1.0, abs=1e-12)
        places.append((middle - along, middle + along))
    inner = places[1:-1] if np.linalg.norm(places[0][0] - nodes[0]) < 1e-12 else places
    assert all(np.linalg.norm(x) == pytest.approx(1.0, abs=1e-2) for pair in inner for x in pair)
    ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    pairs = scene.touch([contact.Sphere(ball.frame(), 0.1)], capsules, contact.PowerLaw(k=1.0))
    assert len(pairs) == 13


def test_a_ball_lies_on_a_rope_and_weighs_on_it():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    section = rope_section(radius=5e-3, rho=1000.0)
    rope = scene.add(
        fm.ExactBeam({"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}, {"rope": [("a", "b")]}, {"rope": section}, 8,
                     viscosity=5e-3, rotary_inertia={"rope": (1e-5, 1e-5)}),
        name="rope",
    )  # fmt: skip
    for end, x in (("a", 0.0), ("b", 1.0)):
        scene.connect(fm.joint.Fixed(), scene.ground.frame((x, 0.0, 0.0)), rope.frame(end))
    ball = scene.add(fm.RigidBody(0.05, (1e-5,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.5, 0.0, 0.025, 1.0, 0.0, 0.0, 0.0)
    capsules = contact.capsules_along(rope, "rope", 5e-3)
    law = contact.PowerLaw(k=1e5, restitution=0.3, speed=0.1)
    pairs = scene.touch(capsules, [contact.Sphere(ball.frame(), 0.02)], law)
    run = scene.simulate(2.0, rtol=1e-5)
    borne = np.array([one.normal_force[-1] for one in run.contacts(pairs)])
    assert borne.sum() == pytest.approx(0.05 * G, rel=1e-3)
    assert np.count_nonzero(borne) == 1  # by the capsule in the middle
    sag = run.position(rope.frame((0.5, 0.0, 0.0)))[-1, 2] - run.position(rope.frame("a"))[-1, 2]
    assert run.position(ball.frame())[-1, 2] == pytest.approx(sag + 0.025 - 0.05 * G / 1e5, abs=1e-6)


def shortened(P, half, radius, E, nu):
    """m, of a disc's radius under P (N/m) on its two ends: its strain along the axis of loads, summed up.

    In plane strain: of Hertz' pressure on a half space near one end (Johnson 1985, eq. 4.46), of the line load on the
    other, and of the even tension P / (pi R) that frees the disc's rim.
    """

    def strain(z):
        root = np.hypot(half, z)
        most = 2.0 * P / (np.pi * half)
        across = -most * ((half**2 + 2.0 * z**2) / root - 2.0 * z) / half + P / (np.pi * radius)
        along = -most * half / root - 2.0 * P / (np.pi * (2.0 * radius - z)) + P / (np.pi * radius)
        return (1.0 - nu**2) / E * (along - nu / (1.0 - nu) * across)

    return -quad(strain, 0.0, radius, points=[half, 10.0 * half], epsrel=1e-10)[0]


@pytest.mark.parametrize("other", [None, (0.02, 7e10, 0.2)])
def test_the_law_of_a_cylinder_along_a_line_has_hertz_s_depth_and_slope(other):
    """Against the strain in plane strain, at the load and near it."""
    radius, E, nu, length, P = 0.01, 2.1e11, 0.3, 0.04, 5e4
    given = {} if other is None else dict(zip(("radius_other", "E_other", "nu_other"), other, strict=True))
    law = contact.PowerLaw.of_cylinder(P * length, length=length, radius=radius, E=E, nu=nu, **given)
    discs = [(radius, E, nu), *([] if other is None else [other])]
    give, curvature = sum((1.0 - v**2) / e for _, e, v in discs), sum(1.0 / r for r, *_ in discs)

    def depth(force):
        half = np.sqrt(4.0 * force * give / (np.pi * curvature))
        return sum(shortened(force, half, *one) for one in discs)

    assert law.k * depth(P) ** law.p == pytest.approx(P * length, rel=2e-3)
    slope = (depth(1.01 * P) - depth(0.99 * P)) / (0.02 * P)
    assert law.p * law.k * depth(P) ** (law.p - 1.0) == pytest.approx(length / slope, rel=2e-3)
    for factor in (0.1, 10.0):
        assert law.k * depth(factor * P) ** law.p == pytest.approx(factor * P * length, rel=0.03)


def test_a_cable_lies_as_deep_as_hertz_says_on_all_of_its_length():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    section = rope_section(radius=5e-3, rho=2000.0, E=1e7)
    line = fm.ExactBeam({"a": (0.0, 0.0, 0.0), "b": (0.5, 0.0, 0.0)}, {"line": [("a", "b")]}, {"line": section}, 5)
    scene.add(line, name="line")
    lift = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), line.frame("a"))
    lift.position = 5e-3
    floor, weight = contact.HalfSpace(scene.ground.frame()), section.rho * section.A * G
    pairs = []
    for sphere, length in zip(*contact.spheres_along(line, "line", 5e-3), strict=True):
        law = contact.PowerLaw.of_cylinder(weight * length, length=length, radius=5e-3, E=1e7)
        pairs += scene.touch(floor, sphere, law)
    run = scene.simulate(1e-6, about=scene.equilibrium())
    half = np.sqrt(4.0 * weight * 5e-3 * 0.91e-7 / np.pi)
    gaps = [one.gap[0] for one in run.contacts(pairs)]
    assert gaps == pytest.approx([-shortened(weight, half, 5e-3, 1e7, 0.3)] * 6, rel=2e-3)


def test_loads_that_press_a_cylinder_flat_are_refused():
    right = {"length": 0.1, "radius": 0.01, "E": 1e6}
    contact.PowerLaw.of_cylinder(10.0, **right)
    for wrong, words in (
        ({"load": 1e5}, "no small part of its diameter"),
        ({"load": 0.0}, "load"),
        ({"length": -1.0}, "length"),
        ({"radius": 0.0}, "radius"),
        ({"nu": 0.6}, "nu"),
        ({"radius_other": -1.0}, "radius_other"),
        ({"E_other": 7e10}, "give its radius_other"),
        ({"nu_other": 0.2}, "give its radius_other"),
        ({"E": "steel"}, "E"),
    ):
        given = {"load": 10.0, **right, **wrong}
        with pytest.raises(SceneError, match=words):
            contact.PowerLaw.of_cylinder(given.pop("load"), **given)


def test_wrong_arguments_are_refused():
    rope = fm.ExactBeam({"a": (0, 0, 0), "b": (1, 0, 0)}, {"rope": [("a", "b")]}, {"rope": rope_section()}, 2)
    with pytest.raises(SceneError, match="no group 'line'; the groups are: 'rope'"):
        contact.spheres_along(rope, "line", 0.1)
    with pytest.raises(SceneError, match="no group 'line'"):
        contact.capsules_along(rope, "line", 0.1)
    with pytest.raises(SceneError, match="radius of a Sphere"):
        contact.spheres_along(rope, "rope", 0.0)
    with pytest.raises(SceneError, match="what shapes are spread along"):
        contact.spheres_along(3.0, "rope", 0.1)
