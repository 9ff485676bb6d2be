"""Error against wall time of our integrators and exudyn's, scene by scene.

    ./run python benchmarks/work_precision.py --quick     # three scenes, about a minute: does it work?
    ./run python benchmarks/work_precision.py             # all scenes; on a core that does nothing else
    ./run python benchmarks/work_precision.py --scene pendulum     # those with the word in their names
    ./run python benchmarks/work_precision.py --meshes FOLDER      # the beam from given meshes, *_5k_*.npz
    ./run python benchmarks/work_precision.py --redraw    # table and picture of the last results
    ./run pip install -e .[benchmark]                     # exudyn, without which its rows are left out

The error is the distance of one point at the end from where a converged solution puts it, over the scene's size.
Ours is measured against a known solution or our own converged one, exudyn's against its own converged one, for its
reduced bodies obey slightly other equations; that the two agree to what that allows is checked. Times are processor
time, the least of some runs in this one process; compiling, or loading what is compiled, comes before them and is
printed. "Solve" is the stepping alone: ours from a consistent start to the last step, exudyn's its SolveDynamic, which
finds the start as well. "Whole" is all from the built model to the result: ours `simulate`, exudyn's Assemble and
SolveDynamic. Ours run on a ladder of rtol, exudyn's on a ladder of steps, or of rtol where a solver has error control;
every solver it has for a scene is tried, in the formulation that is fastest there.

Writes results.json, work_precision.csv, a table and a picture into out_work_precision.
"""

from __future__ import annotations

import argparse
import csv
import importlib.util
import json
import sys
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scenes
import work_precision_picture as picture
from benchmark import Report
from scenes import METHODS, Method, Scene

import flexmbd as fm
from flexmbd.integrate import state as st
from flexmbd.multibody.team import Alone
from flexmbd.run.snapshot import new_snapshot
from flexmbd.run.stepping import Integration

HERE = Path(__file__).resolve().parent
PEER = importlib.util.find_spec("exudyn") is not None
MINUTES = 25.0
PEERS: tuple[str, ...] = ("exudyn",)
TARGET = 1e-6  # the relative error at which times are compared
ENOUGH = 3e-8  # where a ladder ends

Row = dict[str, Any]


def main() -> int:
    arguments = _arguments()
    arguments.output.mkdir(parents=True, exist_ok=True)
    file = arguments.output / "results.json"
    faults: list[str] = []
    if not arguments.redraw:
        faults = _measure_all(_scenes(arguments), file, patience=0.5 if arguments.quick else 0.8)
    rows = json.loads(file.read_text())
    print("\n" + _table(rows) + "\n")
    _tell(rows, Report(arguments.output))
    print("\n".join(faults) or "all converged solutions agree")
    return 1 if faults else 0


def quick(report: Report) -> None:
    """The chain of ten alone."""
    _whole(report, scenes.rigid_scenes(quick=True)[:1], patience=0.02)


def full(report: Report) -> None:
    """All scenes."""
    flexible = scenes.flexible_scenes(quick=False, folder=report.folder, meshes=None)
    _whole(report, [*scenes.rigid_scenes(quick=False), *flexible], patience=0.8)


def _whole(report: Report, some: Sequence[Scene], *, patience: float) -> None:
    file = report.folder / "results.json"
    faults = _measure_all(some, file, patience=patience)
    _tell(json.loads(file.read_text()), report)
    if faults:
        raise SystemExit("; ".join(faults))


def _measure_all(some: Sequence[Scene], file: Path, *, patience: float) -> list[str]:
    """Measure scenes into a file, scene by scene; which of their solutions disagree."""
    faults: list[str] = []
    rows: list[Row] = []
    for scene in some:
        rows += _measure(scene, faults, patience=patience)
        file.write_text(json.dumps(rows, indent=1))
    return faults


def _tell(rows: list[Row], report: Report) -> None:
    """Times to the target, as a table and a picture; all points as CSV."""
    _write_csv(rows, report.folder / "work_precision.csv")
    report.say("\n".join(_claims(rows)))
    for scene in dict.fromkeys(row["scene"] for row in rows):
        (_, *ours), (peer, *theirs) = (_best(rows, scene, code) for code in ("flexmbd", "exudyn"))
        for what, our, their in zip(("stepping", "start and stepping"), ours, theirs, strict=True):
            report.beside(scene, task=f"{what} to {TARGET:.0e}", peer=f"exudyn, {peer}", theirs=their, ours=our)
    report.picture("work_precision.png", partial(picture.draw, rows))


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="few scenes, short ladders")
    parser.add_argument("--scene", help="only scenes with this in their names")
    parser.add_argument("--meshes", type=Path, metavar="FOLDER", help="of the beam's meshes")
    parser.add_argument("--output", type=Path, default=Path("out_work_precision"), metavar="FOLDER")
    parser.add_argument("--redraw", action="store_true", help="nothing measured")
    return parser.parse_args()


def _scenes(arguments: argparse.Namespace) -> list[Scene]:
    quick = arguments.quick
    found = scenes.rigid_scenes(quick=quick)
    found += scenes.flexible_scenes(quick=quick, folder=arguments.output, meshes=arguments.meshes)
    return [scene for scene in found if not arguments.scene or arguments.scene in scene.name]


def _measure(scene: Scene, faults: list[str], *, patience: float) -> list[Row]:
    """All rows of a scene, printed as they come."""
    reference, doubt = _converged(scene, patience=patience)
    print(f"\n{scene.name}: our solution {reference}, certain to {doubt:.1e} of {scene.size} m", flush=True)
    rows = [row for method in METHODS for row in _ours(scene, method, reference, patience=patience)]
    if PEER:
        rows += _peers(scene, reference, faults, patience=patience)
    # an error that its reference is not certain enough to tell is none
    for row in rows:
        row["error"] = max(row["error"], doubt if row["code"] == "flexmbd" else row["doubt"])
    return rows


def _converged(scene: Scene, *, patience: float) -> tuple[np.ndarray, float]:
    """Where the point ends, and how certain that is: a known solution, or two tolerances of the tightest method."""
    if scene.exact is not None:
        return np.array(scene.exact), 1e-11
    best = next((method for method in METHODS if method.tight), METHODS[0])
    ends: list[np.ndarray] = []
    for rtol in 10.0 ** -np.arange(4.0, 12.0):
        run = _run(scene, best, rtol)
        if run is None:
            break
        ends.append(run.end)
        if run.whole > 2.0 * patience:
            break
    return ends[-1], scenes.error(scene, ends[-2], ends[-1])


class Run(NamedTuple):
    """Seconds of the stepping and of all; where the point ends; the statistics."""

    solve: float
    whole: float
    end: np.ndarray
    stats: fm.Stats


def _run(scene: Scene, method: Method, rtol: float) -> Run | None:
    """One simulation, None where it failed; its stepping is repeated apart to be timed."""
    machine, point = scene.build()
    integrator = method.make()
    try:
        began = time.process_time()
        run = machine.simulate(scene.t_end, rtol=rtol, integrator=integrator)
        whole = time.process_time() - began
    except fm.FlexmbdError as reason:
        print(f"{scene.name}, {method.label}, rtol {rtol:.0e}: {reason}", flush=True)
        return None
    end = run.position(point)[-1]
    if whole > 1.0:  # the start counts for nothing
        return Run(whole, whole, end, run.stats)
    start = machine.start()
    snapshot = new_snapshot(start, integrator, t_start=0.0, t_end=scene.t_end, rtol=rtol, h=None)
    integration = Integration(start, integrator, Alone(), snapshot, one_by_one=False)
    code = st.OUTPUT
    began = time.process_time()
    while code == st.OUTPUT:
        code = integration.advance(scene.t_end)
        integration.keep_rows()
    return Run(time.process_time() - began, whole, end, run.stats)


def _ours(scene: Scene, method: Method, reference: np.ndarray, *, patience: float) -> Iterator[Row]:
    warm = _run(scene, method, 1e-4)
    if warm is not None:
        print(f"{scene.name}, {method.label}: {warm.stats.compile_seconds:.2f} s to compile or load", flush=True)
    for rtol in 10.0 ** -np.arange(3.0, 12.5, 0.5):
        first = _run(scene, method, rtol)
        if first is None:
            continue
        again = [_run(scene, method, rtol) for _ in range(_repeats(first.whole))]
        done = [first, *(run for run in again if run is not None)]
        solve, whole = min(run.solve for run in done), min(run.whole for run in done)
        steps = first.stats.steps + first.stats.rejected
        error = scenes.error(scene, first.end, reference)
        yield _row(scene, "flexmbd", method.label, (solve, whole), error, rtol, steps)
        if whole > patience or error < ENOUGH:
            return


def _repeats(seconds: float) -> int:
    """How often a run is repeated so that other processes do not show in the least of its times."""
    return 9 if seconds < 0.05 else 2 if seconds < 0.5 else 0


def _peers(scene: Scene, ours: np.ndarray, faults: list[str], *, patience: float) -> list[Row]:
    import scenes_exudyn as peer

    raw = []
    # without a known solution the finest are wanted to extrapolate from
    goal = ours if scene.exact is not None else np.full(3, np.inf)
    for solver in peer.SOLVERS[scene.kind]:
        last = 8.0 * patience if scene.exact is None and solver is peer.ALPHA else patience
        ladder = 10.0 ** -np.arange(3.0, 12.0) if solver.by_tolerance else scene.t_end / 100.0 * 0.5 ** np.arange(16)
        for size in ladder:
            step = {"h": scene.t_end / 20.0, "rtol": size} if solver.by_tolerance else {"h": size}
            tries = [peer.assemble_and_solve(peer.build(scene), solver, scene.t_end, **step)]
            for _ in range(_repeats(tries[0][1])):
                tries.append(peer.assemble_and_solve(peer.build(scene), solver, scene.t_end, **step))
            found = tries[0][2]
            solve, whole = (min(one[k] for one in tries) for k in range(2))
            if found is not None:
                raw.append((solver, size, (solve, whole), found))
            if whole > last or (found is not None and scenes.error(scene, found, goal) < ENOUGH):
                break
    limit, doubt = _extrapolated(scene, [one for one in raw if one[0] is peer.ALPHA])
    apart = float(np.linalg.norm(limit - ours))
    print(f"{scene.name}: exudyn's solution {limit}, certain to {doubt:.1e}, {apart:.1e} m from ours", flush=True)
    nearest = np.nanmin([apart, *(np.linalg.norm(found - ours) for *_, found in raw)])
    if not nearest <= scene.agreement:
        faults.append(f"{scene.name}: exudyn comes to {nearest:.1e} m of ours, not {scene.agreement:.0e}")
    reference, doubt = (limit, doubt) if scene.exact is None else (ours, 1e-11)
    rows = []
    for solver, size, seconds, found in raw:
        row = _row(scene, "exudyn", solver.label, seconds, scenes.error(scene, found, reference), size, 0)
        row["doubt"] = doubt
        rows.append(row)
    return rows


def _extrapolated(
    scene: Scene, series: Sequence[tuple[Any, float, tuple[float, float], np.ndarray]]
) -> tuple[np.ndarray, float]:
    """From the three smallest steps of a method of order 2, and by how much the last pair disagrees with that."""
    if len(series) < 3:
        return np.full(3, np.nan), np.inf
    rough, middle, fine = (found for *_, found in series[-3:])
    last = fine + (fine - middle) / 3.0
    before = middle + (middle - rough) / 3.0
    return last, scenes.error(scene, before, last)


def _row(
    scene: Scene, code: str, label: str, seconds: tuple[float, float], error: float, setting: float, steps: int
) -> Row:
    row = {"scene": scene.name, "code": code, "method": label, "solve": seconds[0], "whole": seconds[1]}
    row |= {"error": error, "setting": float(setting), "steps": steps, "doubt": 0.0}
    print(_line(row), flush=True)
    return row


HEAD = "| scene | code | method | rtol or h | error | solve, s | whole, s | steps |\n|---|---|---|---|---|---|---|---|"


def _line(row: Row) -> str:
    values = " | ".join(f"{row[key]:.1e}" for key in ("setting", "error", "solve", "whole"))
    return f"| {row['scene']} | {row['code']} | {row['method']} | {values} | {row['steps'] or ''} |"


def _table(rows: Sequence[Row]) -> str:
    return "\n".join([HEAD, *map(_line, rows)])


def _write_csv(rows: Sequence[Row], path: Path) -> None:
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _claims(rows: Sequence[Row]) -> Iterator[str]:
    """Ours over exudyn's times to the target, each by its best method."""
    times = "solve, ms | whole, ms"
    yield f"| scene, to {TARGET:.0e} | flexmbd | {times} | exudyn | {times} | times, solve | whole |"
    yield "|---|---|---|---|---|---|---|---|---|"
    for scene in dict.fromkeys(row["scene"] for row in rows):
        cells = [_best(rows, scene, code) for code in ("flexmbd", "exudyn")]
        said = " | ".join(" | ".join([label, *(_number(1e3 * one, ".3g") for one in times)]) for label, *times in cells)
        (_, *ours), (_, *theirs) = cells
        ratios = (_number(their / our, ".1f") for our, their in zip(ours, theirs, strict=True))
        yield f"| {scene} | {said} | {' | '.join(ratios)} |"


def _number(value: float, form: str) -> str:
    return "" if np.isnan(value) else format(value, form)


def _best(rows: Sequence[Row], scene: str, code: str) -> tuple[str, float, float]:
    """The method that reaches the target first, and its times; where none does, which came how near, in how long."""
    mine = [row for row in rows if (row["scene"], row["code"]) == (scene, code)]
    found = []
    for label in dict.fromkeys(row["method"] for row in mine):
        series = [row for row in mine if row["method"] == label]
        solve, whole = (time_to(TARGET, [(row["error"], row[kind]) for row in series]) for kind in ("solve", "whole"))
        if solve is not None and whole is not None:
            found.append((label, solve, whole))
    if found:
        return min(found, key=lambda one: one[1])
    nearest = min(mine, key=lambda row: row["error"])
    return f"none ({nearest['method']}: {nearest['error']:.0e} in {nearest['solve']:.2g} s)", np.nan, np.nan


def time_to(target: float, points: Sequence[tuple[float, float]]) -> float | None:
    """Seconds to an error: least time of a point that is as good, or between it and a worse one by logarithms.

    A point that happens to be good on the way, where the curve is not monotone yet, does not count: all later ones
    must be good too. Where no point is good enough, the last two carry on by their slope, up to a decade, unless
    the error falls more slowly than the time grows: that is no convergence of any order.
    """
    ladder = sorted(points, key=lambda point: point[1])
    good = [all(error <= target for error, _ in ladder[k:]) for k in range(len(ladder))]
    if len(ladder) < 2:
        return ladder[0][1] if any(good) else None
    k = good.index(True) if any(good) else len(ladder) - 1
    if k == 0:
        return ladder[0][1]
    (worse, quick), (better, slow) = ladder[k - 1], ladder[k]
    if not any(good) and (better > 10.0 * target or better * slow > worse * quick):
        return None
    share = (np.log(target) - np.log(worse)) / (np.log(better) - np.log(worse))
    return float(np.exp(np.log(quick) + share * (np.log(slow) - np.log(quick))))


if __name__ == "__main__":
    sys.exit(main())
