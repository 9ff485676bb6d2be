"""The automatic choice against the best method: time to the error that the chosen one leaves.

Each scene runs by all methods over tolerances. At each rtol the chosen method leaves an error of
the point in some time; the least time in which any method, at any tolerance, comes as near is the best. Written are
both and their ratio. Times are processor times of whole runs, the least of several.

    ./run python benchmarks/choice.py [--only NAME ...] [--meshes FOLDER]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scenes
from benchmark import Report

import flexmbd as fm
from flexmbd.integrate.protocol import Integrator

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
MINUTES = 6.0
PEERS: tuple[str, ...] = ()
FOLDER = Path("out_simulation")
CHOSEN = (1e-3, 1e-4, 1e-6, 1e-8)
LONGEST = 2.0  # s, beyond which a method's tighter runs are left out
RUNS = 3
METHODS: dict[str, Integrator] = {
    "5(4)": fm.ExplicitRungeKutta(),
    "8(5,3)": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
    "Radau IIA": fm.RadauIIA(),
    "generalized-alpha": fm.GeneralizedAlpha(),
    "central differences": fm.CentralDifference(),
}


@dataclass(frozen=True)
class Run:
    """A method at a tolerance: s, and m that the point is off."""

    method: str
    rtol: float
    time: float
    error: float


def runs(scene: scenes.Scene) -> list[Run]:
    """By all methods at all tolerances."""
    system, point = scene.build()
    if scene.exact is None:
        exact = system.simulate(scene.t_end, rtol=1e-12, integrator=METHODS["8(5,3)"]).position(point)[-1]
    else:
        exact = np.array(scene.exact)
    found = []
    for name, method in METHODS.items():
        for rtol in TOLERANCES:
            spent: list[float] = []
            run = None
            for _ in range(RUNS):
                began = time.process_time()
                try:
                    run = system.simulate(scene.t_end, rtol=rtol, integrator=method)
                except fm.FlexmbdError:
                    break
                spent.append(time.process_time() - began)
                if spent[0] > 0.5:
                    break
            if run is None or not spent:
                break
            error = float(np.linalg.norm(run.position(point)[-1] - exact))
            found.append(Run(name, rtol, min(spent), error))
            if min(spent) > LONGEST:
                break
    return found


def table(scene: scenes.Scene) -> str:
    """Markdown lines of a scene."""
    found = runs(scene)
    system, _ = scene.build()
    lines = []
    for rtol in CHOSEN:
        said = system.explain(rtol=rtol).splitlines()[-1].removeprefix("integrator: ")
        names = {method.name: name for name, method in METHODS.items()}
        chosen = next(name for long, name in names.items() if said.startswith(long))
        own = next((one for one in found if one.method == chosen and one.rtol == rtol), None)
        if own is None:
            continue
        best = min((one for one in found if one.error <= own.error), key=lambda one: one.time)
        lines.append(
            f"| {scene.name} | {rtol:.0e} | {chosen} | {1e3 * own.time:.1f} | {own.error:.0e} | {best.method}, "
            f"{best.rtol:.0e} | {1e3 * best.time:.1f} | {own.time / best.time:.2f} |"
        )
    return "\n".join(lines)


def plain_scenes(folder: Path, meshes: Path | None) -> list[scenes.Scene]:
    """The flexible scenes with records that do not stiffen, whose vibrations are slower."""
    found = []
    for scene in scenes.flexible_scenes(quick=False, folder=folder, meshes=meshes):
        files = scene.beam
        assert files is not None
        record = fm.ReducedBody.load(files.plain)
        build = {
            "flexible chain": lambda record=record, n=scene.parameter: scenes.flexible_chain(record, n),
            "spin-up": lambda record=record: scenes.spin_up(record),
            "slider-crank": lambda record=record: scenes.slider_crank(record),
        }[scene.kind]
        found.append(scenes.Scene(f"{scene.name}, plain", scene.kind, scene.t_end, scene.size, build))
    return found


def quick(report: Report) -> None:
    """A chain of ten alone."""
    measure(report, scenes.rigid_scenes(quick=True)[:1])


def full(report: Report) -> None:
    """All scenes, by records with membrane strains and without."""
    measure(report, all_scenes(FOLDER, None))


def measure(report: Report, every: list[scenes.Scene]) -> None:
    """The table of some scenes."""
    report.table("scene", "rtol", "chosen", "ms", "error m", "best", "ms", "ratio")
    for scene in every:
        report.say(table(scene))


def all_scenes(folder: Path, meshes: Path | None) -> list[scenes.Scene]:
    """Rigid ones, flexible ones, and these with plain records."""
    flexible = scenes.flexible_scenes(quick=False, folder=folder, meshes=meshes)
    return [*scenes.rigid_scenes(quick=False), *plain_scenes(folder, meshes), *flexible]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, help="a folder of .npz files of `points` and `tet10`")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of the records")
    parser.add_argument("--only", nargs="*", default=[], help="parts of names")
    asked = parser.parse_args()
    every = all_scenes(asked.folder, asked.meshes)
    some = [scene for scene in every if not asked.only or any(part in scene.name for part in asked.only)]
    measure(Report(asked.folder), some)


if __name__ == "__main__":
    main()
