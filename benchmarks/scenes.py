"""The scenes of the simulation benchmarks, and the integrators that run them.

Rigid: a chain of links, a heavy top, a row of four-bars, a mass under loads that jump or bend. Flexible: a hinged beam
that swings or is spun up, a chain of five, a slider-crank whose rod it is. What exudyn makes of them is in
scenes_exudyn.py.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import PPoly

import flexmbd as fm

if TYPE_CHECKING:  # other checkouts, which run the same scenes, may have these elsewhere
    from flexmbd.integrate.protocol import Integrator
    from flexmbd.multibody.bodies.body import Frame

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
import beam_record
import mechanisms

G = 9.81


@dataclass(frozen=True)
class Method:
    """An integrator: how it is called, how it is made, and whether it may serve as reference."""

    label: str
    make: Callable[[], Integrator]
    tight: bool = False


#: All that is compared and tried; a new integrator is one line more.
METHODS = [
    Method("generalized-alpha", fm.GeneralizedAlpha),
    Method("Dormand-Prince 5(4)", fm.ExplicitRungeKutta),
    Method("Dormand-Prince 8(5,3)", partial(fm.ExplicitRungeKutta, fm.Pair.DORMAND_PRINCE_8), tight=True),
    Method("Radau IIA", fm.RadauIIA),
    Method("energy-momentum", fm.EnergyMomentum),
]


@dataclass(frozen=True)
class Scene:
    """A machine, and the point whose place at the end is compared.

    Attributes:
        name: how tables call it.
        kind: name of the builder in scenes_exudyn.
        t_end: s.
        size: m, what errors are relative to.
        build: the machine at its start and the point.
        exact: (3,) m, where an independent solution is known.
        parameter: number of links or windows, where the scene has one.
        beam: the reduced beam, where there is one.
        agreement: m, how near exudyn's converged solution must come to ours; its reduced bodies know no stiffening.
    """

    name: str
    kind: str
    t_end: float
    size: float
    build: Callable[[], tuple[fm.System, Frame]]
    exact: tuple[float, ...] | None = None
    parameter: int = 0
    beam: beam_record.Beam | None = None
    agreement: float = 1e-6


LINK, SECTION = 0.2, 0.02  # m
LINK_MASS = 7800.0 * LINK * SECTION**2
CHAIN_TIP = {10: (-1.76473832079, -0.92720286516, 0.0), 50: (7.53368009933, -4.90499985199, 0.0)}


def link_inertia() -> tuple[float, float, float]:
    """About the centre of a link, kg m^2."""
    across = LINK_MASS * (LINK**2 + SECTION**2) / 12.0
    return LINK_MASS * SECTION**2 / 6.0, across, across


def rigid_chain(links: int) -> tuple[fm.System, Frame]:
    """Square steel links of 0.2 m on hinges about z, from the horizontal at rest, g along -y."""
    scene = fm.System(gravity=(0.0, -G, 0.0))
    end = scene.ground.frame()
    for i in range(links):
        body = scene.add(fm.RigidBody(LINK_MASS, link_inertia(), (0.5 * LINK, 0.0, 0.0)), name=f"link {i}")
        scene.connect(fm.joint.Revolute("z"), end, body.frame())
        end = body.frame(p=(LINK, 0.0, 0.0))
    return scene, end


def heavy_top() -> tuple[fm.System, Frame]:
    """15 kg on a fixed point, spinning at 150 rad/s."""
    mechanism = mechanisms.heavy_top()
    return mechanism.scene, mechanism.point


def four_bars(windows: int) -> tuple[fm.System, Frame]:
    """A row of windows of hinged rods, falling through positions where the constraints lose rank."""
    mechanism = mechanisms.four_bars(windows)
    return mechanism.scene, mechanism.point


def flexible_chain(record: fm.ReducedBody, links: int) -> tuple[fm.System, Frame]:
    """Beams on hinges about y, from the horizontal at rest, g along -z; one link is the pendulum."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    end = scene.ground.frame()
    for i in range(links):
        body = scene.add(fm.FlexibleBody(record), name=f"beam {i}")
        scene.connect(fm.joint.Revolute("y"), end, body.frame("start"))
        end = body.frame("end")
    return scene, end


TORQUE = 20.0  # N m


def spin_up(record: fm.ReducedBody) -> tuple[fm.System, Frame]:
    """A beam on a hinge about z, from rest, a torque of 20 N m on the hinge."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="beam")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame("start"))
    scene.add_force(fm.force.JointTorque(hinge, TORQUE))
    return scene, body.frame("end")


CRANK, CRANK_MASS, SLIDER_MASS = 0.25, 5.0, 2.0
CRANK_INERTIA = (0.001, 0.03, 0.03)


def slider_crank(record: fm.ReducedBody) -> tuple[fm.System, Frame]:
    """A rigid crank of 0.25 m, the beam as rod, a slider along x; from rest, 20 N m on the crank, no gravity."""
    scene = fm.System()
    crank = scene.add(fm.RigidBody(CRANK_MASS, CRANK_INERTIA, (0.5 * CRANK, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.FlexibleBody(record), name="rod")
    slider = scene.add(fm.RigidBody(SLIDER_MASS, (0.01, 0.01, 0.01)), name="slider")
    turn = fm.joint.Revolute("z")
    first = scene.connect(turn, scene.ground.frame(), crank.frame())
    scene.connect(turn, crank.frame(p=(CRANK, 0.0, 0.0)), rod.frame("start"))
    scene.connect(turn, rod.frame("end"), slider.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), slider.frame(), name="guide")
    # off the dead centre, where a torque moves nothing
    first.position = 0.5
    scene.add_force(fm.force.JointTorque(first, TORQUE))
    return scene, slider.frame()


STRENGTH, STIFFNESS, STOP = 3.0, 4.0, 0.7317  # N, N/m, s
#: Loads (N) on a mass of 1 kg on a spring, as data: one that stops, a triangular pulse.
LOADS = {
    "jump": PPoly([[STRENGTH, 0.0]], [0.0, STOP, 10.0]),
    "pulse": PPoly(
        [[2.0 * STRENGTH / STOP, -2.0 * STRENGTH / STOP, 0.0], [0.0, STRENGTH, 0.0]], [0.0, 0.5 * STOP, STOP, 10.0]
    ),
}


def loaded_spring(load: str) -> tuple[fm.System, Frame]:
    """A mass of 1 kg on a spring along x, from rest, under a load that is not smooth."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
    scene.add_force(fm.force.JointSpring(slide, STIFFNESS, 0.0))
    scene.add_force(fm.force.JointForce(slide, LOADS[load]))
    return scene, body.frame()


def loaded_spring_end(load: str, t: float) -> tuple[float, float, float]:
    """Where the mass is once the load is over, by Duhamel's integral in closed form."""
    omega = np.sqrt(STIFFNESS)
    if load == "jump":
        x = STRENGTH / STIFFNESS * (np.cos(omega * (t - STOP)) - np.cos(omega * t))
    else:  # three ramps, each of which begins a motion t - sin(omega t) / omega
        slope = 2.0 * STRENGTH / STOP
        parts = [(0.0, 1.0), (0.5 * STOP, -2.0), (STOP, 1.0)]
        x = sum(share * slope / STIFFNESS * (t - at - np.sin(omega * (t - at)) / omega) for at, share in parts)
    return float(x), 0.0, 0.0


def rigid_scenes(*, quick: bool) -> list[Scene]:
    """The scenes that need no record."""
    four = mechanisms.FOUR_BAR
    scenes = [
        Scene("rigid chain, 10", "rigid chain", 1.0, 10 * LINK, lambda: rigid_chain(10), CHAIN_TIP[10], 10),
        Scene("rigid chain, 50", "rigid chain", 1.0, 50 * LINK, lambda: rigid_chain(50), CHAIN_TIP[50], 50),
        Scene("heavy top", "heavy top", 2.0, 1.0, heavy_top, mechanisms.HEAVY_TOP[2.0]),
        Scene("four-bars, 2", "four-bars", 10.0, 1.0, lambda: four_bars(2), (*four[2][10.0], 0.0), 2),
        Scene("four-bars, 40", "four-bars", 1.0, 1.0, lambda: four_bars(40), (*four[40][1.0], 0.0), 40),
        *(
            Scene(f"load with a {load}", f"load with a {load}", 3.0, 1.0, partial(loaded_spring, load),
                  loaded_spring_end(load, 3.0), agreement=1e-4)  # exudyn's steps go across the jump
            for load in LOADS
        ),
    ]
    return [scenes[0], scenes[2], scenes[3]] if quick else scenes


def flexible_scenes(*, quick: bool, folder: Path, meshes: Path | None = None) -> list[Scene]:
    """The scenes of the reduced beam: 20 modes of the smallest mesh, 12 in the chain."""
    many = beam_record.beam("5k", 20, folder=folder, meshes=meshes)
    few = beam_record.beam("5k", 12, folder=folder, meshes=meshes)
    record, short = (fm.ReducedBody.load(files.stiffened) for files in (many, few))
    # gravity's moment in exudyn forgets that the centre of mass moves, and nothing stiffens there
    scenes = [
        Scene("pendulum, 20 modes", "flexible chain", 0.5, 1.0, lambda: flexible_chain(record, 1), None, 1, many, 2e-3),
        Scene("spin-up, 20 modes", "spin-up", 0.5, 1.0, lambda: spin_up(record), None, 0, many, 2e-4),
        Scene("5 beams, 12 modes", "flexible chain", 0.5, 5.0, lambda: flexible_chain(short, 5), None, 5, few, 2e-3),
        Scene("slider-crank, 20 modes", "slider-crank", 0.5, 1.0, lambda: slider_crank(record), None, 0, many, 2e-4),
    ]
    return scenes[:1] if quick else scenes


def error(scene: Scene, found: np.ndarray, reference: np.ndarray) -> float:
    """Relative to the scene's size."""
    return float(np.linalg.norm(found - reference)) / scene.size
