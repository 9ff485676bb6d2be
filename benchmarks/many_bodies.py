"""Machines of many bodies: lattices of masses on springs, ladders, chains, pendulums, clusters; beside exudyn.

    ./run python benchmarks/many_bodies.py [--quick] [--only lattice ladder] [--limit 2000] [--seconds 60]

`statics`: a lattice of nx x ny point masses on springs sags between two walls; its equilibrium, by exudyn in as few
steps of the load as balance every node to 1e-6 N.  `lattice`, `ladder`, `chain`, `pendulums`, `stars`: motions, each by
several methods, with the loosest tolerance, or by exudyn the longest step, that keeps the compared point within the
scene's error of a run with a tolerance of 1e-10 (1e-8 of Radau IIA).  `start`: loops closed at the start.  `compile`: a
lattice built and compiled.

Each measurement is a process of its own, in turns, which first runs the scene's smallest size, so that kernels are
loaded; told are processor times of the whole run from a built machine to its end (here it compiles, starts and steps;
there it assembles and steps), medians, and the process' peak of memory.  ``--limit`` leaves out what has more unknowns
by the methods that solve for all of them at once, ``--seconds`` ends a measurement that takes longer; its method
is then left out at larger sizes.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import many_scenes
import numpy as np
from benchmark import Report

import flexmbd as fm

MINUTES = 30.0
PEERS: tuple[str, ...] = ("exudyn",)
FOLDER = Path("out_simulation")

Size = tuple[int, ...]

OWN = {
    "alpha": fm.GeneralizedAlpha,
    "radau": fm.RadauIIA,
    "explicit": fm.ExplicitRungeKutta,
    "central": fm.CentralDifference,
}
IMPLICIT = ("alpha", "radau", "statics")
NAMES = {
    "alpha": "generalized-alpha", "radau": "Radau IIA", "explicit": "explicit Runge-Kutta", "auto": "automatic choice",
    "exudyn": "exudyn generalized-alpha, sparse", "exudyn RK": "exudyn RK44", "statics": "equilibrium",
    "exudyn statics": "exudyn, sparse", "start": "start", "compile": "build and compile",
}  # fmt: skip


@dataclass(frozen=True)
class Scene:
    """A machine of many bodies.

    Attributes:
        sizes: all that are measured; the first is the small one.
        build: here, and where the point is that is compared.
        there: in exudyn.
        unknowns: by a size.
        end: s of the motion.
        error: m, of the point at the end; of statics N, the largest force that is left; 0: nothing is compared.
        methods: here and, by names that begin so, in exudyn.
        point: the place that is compared, in exudyn's body.
        which: numbers of the frame here and of the body there that are compared, of lattices the middle one's.
    """

    sizes: tuple[Size, ...]
    build: Callable[..., Any]
    there: Callable[..., Any] | None
    unknowns: Callable[..., int]
    end: float = 0.0
    error: float = 0.0
    methods: tuple[str, ...] = ()
    point: tuple[float, float, float] = field(default=(0.0, 0.0, 0.0))
    which: tuple[int, int] = (-1, -1)


_HALF = (0.5 * many_scenes.LINK, 0.0, 0.0)
SCENES = {
    "statics": Scene(
        ((36, 4), (72, 6), (72, 24), (300, 100)), many_scenes.lattice, many_scenes.exudyn_lattice,
        lambda nx, ny: 2 * nx * ny, error=1e-6, methods=("statics", "exudyn statics"),
    ),
    "lattice": Scene(
        ((36, 4), (72, 6), (72, 24), (300, 100)), many_scenes.lattice, many_scenes.exudyn_lattice,
        lambda nx, ny: 2 * nx * ny, 0.5, 1e-5, ("alpha", "radau", "explicit", "exudyn", "exudyn RK"),
    ),
    "ladder": Scene(
        ((3,), (10,), (30,), (100,), (300,), (1000,)), many_scenes.ladder, many_scenes.exudyn_ladder,
        lambda n: 5 * n, 0.5, 1e-5, ("alpha", "radau", "exudyn"), (0.5 * many_scenes.RUNG, 0.0, 0.0), (0, 2),
    ),
    "chain": Scene(
        ((10,), (300,), (3000,)), many_scenes.chain, many_scenes.exudyn_chain, lambda n: n, 0.3, 1e-5,
        ("alpha", "radau", "explicit", "exudyn"), _HALF,
    ),
    "pendulums": Scene(
        ((100,), (1000,), (10000,)), many_scenes.pendulums, many_scenes.exudyn_pendulums, lambda n: n, 1.0, 1e-5,
        ("alpha", "radau", "explicit", "exudyn"), _HALF,
    ),
    "stars": Scene(
        ((3,), (10,), (100,), (1000,)), many_scenes.stars, many_scenes.exudyn_stars, lambda n: 3 * n, 1.0, 1e-6,
        ("explicit", "radau", "exudyn", "exudyn RK"),
    ),
    "start": Scene(((10,), (200,)), many_scenes.four_bars, None, lambda n: 3 * n, methods=("start",)),
    "compile": Scene(
        ((12, 4), (72, 24), (300, 100)), many_scenes.lattice, None, lambda nx, ny: 2 * nx * ny, methods=("compile",)
    ),
}  # fmt: skip


# -- one measurement, in a process of its own --------------------------------------------------------------------------


def measured(name: str, size: Size, method: str, value: float) -> dict[str, Any]:
    """Processor time (s), the compared point (m) and the peak of memory (MB) of one run."""
    scene = SCENES[name]
    run = _theirs if method.startswith("exudyn") else _own
    run(scene, scene.sizes[0], method, value)
    seconds, point, further = run(scene, size, method, value)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    return {"seconds": seconds, "point": None if point is None else list(map(float, point)), "peak": peak, **further}


def _own(scene: Scene, size: Size, method: str, value: float) -> tuple[float, Any, dict[str, Any]]:
    """``value``: rtol of a motion."""
    began = time.process_time()
    if method == "compile":
        scene.build(*size)[0].compile()
        return time.process_time() - began, None, {}
    made = scene.build(*size)
    system, frames = (made, []) if isinstance(made, fm.System) else made
    began = time.process_time()
    if method == "start":
        system.start()
        return time.process_time() - began, None, {}
    if method == "statics":
        point = system.equilibrium()
        took = time.process_time() - began
        places = np.array([point.position(frame)[:2] for frame in frames])
        return took, None, {"error": many_scenes.unbalanced(places, *size)}
    chosen = "auto" if method == "auto" else OWN[method]()
    run = system.simulate(scene.end, rtol=value, integrator=chosen)
    frame = frames[_middle(size) if len(size) > 1 else scene.which[0]]
    return time.process_time() - began, run.position(frame)[-1], {"steps": run.stats.steps}


def _middle(size: Size) -> int:
    """The number of a lattice's middle node."""
    return size[0] // 2 * size[1] + size[1] // 2


def _theirs(scene: Scene, size: Size, method: str, value: float) -> tuple[float, Any, dict[str, Any]]:
    """``value``: how many steps, of a motion or of the load."""
    exudyn, _ = many_scenes.modules()
    if scene.there is None:
        raise ValueError(f"{method} does not have this scene")
    system = scene.there(*size)
    settings = exudyn.SimulationSettings()
    settings.linearSolver.solverType = exudyn.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.show.statistics = False
    settings.staticSolver.verboseMode = settings.timeIntegration.verboseMode = 0
    settings.staticSolver.numberOfLoadSteps = max(1, int(value))
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = scene.end, max(1, int(value))
    settings.timeIntegration.newton.useModifiedNewton = True
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    kinds = exudyn.DynamicSolverType
    began = time.process_time()
    system.Assemble()
    if method == "exudyn statics":
        done = system.SolveStatic(settings)
    else:
        kind = kinds.RK44 if method == "exudyn RK" else kinds.GeneralizedAlpha
        done = system.SolveDynamic(settings, solverType=kind)
    seconds = time.process_time() - began
    if not done:
        raise RuntimeError(f"{method} failed")
    if method == "exudyn statics":
        moved = np.reshape(system.systemData.GetODE2Coordinates(), (-1, 2))
        drawn = np.array([(i, j) for i in range(size[0]) for j in range(size[1])], float)
        return seconds, None, {"error": many_scenes.unbalanced(drawn + moved, *size)}
    kinds_of = [system.GetObject(k)["objectType"] for k in range(system.systemData.NumberOfObjects())]
    bodies = [k for k, kind in enumerate(kinds_of) if "Mass" in kind or "Rigid" in kind]
    body = bodies[_middle(size) if len(size) > 1 else scene.which[1]]
    place = system.GetObjectOutputBody(body, exudyn.OutputVariableType.Position, localPosition=list(scene.point))
    return seconds, place, {"steps": int(value)}


# -- measurements in turns ---------------------------------------------------------------------------------------------


class TooLongError(Exception):
    """A measurement took longer than it may."""


def in_process(name: str, size: Size, method: str, value: float, seconds: float) -> dict[str, Any] | None:
    """`measured` in a process of its own; None where it fails.

    Raises:
        TooLongError: it takes longer than ``seconds``.
    """
    command = [sys.executable, __file__, "--one", name, "x".join(map(str, size)), method, repr(value)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=seconds)
    except subprocess.TimeoutExpired as reason:
        raise TooLongError from reason
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"seconds"')]
    return json.loads(lines[-1]) if done.returncode == 0 and lines else None


def values_of(method: str) -> Sequence[float]:
    """From loose to tight: tolerances here, numbers of steps there."""
    if method == "statics":
        return [0.0]
    if method == "exudyn statics":
        return [1.0, 2.0, 5.0, 10.0, 20.0, 50.0]
    if method.startswith("exudyn"):
        return [float(round(12.5 * 2.0**k)) for k in range(12)]
    return [10.0**-k for k in range(3, 11)]


def reference(name: str, size: Size, seconds: float) -> np.ndarray | None:
    """The point, by the tightest run that comes to its end."""
    for method, rtol in (("explicit", 1e-10), ("radau", 1e-8)):
        if method in SCENES[name].methods:
            try:
                found = in_process(name, size, method, rtol, 2.0 * seconds)
            except TooLongError:
                continue
            if found is not None:
                return np.array(found["point"])
    return None


def good_enough(
    name: str, size: Size, method: str, exact: np.ndarray | None, seconds: float
) -> tuple[float, float] | None:
    """The first value with which the error is small enough, and the error; None where none is.

    Raises:
        TooLongError: such a run takes longer than it may.
    """
    for value in values_of(method):
        found = in_process(name, size, method, value, seconds)
        if found is None:
            continue  # as with steps that are too long
        error = found.get("error", np.inf)
        if exact is not None:
            error = float(np.linalg.norm(np.array(found["point"]) - exact))
        if error <= SCENES[name].error:
            return value, error
    return None


def rows(
    report: Report, name: str, size: Size, *, turns: int, limit: int, seconds: float, leave: set[str]
) -> None:
    """The rows of a scene at a size, but of methods to ``leave``, to which those that take too long are added."""
    scene, taken = SCENES[name], {}
    moves = scene.end > 0.0
    methods = [m for m in scene.methods if m not in leave]
    methods = [m for m in methods if m not in IMPLICIT or scene.unknowns(*size) <= limit]
    exact = reference(name, size, seconds) if moves else None
    if moves and exact is None:
        report.say(f"{name} {'x'.join(map(str, size))}: no reference within the time")
        return
    for method in methods:
        try:
            found = good_enough(name, size, method, exact, seconds) if scene.error else (0.0, 0.0)
        except TooLongError:
            leave.add(method)
            cells = [name, " x ".join(map(str, size)), NAMES[method], f"more than {seconds:.0f}", "-", "-", "-"]
            report.say(f"| {' | '.join(cells)} |")
            continue
        if found is not None:
            taken[method] = found
    results: dict[str, list[dict[str, Any]]] = {method: [] for method in taken}
    for _ in range(turns):
        for method, (value, _) in taken.items():
            with suppress(TooLongError):
                result = in_process(name, size, method, value, 2.0 * seconds)
                results[method] += [] if result is None else [result]
    for method, several in results.items():
        if not several:
            continue
        times = np.array([one["seconds"] for one in several])
        told = f"{np.median(times):.3g} ({times.min():.3g} to {times.max():.3g})"
        cells = [name, " x ".join(map(str, size)), NAMES[method], told]
        cells.append(f"{max(one['peak'] for one in several):.0f}")
        cells.append(f"{several[0]['steps']}" if moves else "-")
        cells.append(f"{taken[method][1]:.0e}" if scene.error else "-")
        report.say(f"| {' | '.join(cells)} |")
    _compare(report, f"{name} of {' x '.join(map(str, size))}", scene, results)


def _compare(report: Report, what: str, scene: Scene, results: dict[str, list[dict[str, Any]]]) -> None:
    """Keep exudyn's best method beside the best one here, where both came to the error."""
    times = {method: [one["seconds"] for one in several] for method, several in results.items() if several}
    best = {
        is_theirs: min(methods, key=lambda method: np.median(times[method]))
        for is_theirs in (False, True)
        if (methods := [method for method in times if method.startswith("exudyn") == is_theirs])
    }
    if len(best) == 2:
        unit = "m" if scene.end else "N"
        task = f"from the built machine to its end, to {scene.error:.0e} {unit}"
        report.beside(what, task=task, peer=NAMES[best[True]], theirs=times[best[True]], ours=times[best[False]])


def table(report: Report) -> None:
    report.table("scene", "size", "method", "processor time (s)", "peak (MB)", "steps", "error (m; of statics N)")


def quick(report: Report) -> None:
    """The smallest sizes of some scenes, without exudyn."""
    table(report)
    for name in ("statics", "lattice", "start", "compile"):
        theirs = {method for method in SCENES[name].methods if method.startswith("exudyn")}
        rows(report, name, SCENES[name].sizes[0], turns=1, limit=2000, seconds=60.0, leave=theirs)


def full(report: Report) -> None:
    """All scenes and sizes."""
    measure(report, list(SCENES), turns=3, limit=10**9, seconds=20.0)


def measure(report: Report, names: Sequence[str], *, turns: int, limit: int, seconds: float) -> None:
    """All sizes of scenes, the small one apart; what takes too long at one is not tried at larger ones."""
    table(report)
    for name in names:
        leave: set[str] = set()
        for size in SCENES[name].sizes[1:]:
            rows(report, name, size, turns=turns, limit=limit, seconds=seconds, leave=leave)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small sizes, without exudyn")
    parser.add_argument("--only", nargs="+", choices=list(SCENES), default=list(SCENES), help="these scenes")
    parser.add_argument("--limit", type=int, default=10**9, help="most unknowns of methods that solve for all at once")
    parser.add_argument("--seconds", type=float, default=120.0, help="longest measurement")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--one", nargs=4, metavar=("SCENE", "SIZE", "METHOD", "VALUE"), help="one measurement, as JSON")
    given = parser.parse_args()
    if given.one:
        name, size, method, value = given.one
        print(json.dumps(measured(name, tuple(map(int, size.split("x"))), method, float(value))))
    elif given.quick:
        quick(Report(FOLDER))
    else:
        limits = {"turns": given.turns, "limit": given.limit, "seconds": given.seconds}
        measure(Report(FOLDER), given.only, **limits)


if __name__ == "__main__":
    main()
