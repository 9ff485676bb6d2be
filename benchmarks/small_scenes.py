"""Small scenes from the built System to the result, where little of the time is stepping; beside MuJoCo and exudyn.

    ./run python benchmarks/small_scenes.py [--quick]

Rigid chains of 2, 10 and 50 links of `scenes.py` and a plane four-bar whose hinges hold three rows too many, for 1 s
with rtol = 1e-3.  Measured are a first `simulate` of a new System, which compiles, starts and steps; a later one of the
same System, in which nothing was changed; and a variant of a compiled machine, whose start velocity varies (of the
chains the mass of a link), alone and in an ensemble that samples a point.  Building the System itself is told apart.

MuJoCo loads its model from XML and takes fixed steps of RK4, exudyn assembles its system, which is built before, and
takes those of DOPRI5, of the four-bar of generalized-alpha: the longest with which the point at the end comes as near
to the exact one as here, or the nearest that they come.  MuJoCo's loops are soft constraints; `pip install "mujoco<4"`.

All in one process in turns, processor times: median, least and most.  The factor is of the first run over the least of
the other programs, medians of all.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scenes
from benchmark import Report

import flexmbd as fm
from flexmbd.ensemble import Sampled

MINUTES = 2.0
PEERS: tuple[str, ...] = ("exudyn", "mujoco")
FOLDER = Path("out_simulation")
RTOL, END = 1e-3, 1.0
SIDES = {"crank": 0.2, "coupler": 0.6, "rocker": 0.5}  # m
BASE, ANGLE, SPEED, DENSITY, THIN = 0.6, 0.5 * np.pi, 6.0, 2.5, 1e-4  # m, rad, rad/s, kg/m, kg m^2

Point = Any


@dataclass(frozen=True)
class Small:
    """A scene.

    Attributes:
        name: in the table.
        links: of a chain; 0 of the four-bar.
    """

    name: str
    links: int

    def build(self) -> tuple[fm.System, Point]:
        """The System, new, and the point that is compared."""
        return scenes.rigid_chain(self.links) if self.links else four_bar()

    def machine(self) -> tuple[fm.CompiledMachine, Point, float]:
        """Compiled, with a parameter `of`, the point, and the parameter's own value."""
        system, point = self.build()
        if self.links:
            link = system.compile().bodies[0]
            return system.compile(parameters={"of": fm.parameter.Mass(link)}), point, scenes.LINK_MASS  # type: ignore[arg-type]
        crank = system.compile().connections[0]
        return system.compile(parameters={"of": fm.parameter.InitialVelocity(crank)}), point, SPEED


SCENES = (Small("chain, 2", 2), Small("chain, 10", 10), Small("chain, 50", 50), Small("four-bar", 0))


def moments(length: float) -> tuple[float, float, float]:
    """Of a side of the four-bar about its centre, kg m^2."""
    across = DENSITY * length**3 / 12.0 + THIN
    return THIN, across, across


def angles() -> tuple[float, float]:
    """The coupler's and the rocker's angles against x at the start (rad)."""
    tip = SIDES["crank"] * np.exp(1j * ANGLE)
    across = BASE - tip
    far = abs(across)
    inner = np.arccos((SIDES["coupler"] ** 2 - SIDES["rocker"] ** 2 + far**2) / (2.0 * SIDES["coupler"] * far))
    coupler = np.angle(across) + inner
    return float(coupler), float(np.angle(tip + SIDES["coupler"] * np.exp(1j * coupler) - BASE))


def rates() -> tuple[float, float]:
    """Their rates (rad/s)."""
    coupler, rocker = angles()
    turns = [1j * SIDES[name] * np.exp(1j * angle) for name, angle in (("coupler", coupler), ("rocker", rocker))]
    tip = 1j * SPEED * SIDES["crank"] * np.exp(1j * ANGLE)
    found = np.linalg.solve([[turns[0].real, -turns[1].real], [turns[0].imag, -turns[1].imag]], [-tip.real, -tip.imag])
    return float(found[0]), float(found[1])


def four_bar() -> tuple[fm.System, Point]:
    """Started with its crank upright; the middle of its coupler."""
    system, hinge = fm.System(gravity=(0.0, -scenes.G, 0.0)), fm.joint.Revolute("z")
    crank, coupler, rocker = (
        system.add(fm.RigidBody(DENSITY * length, moments(length), (0.5 * length, 0.0, 0.0)), name=name)
        for name, length in SIDES.items()
    )
    drive = system.connect(hinge, system.ground.frame(), crank.frame())
    pin = system.connect(hinge, crank.frame(p=(SIDES["crank"], 0.0, 0.0)), coupler.frame())
    pivot = system.connect(hinge, system.ground.frame(p=(BASE, 0.0, 0.0)), rocker.frame())
    system.connect(hinge, coupler.frame(p=(SIDES["coupler"], 0.0, 0.0)), rocker.frame(p=(SIDES["rocker"], 0.0, 0.0)))
    first, second = angles()
    drive.position, drive.velocity = ANGLE, SPEED
    pin.position, pivot.position = first - ANGLE, second
    return system, coupler.frame(p=(0.5 * SIDES["coupler"], 0.0, 0.0))


# -- here --------------------------------------------------------------------------------------------------------------


def spent(call: Callable[[], object]) -> float:
    """Processor time, ms."""
    began = time.process_time()
    call()
    return 1e3 * (time.process_time() - began)


def own(small: Small, variants: int) -> Iterator[tuple[str, Callable[[], float]]]:
    """What is measured here, by its name: each call is one measurement, ms."""
    kept, _ = small.build()
    machine, _, value = small.machine()
    sampler, point, _ = small.machine()  # of its own: workspaces are of one kind of runs
    numbers = iter(range(10**9))

    def first() -> float:
        system, _ = small.build()
        return spent(lambda: system.simulate(END, rtol=RTOL))

    def variant() -> float:
        return spent(lambda: machine.simulate(END, rtol=RTOL, of=value * (1.0 + 1e-6 * next(numbers))))

    def sampled() -> float:
        values = {"of": value * (1.0 + 1e-5 * np.arange(variants))}
        end = {"end": Sampled(fm.output.Position(point), t=END)}

        def run() -> None:
            sampler.ensemble(values, end, t_end=END, rtol=RTOL, integrator=fm.ExplicitRungeKutta(), workers=1).close()

        return spent(run) / variants

    yield "build", lambda: spent(small.build)
    yield "first", first
    yield "again", lambda: spent(lambda: kept.simulate(END, rtol=RTOL))
    yield "variant", variant
    yield "sampled", sampled


# -- the others --------------------------------------------------------------------------------------------------------


def mujoco_xml(small: Small, steps: int) -> str:
    """The model for MuJoCo, in its start."""
    if small.links:
        size = " ".join(map(str, scenes.link_inertia()))
        inside = ""
        for i in reversed(range(small.links)):
            end = f'<site name="point" pos="{scenes.LINK} 0 0"/>' if i == small.links - 1 else ""
            inside = _mujoco_body("", scenes.LINK if i else 0.0, 0.0, scenes.LINK, scenes.LINK_MASS, size, end + inside)
        loops, flags = "", 'constraint="disable"'
    else:
        first, second = angles()
        parts = {
            name: (length, DENSITY * length, " ".join(map(str, moments(length)))) for name, length in SIDES.items()
        }
        site = f'<site name="point" pos="{0.5 * SIDES["coupler"]} 0 0"/>'
        coupler = _mujoco_body("coupler", SIDES["crank"], first - ANGLE, *parts["coupler"], site)
        inside = _mujoco_body("crank", 0.0, ANGLE, *parts["crank"], coupler)
        inside += _mujoco_body("rocker", BASE, second, *parts["rocker"], "")
        anchor = f'anchor="{SIDES["coupler"]} 0 0" solref="{2.0 * END / steps} 1" solimp="0.9999 0.9999 0.001"'
        loops, flags = f'<equality><connect body1="coupler" body2="rocker" {anchor}/></equality>', ""
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{END / steps}" integrator="RK4" '
        f'gravity="0 {-scenes.G} 0"><flag {flags} contact="disable" limit="disable" frictionloss="disable" '
        f'spring="disable" damper="disable" actuation="disable" sensor="disable"/></option>'
        f"<worldbody>{inside}</worldbody>{loops}</mujoco>"
    )


def _mujoco_body(
    name: str, place: float, angle: float, length: float, mass: float, size: str, inside: str
) -> str:
    named = f'name="{name}" ' if name else ""
    return (
        f'<body {named}pos="{place} 0 0" euler="0 0 {angle}"><joint type="hinge" axis="0 0 1"/>'
        f'<inertial pos="{0.5 * length} 0 0" mass="{mass}" diaginertia="{size}"/>{inside}</body>'
    )


def in_mujoco(small: Small, steps: int) -> tuple[float, np.ndarray]:
    """Processor time (ms) from the model's text to the end, and the point there."""
    import mujoco
    from mujoco import rollout

    text, found = mujoco_xml(small, steps), []

    def run() -> None:
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        if not small.links:
            first, second = rates()
            data.qvel[:] = SPEED, first - SPEED, second
        state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
        mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states, _ = rollout.rollout(model, data, state[None], nstep=steps)
        mujoco.mj_setState(model, data, states[0, -1], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        mujoco.mj_kinematics(model, data)
        found.append(data.site_xpos[0].copy())

    return spent(run), found[0]


def in_exudyn(small: Small, steps: float) -> tuple[float, np.ndarray]:
    """Processor time (ms) of assembling and solving, and the point; of the chains ``steps`` is 1 / rtol."""
    import scenes_exudyn as exudyn

    if small.links:
        known = scenes.Scene(small.name, "rigid chain", END, 1.0, small.build, None, small.links)
        _, took, found = exudyn.assemble_and_solve(exudyn.build(known), exudyn.DOPRI5, END, h=1e-2, rtol=1.0 / steps)
    else:
        _, took, found = exudyn.assemble_and_solve(_exudyn_four_bar(), exudyn.ALPHA, END, h=END / steps)
    return 1e3 * took, np.full(3, np.nan) if found is None else found


def _exudyn_four_bar() -> Any:
    """Planar bodies and hinges, index 3."""
    import scenes_exudyn  # first, for it says which build is loaded
    import exudyn  # isort: skip
    import exudyn.itemInterface as item  # isort: skip

    system = exudyn.SystemContainer().AddSystem()
    first, second = angles()
    tip = SIDES["crank"] * np.exp(1j * ANGLE)
    begins = {"crank": (0.0, ANGLE, SPEED, 0.0), "rocker": (BASE, second, rates()[1], 0.0)}
    begins["coupler"] = (tip, first, rates()[0], 1j * SPEED * tip)
    ground, bodies = system.AddObject(item.ObjectGround()), {}

    def marker(body: Any, place: list[float]) -> Any:
        return system.AddMarker(item.MarkerBodyPosition(bodyNumber=body, localPosition=place))

    for name, (start, angle, rate, speed) in begins.items():
        length = SIDES[name]
        half = 0.5 * length * np.exp(1j * angle)
        centre, moves = start + half, speed + 1j * rate * half
        node = item.NodeRigidBody2D(
            referenceCoordinates=[centre.real, centre.imag, angle], initialVelocities=[moves.real, moves.imag, rate]
        )
        inertia = {"mass": DENSITY * length, "inertia": moments(length)[2]}
        bodies[name] = system.AddObject(item.ObjectRigidBody2D(**inertia, nodeNumber=system.AddNode(node)))
        weight = [0.0, -scenes.G * DENSITY * length, 0.0]
        system.AddLoad(item.Force(markerNumber=marker(bodies[name], [0.0, 0.0, 0.0]), loadVector=weight))
    ends = {name: (marker(bodies[name], [-0.5 * n, 0.0, 0.0]), marker(bodies[name], [0.5 * n, 0.0, 0.0]))
            for name, n in SIDES.items()}  # fmt: skip
    pairs = (
        (marker(ground, [0.0, 0.0, 0.0]), ends["crank"][0]), (ends["crank"][1], ends["coupler"][0]),
        (marker(ground, [BASE, 0.0, 0.0]), ends["rocker"][0]), (ends["coupler"][1], ends["rocker"][1]),
    )  # fmt: skip
    for pair in pairs:
        system.AddObject(item.RevoluteJoint2D(markerNumbers=list(pair)))
    sensor = scenes_exudyn._point(system, bodies["coupler"], [0.0, 0.0, 0.0])
    return system, lambda: np.array(system.GetSensorValues(sensor))


def matched(
    run: Callable[[Any], tuple[float, np.ndarray]], counts: list[float], exact: np.ndarray, wanted: float
) -> tuple[Any, float]:
    """The first count with which a program comes as near as wanted (m), else its nearest; and how near."""
    best: tuple[Any, float] = (counts[0], np.inf)
    for count in counts:
        error = float(np.linalg.norm(run(count)[1] - exact))
        if error < best[1]:
            best = count, error
        if error <= wanted:
            break
    return best


# -- all ---------------------------------------------------------------------------------------------------------------


def measure(report: Report, small: Small, *, turns: int, variants: int, others: bool) -> None:
    """A scene's row."""
    system, point = small.build()
    exact = system.simulate(END, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    place = exact.position(point)[-1]
    wanted = float(np.linalg.norm(system.simulate(END, rtol=RTOL).position(point)[-1] - place))
    errors = [f"{wanted:.0e}"]
    measured = dict(own(small, variants))
    peers: dict[str, tuple[Callable[[Any], tuple[float, np.ndarray]], list[float]]] = {
        "MuJoCo": (partial(in_mujoco, small), [round(max(20, 8 * small.links) * 2.0 ** (k / 2)) for k in range(16)]),
        "exudyn": (partial(in_exudyn, small), [10.0**k for k in np.arange(2.0, 9.0, 0.5)] if small.links else
                   [round(50 * 2.0 ** (k / 2)) for k in range(14)]),
    }  # fmt: skip
    for name, (run, counts) in peers.items():
        try:
            count, error = matched(run, counts, place, wanted) if others else (None, np.inf)
        except ImportError:
            count, error = None, np.inf
        errors.append(f"{error:.0e}" if count is not None else "-")
        if count is not None:
            measured[name] = lambda run=run, count=count: run(count)[0]  # type: ignore[misc]
    for call in measured.values():
        for _ in range(3):  # kernels are loaded, and the workspaces of later runs made
            call()
    taken: dict[str, list[float]] = {name: [] for name in measured}
    for _ in range(turns):
        for name, call in measured.items():
            taken[name].append(call())
    cells = [told(taken.get(name)) for name in ("build", "first", "again", "variant", "sampled", "MuJoCo", "exudyn")]
    theirs = [float(np.median(taken[name])) for name in ("MuJoCo", "exudyn") if name in taken]
    for name in ("MuJoCo", "exudyn"):
        if name in taken:
            task = "from the model to the result"
            report.beside(small.name, task=task, peer=name, theirs=taken[name], ours=taken["first"])
    ratio = f"{float(np.median(taken['first'])) / min(theirs):.2g}" if theirs else "-"
    report.say(f"| {small.name} | {' | '.join(cells)} | {ratio} | {', '.join(errors)} |")


def told(times: list[float] | None) -> str:
    """Median, least and most."""
    if times is None:
        return "-"
    low, middle, high = np.percentile(times, [0.0, 50.0, 100.0])
    return f"{middle:.2f} ({low:.2f} to {high:.2f})"


def table(report: Report) -> None:
    report.table(
        "scene", "building (ms)", "first run (ms)", "again (ms)", "variant (ms)", "sampled variant (ms)",
        "MuJoCo, load and steps (ms)", "exudyn, assembly and steps (ms)", "first run over the best of these",
        "errors at the end: here, MuJoCo, exudyn (m)",
    )  # fmt: skip


def quick(report: Report) -> None:
    """Few turns of the chain of ten and the four-bar, without other programs."""
    table(report)
    for small in SCENES[1::2]:
        measure(report, small, turns=3, variants=5, others=False)


def full(report: Report) -> None:
    """All scenes, beside other programs."""
    table(report)
    for small in SCENES:
        measure(report, small, turns=25, variants=50, others=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few turns, without other programs")
    (quick if parser.parse_args().quick else full)(Report(FOLDER))


if __name__ == "__main__":
    main()
