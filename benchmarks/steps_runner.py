"""Runs small scenes by all methods and tells the processor time of their stepping: a process of `steps.py`.

It is asked by lines of JSON on its input, `null` for what there is to run, else a scene and a method; answers are lines
that begin with `ANSWER`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import beam_record
import scenes
from steps import ANSWER

import flexmbd as fm

if TYPE_CHECKING:
    from flexmbd.integrate.protocol import Integrator
try:
    from flexmbd.run.stepping import Integration
except ImportError:  # a checkout from before the rooms
    from flexmbd.stepping import Integration  # type: ignore[import-not-found,no-redef]

mechanisms = scenes.mechanisms  # type: ignore[attr-defined]

TURN = 0.1  # s of processor time that a turn takes at least


@dataclass(frozen=True)
class Case:
    """A scene, its length (s), a fixed step for implicit and one for explicit methods (s), and a tolerance."""

    name: str
    build: Callable[[], fm.System]
    t_end: float
    h: float
    explicit: float
    rtol: float = 1e-6

    def runs(self) -> dict[str, tuple[Integrator, dict[str, float]]]:
        """What is measured: the method and how it is called."""
        controlled = {"rtol": self.rtol}
        return {
            "5(4)": (fm.ExplicitRungeKutta(), controlled),
            "8(5,3)": (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), controlled),
            "central differences, h": (fm.CentralDifference(), {"h": self.explicit}),
            "Radau": (fm.RadauIIA(), controlled),
            "Radau, h": (fm.RadauIIA(), {"h": self.h}),
            "generalized-alpha": (fm.GeneralizedAlpha(), {"rtol": 1e-4}),
            "generalized-alpha, h": (fm.GeneralizedAlpha(), {"h": self.h}),
            "energy-momentum": (fm.EnergyMomentum(), {"rtol": 1e-4}),
            "energy-momentum, h": (fm.EnergyMomentum(), {"h": self.h}),
        }


def cases(folder: Path) -> list[Case]:
    """The scenes; the beam is reduced by the checkout that runs, once."""
    def beam() -> fm.ReducedBody:
        return fm.ReducedBody.load(beam_record.beam("5k", 20, folder=folder).plain)

    return [
        Case("1 rigid link", partial(_chain, 1), 10.0, 1e-3, 2e-4),  # long: what a call costs is not a step's
        Case("4 rigid links", partial(_chain, 4), 3.0, 1e-3, 2e-4),
        Case("20 rigid links", partial(_chain, 20), 0.5, 1e-3, 2e-4),
        Case("heavy top", lambda: scenes.heavy_top()[0], 2.0, 1e-3, 2e-4),
        Case("four-bar", lambda: mechanisms.four_bars(1).scene, 3.0, 1e-3, 2e-4),
        Case("slider-crank, rigid", lambda: mechanisms.slider_crank(0.3, 1.0, speed=10.0).scene, 3.0, 1e-3, 2e-4),
        Case("pendulum, 20 modes", lambda: scenes.flexible_chain(beam(), 1)[0], 0.2, 1e-3, 1e-4, 1e-4),
        Case("slider-crank, 20 modes", lambda: scenes.slider_crank(beam())[0], 0.2, 1e-3, 1e-4, 1e-4),
    ]


def _chain(links: int) -> fm.System:
    return scenes.rigid_chain(links)[0]


def stepping(system: fm.System, case: Case, method: Integrator, how: dict[str, float]) -> tuple[float, int, int]:
    """One run: processor time of its stepping alone (s), steps, iterations of Newton or evaluations of forces."""
    spent = 0.0
    advance = Integration.advance

    def timed(self: Integration, t_end: float) -> int:
        nonlocal spent
        began = time.process_time()
        try:
            return advance(self, t_end)
        finally:
            spent += time.process_time() - began

    Integration.advance = timed  # type: ignore[method-assign]
    try:
        # compiled anew: an unchanged scene that runs again is stepped by its prepared run, without `Integration`
        stats = system.compile().simulate(case.t_end, integrator=method, **how).stats  # type: ignore[arg-type]
    finally:
        Integration.advance = advance  # type: ignore[method-assign]
    return spent, stats.steps + stats.rejected, stats.iterations or stats.evaluations


def turn(system: fm.System, case: Case, name: str) -> tuple[float, int, int] | None:
    """The run that took least; None where the method stops."""
    method, how = case.runs()[name]
    began = time.process_time()
    rows: list[tuple[float, int, int]] = []
    try:
        while not rows or time.process_time() - began < TURN:
            rows.append(stepping(system, case, method, how))
    except fm.FlexmbdError as reason:
        sys.stderr.write(f"{case.name}, {name}: {reason}\n")
        return None
    return min(rows)


def serve(folder: Path, core: int) -> None:
    """Answer each line of the input until there is no more."""
    built: dict[str, fm.System] = {}
    known = {case.name: case for case in cases(folder)}
    os.sched_setaffinity(0, {core})
    for line in sys.stdin:
        asked = json.loads(line)
        if asked is None:
            answer: object = [(case.name, method) for case in known.values() for method in case.runs()]
        else:
            name, method = asked
            if name not in built:
                built[name] = known[name].build()
            answer = turn(built[name], known[name], method)
        print(ANSWER + json.dumps(answer), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of the beam's record")
    parser.add_argument("core", type=int)
    chosen = parser.parse_args()
    serve(chosen.folder, chosen.core)


if __name__ == "__main__":
    main()
