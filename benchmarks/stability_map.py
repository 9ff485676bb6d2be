"""Where each integrator is stable and how exact it is there: maps over many decades.

    ./run python benchmarks/stability_map.py --quick     # a corner of each map
    ./run python benchmarks/stability_map.py             # whole maps, about two minutes

A row of a map is an integrator, a column a value; its colour is the error of one point at the end over the scene's
size, against differential equations that scipy solves.  "stopped": the run ended with an error that says where and
why.  "long": it was broken off after 300 000 steps.  "lost": it went on, and the error is larger than the scene.
"refused": the method does not take the scene.

    step times frequency  an elastic pendulum by steps of 0.01 s: the swing is resolved, the stretch vibrates with
                          10^-1 to 10^5 rad a step
    stiffness             a flyball governor by rtol = 1e-6: springs and dampers 10^-3 to 10 times the usual ones
    mass ratio            a double pendulum by rtol = 1e-6: the lower mass 10^-8 to 10^8 times the upper one
    redundant rows        a row of four-bars by rtol = 1e-6: each window beyond the first closes with rows that depend
                          on the others', through positions where the rows lose rank besides
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from benchmark import Report
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from scenes import METHODS, G, Method
from scipy.integrate import solve_ivp

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))
import mechanisms

import flexmbd as fm

MINUTES = 3.0
TIMED = False  # errors alone
PEERS: tuple[str, ...] = ()
STEP, RTOL = 0.01, 1e-6  # s, and of the runs that control their error
BEST, WORST = 1e-12, 1.0  # the ends of the colours
MOST = 300_000  # steps
STOPPED, LONG, LOST, REFUSED = "stopped", "long", "lost", "refused"

Cell = float | str


@dataclass(frozen=True)
class Map:
    """A map: its name, what its columns are, their values, and the error of a method at a value."""

    name: str
    across: str
    values: Sequence[float]
    error: Callable[[float, Method], float]


@cache
def _swung(stiffness: float) -> np.ndarray:
    """m, (2,): where the elastic pendulum is after 1 s.

    A stiff spring hardly vibrates: it has the length at which it bears the weight and the turning, to the square of
    its compliance (200 m over the square of its stiffness: 2e-12 m from where this is used).
    """

    def free(_: float, y: np.ndarray) -> np.ndarray:
        r = np.hypot(y[0], y[1])
        pull = -stiffness * (r - 1.0) * y[:2] / r
        return np.concatenate([y[2:], pull - [0.0, G]])

    def borne(_: float, y: np.ndarray) -> list[float]:
        angle, turning = y
        r = 1.0 + (G * np.cos(angle) + turning**2) / stiffness
        # r' = turning (-G sin + 2 turning') / k, in the angle's own equation
        share = 2.0 * turning**2 / (stiffness * r)
        return [turning, G * np.sin(angle) * (share - 1.0 / r) / (1.0 + 2.0 * share)]

    if stiffness < 5e6:
        length = 1.0 + G * np.cos(1.0) / stiffness
        start = [length * np.sin(1.0), -length * np.cos(1.0), 0.0, 0.0]
        return solve_ivp(free, (0.0, 1.0), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:2, -1]
    angle, turning = solve_ivp(borne, (0.0, 1.0), [1.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return (1.0 + (G * np.cos(angle) + turning**2) / stiffness) * np.array([np.sin(angle), -np.cos(angle)])


def elastic_pendulum(per_step: float, method: Method) -> float:
    """A mass of 1 kg on a spring of 1 m, released at 1 rad with the spring's force in balance; after 1 s (m)."""
    stiffness = (per_step / STEP) ** 2
    exact = _swung(stiffness)
    length = 1.0 + G * np.cos(1.0) / stiffness
    start = np.array([np.sin(1.0), -np.cos(1.0)]) * length
    scene = fm.System(gravity=(0.0, 0.0, -G))
    ball = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    free.position = (start[0], 0.0, start[1], 1.0, 0.0, 0.0, 0.0)
    scene.add_force(fm.force.SpringDamper(scene.ground.frame(), ball.frame(), stiffness, 1.0))
    run = scene.simulate(1.0, h=STEP, integrator=method.make())
    return float(np.abs(run.position(ball.frame())[-1, [0, 2]] - exact).max())


def _governed(times: float) -> mechanisms.Governor:
    return mechanisms.Governor(stiffness=8e5 * times, damping=4e4 * times)


@cache
def _slid(times: float) -> float:
    return _governed(times).solution(1.0)[0]


@cache
def _tip(ratio: float) -> np.ndarray:
    return np.array(mechanisms.point_masses_end((1.0, ratio), 1.0))


def governor(times: float, method: Method) -> float:
    """Its slide after 1 s (m)."""
    mechanism = _governed(times).mechanism()
    run = mechanism.scene.simulate(1.0, rtol=RTOL, integrator=method.make(), max_steps=MOST)
    return abs(float(run.beta(mechanism.joint)[-1]) - _slid(times))


def double_pendulum(ratio: float, method: Method) -> float:
    """Its tip after 1 s (m)."""
    scene, tip = mechanisms.point_masses((1.0, ratio))
    run = scene.simulate(1.0, rtol=RTOL, integrator=method.make(), max_steps=MOST)
    return float(np.abs(run.position(tip)[-1, [0, 2]] - _tip(ratio)).max())


def windows(count: float, method: Method) -> float:
    """The first corner of a row of windows after 1 s (m): all uprights turn alike, so one equation has them all."""
    n = round(count)
    push, inertia = G * ((n + 1) / 2.0 + n), (n + 1) / 3.0 + n

    def equation(_: float, y: np.ndarray) -> list[float]:
        return [y[1], push / inertia * np.sin(y[0])]

    angle = solve_ivp(equation, (0.0, 1.0), [0.0, 1.0], method="DOP853", rtol=1e-12, atol=1e-12).y[0, -1]
    mechanism = mechanisms.four_bars(n)
    run = mechanism.scene.simulate(1.0, rtol=RTOL, integrator=method.make(), max_steps=MOST)
    return float(np.abs(run.position(mechanism.point)[-1, :2] - [np.sin(angle), np.cos(angle)]).max())


def maps(*, quick: bool) -> list[Map]:
    """All four, or a corner of each."""

    def decades(first: int, last: int, each: int = 1) -> list[float]:
        values = [10.0 ** (k / each) for k in range(first * each, last * each + 1)]
        return values[:: max(1, len(values) - 1)] if quick else values

    return [
        Map("step times frequency", "h w, rad", decades(-1, 2 if quick else 5, 2), elastic_pendulum),
        Map("stiffness", "times the usual stiffness", decades(-3, -2 if quick else 1), governor),
        Map("mass ratio", "lower mass over upper mass", decades(-8, 8), double_pendulum),
        Map("redundant rows", "windows", [1.0, 4.0] if quick else [2.0**k for k in range(7)], windows),
    ]


def cell(one: Map, value: float, method: Method) -> Cell:
    """The error of a method at a value, or what became of the run."""
    try:
        error = one.error(value, method)
    except fm.SimulationError as reason:
        print(f"{one.name} {value:g}, {method.label}: {reason}", flush=True)
        return LONG if reason.trajectory.stats.steps >= MOST else STOPPED
    except fm.errors.SceneError as reason:
        print(f"{one.name} {value:g}, {method.label}: {reason}", flush=True)
        return REFUSED
    return error if error < WORST else LOST


def tell(report: Report, some: Sequence[Map]) -> None:
    """A table and a panel of the picture for each map."""
    found = {one.name: [[cell(one, value, method) for value in one.values] for method in METHODS] for one in some}
    for one in some:
        report.table(one.across, *(f"{value:.2g}" for value in one.values))
        for method, row in zip(METHODS, found[one.name], strict=True):
            cells = (each if isinstance(each, str) else f"{each:.0e}" for each in row)
            report.say(f"| {method.label} | {' | '.join(cells)} |")
        report.say()
    report.picture("stability_map.png", partial(draw, some, found))


def draw(some: Sequence[Map], found: dict[str, list[list[Cell]]], path: Path) -> None:
    """A panel a map: colours by the error, letters where there is none."""
    figure, panels = plt.subplots(len(some), 1, figsize=(9.0, 2.3 * len(some)), layout="constrained")
    image = None
    for axes, one in zip(panels, some, strict=True):
        image = _panel(axes, one, found[one.name])
    figure.colorbar(image, ax=list(panels), label="error over the scene's size", shrink=0.5)
    figure.savefig(path, dpi=80)
    plt.close(figure)


def _panel(axes: Axes, one: Map, rows: list[list[Cell]]) -> object:
    numbers = np.array([[np.nan if isinstance(each, str) else max(each, BEST) for each in row] for row in rows])
    image = axes.imshow(numbers, norm=LogNorm(BEST, WORST), cmap="viridis", aspect="auto")
    axes.set_facecolor("0.85")
    for i, row in enumerate(rows):
        for j, each in enumerate(row):
            if isinstance(each, str):
                axes.text(j, i, each, ha="center", va="center", fontsize=6)
    axes.set_yticks(range(len(METHODS)), [method.label for method in METHODS], fontsize=8)
    axes.set_xticks(range(len(one.values)), [f"{value:.2g}" for value in one.values], fontsize=7)
    axes.set_title(f"{one.name}: {one.across}", fontsize=10)
    return image


def quick(report: Report) -> None:
    """The ends of each map."""
    tell(report, maps(quick=True))


def full(report: Report) -> None:
    """Whole maps."""
    tell(report, maps(quick=False))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="the ends of each map")
    parser.add_argument("--output", type=Path, default=Path("out_stability_map"), metavar="FOLDER")
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    tell(Report(given.output), maps(quick=given.quick))


if __name__ == "__main__":
    main()
