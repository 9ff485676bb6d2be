"""Time of a step of generalized-alpha on reduced beams, beside exudyn's, at the same step and each one's own error.

Pendulum, spin-up and a chain of five of the beam; the same modes in both, no geometric stiffening, which exudyn does
not know; and once more with it. Errors are of the point at the end against each code's own solution at a small step.
Ratios are of processor times measured in turn, the least of several runs.

    ./run python benchmarks/implicit_step.py [--meshes FOLDER] [--large]
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import beam_record
import numpy as np
import scenes

import flexmbd as fm

H, FINE = 1e-3, 2e-5  # s
END = 0.5  # s
SLACK = 1e-2  # rtol, which rules Newton's iteration alone where h is given
RUNS = 7


@dataclass(frozen=True)
class Row:
    """What was measured of one scene: microseconds a step, and m that the point is off."""

    name: str
    ours: float
    stiffened: float
    peer: float | None
    error: float
    peer_error: float | None
    iterations: float


def step_time(system: fm.System) -> tuple[float, fm.Trajectory]:
    """Processor time of a step (us), what a longer run adds, so that what is done once does not count."""
    system.simulate(2.0 * H, h=H)  # compiles
    times = []
    for _ in range(RUNS):
        spent = []
        for end in (END, 2.0 * END):
            began = time.thread_time()
            system.simulate(end, h=H, rtol=SLACK)
            spent.append(time.thread_time() - began)
        times.append((spent[1] - spent[0]) * H / END)
    return 1e6 * min(times), system.simulate(END, h=H, rtol=SLACK)


def peer_time(scene: scenes.Scene) -> tuple[float, float] | None:
    """exudyn's time of a step (us) and its error (m); None where it is not installed."""
    try:
        import scenes_exudyn as peer
    except ImportError:
        return None
    times = []
    for _ in range(RUNS):
        model = peer.build(scene)
        began = time.thread_time()
        _, found = peer.solve(model, peer.ALPHA, END, h=H)
        times.append((time.thread_time() - began) * H / END)
    _, exact = peer.solve(peer.build(scene), peer.ALPHA, END, h=FINE)
    return 1e6 * min(times), float(np.linalg.norm(found - exact))


def measure(name: str, kind: str, files: beam_record.Beam, links: int) -> Row:
    """One scene on one beam."""
    def build(path: Path) -> tuple[fm.System, object]:
        record = fm.ReducedBody.load(path)
        return scenes.spin_up(record) if kind == "spin-up" else scenes.flexible_chain(record, links)

    system, point = build(files.plain)
    ours, run = step_time(system)
    exact = system.simulate(END, h=FINE, rtol=1e-5).position(point)[-1]
    error = float(np.linalg.norm(run.position(point)[-1] - exact))
    stiffened, _ = step_time(build(files.stiffened)[0])
    scene = scenes.Scene(name, kind, END, 1.0, lambda: build(files.plain), None, links, files)
    peer, peer_error = peer_time(scene) or (None, None)
    return Row(name, ours, stiffened, peer, error, peer_error, run.stats.iterations / run.stats.steps)


def table(rows: list[Row]) -> str:
    """Markdown."""
    lines = [
        "| scene | flexmbd us | with stiffening us | iterations | error m | exudyn us | error m | ratio |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        peer = "- | - | -" if row.peer is None else f"{row.peer:.0f} | {row.peer_error:.1e} | {row.peer / row.ours:.1f}"
        lines.append(
            f"| {row.name} | {row.ours:.1f} | {row.stiffened:.1f} | {row.iterations:.2f} | {row.error:.1e} | {peer} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--meshes", type=Path, help="a folder of .npz files of `points` and `tet10`")
    parser.add_argument("--folder", type=Path, default=Path("out_simulation"), help="of the records")
    parser.add_argument("--large", action="store_true", help="the mesh of 63 000 dofs too")
    chosen = parser.parse_args()
    rows = []
    for mesh in ("5k", "63k") if chosen.large else ("5k",):
        many = beam_record.beam(mesh, 20, folder=chosen.folder, meshes=chosen.meshes)
        rows.append(measure(f"pendulum, {mesh}, 20 modes", "flexible chain", many, 1))
        rows.append(measure(f"spin-up, {mesh}, 20 modes", "spin-up", many, 0))
    few = beam_record.beam("5k", 12, folder=chosen.folder, meshes=chosen.meshes)
    rows.append(measure("chain of 5, 5k, 12 modes", "flexible chain", few, 5))
    print(table(rows))


if __name__ == "__main__":
    main()
