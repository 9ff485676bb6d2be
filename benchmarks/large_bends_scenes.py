"""Beams that bend a lot, by `fm.ExactBeam`: the scenes of `large_bends.py`, with the numbers of the papers."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import PPoly
from scipy.optimize import fsolve

import flexmbd as fm
from flexmbd.forms import beam_timoshenko

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
from exact_beam import PlanarBeam, bent_frequencies

Vector = tuple[float, float, float]
Z = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Bar:
    """Stiffnesses EA, GA (N), GJ, EI (N m^2), mass of a metre (kg/m), and rho I (kg m) of its round section."""

    EA: float
    GA: float
    GJ: float
    EI: float
    rho_A: float
    rho_I: float

    def beam(self, points: dict[str, Any], beams: list[tuple[Any, ...]], n: int, *, axis: Vector = Z) -> fm.ExactBeam:
        """Beams of this bar, each of n elements: of a section of 1 m^2 with nu = 0."""
        G, inertia = 0.5 * self.EA, self.EI / self.EA
        k = self.GA / G
        section = SimpleNamespace(
            E=self.EA, nu=0.0, rho=self.rho_A, A=1.0, Iy=inertia, Iz=inertia, Iyz=0.0, J=self.GJ / G, ky=k, kz=k,
            orientation=axis,
        )  # fmt: skip
        rotary = {"bar": (self.rho_I, self.rho_I)}
        return fm.ExactBeam(points, {"bar": beams}, {"bar": section}, n, rotary_inertia=rotary)


# A cantilever that a moment at its tip rolls up to a full circle.
ROLLED, ROLLED_LENGTH, ROLLED_TIME, ROLLED_END = Bar(1e4, 1e4, 100.0, 100.0, 1.0, 1.0), 10.0, 10.0, 12.0
# Simo & Vu-Quoc 1986 (doi:10.1115/1.3171871): the flying beam.
FLYING, FLYING_LOWER, FLYING_UPPER = Bar(1e4, 1e4, 100.0, 100.0, 1.0, 10.0), (6.0, 0.0, 0.0), (0.0, 8.0, 0.0)
FLYING_TIME, FLYING_END = 2.5, 7.0
# Simo & Vu-Quoc 1988 (doi:10.1016/0045-7825(88)90073-4): the right-angle cantilever.
CORNER, CORNER_ARM, CORNER_END = Bar(1e6, 1e6, 1e3, 1e3, 1.0, 10.0), 10.0, 6.0
# Bathe & Bolourchi 1979 (doi:10.1002/nme.1620140703): an eighth of a circle under a force across it.
ELBOW, ELBOW_RADIUS, ELBOW_FORCE = Bar(1e7, 41.6667e5, 8.333e5, 8.333e5, 1.0, 1.0), 100.0, 600.0
# Bauchau et al. 2016 (doi:10.1007/s11044-016-9514-y): a four-bar of steel with one hinge askew by 5 degrees.
THICK = Bar(52.99e6, 16.88e6, 733.5, 1131.0, 1.997, 42.6e-6)
THIN = Bar(13.25e6, 4.22e6, 45.84, 70.69, 0.4992, 2.66e-6)
SHORT, LONG, SPEED, ASKEW, BARS_END = 0.12, 0.24, 0.6, np.deg2rad(5.0), 2.0
# A rotating shaft, after Bauchau et al. 2016: a steel tube of 6 m with a disc in its middle whose centre lies 50 mm off
# its axis, held at both ends so that it bends there with no slope, is brought to 0.8 of 60 rad/s, below its first
# critical speed, and through that to 1.2.  The paper was not at hand: the numbers are those that its example is
# usually given with, and its curves are not compared.
SHAFT = beam_timoshenko.Parameters.tube(
    2.1e11, 0.3, 7800.0, outer_radius=0.05, inner_radius=0.045, orientation=(0.0, 1.0, 0.0)
)
SHAFT_LENGTH, SHAFT_END, DISC_MASS, DISC_RADIUS, DISC_OFF = 6.0, 1.5, 70.573, 0.24, 0.05
# The Princeton beam (Dowell & Traybar 1975) under 13.345 N across its thin side.
PRINCETON = beam_timoshenko.Parameters.rectangle(
    71.7e9, 0.31, 2700.0, width=12.3777e-3, height=3.2024e-3, orientation=(0.0, 1.0, 0.0)
)
PRINCETON_LENGTH, PRINCETON_FORCE = 0.508, 13.345


def rolling(t: float) -> float:
    """N m, the moment that makes the circle, brought up smoothly."""
    s = min(t / 10.0, 1.0)
    return 2.0 * np.pi * 100.0 / 10.0 * s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def flung(t: float) -> float:
    """N, on the lower end of the flying beam."""
    return 8.0 if t < 2.5 else 0.0


def spun(t: float) -> float:
    """N m, on the lower end of the flying beam."""
    return -80.0 if t < 2.5 else 0.0


def triangle(t: float) -> float:
    """N, at the elbow of the right-angle cantilever."""
    return 50.0 * max(0.0, 1.0 - abs(t - 1.0))


def shaft_angle(t: float) -> float:
    """rad, of the shaft's driven end."""
    if t < 0.5:
        return 24.0 * (t - 0.5 / math.pi * math.sin(2.0 * math.pi * t))
    if t < 1.0:
        return 12.0 + 48.0 * (t - 0.5)
    s = min(t, 1.25) - 1.0
    rise = 12.0 * (s - 0.25 / math.pi * math.sin(4.0 * math.pi * s))
    return 36.0 + 48.0 * (t - 1.0) + rise + 24.0 * max(0.0, t - 1.25)


def shaft_speed(t: float) -> float:
    """rad/s."""
    if t < 0.5:
        return 24.0 * (1.0 - math.cos(2.0 * math.pi * t))
    s = min(max(t - 1.0, 0.0), 0.25)
    return 48.0 + 12.0 * (1.0 - math.cos(4.0 * math.pi * s))


def shaft_acceleration(t: float) -> float:
    """rad/s^2."""
    if t < 0.5:
        return 48.0 * math.pi * math.sin(2.0 * math.pi * t)
    if 1.0 <= t < 1.25:
        return 48.0 * math.pi * math.sin(4.0 * math.pi * (t - 1.0))
    return 0.0


SHAFT_BREAKS = (0.5, 1.0, 1.25)
SHAFT_DRIVE = fm.Motion(
    *(fm.compiled(one, breaks=SHAFT_BREAKS) for one in (shaft_angle, shaft_speed, shaft_acceleration))
)
COMPILED = {
    rolling: fm.compiled(rolling, breaks=(ROLLED_TIME,)),
    flung: fm.compiled(flung, breaks=(FLYING_TIME,)),
    spun: fm.compiled(spun, breaks=(FLYING_TIME,)),
    triangle: fm.compiled(triangle, breaks=(1.0, 2.0)),
}


def rolled(n: int, *, moment: Any = COMPILED[rolling]) -> tuple[fm.System, fm.Frame]:
    """A cantilever with a moment at its tip, and its tip."""
    scene = fm.System()
    ends = {"clamp": (0.0, 0.0, 0.0), "tip": (ROLLED_LENGTH, 0.0, 0.0)}
    beam = scene.add(ROLLED.beam(ends, [("clamp", "tip")], n), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), torque=(0.0, 0.0, moment)))
    return scene, beam.frame("tip")


def flying(n: int) -> tuple[fm.System, fm.Frame]:
    """The flying beam, and its upper end."""
    scene = fm.System()
    ends = {"lower": FLYING_LOWER, "upper": FLYING_UPPER}
    beam = scene.add(FLYING.beam(ends, [("lower", "upper")], n), name="beam")
    scene.connect(fm.joint.Free(), scene.ground.frame(p=FLYING_LOWER), beam.frame("lower"))
    scene.add_force(fm.force.FrameForce(beam.frame("lower"), (COMPILED[flung], 0.0, 0.0), (0.0, 0.0, COMPILED[spun])))
    return scene, beam.frame("upper")


def corner(n: int) -> tuple[fm.System, fm.Frame]:
    """The right-angle cantilever of n elements an arm, and its tip."""
    scene = fm.System()
    points = {"clamp": (0.0, 0.0, 0.0), "elbow": (CORNER_ARM, 0.0, 0.0), "tip": (CORNER_ARM, CORNER_ARM, 0.0)}
    beam = scene.add(CORNER.beam(points, [("clamp", "elbow"), ("elbow", "tip")], n), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    scene.add_force(fm.force.FrameForce(beam.frame("elbow"), (0.0, 0.0, COMPILED[triangle])))
    return scene, beam.frame("tip")


def elbow(n: int, *, force: float) -> tuple[fm.System, fm.Frame]:
    """The eighth of a circle under a force (N) across it, and its tip."""

    def at(angle: float) -> Vector:
        return ELBOW_RADIUS * np.sin(angle), ELBOW_RADIUS * (1.0 - np.cos(angle)), 0.0

    scene = fm.System()
    beams = [("clamp", at(np.pi / 8), "tip")]
    beam = scene.add(ELBOW.beam({"clamp": at(0.0), "tip": at(np.pi / 4)}, beams, n), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, 0.0, force)))
    return scene, beam.frame("tip")


def four_bar(n: int) -> tuple[fm.System, fm.Frame]:
    """The four-bar with the hinge at C askew, each bar of n elements, and C on the bar BC."""
    scene = fm.System()
    A, B, C, D = (0.0, 0.0, 0.0), (0.0, SHORT, 0.0), (LONG, SHORT, 0.0), (LONG, 0.0, 0.0)
    crank, coupler, rocker = (
        scene.add(bar.beam({"start": p, "end": q}, [("start", "end")], n), name=name)
        for name, bar, p, q in (("crank", THICK, A, B), ("coupler", THICK, B, C), ("rocker", THIN, D, C))
    )
    drive = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), crank.frame("start"))
    begins = [-0.5 * SPEED, SPEED, 0.0, 0.0, 0.0]  # comes to speed within a second
    goes_on = [0.0, 0.0, 0.0, SPEED, 0.5 * SPEED]
    drive.prescribe(PPoly(-np.stack([begins, goes_on], axis=1), [0.0, 1.0, 100.0]))
    scene.connect(fm.joint.Revolute("z"), crank.frame("end"), coupler.frame("start"))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=D), rocker.frame("start"))
    askew = (0.0, np.sin(ASKEW), np.cos(ASKEW))
    scene.connect(fm.joint.Revolute(askew), coupler.frame("end"), rocker.frame("end"))
    return scene, coupler.frame("end")


def shaft(n: int) -> tuple[fm.System, fm.Frame]:
    """The rotating shaft of n elements, and its middle."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    points = {"driven": (0.0, 0.0, 0.0), "middle": (0.5 * SHAFT_LENGTH, 0.0, 0.0), "far": (SHAFT_LENGTH, 0.0, 0.0)}
    halves = [("driven", "middle"), ("middle", "far")]
    beam = scene.add(fm.ExactBeam(points, {"tube": halves}, {"tube": SHAFT}, n // 2), name="shaft")
    drive = scene.connect(fm.joint.Revolute("x"), scene.ground.frame(), beam.frame("driven"))
    drive.prescribe(SHAFT_DRIVE)
    scene.connect(fm.joint.Cylindrical("x"), scene.ground.frame(p=points["far"]), beam.frame("far"))
    across = 0.25 * DISC_MASS * DISC_RADIUS**2
    disc = fm.RigidBody(DISC_MASS, (2.0 * across, across, across), (0.0, DISC_OFF, 0.0))
    scene.connect(fm.joint.Fixed(), beam.frame("middle"), scene.add(disc, name="disc").frame())
    return scene, beam.frame("middle")


def princeton_frequencies(n: int) -> np.ndarray:
    """rad/s, ascending, of the Princeton beam of n elements about the state that its load bends it to."""
    about = None
    for share in (0.5, 1.0):
        scene = fm.System()
        ends = {"clamp": (0.0, 0.0, 0.0), "tip": (PRINCETON_LENGTH, 0.0, 0.0)}
        beam = scene.add(fm.ExactBeam(ends, {"strip": [("clamp", "tip")]}, {"strip": PRINCETON}, n), name="strip")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
        scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, 0.0, share * PRINCETON_FORCE)))
        about = scene.equilibrium(about=about)
    values = scene.linearize(about=about).eigenvalues().imag
    return np.sort(values[values > 0.0])


def princeton_by_another(n: int) -> np.ndarray:
    """(2,) rad/s, the first two in the load's plane by Simo's and Vu-Quoc's element, n and 2 n of them extrapolated."""
    p = PRINCETON
    shear = p.kz * p.E / (2.0 * (1.0 + p.nu)) * p.A
    planar = PlanarBeam(p.E * p.A, shear, p.E * p.Iy, p.rho * p.A, p.rho * p.Iy, PRINCETON_LENGTH)
    coarse, fine = (bent_frequencies(planar, PRINCETON_FORCE, elements=k)[:2] for k in (n, 2 * n))
    return np.asarray(fine + (fine - coarse) / 3.0)


def instants(end: float) -> np.ndarray:
    """(k,) s, equally apart, up to the end, about one a second."""
    count = max(2, int(end))
    return end / count * np.arange(1, count + 1)


def statics(scene_of: Callable[[float], tuple[fm.System, fm.Frame]], steps: int) -> np.ndarray:
    """(3,) m, the frame at rest under the whole load, brought up in equal steps; ``scene_of``: of a share of it."""
    about = None
    for share in np.arange(1, steps + 1) / steps:
        scene, frame = scene_of(float(share))
        about = scene.equilibrium(about=about)
    return np.asarray(about.position(frame))


def elbow_by_shooting() -> np.ndarray:
    """(3,) m, the tip of the elbow by the differential equations of a rod (Antman 2005, chapter 8)."""
    bar, length = ELBOW, ELBOW_RADIUS * np.pi / 4
    stiff, soft = np.array([bar.EA, bar.GA, bar.GA]), np.array([bar.GJ, bar.EI, bar.EI])
    bent = np.array([0.0, 0.0, 1.0 / ELBOW_RADIUS])

    def rod(force: np.ndarray, moment: np.ndarray) -> np.ndarray:
        def slopes(s: float, y: np.ndarray) -> np.ndarray:
            R = y[3:12].reshape(3, 3)
            along = R @ (R.T @ force / stiff + [1.0, 0.0, 0.0])
            turn = R.T @ y[12:] / soft + bent
            return np.concatenate([along, (R @ np.cross(np.eye(3), -turn).T).ravel(), -np.cross(along, force)])

        start = np.concatenate([np.zeros(3), np.eye(3).ravel(), moment])
        return np.asarray(solve_ivp(slopes, (0.0, length), start, rtol=1e-10, atol=1e-10, method="DOP853").y[:, -1])

    moment = np.zeros(3)
    for share in np.linspace(0.1, 1.0, 10):
        force = np.array([0.0, 0.0, share * ELBOW_FORCE])
        moment = fsolve(lambda m, force=force: rod(force, m)[12:] / 1e4, moment, xtol=1e-12)
    return rod(force, moment)[:3]
