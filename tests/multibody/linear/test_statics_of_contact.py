"""Equilibria and their paths where bodies touch: nothing is passed through, whatever the start and the steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from patched import patched_body

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.contact.signed_distance import distances
from flexmbd.multibody.kernels.sampling.passing_shares import SHARE, point_shares
from flexmbd.multibody.linear.passing import passing, passing_on_the_way

RADIUS, LOAD = 0.01, 1000.0
SHAPES = {
    "half space": contact.HalfSpace,
    "box": lambda f: contact.Box(f.body.frame(p=(0, 0, -0.002)), (1, 1, 0.004)),
    "sphere": lambda f: contact.Sphere(f.body.frame(p=(0, 0, -0.05)), 0.05),
    "disc": lambda f: contact.Disc(f.body.frame(p=(0, 0, -0.002)), 0.1, 0.004),
}
ROUGH = contact.Friction(mu=0.3, stiffness=1e8, damping=10.0, load=LOAD)


def pulled(name, law, *, gap, pull=1.0, friction=None):
    """A ball over a shape, pulled through it by a spring, of that stiffness (N/m), whose rest is far below."""
    scene = fm.System()
    ball = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="ball")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame(), name="slide")
    slide.position = RADIUS + gap
    scene.add_force(fm.force.JointSpring(slide, pull, rest=RADIUS - LOAD / pull))
    scene.touch(SHAPES[name](scene.ground.frame()), contact.Sphere(ball.frame(), RADIUS), law, friction=friction)
    return scene, slide


@pytest.mark.parametrize("friction", [None, ROUGH], ids=["smooth", "rough"])
@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_a_soft_spring_pulls_nothing_through(name, exponent, friction):
    """Found where the law bears the load, from apart, from touching and from pressed in."""
    law = contact.PowerLaw(k=1e8 if exponent == 1.0 else 1e10, p=exponent)
    depth = (LOAD / law.k) ** (1.0 / exponent)
    for gap in (0.3, 1e-4, 0.0, -1e-3):
        for stable in (False, True) if friction is None else (False,):
            scene, slide = pulled(name, law, gap=gap, friction=friction)
            found = scene.equilibrium(stable=stable).beta(slide) - RADIUS
            assert found == pytest.approx(-depth, rel=1e-5)


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("friction", [None, ROUGH], ids=["smooth", "rough"])
def test_what_nothing_holds_falls_onto_what_is_below(friction, free):
    for name in ("half space", "box"):
        for gap in (0.5, 1e-4, 0.0):
            scene = fm.System(gravity=(0.0, 0.0, -9.81))
            ball = scene.add(fm.RigidBody(100.0, (1, 1, 1)), name="ball")
            joint = fm.joint.Free() if free else fm.joint.Prismatic("z")
            fall = scene.connect(joint, scene.ground.frame(), ball.frame())
            fall.position = (0.1, 0.05, RADIUS + gap, 1, 0, 0, 0) if free else RADIUS + gap
            shape = SHAPES[name](scene.ground.frame())
            scene.touch(shape, contact.Sphere(ball.frame(), RADIUS), contact.PowerLaw(k=1e8), friction=friction)
            place = scene.equilibrium().position(ball.frame())
            np.testing.assert_allclose(place, ((0.1, 0.05) if free else (0.0, 0.0)) + (RADIUS - 9.81e-6,), atol=1e-12)


def test_what_falls_beside_everything_is_refused():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    ball = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="ball")
    scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame(), name="fall")
    below = contact.Sphere(scene.ground.frame(p=(0.3, 0.0, -3.0)), 0.05)
    scene.touch(below, contact.Sphere(ball.frame(), RADIUS), contact.PowerLaw(k=1e8))
    with pytest.raises(SceneError, match=r"'fall.vz' a force of -9.81 .* nothing resists it"):
        scene.equilibrium()


@pytest.mark.parametrize(("stable", "friction"), [(False, None), (True, None), (False, ROUGH)])
def test_what_the_law_does_not_bear_is_named(stable, friction):
    """The box is 4 mm thick: with 1e4 N/m its middle is reached before the load is borne."""
    scene, _ = pulled("box", contact.PowerLaw(k=1e4), gap=1e-4, friction=friction)
    told = r"contact of sphere ball with Box .*, pressed in by 0\.01\d* m, does not bear the load before the middle"
    with pytest.raises(SceneError, match=told):
        scene.equilibrium(stable=stable)


@pytest.mark.parametrize("at", [0.2, 3.0, 6.0])
def test_an_arm_that_is_wound_up_stops_at_the_first_pin(at):
    """At the angle (rad) at which the spheres touch, on a way on which it turns a hundred times."""
    scene = fm.System()
    arm = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
    scene.add_force(fm.force.JointSpring(hinge, 1e-3, rest=700.0))
    pin = contact.Cylinder(scene.ground.frame(p=(np.cos(at), np.sin(at), 0.0)), 1e-3)
    scene.touch(pin, contact.Sphere(arm.frame(p=(1.0, 0.0, 0.0)), 1e-3), contact.PowerLaw(k=1e8))
    assert scene.equilibrium().beta(hinge) == pytest.approx(at - 2.0 * np.arcsin(1e-3), abs=1e-7)


@pytest.mark.parametrize("name", ["sphere", "cylinder", "box"])
def test_a_step_that_is_allowed_passes_no_shape(name):
    """A body of random patches flies at a shape: the allowed share takes none further than half-way to the middle."""
    makes: dict[str, Callable[[fm.Frame], contact.Sphere | contact.Cylinder | contact.Box]] = {
        "sphere": lambda f: contact.Sphere(f, 0.1), "cylinder": lambda f: contact.Cylinder(f, 0.1),
        "box": lambda f: contact.Box(f, (0.1, 0.2, 0.3)),
    }  # fmt: skip
    half = 0.025 if name == "box" else 0.05
    rng, shortest = np.random.default_rng(5), 1.0
    for seed in range(20):
        scene = fm.System()
        body = scene.add(patched_body(seed, modes=4, patches=25), name="elastic")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        shape = makes[name](scene.ground.frame())
        scene.touch(contact.ElasticSurface(body), shape, contact.Hard())
        way = rng.standard_normal(3)
        way /= np.linalg.norm(way)
        free.position = (*(2.0 * way), 1.0, 0.0, 0.0, 0.0)
        compiled = scene.compile()
        plan, start = compiled.scene, compiled.start()
        step = np.zeros(plan.nv)
        for axis, value in zip("xyz", -4.0 * way, strict=True):
            step[next(k for k, one in enumerate(plan.velocity_names) if one.endswith(f".v{axis}"))] = value
        share = min(passing(plan, new_work(plan.plan), start.x, step).share, 1.0)
        shortest, out = min(shortest, share), np.zeros((25, 4))
        deep = None
        for part in np.linspace(0.0, share, 200):
            places = np.ascontiguousarray((2.0 - 4.0 * part) * way + body.record.contact.x)
            distances(np.append(shape.numbers(), 0.0), places, out)
            deep = max(0.0, -out[:, 0].min()) if deep is None else deep  # at the start; then half of what is left
            assert out[:, 0].min() >= -half - 0.5 * deep - 1e-9
    assert shortest < 0.5  # some are in its way


def test_of_no_step_less_than_nothing_is_allowed():
    """Of a ball over a plane that is felt to 0.1 m: half of what is left of that, and nothing deeper."""
    plane = np.append(contact.HalfSpace(fm.System().ground.frame()).numbers(), 0.0)
    gaps = np.array([0.2, 0.0, -0.05, -0.1, -0.3])
    out = np.zeros((5, 3))
    places, speeds = np.outer(gaps + RADIUS, (0.0, 0.0, 1.0)), np.tile((0.0, 0.0, -1.0), (5, 1))
    point_shares(plane, 0, RADIUS, 0.1, places, speeds, 0.0, out)
    np.testing.assert_allclose(out[:, SHARE], (0.25, 0.05, 0.025, 0.0, 0.0), atol=1e-15)


def test_a_step_is_looked_along_wherever_angles_turn():
    scene = fm.System()
    arm = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="arm")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
    pin = contact.Cylinder(scene.ground.frame(p=(-1.0, 0.0, 0.0)), 1e-3)
    scene.touch(pin, contact.Sphere(arm.frame(p=(1.0, 0.0, 0.0)), 1e-3), contact.PowerLaw(k=1e8))
    compiled = scene.compile()
    plan, start = compiled.scene, compiled.start()
    found = passing_on_the_way(plan, new_work(plan.plan), start.x, np.array([40.0]), np.ones(1))
    assert 40.0 * found.share == pytest.approx(np.pi, abs=0.01)
    assert passing_on_the_way(plan, new_work(plan.plan), start.x, np.array([3.0]), np.ones(1)).share == np.inf


def test_a_step_touches_where_the_first_of_its_pieces_does():
    """An arm of 1 m comes down to a floor 0.5 m below its hinge, after 30 degrees, and up again."""
    scene = fm.System()
    arm = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="arm")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), arm.frame())
    floor = contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -0.5)))
    scene.touch(floor, contact.Sphere(arm.frame(p=(1.0, 0.0, 0.0)), 1e-3), contact.PowerLaw(k=1e8))
    compiled = scene.compile()
    plan, start = compiled.scene, compiled.start()
    found = passing_on_the_way(plan, new_work(plan.plan), start.x, np.array([3.0]), np.ones(1))
    assert 3.0 * found.touch == pytest.approx(np.pi / 6.0, abs=0.02)
    assert not passing_on_the_way(plan, new_work(plan.plan), start.x, np.array([-1.0]), np.ones(1)).meets


@pytest.mark.parametrize("to", [30.0, 1e3, 1e6])
@pytest.mark.parametrize("name", ["half space", "box"])
def test_a_path_goes_through_a_touch(name, to):
    """Where the load comes to 10 N a ball on a spring of 1e4 N/m touches; from there on both springs bear."""
    gap, soft, stiff = 1e-3, 1e4, 1e9
    scene = fm.System()
    ball = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="ball")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame(), name="slide")
    slide.position = RADIUS + gap
    scene.add_force(fm.force.JointSpring(slide, soft, rest=RADIUS + gap))
    scene.add_force(fm.force.JointForce(slide, lambda t: -t))
    scene.touch(SHAPES[name](scene.ground.frame()), contact.Sphere(ball.frame(), RADIUS), contact.PowerLaw(k=stiff))
    path = scene.equilibrium(path=fm.Continuation(to=to))
    load = path.factors
    exact = np.where(load < soft * gap, gap - load / soft, -(load - soft * gap) / (soft + stiff))
    np.testing.assert_allclose(path.beta(slide) - RADIUS, exact, atol=1e-12)
    assert load[-1] == to
    assert len(load) < 40
    assert not path.critical


def test_a_column_that_buckles_is_stopped_by_a_wall():
    """A rod on a spring of its hinge: M = c (angle - 1e-3) = P sin(angle) up to the wall, where the angle stays."""
    scene = fm.System()
    rod = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="rod")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), rod.frame(), name="hinge")
    scene.add_force(fm.force.JointSpring(hinge, 100.0, rest=1e-3))
    scene.add_force(fm.force.FrameForce(rod.frame(p=(0, 0, 1.0)), (0, 0, lambda t: -t)))
    wall = contact.HalfSpace(scene.ground.frame(p=(0.3, 0, 0)), (-1, 0, 0))
    scene.touch(wall, contact.Sphere(rod.frame(p=(0, 0, 1.0)), 0.01), contact.PowerLaw(k=1e7))
    path = scene.equilibrium(path=fm.Continuation(to=1000.0))
    angle = path.beta(hinge)
    depth = np.maximum(np.sin(angle) - 0.29, 0.0)
    moment = path.factors * np.sin(angle) - 100.0 * (angle - 1e-3) - 1e7 * depth * np.cos(angle)
    np.testing.assert_allclose(moment, 0.0, atol=1e-4)
    assert angle[-1] == pytest.approx(np.arcsin(0.29), abs=1e-4)
    assert path.factors[-1] == 1000.0


@pytest.mark.parametrize("friction", [None, ROUGH], ids=["smooth", "rough"])
@pytest.mark.parametrize("tilt", [0.02, 0.2])
def test_a_table_that_falls_aslant_comes_to_stand_on_its_legs(friction, tilt):
    """Upright, a fourth of its weight on each, and not aside of where it was."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    table = scene.add(fm.RigidBody(10.0, (1, 1, 1)), name="table")
    fall = scene.connect(fm.joint.Free(), scene.ground.frame(), table.frame())
    fall.position = (0.0, 0.0, 0.6, np.cos(tilt / 2), 0.6 * np.sin(tilt / 2), 0.8 * np.sin(tilt / 2), 0.0)
    feet = [contact.Sphere(table.frame(p=(x, y, -0.49)), RADIUS) for x in (-0.4, 0.4) for y in (-0.3, 0.3)]
    floor = contact.Box(scene.ground.frame(p=(0.0, 0.0, -0.005)), (3.0, 3.0, 0.01))
    scene.touch(floor, feet, contact.PowerLaw(k=1e6), friction=friction)
    rest = scene.equilibrium()
    np.testing.assert_allclose(rest.rotation(table.frame())[:, 2], (0.0, 0.0, 1.0), atol=1e-6)
    np.testing.assert_allclose(rest.position(table.frame())[:2], 0.0, atol=1e-3)
    assert rest.position(table.frame())[2] == pytest.approx(0.5 - 98.1 / 4e6, abs=1e-9)
