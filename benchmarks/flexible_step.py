"""Time of a simulated millisecond of reduced beams, beside exudyn's generalized-alpha at a step of a millisecond.

Pendulum, spin-up and a chain of five of the beam; the same modes in both, no geometric stiffening, which exudyn does
not know. Errors are of the point at the end, ours against our own solution to twelve digits, exudyn's against its own
at a small step. Ours are generalized-alpha at the same step, central differences near their limit, and Radau IIA to a
tolerance. exudyn runs twice: with joints on the body frame's own node, which is fastest there, and on the mean of a
face's nodes, which is how its users join a body at any of its faces. Ratios are of processor times measured in turn,
the least of several runs, over those of the latter and of the former.

    ./run pip install exudyn
    ./run python benchmarks/flexible_step.py [--meshes FOLDER] [--large] [--module default]
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import beam_record
import numpy as np
import scenes
from benchmark import Report

import flexmbd as fm
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.body import Frame

H, FINE = 1e-3, 2e-5  # s
END = 0.5  # s
SLACK = 1e-2  # rtol, which rules Newton's iteration alone where h is given
RUNS = 7
HEADS = ("scene", "method", "us", "error m", "times less")
MINUTES = 3.0
PEERS: tuple[str, ...] = ("exudyn",)
FOLDER = Path("out_simulation")


@dataclass(frozen=True)
class Case:
    """A scene, its beam, and the step (s) of central differences, a little below their limit."""

    name: str
    kind: str
    beam: beam_record.Beam
    links: int
    explicit: float

    def start(self) -> tuple[fm.System, Frame]:
        """The machine at its start, and the point that is compared."""
        record = fm.ReducedBody.load(self.beam.plain)
        return scenes.spin_up(record) if self.kind == "spin-up" else scenes.flexible_chain(record, self.links)


@dataclass(frozen=True)
class Row:
    """A method on a scene: microseconds a simulated millisecond, and m that the point is off."""

    method: str
    time: float
    error: float


def own_rows(case: Case) -> list[Row]:
    """Ours. What a run takes beyond one of two steps is its time, so that what is done once does not count."""
    system, point = case.start()
    exact = system.simulate(END, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    place = exact.position(point)[-1]
    methods: list[tuple[str, Integrator, dict[str, Any]]] = [
        ("generalized-alpha, h = 1 ms", fm.GeneralizedAlpha(), {"h": H, "rtol": SLACK}),
        (f"central differences, h = {1e3 * case.explicit:g} ms", fm.CentralDifference(), {"h": case.explicit}),
        ("Radau IIA, rtol = 1e-2", fm.RadauIIA(), {"rtol": 1e-2}),
        ("Radau IIA, rtol = 1e-3", fm.RadauIIA(), {"rtol": 1e-3}),
    ]
    rows = []
    for name, method, how in methods:
        run = system.simulate(END, integrator=method, **how)
        short: list[float] = []
        whole: list[float] = []
        for _ in range(2 * RUNS):
            for end, spent in ((2.0 * H, short), (END, whole)):
                began = time.thread_time()
                system.simulate(end, integrator=method, **how)
                spent.append(time.thread_time() - began)
        error = float(np.linalg.norm(run.position(point)[-1] - place))
        rows.append(Row(name, 1e3 * (min(whole) - min(short)) / END, error))
    return rows


def peer_rows(case: Case) -> list[Row]:
    """exudyn's, in both forms; none where it is not installed."""
    try:
        import scenes_exudyn as peer
    except ImportError:
        return []
    rows = []
    kinds = {"joints on the faces' nodes": f"averaged {case.kind}", "joints on the body's node": case.kind}
    for form, kind in kinds.items():
        if kind not in peer.BUILDERS:
            continue
        scene = scenes.Scene(case.name, kind, END, 1.0, case.start, None, case.links, case.beam)
        times = []
        for _ in range(RUNS):
            spent, found = peer.solve(peer.build(scene), peer.ALPHA, END, h=H)
            times.append(spent)
        _, exact = peer.solve(peer.build(scene), peer.ALPHA, END, h=FINE)
        rows.append(Row(f"exudyn, {form}", 1e3 * min(times) / END, float(np.linalg.norm(found - exact))))
    return rows


def table(name: str, own: Sequence[Row], peers: Sequence[Row]) -> str:
    """Markdown lines of one scene."""
    lines = [f"| {name} | {row.method} | {row.time:.0f} | {row.error:.1e} | |" for row in peers]
    for row in own:
        ratios = " / ".join(f"{peer.time / row.time:.0f}" for peer in peers) or "-"
        lines.append(f"| {name} | {row.method} | {row.time:.1f} | {row.error:.1e} | {ratios} |")
    return "\n".join(lines)


def compare(report: Report, name: str, own: Sequence[Row], peers: Sequence[Row]) -> None:
    """Keep the best method of ours that is as near as a peer's against it."""
    for peer in peers:
        as_near = [row.time for row in own if row.error <= 1.1 * peer.error]
        if as_near:
            report.beside(name, task="a simulated millisecond", peer=peer.method, theirs=peer.time, ours=min(as_near))


def quick(report: Report) -> None:
    """The pendulum alone, without exudyn, whose small steps take a minute."""
    case = cases(FOLDER)[0]
    report.table(*HEADS)
    report.say(table(case.name, own_rows(case), []))


def full(report: Report) -> None:
    """All scenes on the mesh of 5000 dofs."""
    os.environ["EXUDYN_MODULE"] = "fast"
    measure(report, cases(FOLDER))


def measure(report: Report, some: Sequence[Case]) -> None:
    """Ours and exudyn's rows of some scenes."""
    report.table(*HEADS)
    for case in some:
        own, peers = own_rows(case), peer_rows(case)
        report.say(table(case.name, own, peers))
        compare(report, case.name, own, peers)


def cases(folder: Path, *, meshes: Path | None = None, large: bool = False) -> list[Case]:
    """The scenes, with their beams."""
    found = []
    for mesh in ("5k", "63k") if large else ("5k",):
        many = beam_record.beam(mesh, 20, folder=folder, meshes=meshes)
        found.append(Case(f"pendulum, {mesh}, 20 modes", "flexible chain", many, 1, 2e-4))
        found.append(Case(f"spin-up, {mesh}, 20 modes", "spin-up", many, 0, 2e-4))
    few = beam_record.beam("5k", 12, folder=folder, meshes=meshes)
    return [*found, Case("chain of 5, 5k, 12 modes", "flexible chain", few, 5, 4e-4)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, help="a folder of .npz files of `points` and `tet10`")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="of the records")
    parser.add_argument("--large", action="store_true", help="the mesh of 63 000 dofs too")
    parser.add_argument("--module", choices=("fast", "default"), default="fast", help="exudyn's build")
    chosen = parser.parse_args()
    os.environ["EXUDYN_MODULE"] = "fast" if chosen.module == "fast" else ""
    measure(Report(chosen.folder), cases(chosen.folder, meshes=chosen.meshes, large=chosen.large))


if __name__ == "__main__":
    main()
