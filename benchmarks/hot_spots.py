"""How much quicker the largest stress of a run is found than by the stress of all nodes.

    ./run python benchmarks/hot_spots.py

A rod with a weight swings; 21 modes, 7 and 20 thousand nodes, 4 000 instants. Both find the same node and stress.
Prints seconds and their ratio, median and range of five turns.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from benchmark import Report

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, craig_bampton

STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
INSTANTS = np.linspace(0.0, 1.0, 4000)
TURNS = 5
MINUTES = 1.5
PEERS: tuple[str, ...] = ()


def swung(divisions: tuple[int, int, int]) -> tuple[fm.Trajectory, fm.FlexibleBody]:
    """The run and its flexible body."""
    mesh = meshes.block(0.6, 0.03, 0.02, divisions=divisions)
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=2, interfaces=[Interface("x_min"), Interface("x_max")])
    record = craig_bampton(model, modes=12, frame="x_min", keep=Keep(stress=True))
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    rod = scene.add(fm.FlexibleBody(record), name="rod")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), rod.frame("x_min"))
    tip = scene.add(fm.RigidBody(mass=0.7, inertia=(1e-3, 2e-3, 2e-3)), name="tip")
    scene.connect(fm.joint.Fixed(), rod.frame("x_max"), tip.frame())
    return scene.simulate(t_end=1.0, rtol=1e-4), rod


def every_node(run: fm.Trajectory, rod: fm.FlexibleBody) -> tuple[float, int]:
    """The largest von Mises stress and its node, by all of them, in blocks that fit the cache."""
    monitor = fm.YieldMonitor(rod, yield_stress=1.0)
    history = monitor.over(run, t=INSTANTS)
    i = int(history.utilisation.argmax())
    return float(history.utilisation[i]), int(history.node[i])


def quick(report: Report) -> None:
    """A coarse rod."""
    tell(report, (12, 2, 2))


def full(report: Report) -> None:
    """7 and 20 thousand nodes."""
    tell(report, (40, 4, 4), (60, 6, 6))


def tell(report: Report, *sizes: tuple[int, int, int]) -> None:
    """A row for each mesh."""
    report.table("nodes", "modes", "s", "times as fast as all nodes")
    for divisions in sizes:
        run, rod = swung(divisions)
        ratios, seconds = [], []
        for _ in range(TURNS):
            begin = time.perf_counter()
            all_of_them = every_node(run, rod)
            middle = time.perf_counter()
            worst = fm.hot_spots(run, rod, t=INSTANTS)[0]
            end = time.perf_counter()
            same = worst.node == all_of_them[1] and abs(worst.stress / all_of_them[0] - 1.0) < 1e-9
            assert same, "they differ"
            ratios.append((middle - begin) / (end - middle))
            seconds.append(end - middle)
        stress = rod.record.stress
        assert stress is not None
        ratio = f"{np.median(ratios):.1f} ({min(ratios):.1f} to {max(ratios):.1f})"
        report.say(f"| {len(stress.node)} | {rod.record.n_modes} | {np.median(seconds):.3f} | {ratio} |")


if __name__ == "__main__":
    full(Report(Path("out_hot_spots")))
