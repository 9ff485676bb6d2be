"""Contacts of rigid bodies: a cradle, a cam that loses its follower, a ball from sliding to rolling; beside others.

    ./run python benchmarks/contact.py [--quick]

`cradle`: five steel balls in a row, a millimetre apart, by Hertz' law: the last one leaves with the first one's speed;
the error is that of the speeds, of 1 m/s.  `rolling`: a billiard ball of 2 m/s slides on cloth until it rolls; its
error is that of its place after 0.5 s against Coulomb's closed form.  `cam`: an eccentric disc on a flywheel throws off
its follower, which comes back; the error is that of the follower's place at the end against the same program's run
with a far tighter tolerance, or far shorter steps, since laws differ.  `geneva`: a flywheel's pin indexes a wheel of
four slots, with play; the error is that of the wheel's angle, as of the cam.

Beside exudyn, whose laws are the same but for friction, which is regularised there, and MuJoCo, whose contacts are
springs of its constraint solver (`solref` by stiffness).  Both take fixed steps.  Measured are processor times of all
from a built scene to its end (of MuJoCo from its text), in turns, in one process whose kernels are loaded; medians.  A
program has reached the error where it and all its finer runs are as exact.
"""

from __future__ import annotations

import argparse
import importlib.util
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import contact_peers
import numpy as np
from benchmark import Report
from contact_peers import CAM, CRADLE, GENEVA, ROLLING

import flexmbd as fm
from flexmbd import contact

MINUTES = 3.0
PEERS: tuple[str, ...] = ("exudyn", "mujoco")
FOLDER = Path("out_simulation")

OWN = {
    "Dormand-Prince 8(5,3)": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
    "Radau IIA": fm.RadauIIA(),
    "generalized-alpha": fm.GeneralizedAlpha(),
}
#: A run: how exact (rtol, or the step in s) -> processor time (s), and what is compared.
Run = Callable[[float], tuple[float, np.ndarray]]


@dataclass(frozen=True)
class Scene:
    """A scene.

    Attributes:
        build: here; and what is compared, of a run.
        exact: what is compared, in closed form; None: by each program's own finest run.
        error: at which programs are compared.
        unit: of it.
        steps: s, of the others, the first is the coarsest.
        end: s.
    """

    build: Callable[[], tuple[fm.System, Callable[[Any], np.ndarray]]]
    exact: np.ndarray | None
    error: float
    unit: str
    steps: tuple[float, ...]
    end: float


def ball(scene: fm.System, name: str, place: Sequence[float], speed: float, radius: float, mass: float) -> Any:
    """A ball that flies."""
    body = scene.add(fm.RigidBody(mass, (0.4 * mass * radius**2,) * 3), name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (*place, 1.0, 0.0, 0.0, 0.0), (speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    return body


def cradle() -> tuple[fm.System, Callable[[Any], np.ndarray]]:
    """The speeds at the end."""
    scene = fm.System()
    balls = [
        ball(scene, f"ball {i}", (x, 0.0, 0.0), v, CRADLE.radius, CRADLE.mass)
        for i, (x, v) in enumerate(zip(CRADLE.places, CRADLE.speeds, strict=True))
    ]
    shapes = [contact.Sphere(one.frame(), CRADLE.radius) for one in balls]
    for one, other in pairwise(shapes):
        scene.touch(one, other, contact.PowerLaw(k=CRADLE.stiffness, p=1.5))
    return scene, lambda run: np.array([run.velocity(one.frame())[-1, 0] for one in balls])


def rolling() -> tuple[fm.System, Callable[[Any], np.ndarray]]:
    """The place at the end."""
    scene = fm.System(gravity=(0.0, 0.0, -ROLLING.gravity))
    mass, k = ROLLING.mass, ROLLING.stiffness
    body = ball(scene, "ball", (0.0, 0.0, ROLLING.height), ROLLING.speed, ROLLING.radius, mass)
    rough = contact.Friction(ROLLING.mu, stiffness=k, damping=0.1 * np.sqrt(k * mass), load=mass * ROLLING.gravity)
    floor = contact.HalfSpace(scene.ground.frame())
    scene.touch(floor, contact.Sphere(body.frame(), ROLLING.radius), contact.PowerLaw(k=k), friction=rough)
    return scene, lambda run: run.position(body.frame())[-1, :1]


def cam() -> tuple[fm.System, Callable[[Any], np.ndarray]]:
    """The follower's place at the end."""
    scene = fm.System(gravity=(0.0, -CAM.gravity, 0.0))
    wheel = scene.add(fm.RigidBody(1.0, (CAM.inertia,) * 3), name="wheel")
    turn = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame())
    turn.velocity = CAM.rate
    follower = scene.add(fm.RigidBody(CAM.mass, (1e-4,) * 3), name="follower")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), follower.frame())
    slide.position, slide.velocity = CAM.start, CAM.start_rate
    scene.add_force(fm.force.JointSpring(slide, CAM.spring, rest=CAM.rest))
    disc = contact.Sphere(wheel.frame(p=(CAM.eccentricity, 0.0, 0.0)), CAM.disc)
    scene.touch(disc, contact.Sphere(follower.frame(), CAM.roller), contact.PowerLaw(k=CAM.stiffness))
    return scene, lambda run: run.position(follower.frame())[-1, 1:2]


def geneva() -> tuple[fm.System, Callable[[Any], np.ndarray]]:
    """The wheel's angle at the end."""
    scene = fm.System()
    joints, frames = [], []
    for name, inertia, x, angle, rate in (
        ("driver", GENEVA.inertia, 0.0, GENEVA.first, GENEVA.rate),
        ("wheel", GENEVA.wheel, GENEVA.centre, GENEVA.start, GENEVA.start_rate),
    ):
        body = scene.add(fm.RigidBody(1.0, (inertia,) * 3), name=name)
        joints.append(scene.connect(fm.joint.Revolute("z"), scene.ground.frame((x, 0.0, 0.0)), body.frame()))
        joints[-1].position, joints[-1].velocity = angle, rate
        frames.append(body.frame((GENEVA.crank, 0.0, 0.0) if name == "driver" else (0.0, 0.0, 0.0)))
    scene.add_force(fm.force.JointDamper(joints[1], GENEVA.damping))
    half, points, bulges = GENEVA.half, [], []
    for k in range(4):
        along = np.array([np.cos(np.pi * (0.5 * k + 0.25)), np.sin(np.pi * (0.5 * k + 0.25))])
        aside = np.array([-along[1], along[0]])
        corners = ((0.0707, -1.0), (0.022, -1.0), (0.022, 1.0), (0.0707, 1.0))
        points += [r * along + s * half * aside for r, s in corners]
        bulges += [0.0, -1.0, 0.0, 0.0]
    law = contact.PowerLaw(k=GENEVA.stiffness)
    scene.touch(contact.Profile(frames[1], points, bulges), contact.Sphere(frames[0], GENEVA.pin), law)
    return scene, lambda run: run.beta(joints[1])[-1:]


SCENES = {
    "cradle": Scene(
        cradle, np.array([0.0, 0.0, 0.0, 0.0, 1.0]), 1e-4, "m/s", tuple(2e-5 / 2.0**k for k in range(8)), CRADLE.end
    ),
    "rolling": Scene(
        rolling, np.array([ROLLING.exact]), 1e-5, "m", tuple(1e-3 / 2.0**k for k in range(9)), ROLLING.end
    ),
    "geneva": Scene(geneva, None, 1e-6, "rad", tuple(1e-4 / 2.0**k for k in range(9)), GENEVA.end),
    "cam": Scene(cam, None, 1e-6, "m", tuple(4e-5 / 2.0**k for k in range(8)), CAM.end),
}  # fmt: skip


def own(scene: Scene, method: str) -> Run:
    """Here: by rtol."""

    def run(rtol: float) -> tuple[float, np.ndarray]:
        system, found = scene.build()
        began = time.process_time()
        trajectory = system.simulate(scene.end, rtol=rtol, integrator=OWN[method])
        return time.process_time() - began, found(trajectory)

    return run


def programs(name: str) -> dict[str, tuple[str, Run, tuple[float, ...], float]]:
    """Label -> the program, its run, from coarse to fine, and finer than all."""
    scene = SCENES[name]
    rtols = tuple(10.0**-k for k in range(2, 10))
    found = {f"flexmbd, {method}": ("flexmbd", own(scene, method), rtols, 1e-11) for method in OWN}
    found["flexmbd, generalized-alpha"] = (*found["flexmbd, generalized-alpha"][:2], rtols[:5], 1e-8)
    for peer, label, run in contact_peers.runs(name):
        if importlib.util.find_spec(peer) is not None:
            found[label] = (peer, run, scene.steps, scene.steps[-1] / 4.0)
    return found


def measure(report: Report, name: str, *, turns: int, fewest: bool) -> None:
    """Rows of a scene: error over processor time; and the comparison.  ``fewest``: two values of each, no finer run."""
    scene, reached = SCENES[name], {}
    for label, (program, run, values, finest) in programs(name).items():
        values = values[1:3] if fewest else values
        run(values[0])  # kernels are loaded
        exact = scene.exact if scene.exact is not None else run(values[-1] if fewest else finest)[1]
        errors = []
        for value in values:
            seconds, found = run(value)
            errors.append(float(np.abs(found - exact).max()) if np.isfinite(found).all() else np.inf)
            what = f"rtol {value:.0e}" if program == "flexmbd" else f"{value:.1e} s"
            told = f"{errors[-1]:.1e} {scene.unit}" if np.isfinite(errors[-1]) else "failed"
            report.say(f"| {name} | {label} | {what} | {1e3 * seconds:.3g} | {told} |")
        missed = [k for k, error in enumerate(errors) if error > scene.error]
        first = missed[-1] + 1 if missed else 0  # where it and all that are finer are exact enough
        if first < len(values):
            reached[label] = (program, run, values[first])
    times: dict[str, list[float]] = {label: [] for label in reached}
    for _ in range(turns):
        for label, (_, run, value) in reached.items():
            times[label].append(run(value)[0])
    best: dict[str, str] = {}
    for label, (program, _, _) in reached.items():
        if program not in best or np.median(times[label]) < np.median(times[best[program]]):
            best[program] = label
    for program, label in best.items():
        if program != "flexmbd" and "flexmbd" in best:
            task = f"from the built scene to its end, to {scene.error:.0e} {scene.unit}"
            report.beside(f"contact, {name}", task=task, peer=label, theirs=times[label], ours=times[best["flexmbd"]])


def table(report: Report) -> None:
    report.table("scene", "method", "tolerance or step", "processor time (ms)", "error")


def quick(report: Report) -> None:
    """Two tolerances and steps of each program."""
    table(report)
    for name in SCENES:
        measure(report, name, turns=1, fewest=True)


def full(report: Report) -> None:
    """All, until the error is small enough."""
    table(report)
    for name in SCENES:
        measure(report, name, turns=5, fewest=False)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few tolerances and steps")
    given = parser.parse_args()
    report = Report(FOLDER)
    (quick if given.quick else full)(report)
    for one in report.comparisons:
        print(one)


if __name__ == "__main__":
    main()
