"""Stiff contacts that bear, let go and meet again, by every adaptive method, against one-dimensional equations.

What a contact's vibration leaves in velocities as it lets go stays, however fast it swings; against scipy's pair of
order 8 with steps far below the contact's own rate, and against the closed form of a ball that bounces.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexmbd as fm
from flexmbd import contact

METHODS = {
    "5(4)": fm.ExplicitRungeKutta(),
    "8(5,3)": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
    "Radau": fm.RadauIIA(),
    "generalized-alpha": fm.GeneralizedAlpha(),
    "energy-momentum": fm.EnergyMomentum(),
    "automatic": "auto",
}
G = 9.81


def exact(equation, start, t_end, rate):
    """(n,) the state at t_end."""
    run = solve_ivp(equation, (0.0, t_end), start, method="DOP853", rtol=1e-12, atol=1e-14, max_step=0.3 / rate)
    return run.y[:, -1]


@dataclass(frozen=True)
class Cam:
    """An eccentric disc on a flywheel that throws off its follower, which a spring presses onto it (SI units)."""

    rate: float
    end: float
    stiffness: float = 1e7
    size: float = 1.0  # of all lengths, at the same rates and loads over masses

    disc, eccentricity, roller, inertia, mass, spring, press = 0.04, 0.005, 0.01, 0.02, 0.4, 4e3, 20.0

    @property
    def start(self):
        high = np.sqrt((self.disc + self.roller) ** 2 - self.eccentricity**2)
        return high - (self.press + self.mass * G) / self.stiffness

    def scene(self):
        """The scene, and what the follower's place is read from."""
        s = self.size
        scene = fm.System(gravity=(0.0, -G * s, 0.0))
        wheel = scene.add(fm.RigidBody(1.0, (self.inertia * s**2,) * 3), name="wheel")
        turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame())
        turn.velocity = self.rate
        follower = scene.add(fm.RigidBody(self.mass, (1e-4 * s**2,) * 3), name="follower")
        slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), follower.frame())
        slide.position, slide.velocity = self.start * s, self.eccentricity * self.rate * s
        rest = (self.start - self.press / self.spring) * s
        scene.add_force(fm.force.JointSpring(slide, self.spring, rest=rest))
        disc = contact.Sphere(wheel.frame(p=(self.eccentricity * s, 0.0, 0.0)), self.disc * s)
        roller = contact.Sphere(follower.frame(), self.roller * s)
        scene.touch(disc, roller, contact.PowerLaw(k=self.stiffness))
        return scene, slide


@cache
def cam_place(cam):
    """Where the follower is at the end, over the size (m)."""

    def equation(_, y):
        angle, turning, place, speed = y
        cx, cy = cam.eccentricity * np.cos(angle), cam.eccentricity * np.sin(angle)
        dx, dy = -cx, place - cy
        r = np.hypot(dx, dy)
        force = cam.stiffness * max(cam.disc + cam.roller - r, 0.0)
        rest = cam.start - cam.press / cam.spring
        acceleration = (force * dy / r - cam.spring * (place - rest)) / cam.mass - G
        return turning, -force / r * (cx * dy - cy * dx) / cam.inertia, speed, acceleration

    start = 0.0, cam.rate, cam.start, cam.eccentricity * cam.rate
    return exact(equation, start, cam.end, np.sqrt(cam.stiffness / cam.mass))[2]


def cam_error(cam, method, rtol):
    """The error of the follower's place, over rtol and the flywheel's radius of gyration, the machine's extent."""
    scene, slide = cam.scene()
    run = scene.simulate(cam.end, rtol=rtol, integrator=METHODS[method])
    return abs(run.beta(slide)[-1].item() / cam.size - cam_place(cam)) / (np.sqrt(cam.inertia) * rtol)


#: Speeds (rad/s), ends (s) and stiffnesses: one flight, several meetings, a contact a hundred times as stiff.
CAMS = [Cam(180.0, 0.045), Cam(160.0, 0.06), Cam(250.0, 0.04), Cam(180.0, 0.045, 1e8)]
TOLERANCES = {"generalized-alpha": (1e-3, 1e-5, 1e-6), "energy-momentum": (1e-3, 1e-5, 1e-6)}


@pytest.mark.parametrize("cam", CAMS, ids=lambda cam: f"{cam.rate:g}-{cam.stiffness:g}")
@pytest.mark.parametrize("method", METHODS)
def test_a_cam_that_loses_its_follower_is_as_exact_as_rtol_asks(method, cam):
    """The follower is off by some hundredths of its way where the vibration on the contact is stepped over."""
    errors = [cam_error(cam, method, rtol) for rtol in TOLERANCES.get(method, (1e-3, 1e-5, 1e-7, 1e-8))]
    assert max(errors) < 150.0, errors


@pytest.mark.parametrize("size", [1e-3, 1e3])
@pytest.mark.parametrize("method", ["Radau", "generalized-alpha", "energy-momentum"])
def test_it_does_so_at_all_sizes(method, size):
    cam = Cam(180.0, 0.045, size=size)
    assert cam_error(cam, method, 1e-5) < 150.0


PLATE = 1.0, 0.5, 2e4, 1e7, 0.02  # kg, kg, N/m, N/m, m: the plate, the ball, the spring, the contact, the radius


def plate_start():
    """Where the plate starts, pressed down by 1 cm, and how deep the ball lies on it, as its inertia presses it (m)."""
    mass, ball_mass, spring, stiffness, _ = PLATE
    down = 0.01
    depth = ball_mass * (spring * down / (mass + ball_mass) + G) / stiffness
    return -(mass + ball_mass) * G / spring - down, depth


def plate():
    """A ball on a plate on a spring: both start at rest, and the ball jumps off."""
    mass, ball_mass, spring, stiffness, radius = PLATE
    start, depth = plate_start()
    scene = fm.System(gravity=(0.0, 0.0, -G))
    body = scene.add(fm.RigidBody(mass, (1e-3,) * 3), name="plate")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), body.frame())
    slide.position = start
    scene.add_force(fm.force.JointSpring(slide, spring))
    ball = scene.add(fm.RigidBody(ball_mass, (0.4 * ball_mass * radius**2,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (0.0, 0.0, start + radius - depth, 1.0, 0.0, 0.0, 0.0)
    scene.touch(contact.HalfSpace(body.frame()), contact.Sphere(ball.frame(), radius), contact.PowerLaw(k=stiffness))
    return scene, ball


@cache
def jumped():
    """Where the ball is after 0.2 s (m)."""
    mass, ball_mass, spring, stiffness, radius = PLATE
    start, depth = plate_start()

    def equation(_, y):
        z, v, p, u = y
        force = stiffness * max(z + radius - p, 0.0)
        return v, (-spring * z - force) / mass - G, u, force / ball_mass - G

    rate = np.sqrt(stiffness * (1.0 / mass + 1.0 / ball_mass))
    return exact(equation, (start, 0.0, start + radius - depth, 0.0), 0.2, rate)[2]


@pytest.mark.parametrize("method", METHODS)
def test_a_ball_jumps_off_a_sprung_plate(method):
    errors = []
    for rtol in TOLERANCES.get(method, (1e-3, 1e-5, 1e-7)):
        scene, ball = plate()
        run = scene.simulate(0.2, rtol=rtol, integrator=METHODS[method])
        errors.append(abs(run.position(ball.frame())[-1, 2] - jumped()) / (0.05 * rtol))
    assert max(errors) < 100.0, errors


def bounce(t, *, height, stiffness, mass):
    """The gap (m) at t (s) of a ball that falls from a height and loses nothing: parabolas, and arcs of a sine."""
    speed, rate = np.sqrt(2.0 * G * height), np.sqrt(stiffness / mass)
    along, across = G / rate**2, -speed / rate
    phase = 2.0 * np.pi + 2.0 * np.arctan2(across, along)  # while it touches
    t = (t - speed / G) % (phase / rate + 2.0 * speed / G)
    if t < phase / rate:
        return -along + along * np.cos(rate * t) + across * np.sin(rate * t)
    t -= phase / rate
    return speed * t - 0.5 * G * t * t


@pytest.mark.parametrize("stiffness", [1e6, 1e9])
@pytest.mark.parametrize("method", METHODS)
def test_a_ball_bounces_on_and_on(method, stiffness):
    """Five bounces of 1 ms and of 0.04 ms, from which nothing is lost."""
    mass, radius, height = 0.17, 0.0286, 0.05
    exact_gap = bounce(1.0, height=height, stiffness=stiffness, mass=mass)
    errors = []
    for rtol in (1e-3, 1e-5, 1e-6):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        ball = scene.add(fm.RigidBody(mass, (0.4 * mass * radius**2,) * 3), name="ball")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
        free.position = (0.0, 0.0, radius + height, 1.0, 0.0, 0.0, 0.0)
        floor = contact.HalfSpace(scene.ground.frame())
        scene.touch(floor, contact.Sphere(ball.frame(), radius), contact.PowerLaw(k=stiffness))
        run = scene.simulate(1.0, rtol=rtol, integrator=METHODS[method])
        errors.append(abs(run.position(ball.frame())[-1, 2] - radius - exact_gap) / (height * rtol))
    assert max(errors) < 100.0, errors


def test_a_spring_elsewhere_changes_nothing_of_a_contact():
    """Vibrations of springs last, those of contacts do not: whether there is a spring in the scene is all one."""
    errors = []
    for stiffness in (0.0, 1e3):
        scene, ball = plate()
        swing = scene.add(fm.RigidBody(1.0, (1e-2,) * 3, (0.05, 0.0, 0.0)), name="swing")
        hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), swing.frame())
        if stiffness:
            scene.add_force(fm.force.JointSpring(hinge, stiffness))
        run = scene.simulate(0.2, rtol=1e-6, integrator=fm.RadauIIA())
        errors.append(abs(run.position(ball.frame())[-1, 2] - jumped()))
    assert max(errors) < 50.0 * 0.05 * 1e-6, errors


@pytest.mark.parametrize("method", ["Radau", "generalized-alpha"])
def test_what_rests_is_cheap(method):
    """A ball that lies on a hard floor beside a pendulum takes the steps of the pendulum."""
    steps = []
    for rests in (False, True):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        body = scene.add(fm.RigidBody(1.0, (0.01,) * 3, (0.2, 0.0, 0.0)), name="pendulum")
        hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
        hinge.position = 0.5
        scene.add_force(fm.force.JointSpring(hinge, 10.0))
        if rests:
            ball = scene.add(fm.RigidBody(0.5, (2e-4,) * 3), name="ball")
            free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
            free.position = (0.0, 0.0, 0.03 - 0.5 * G / 1e8, 1.0, 0.0, 0.0, 0.0)
            floor = contact.HalfSpace(scene.ground.frame())
            scene.touch(floor, contact.Sphere(ball.frame(), 0.03), contact.PowerLaw(k=1e8))
        steps.append(scene.simulate(2.0, rtol=1e-5, integrator=METHODS[method]).stats.steps)
    assert steps[1] < 1.2 * steps[0] + 20


def flight(size, *, speed=30.0, floor=False):
    """A small ball that flies far (m), at the same times at all sizes."""
    scene = fm.System(gravity=(0.0, 0.0, -G * size if floor else 0.0))
    body = scene.add(fm.RigidBody(0.01, (1e-6 * size**2,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (0.0, 0.0, 100.0 * size, 1.0, 0.0, 0.0, 0.0)
    free.velocity = (speed * size, 0.0, 0.0, 0.0, 0.0, 0.0)
    if floor:
        ground = contact.HalfSpace(scene.ground.frame())
        scene.touch(ground, contact.Sphere(body.frame(), 0.01 * size), contact.PowerLaw(k=1e6))
    return scene, body


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("method", METHODS)
def test_a_body_that_flies_far_takes_long_steps(method, size):
    """Of its own extent it flies 30 000 times; nothing asks where it is."""
    scene, body = flight(size)
    run = scene.simulate(10.0, rtol=1e-6, integrator=METHODS[method])
    assert run.position(body.frame())[-1] / size == pytest.approx([300.0, 0.0, 100.0], rel=1e-12)
    assert run.stats.steps < 60


@pytest.mark.parametrize("method", ["5(4)", "8(5,3)", "Radau"])
def test_a_small_body_that_falls_far_meets_the_floor(method):
    """A fall of 100 m, ten thousand times its extent, and the bounce, which loses nothing."""
    scene, body = flight(1.0, floor=True)
    run = scene.simulate(6.0, rtol=1e-8, integrator=METHODS[method])
    gap = bounce(6.0, height=100.0 - 0.01, stiffness=1e6, mass=0.01)
    assert run.position(body.frame())[-1, 2] - 0.01 == pytest.approx(gap, abs=1e-4)
    assert run.stats.steps < 1500


@pytest.mark.parametrize("touches", ["profile", "box"])
def test_a_body_that_flies_along_a_surface_meets_what_stands_up_from_it(touches):
    """A wall 3 m ahead, of a curve whose nearest point is below, and of a thin box."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(0.01, (1e-6,) * 3), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (0.0, 0.05, 0.0, 1.0, 0.0, 0.0, 0.0), (20.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    if touches == "box":
        shape = contact.Box(scene.ground.frame(p=(3.0, 0.0, 0.0)), (0.02, 1.0, 1.0))
    else:
        corners = [(-5.0, -1.0), (5.0, -1.0), (5.0, 0.0), (3.02, 0.0), (3.02, 1.0), (3.0, 1.0), (3.0, 0.0), (-5.0, 0.0)]
        shape = contact.Profile(scene.ground.frame(), corners)
    scene.touch(shape, contact.Sphere(body.frame(), 0.01), contact.PowerLaw(k=1e6))
    for method in METHODS.values():
        run = scene.simulate(0.3, rtol=1e-4, integrator=method)
        assert run.velocity(body.frame())[-1, 0] == pytest.approx(-20.0, rel=1e-2)


def coupler(stiffness):
    """A four-bar linkage on a spring, whose coupler swings against a hard ledge again and again."""
    scene = fm.System(gravity=(0.0, -G, 0.0))
    inertia = (1e-3, 1e-3, 1e-3)
    crank, rod, rocker = (
        scene.add(fm.RigidBody(0.5, inertia, (reach, 0.0, 0.0)), name=name)
        for name, reach in (("crank", 0.1), ("rod", 0.15), ("rocker", 0.1))
    )
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame())
    scene.connect(fm.joint.Revolute("z"), crank.frame(p=(0.2, 0.0, 0.0)), rod.frame()).position = -1.2
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=(0.3, 0.0, 0.0)), rocker.frame()).position = 1.2
    scene.connect(fm.joint.Revolute("z"), rod.frame(p=(0.3, 0.0, 0.0)), rocker.frame(p=(0.2, 0.0, 0.0)))
    hinge.position = 1.2
    scene.add_force(fm.force.JointSpring(hinge, 2.0))
    ledge = contact.HalfSpace(scene.ground.frame(p=(0.0, 0.12, 0.0)), normal="y")
    scene.touch(ledge, contact.Sphere(rod.frame(p=(0.15, 0.0, 0.0)), 0.01), contact.PowerLaw(k=stiffness))
    return scene, hinge


@pytest.mark.parametrize("method", ["Radau", "generalized-alpha", "energy-momentum"])
def test_a_linkage_on_a_spring_bounces_off_a_ledge(method):
    """Of a closed loop, against 8(5,3) at a far tighter rtol: five bounces, each of which adds to the errors before."""
    scene, hinge = coupler(1e8)
    angle = scene.simulate(1.5, rtol=1e-10, integrator=METHODS["8(5,3)"]).beta(hinge)[-1].item()
    for rtol in (1e-4, 1e-6):
        scene, hinge = coupler(1e8)
        run = scene.simulate(1.5, rtol=rtol, integrator=METHODS[method])
        assert abs(run.beta(hinge)[-1].item() - angle) < 300.0 * rtol


@pytest.mark.parametrize("method", ["Radau", "generalized-alpha", "energy-momentum"])
def test_a_driven_disc_throws_off_its_follower(method):
    """A prescribed turn: stages are looked at where their own times put it."""
    ends = []
    for one, rtol in (("8(5,3)", 1e-11), (method, 1e-5)):
        scene = fm.System(gravity=(0.0, -G, 0.0))
        wheel = scene.add(fm.RigidBody(1.0, (0.02,) * 3), name="wheel")
        turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame())
        turn.prescribe(lambda t: (180.0 * t, 180.0, 0.0))
        follower = scene.add(fm.RigidBody(0.4, (1e-4,) * 3), name="follower")
        slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), follower.frame())
        cam = CAMS[0]
        slide.position, slide.velocity = cam.start, cam.eccentricity * 180.0
        scene.add_force(fm.force.JointSpring(slide, cam.spring, rest=cam.start - cam.press / cam.spring))
        disc = contact.Sphere(wheel.frame(p=(cam.eccentricity, 0.0, 0.0)), cam.disc)
        scene.touch(disc, contact.Sphere(follower.frame(), cam.roller), contact.PowerLaw(k=1e7))
        ends.append(scene.simulate(0.045, rtol=rtol, integrator=METHODS[one]).beta(slide)[-1].item())
    assert abs(ends[1] - ends[0]) < 50.0 * 0.14 * 1e-5
