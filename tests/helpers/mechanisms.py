"""Rigid mechanisms with reference solutions, for tests and benchmarks: builders, and the references as numbers.

The references are closed forms or independent integrations at two tolerances; SI units, angles in rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

import flexmbd as fm

if TYPE_CHECKING:  # so that benchmarks build these scenes in older checkouts, too
    from flexmbd.multibody.bodies.body import Frame
    from flexmbd.multibody.joint.connection import Connection

G = 9.81


@dataclass(frozen=True)
class Mechanism:
    """A scene, and what to look at in it; each builder takes `way`, how all its joints are carried.

    Attributes:
        scene: the machine at its start.
        point: the frame whose position is compared.
        plane: which components of the position the reference gives.
        reference: time (s) to position (m).
        joint: the joint that drives or tells the mechanism's motion.
    """

    scene: fm.System
    point: Frame
    plane: tuple[int, ...]
    reference: Mapping[float, tuple[float, ...]]
    joint: Connection | None = field(default=None)

    def error(self, run: fm.Trajectory, at: float) -> float:
        """Distance (m) of the point from its reference at the time ``at`` (s), where the run must have a step."""
        k = int(np.argmin(np.abs(run.t - at)))
        if abs(run.t[k] - at) > 1e-9:
            raise ValueError(f"the run has no instant {at} s")
        found = run.position(self.point)[k, list(self.plane)]
        return float(np.linalg.norm(found - np.array(self.reference[at])))


def rod(length: float, mass: float, *, along: int = 0, thin: float = 1e-6) -> fm.RigidBody:
    """A uniform thin rod from the body frame along one of its axes; ``thin`` is its own share of the inertia."""
    across = mass * length**2 / 12.0
    inertia, com = np.full(3, across), np.zeros(3)
    inertia[along] = thin * across
    com[along] = 0.5 * length
    return fm.RigidBody(mass, tuple(inertia), tuple(com))


# -- pendulums ---------------------------------------------------------------------------------------------------------

PENDULUM = {
    1.0: (0.986291751132, -0.165010853126),
    5.0: (-0.942305435044, -0.334754338414),
    10.0: (-0.275087462576, -0.961419205099),
}
PERIOD_POINT, PERIOD_BAR = 2.36784194757624, 1.93333485437325


def pendulum(*, bar: bool = False, way: fm.Way | None = None) -> Mechanism:
    """1 m long, from the horizontal at -x, at rest: a point mass of 1 kg, or a uniform bar."""
    scene = fm.System(gravity=(0.0, -G, 0.0))
    mass = rod(1.0, 1.0) if bar else fm.RigidBody(1.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    bob = scene.add(mass, name="bob")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame(), way=way)
    hinge.position = np.pi
    return Mechanism(scene, bob.frame(p=(1.0, 0.0, 0.0)), (0, 1), {} if bar else PENDULUM, hinge)


DOUBLE_PENDULUM = {
    ("rods", "both horizontal"): {
        1.0: (-1.6621151358, -1.0414666372),
        3.0: (1.3304368251, -1.3986448605),
        5.0: (1.8552219378, -0.7395679325),
    },
    ("rods", "second hanging"): {
        1.0: (-1.4419899284, -0.5402322145),
        3.0: (-0.7953051438, 0.2018162218),
        5.0: (-1.0991590247, -1.3491665132),
    },
    ("tip masses", "both horizontal"): {
        1.0: (-1.6086686674, -1.1489693011),
        3.0: (1.8233706314, -0.3942082255),
        5.0: (-0.3397062646, -1.9499072521),
    },
    ("tip masses", "second hanging"): {
        1.0: (-1.4423958972, -1.3737121046),
        3.0: (0.1839251072, -0.2715911158),
        5.0: (-1.1364031888, -1.0220034751),
    },
}


def double_pendulum(kind: str, start: str, *, way: fm.Way | None = None) -> Mechanism:
    """Two uniform rods of 1 m and 1 kg, or the same with a point mass of 1 kg at the end of each."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    links = []
    for name in ("first", "second"):
        if kind == "rods":
            link = rod(1.0, 1.0, along=2)
        else:  # rod and tip together: 2 kg, their centre at 3/4 of the length
            across = 1.0 / 12.0 + 0.25**2 + 0.25**2
            link = fm.RigidBody(2.0, (across, across, 1e-6), (0.0, 0.0, 0.75))
        links.append(scene.add(link, name=name))
    hinge = fm.joint.Revolute("y")
    # the links lie along their own +z; hanging is a half turn
    first = scene.connect(hinge, scene.ground.frame(), links[0].frame(), way=way)
    second = scene.connect(hinge, links[0].frame(p=(0, 0, 1)), links[1].frame(), way=way)
    first.position = 0.5 * np.pi
    second.position = 0.0 if start == "both horizontal" else 0.5 * np.pi
    reference = DOUBLE_PENDULUM.get((kind, start), {})
    return Mechanism(scene, links[1].frame(p=(0, 0, 1)), (0, 2), reference, first)


def point_masses(masses: tuple[float, float]) -> tuple[fm.System, Frame]:
    """A double pendulum of two point masses on arms of 1 m, in line at 1 rad from hanging, at rest; and its tip."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    first, second = (
        scene.add(fm.RigidBody(mass, (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)), name=name)
        for mass, name in zip(masses, ("first", "second"), strict=True)
    )
    hinge = fm.joint.Revolute((0.0, -1.0, 0.0))
    above = scene.connect(hinge, scene.ground.frame(), first.frame())
    scene.connect(hinge, first.frame(p=(0, 0, -1)), second.frame())
    above.position = 1.0
    return scene, second.frame(p=(0, 0, -1))


def point_masses_end(masses: tuple[float, float], t_end: float) -> tuple[float, float]:
    """Its tip's x and z (m) at the end, by the two equations of motion in the angles from hanging."""
    from scipy.integrate import solve_ivp

    m1, m2 = masses

    def equation(_: float, y: np.ndarray) -> np.ndarray:
        (a, b), (w, u) = y[:2], y[2:]
        c, s = np.cos(a - b), np.sin(a - b)
        matrix = [[m1 + m2, m2 * c], [m2 * c, m2]]
        right = [-m2 * u**2 * s - (m1 + m2) * G * np.sin(a), m2 * w**2 * s - m2 * G * np.sin(b)]
        return np.concatenate([[w, u], np.linalg.solve(matrix, right)])

    start = (1.0, 1.0, 0.0, 0.0)
    a, b = solve_ivp(equation, (0.0, t_end), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:2, -1]
    return float(np.sin(a) + np.sin(b)), float(-np.cos(a) - np.cos(b))


# -- closed loops ------------------------------------------------------------------------------------------------------

FOUR_BAR = {
    2: {
        0.5: (0.695286633164, 0.718732563436),
        1.0: (-0.195020301950, -0.980799205662),
        2.0: (0.057815795768, 0.998327267863),
        5.0: (-0.811310461003, -0.584615545352),
        10.0: (0.328458111536, 0.944518538180),
    },
    40: {
        0.5: (0.687925970791, 0.725780861357),
        1.0: (-0.115356880632, -0.993324111300),
        2.0: (0.034466307300, 0.999405860330),
        5.0: (-0.540190050672, -0.841543052467),
        10.0: (0.180512226684, 0.983572740583),
    },
}


def four_bars(windows: int, *, way: fm.Way | None = None) -> Mechanism:
    """A row of windows of rods of 1 m and 1 kg, upright, its first free corner moving at 1 m/s along x."""
    scene = fm.System(gravity=(0.0, -G, 0.0))
    hinge = fm.joint.Revolute("z")
    upright, joints = [], []
    for i in range(windows + 1):
        upright.append(scene.add(rod(1.0, 1.0, along=1), name=f"upright {i}"))
        joints.append(scene.connect(hinge, scene.ground.frame(p=(i, 0, 0)), upright[i].frame(), way=way))
    for i in range(windows):
        beam = scene.add(rod(1.0, 1.0), name=f"beam {i}")
        scene.connect(hinge, upright[i].frame(p=(0, 1, 0)), beam.frame(), way=way).velocity = 1.0
        scene.connect(hinge, beam.frame(p=(1, 0, 0)), upright[i + 1].frame(p=(0, 1, 0)), way=way)
    for joint in joints:
        joint.velocity = -1.0
    return Mechanism(scene, upright[0].frame(p=(0, 1, 0)), (0, 1), FOUR_BAR.get(windows, {}), joints[0])


def slider_crank(
    crank: float, length: float, *, speed: float, start: float = 0.0, way: fm.Way | None = None
) -> Mechanism:
    """Crank, connecting rod of ``length`` and a slider of 1 kg along x, no gravity; the crank turns from `start`."""
    scene = fm.System()
    hinge = fm.joint.Revolute("z")
    arm = scene.add(rod(crank, 1.0), name="crank")
    link = scene.add(rod(length, 1.0), name="rod")
    slider = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="slider")
    first = scene.connect(hinge, scene.ground.frame(), arm.frame(), way=way)
    second = scene.connect(hinge, arm.frame(p=(crank, 0, 0)), link.frame(), way=way)
    third = scene.connect(hinge, link.frame(p=(length, 0, 0)), slider.frame(), way=way)
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame(), name="guide", way=way)
    # the others as the loop has them, for joints by constraints hold nothing of a start
    tilt = -np.arcsin(crank * np.sin(start) / length)
    turn = -crank * np.cos(start) * speed / (length * np.cos(tilt))
    first.position, second.position, third.position = start, tilt - start, -tilt
    first.velocity, second.velocity, third.velocity = speed, turn - speed, -turn
    return Mechanism(scene, slider.frame(), (0,), {}, first)


# -- a stiff tree ------------------------------------------------------------------------------------------------------


#: Slide (m), tilt (rad) and speed of the shaft (rad/s) of `Governor()` after 10 s, by its `solution`.
GOVERNOR_LATE = (0.8259620542948524, 0.5989547150184075, 4.944056049822106)


@dataclass(frozen=True)
class Governor:
    """A flyball governor: rods of 1 m on the shaft's top, balls at their ends, springs from their middles to a slider.

    Attributes:
        stiffness, damping: N/m and N s/m of each of the two springs, 0.5 m long unstretched and at the start.
    """

    stiffness: float = 8e5
    damping: float = 4e4
    ball: float = 5.0
    slider: float = 3.0
    rod: float = 0.3
    axial: float = 5e-6  # a rod's and the shaft's inertia about their own axes, kg m^2
    tilt: float = np.pi / 6.0
    spin: float = 2.0 * np.pi

    def mechanism(self, *, way: fm.Way | None = None) -> Mechanism:
        """The machine at its start; the point is the slider, the joint the slide."""
        scene = fm.System(gravity=(0.0, 0.0, -G))
        top = scene.ground.frame(p=(0.0, 0.0, 1.0))
        shaft = scene.add(fm.RigidBody(0.3, (0.1, 0.1, self.axial), (0.0, 0.0, -0.5)), name="shaft")
        turning = scene.connect(fm.joint.Revolute("z"), top, shaft.frame(), way=way)
        turning.velocity = self.spin
        # the cube's side is 0.1 m
        cube = self.slider * 0.1**2 / 6.0
        slider = scene.add(fm.RigidBody(self.slider, (cube, cube, cube)), name="slider")
        slide = scene.connect(fm.joint.Prismatic((0, 0, -1)), shaft.frame(), slider.frame(), way=way)
        slide.position = np.cos(self.tilt)
        mass = self.rod + self.ball
        com = (0.5 * self.rod + self.ball) / mass
        across = self.rod / 12.0 + self.rod * (com - 0.5) ** 2 + self.ball * (1.0 - com) ** 2
        for side in (1.0, -1.0):
            arm = scene.add(fm.RigidBody(mass, (across, across, self.axial), (0.0, 0.0, -com)), name=f"arm {side:+.0f}")
            hinge = scene.connect(fm.joint.Revolute((0, -side, 0)), shaft.frame(), arm.frame(), way=way)
            hinge.position = self.tilt
            middle = arm.frame(p=(0.0, 0.0, -0.5))
            scene.add_force(fm.force.SpringDamper(middle, slider.frame(), self.stiffness, 0.5, self.damping))
        return Mechanism(scene, slider.frame(), (0, 1, 2), {}, slide)

    def solution(self, t_end: float) -> tuple[float, float, float]:
        """Slide (m), tilt (rad) and speed of the shaft (rad/s) at the end, by Lagrange's equations."""
        from scipy.integrate import solve_ivp

        swing = self.rod / 3.0 + self.ball
        weight = 2.0 * (0.5 * self.rod + self.ball) * G
        fixed = self.axial + self.slider * 0.1**2 / 6.0

        def about_shaft(a: float) -> float:
            return fixed + 2.0 * (swing * np.sin(a) ** 2 + self.axial * np.cos(a) ** 2)

        momentum = about_shaft(self.tilt) * self.spin

        def equation(_: float, y: np.ndarray) -> tuple[float, ...]:
            s, a, ds, da = y
            line = np.array([0.5 * np.sin(a), s - 0.5 * np.cos(a)])
            length = np.hypot(*line)
            by_s, by_a = line[1] / length, (line[0] * 0.5 * np.cos(a) + line[1] * 0.5 * np.sin(a)) / length
            pull = 2.0 * (self.stiffness * (length - 0.5) + self.damping * (by_s * ds + by_a * da))
            turn = momentum / about_shaft(a)
            centrifugal = turn**2 * (swing - self.axial) * 2.0 * np.sin(a) * np.cos(a)
            force = centrifugal - weight * np.sin(a) - pull * by_a
            return ds, da, G - pull * by_s / self.slider, force / (2.0 * swing)

        start = (np.cos(self.tilt), self.tilt, 0.0, 0.0)
        found = solve_ivp(equation, (0.0, t_end), start, method="Radau", rtol=1e-11, atol=1e-13).y[:, -1]
        return float(found[0]), float(found[1]), float(momentum / about_shaft(found[1]))


# -- tops --------------------------------------------------------------------------------------------------------------

HEAVY_TOP = {
    0.2: (0.605550561377, 0.598957681795, -0.523983027430),
    0.5: (-0.702468297057, -0.021165184702, -0.711400257652),
    1.0: (0.173343964098, 0.640088592070, -0.748490791134),
    2.0: (-0.150416822746, -0.724165591637, -0.673022269560),
}
HEAVY_TOP_QUATERNION = (0.122947135042, -0.491079892550, 0.350430030344, -0.787986887550)
HEAVY_TOP_ENERGY = 5435.6967908655


def heavy_top(*, way: fm.Way | None = None) -> Mechanism:
    """A top of 15 kg on a fixed point 1 m from its centre (Bruels, Cardona & Arnold 2012, section 6)."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    top = scene.add(fm.RigidBody(15.0, (0.234375, 0.46875, 0.234375), (0.0, 1.0, 0.0)), name="top")
    point = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame(), way=way)
    point.velocity = (0.0, 150.0, -4.61538)
    return Mechanism(scene, top.frame(p=(0, 1, 0)), (0, 1, 2), HEAVY_TOP, point)


FAST_TOP = {
    1.0: (0.021541105, -0.0500103355, 0.998516373),
    5.0: (0.0470679597, 0.0241956756, 0.9985986063),
    10.0: (-0.0471322314, 0.0267486864, 0.9985304505),
}
FAST_TOP_ENERGY = 1269.9750052079


@dataclass(frozen=True)
class Nutation:
    """Range of the tilt (rad), period (s), and precession (rad) in a period."""

    range: tuple[float, float]
    period: float
    precession: float


NUTATION = {
    0.05: Nutation((0.05, 0.054551690224342), 0.68545849728962, 0.28610768780066),
    0.3: Nutation((0.3, 0.32673371464485), 0.68225601583118, 0.28410848611437),
}


def fast_top(tilt: float = 0.05, *, way: fm.Way | None = None) -> Mechanism:
    """A symmetric top, inertia (5, 5, 1) about its tip, weight moment 20 N m, spin 50 rad/s (Simo & Wong 1991)."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    mass = 20.0 / G
    top = scene.add(fm.RigidBody(mass, (5.0 - mass, 5.0 - mass, 1.0), (0.0, 0.0, 1.0)), name="top")
    point = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame(), way=way)
    point.position = (np.cos(0.5 * tilt), np.sin(0.5 * tilt), 0.0, 0.0)
    point.velocity = (0.0, 0.0, 50.0)
    return Mechanism(scene, top.frame(p=(0, 0, 1)), (0, 1, 2), FAST_TOP if tilt == 0.05 else {}, point)
