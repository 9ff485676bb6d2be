"""Time a step against the number of bodies, of modes, and of the dofs of the mesh.

    ./run python benchmarks/scaling.py --quick     # few sizes, about a minute
    ./run python benchmarks/scaling.py             # the whole; on a core that does nothing else
    ./run python benchmarks/scaling.py --meshes FOLDER     # the beam from given meshes, *_5k_*.npz and so on

By fixed steps, the least of several runs of enough steps; compiling comes before. What a step costs, not what it is
worth: for that see work_precision.py.

    bodies        rigid chain, 10 to 3000 links: RK4, and generalized-alpha; exudyn's kinematic tree to 200. "per body
                  by that at 50" says how far the time is from growing in proportion.
    loops         four-bars side by side, 10 to 1000: compiling and start with two steps, s; RK4, us a step. "as n^e" is
                  the growth from the row before.
    ladder        windows of three bars that hang one from the other, 12 to 200, as loops: RK4, us a step
    implicit      rigid chain, 10 to 3000 links, and four-bars side by side, 10 to 1000, by generalized-alpha, Radau IIA
                  and energy-momentum: the first step, with its tangent and factors, and the mean of 20, us; "as n^e"
                  is the growth of the two from the row before.  A method ends where a first step takes over 0.2 s
    modes         pendulum of the smallest mesh, 6 to 100 modes; and its forward dynamics as a leaf and with a child,
                  whose ratio tells what carrying a child costs
    mesh          pendulum of 20 modes from 5k, 19k and 63k dofs, the joint on the body frame's node in exudyn, or on
                  its rigid end as the mean of that end's nodes
    start         a fresh process: seconds from its start to the first step's end, with what is compiled in the cache

Writes out_scaling/table.md.
"""

from __future__ import annotations

import argparse
import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import scenes
from beam_record import beam
from benchmark import Report
from numpy.typing import NDArray
from steps_runner import Case, stepping

import flexmbd as fm
from flexmbd.integrate.protocol import Integrator

PEER = importlib.util.find_spec("exudyn") is not None
H = 1e-3
MINUTES = 10.0
PEERS: tuple[str, ...] = ("exudyn",)
FOLDER = Path("out_scaling")
CLASSICAL = fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4)

Row = tuple[str, str, str]
FloatArray = NDArray[np.float64]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few sizes")
    parser.add_argument("--part", help="only parts with this in their names")
    parser.add_argument("--meshes", type=Path, metavar="FOLDER", help="of the beam's meshes")
    parser.add_argument("--output", type=Path, default=FOLDER, metavar="FOLDER")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    parts = _parts(arguments.output, arguments.meshes, quick=arguments.quick)
    report = Report(arguments.output)
    tell(report, {name: part for name, part in parts.items() if arguments.part is None or arguments.part in name})
    (arguments.output / "table.md").write_text("\n".join(report.lines) + "\n")
    return 0


def _parts(folder: Path, meshes: Path | None, *, quick: bool) -> dict[str, Callable[[], Iterator[Row]]]:
    return {
        "bodies": lambda: bodies(quick=quick),
        "loops": lambda: loops(quick=quick),
        "ladder": lambda: ladder(quick=quick),
        "implicit": lambda: implicit(quick=quick),
        "modes": lambda: modes(folder, quick=quick),
        "mesh": lambda: mesh(folder, meshes, quick=quick),
        "start": start,
    }


def quick(report: Report) -> None:
    """Windows of a ladder."""
    tell(report, {"ladder": partial(ladder, quick=True)})


def full(report: Report) -> None:
    """All parts."""
    tell(report, _parts(report.folder, None, quick=False))


def tell(report: Report, parts: Mapping[str, Callable[[], Iterator[Row]]]) -> None:
    """The table of some parts."""
    report.table("part", "what", "us a step, and ratios")
    for part in parts.values():
        for row in part():
            report.say(f"| {' | '.join(row)} |")


def step_time(
    build: Callable[[], fm.System], method: Integrator, *, h: float = H, steps: int | None = None, least: float = 0.04
) -> float:
    """us of processor time a step, of the stepping alone: the least of five runs.

    Each takes as many ``steps``, or as many as last for a while (``least``, s).
    """

    def spent(count: int) -> float:
        case = Case("", build, count * h, h, h)
        return stepping(case.build(), case, method, {"h": h})[0] / count * 1e6

    count = 1 if steps is None else steps
    spent(count)  # whatever is compiled, or read, once
    while steps is None and spent(count) * count < least * 1e6 and count < 10**6:
        count *= 4
    return min(spent(count) for _ in range(5))


def bodies(*, quick: bool) -> Iterator[Row]:
    sizes = (10, 50, 200) if quick else (10, 20, 50, 100, 200, 500, 1000, 3000)
    found = {}
    for links in sizes:
        # long chains swing slowly; a short step keeps Newton's iterations alike
        found[links] = step_time(partial(_rigid, links), CLASSICAL)
    for links, explicit in found.items():
        each = (explicit / links) / (found[50] / 50.0)
        text = f"RK4 {explicit:.2f}; per body by that at 50: {each:.2f}"
        if links <= 200:
            implicit = step_time(partial(_rigid, links), fm.GeneralizedAlpha())
            text += f"; generalized-alpha {implicit:.1f}"
            if PEER:
                import scenes_exudyn as peer

                scene = scenes.Scene("", "rigid chain", 1.0, 1.0, partial(scenes.rigid_chain, links), None, links)
                theirs = min(peer.solve(peer.build(scene), peer.RK44, 0.2, h=H)[0] for _ in range(3)) / 200.0 * 1e6
                damped = min(peer.solve(peer.build(scene), peer.ALPHA, 0.1, h=H)[0] for _ in range(3)) / 100.0 * 1e6
                text += f"; exudyn RK4 {theirs:.1f} ({theirs / explicit:.1f} times)"
                text += f", generalized-alpha {damped:.1f} ({damped / implicit:.1f} times)"
        yield "bodies", str(links), text


def loops(*, quick: bool) -> Iterator[Row]:
    before: tuple[int, float, float] | None = None
    for count in (10, 40, 160) if quick else (10, 30, 100, 300, 1000):
        build = partial(_four_bars, count)
        step = step_time(build, CLASSICAL)
        seconds = []
        for _ in range(3):
            machine = build()
            began = time.process_time()
            machine.simulate(2.0 * H, h=H, integrator=CLASSICAL)
            seconds.append(time.process_time() - began)
        text = f"start {min(seconds):.3f} s; RK4 {step:.1f}"
        if before is not None:
            growth = np.log(np.array([min(seconds), step]) / before[1:]) / np.log(count / before[0])
            text += f"; as n^{growth[0]:.2f} and n^{growth[1]:.2f}"
        before = count, min(seconds), step
        yield "loops", str(count), text


def ladder(*, quick: bool) -> Iterator[Row]:
    before: tuple[int, float] | None = None
    for windows in (12, 50) if quick else (12, 25, 50, 100, 200):
        step = step_time(partial(_ladder, windows), CLASSICAL, steps=20)
        text = f"RK4 {step:.1f}"
        if before is not None:
            text += f"; as n^{np.log(step / before[1]) / np.log(windows / before[0]):.2f}"
        before = windows, step
        yield "ladder", f"{windows} windows", text


def implicit(*, quick: bool) -> Iterator[Row]:
    methods: dict[str, Integrator] = {
        "generalized-alpha": fm.GeneralizedAlpha(),
        "Radau": fm.RadauIIA(),
        "energy-momentum": fm.EnergyMomentum(),
    }
    machines = {"links": (_rigid, 3000), "four-bars": (_four_bars, 1000)}
    for what, (build, most) in machines.items():
        for name, method in methods.items():
            before: tuple[int, FloatArray] | None = None
            for count in (10, 100) if quick else (10, 30, 100, 300, 1000, 3000):
                if count > most or (before is not None and before[1][0] > 1e5):
                    break
                found = np.array([step_time(partial(build, count), method, steps=steps) for steps in (1, 20)])
                text = f"{name}: first {found[0]:.0f}; each of 20 {found[1]:.1f}"
                if before is not None:
                    growth = np.log(found / before[1]) / np.log(count / before[0])
                    text += f"; as n^{growth[0]:.2f} and n^{growth[1]:.2f}"
                before = count, found
                yield "implicit", f"{count} {what}", text


def _four_bars(count: int) -> fm.System:
    """Three bars on hinges each, on a common ground, their cranks at 0.3 rad; each a loop of its own."""
    scene, hinge = fm.System(gravity=(0.0, -9.81, 0.0)), fm.joint.Revolute("z")
    inertia = (0.1, 0.1, 0.1)
    for k in range(count):
        crank = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"crank {k}")
        coupler = scene.add(fm.RigidBody(1.0, inertia, (0.5, 0.0, 0.0)), name=f"coupler {k}")
        rocker = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"rocker {k}")
        scene.connect(hinge, scene.ground.frame(p=(3.0 * k, 0.0, 0.0)), crank.frame()).position = 0.3
        scene.connect(hinge, crank.frame(p=(0.0, -1.0, 0.0)), coupler.frame())
        scene.connect(hinge, coupler.frame(p=(1.0, 0.0, 0.0)), rocker.frame(p=(0.0, -1.0, 0.0)))
        scene.connect(hinge, scene.ground.frame(p=(3.0 * k + 1.0, 0.0, 0.0)), rocker.frame())
    return scene


def _ladder(windows: int) -> fm.System:
    """Four-bars that hang one from the other, the first on the ground."""
    scene, hinge = fm.System(gravity=(0.0, -9.81, 0.0)), fm.joint.Revolute("z")
    left, right = scene.ground.frame(), scene.ground.frame(p=(1.0, 0.0, 0.0))
    inertia = (0.1, 0.1, 0.1)
    for k in range(windows):
        rail = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"rail {k}")
        rung = scene.add(fm.RigidBody(1.0, inertia, (0.5, 0.0, 0.0)), name=f"rung {k}")
        other = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"other rail {k}")
        scene.connect(hinge, left, rail.frame()).position = 0.3 if k == 0 else 0.0
        scene.connect(hinge, rail.frame(p=(0.0, -1.0, 0.0)), rung.frame())
        scene.connect(hinge, rung.frame(p=(1.0, 0.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0)))
        scene.connect(hinge, right, other.frame())
        left, right = rail.frame(p=(0.0, -1.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0))
    return scene


def modes(folder: Path, *, quick: bool) -> Iterator[Row]:
    for count in (8, 20) if quick else (6, 8, 12, 20, 35, 50, 75, 100):
        record = fm.ReducedBody.load(beam("5k", count, folder=folder).plain)
        leaf = step_time(partial(_flexible, record), CLASSICAL, h=1e-5)
        parent = step_time(partial(_with_child, record), CLASSICAL, h=1e-5)
        implicit = step_time(partial(_flexible, record), fm.GeneralizedAlpha())
        text = f"RK4 {leaf:.1f}, with a child {parent:.1f} ({parent / leaf:.2f} times)"
        yield "modes", str(count), f"{text}; generalized-alpha {implicit:.1f}"


def _rigid(links: int) -> fm.System:
    return scenes.rigid_chain(links)[0]


def _flexible(record: fm.ReducedBody) -> fm.System:
    return scenes.flexible_chain(record, 1)[0]


def _with_child(record: fm.ReducedBody) -> fm.System:
    """The pendulum with a rigid body hinged to its end."""
    scene, end = scenes.flexible_chain(record, 1)
    child = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01), (0.1, 0.0, 0.0)), name="child")
    scene.connect(fm.joint.Revolute("y"), end, child.frame())
    return scene


def mesh(folder: Path, meshes: Path | None, *, quick: bool) -> Iterator[Row]:
    first = None
    for size in ("5k",) if quick else ("5k", "19k", "63k"):
        files = beam(size, 20, folder=folder, meshes=meshes)
        record = fm.ReducedBody.load(files.plain)
        ours = step_time(partial(_flexible, record), fm.GeneralizedAlpha())
        first = first or ours
        text = f"generalized-alpha {ours:.1f}; by that of the first mesh {ours / first:.3f}"
        if PEER:
            import scenes_exudyn as peer

            for name, way in (("node", "flexible chain"), ("averaged", "averaged flexible chain")):
                scene = scenes.Scene("", way, 1.0, 1.0, partial(scenes.flexible_chain, record, 1), None, 1, files)
                seconds = min(peer.solve(peer.build(scene), peer.ALPHA, 0.1, h=H)[0] for _ in range(2))
                theirs = seconds / 100.0 * 1e6
                text += f"; exudyn, {name}: {theirs:.0f} ({theirs / ours:.1f} times)"
        yield "mesh", size, text


CODE = """
import sys; sys.path.insert(0, {folder!r})
import scenes
import flexmbd as fm
scenes.rigid_chain(10)[0].simulate(1e-3, h=1e-3, integrator={method})
"""


def start() -> Iterator[Row]:
    here = str(Path(__file__).resolve().parent)
    for method in ("fm.GeneralizedAlpha()", "fm.ExplicitRungeKutta()"):
        seconds = []
        for _ in range(4):
            began = time.perf_counter()
            subprocess.run([sys.executable, "-c", CODE.format(folder=here, method=method)], check=True)
            seconds.append(time.perf_counter() - began)
        text = f"{min(seconds[1:]):.2f} s, python and its libraries included; the first time {seconds[0]:.2f} s"
        yield "start", method.removeprefix("fm."), text


if __name__ == "__main__":
    sys.exit(main())
