"""Bodies that yield: error over processor time, growth with cells, and other programs on the same problems.

    bash benchmarks/install_peers.sh                        # once: Kratos, CalculiX, dolfinx-external-operator
    ./run python benchmarks/yielding.py --quick             # coarse meshes and short runs: does it work?
    ./run python benchmarks/yielding.py                     # the whole, a quarter of an hour of processor time
    ./run python benchmarks/yielding.py --parts taylor tube

The parts:

- *cells*: microseconds a cell of residual, pass, tangent and explicit step; what bricks carry of a limit load.
- *cylinder*, *large* (20 000 bricks, only when asked for): a thick cylinder in plane strain by 8-node bricks, 20 steps
  to 0.98 of the perfectly plastic limit pressure, with a hardening of 700 MPa beside CalculiX, without beside Kratos;
  errors of the displacements of both radii against a program of the radius alone (radial_cylinder.py), which shares no
  code with any of them.
- *ring*, *slope*: the von Mises and Mohr-Coulomb demos of dolfinx-external-operator, both programs on the same
  biquadratic cells with the same points: their displacements are compared with one another, step by step.
- *taylor*: error of Taylor's bar's length, explicit. *tube*: a crash tube into its first fold, explicit, by bricks and
  by solid-shells of the same law; error of the mean force against the finest bricks. *pendulum*: a rod that bends in
  a plastic hinge, implicit by rtol, and explicit; errors of bend and plastic work against a tighter rtol.

Times are of processor time of one thread, without what compiles; programs run in turns, `--rounds` times, and stand as
the least, ratios with their range. CalculiX's is of the whole program, the others' of the steps. The tables are
markdown; the picture and the figures go to `out_yielding`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import radial_cylinder
import yielding_motion as motion
import yielding_statics as statics
from benchmark import Report
from dolfinx import fem
from peer_process import Task, peer_task
from yielding_picture import draw

from flexmbd.errors import FlexmbdError
from flexmbd.forms import j2_plasticity as j2
from flexmbd.forms import solid_linear

HERE = Path(__file__).parent
OUT = Path("out_yielding")
MINUTES = 20.0
PEERS: tuple[str, ...] = ()  # programs of their own environments, which tell their versions in the tables


@dataclass(eq=False)
class Row:
    """One mesh or tolerance by one program.

    Attributes:
        scene: the problem.
        series: the program, or the method.
        level: which mesh or tolerance.
        cells: of the mesh.
        seconds: of processor time, one for each round.
        error: relative; None if it is the reference itself.
        told: anything else worth a column.
    """

    scene: str
    series: str
    level: str
    cells: int
    seconds: list[float]
    error: float | None = None
    told: str = ""
    found: dict[str, Any] = field(default_factory=dict)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="coarse meshes, short runs, under a minute")
    most = [part for part in PARTS if part != "large"]
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=most, help="which of them")
    parser.add_argument("--rounds", type=int, default=3, help="runs of each program where programs are compared")
    parser.add_argument("--redraw", nargs="+", type=Path, help="only draw the rows.json of earlier runs")
    arguments = parser.parse_args()
    if arguments.redraw:
        kept = [row for file in arguments.redraw for row in json.loads(file.read_text())]
        draw([Row(**row) for row in kept], OUT / "yielding.png")
        return 0
    rows: list[Row] = []
    for part in arguments.parts:
        found = PARTS[part](arguments.quick, 1 if arguments.quick else arguments.rounds)
        if found:
            print(table(found), flush=True)
        rows += found
    OUT.mkdir(exist_ok=True)
    (OUT / "rows.json").write_text(json.dumps([{**vars(row), "found": None} for row in rows], indent=1))
    if any(row.error is not None for row in rows):
        draw(rows, OUT / "yielding.png")
        print(f"in {OUT}: rows.json, yielding.png")
    return 0


def quick(report: Report) -> None:
    """A cylinder on coarse meshes, once."""
    _tell(report, ("cylinder",), short=True)


def full(report: Report) -> None:
    """All parts but the large one, three rounds."""
    _tell(report, [part for part in PARTS if part not in ("cells", "large")], short=False)


def _tell(report: Report, parts: Sequence[str], *, short: bool) -> None:
    """Tables of some parts, and their picture."""
    rows: list[Row] = []
    for part in parts:
        found = PARTS[part](short, 1 if short else 3)
        report.say(table(found))
        compare(report, found)
        rows += found
    report.picture("yielding.png", partial(draw, rows))


def cells(quick: bool, rounds: int) -> list[Row]:
    """Printed: us a cell of a body that yields all over, and of an elastic one; limit loads."""
    divisions = (8, 10, 3) if quick else (40, 50, 10)
    print(f"{'us a cell':22} {'residual':>9} {'pass':>9} {'tangent':>9} {'explicit':>9}")
    for name, form, means in (
        ("linear elastic", solid_linear, False), ("J2", j2, False), ("J2, mean dilatation", j2, True)
    ):
        body = statics.ring(divisions, form=form, hardening=700e6, means=means)
        u = np.zeros(body.layout.n_local)
        u[body.displacement_dofs] = statics.STRAIN * body.layout.node_x * [1.0, -0.5, -0.3]
        body.tangent(u)
        terms = [fem.form(term) for history in body._histories for term in history.terms]
        forces = body.vector().array
        times = [
            least(lambda terms=terms, forces=forces: [fem.assemble_vector(forces, term) for term in terms]),
            least(partial(body.force, u)),
            least(partial(body.tangent, u)),
        ]
        body.revert()
        times.append(least(motion.explicit_step(body, strain=statics.STRAIN)))
        print(f"{name:22}" + "".join(f" {1e6 * t / np.prod(divisions):9.2f}" for t in times), flush=True)
    print("residual: DOLFINx's assembly alone; pass: forces, history and means")
    for means in (True, False):
        carried = statics.limit((8, 12, 1), means=means)
        print(f"limit pressure with{'' if means else 'out'} mean dilatation: {carried:.4f} of the exact one")
    print()
    return []


def cylinder(quick: bool, rounds: int) -> list[Row]:
    sizes = (8, 16) if quick else (8, 16, 32, 64)
    meshes = [(n, 5 * n // 4, 1) for n in sizes]
    # on the finest Kratos' multigrid takes minutes
    return thick_cylinder("CalculiX", 700e6, meshes, rounds) + thick_cylinder("Kratos", 0.0, meshes[:3], rounds)


def large(quick: bool, rounds: int) -> list[Row]:
    meshes = [(10, 12, 3) if quick else (40, 50, 10)]
    return thick_cylinder("CalculiX", 700e6, meshes, rounds) + thick_cylinder("Kratos", 0.0, meshes, rounds)


def thick_cylinder(
    peer: str, hardening: float, ladder: Sequence[tuple[int, int, int]], rounds: int
) -> list[Row]:
    """Meshes along the radius, around and along z."""
    rows = []
    exact = np.array(radial_cylinder.displacements(hardening))
    scene = f"cylinder, hardening {hardening / 1e6:.0f} MPa"
    for divisions in ladder:
        tasks: dict[str, Task] = {"flexmbd": partial(statics.cylinder, divisions, hardening)}
        named = [peer.lower(), ",".join(map(str, divisions)), str(hardening / 1e6)]
        called = peer_task(peer.lower(), "yielding_peers.py", named)
        if called is not None:
            tasks[peer] = called
        level = " x ".join(map(str, divisions))
        for row in in_turns(scene, tasks, level=level, cells=int(np.prod(divisions)), rounds=rounds):
            u = np.array([row.found["u_a"], row.found["u_b"]])
            row.error = float(abs(u / exact - 1.0).max())
            row.told = f"{row.found['iterations']:.0f} matrices"
            rows.append(row)
    return rows


def ring(quick: bool, rounds: int) -> list[Row]:
    loads = 2 / np.sqrt(3) * 250.0 * np.log(1.3) * statics.ring_loads()
    return demo("ring, von Mises", "ring", statics.thin_ring, loads, (4,) if quick else (4, 8, 16), rounds)


def slope(quick: bool, rounds: int) -> list[Row]:
    loads = statics.slope_loads(step=2.0) if quick else statics.slope_loads()
    ours = partial(statics.slope, loads=loads)
    return demo("slope, Mohr-Coulomb", "slope", ours, loads, (4,) if quick else (4, 8, 12), rounds)


def demo(scene: str, name: str, ours: Callable[[int], Any], loads: Any, sizes: Sequence[int], rounds: int) -> list[Row]:
    """One of dolfinx-external-operator's, beside it; printed is by how much the displacements differ."""
    rows = []
    for n in sizes:
        tasks: dict[str, Task] = {"flexmbd": partial(ours, n)}
        values = ",".join(repr(float(load)) for load in loads)
        called = peer_task("external_operator", "external_operator_peer.py", [name, str(n), values])
        if called is not None:
            tasks["external operator"] = called
        found = in_turns(scene, tasks, level=str(n), cells=0, rounds=rounds)
        for row in found:
            row.cells = found[0].found["cells"]
            moved = np.array(row.found["moved"])
            both = min(len(moved), len(found[0].found["moved"]))
            apart = abs(moved[:both] / np.array(found[0].found["moved"])[:both] - 1.0).max()
            row.told = f"{len(moved)} of {len(loads)} loads, {row.found['iterations']} matrices, u {moved[-1]:.6e}"
            row.told += "" if row is found[0] else f", apart by {apart:.0e} over {both} loads"
        rows += found
    return rows


def taylor(quick: bool, rounds: int) -> list[Row]:
    ladder = [(1, 1, 12)] if quick else [(1, 1, 12), (2, 2, 24), (3, 2, 36), (4, 3, 44)]
    rows = []
    for divisions in ladder:
        found = motion.taylor(divisions)
        error = abs(found["length"] / motion.TAYLOR_LENGTH - 1.0)
        told = f"{found['steps']:.0f} steps, {1e3 * found['length']:.3f} mm"
        level = " x ".join(map(str, divisions))
        rows.append(Row("Taylor's bar", "explicit", level, int(found["cells"]), [found["seconds"]], error, told))
    return rows


def tube(quick: bool, rounds: int) -> list[Row]:
    # walls of one brick fold into themselves; of solid-shells one goes through the wall
    bricks = [(3, 2, 16)] if quick else [(3, 2, 24), (5, 2, 40), (8, 3, 64), (10, 3, 80)]
    shells = [(3, 1, 16)] if quick else [(5, 1, 24), (5, 1, 30), (8, 1, 40)]
    rows = []
    for series, divisions in [("solid-shells", d) for d in shells] + [("bricks", d) for d in bricks]:
        level = " x ".join(map(str, divisions))
        try:
            found = motion.tube(divisions, shells=series == "solid-shells", end=1e-4 if quick else motion.TUBE_END)
        except FlexmbdError as error:
            print(f"tube by {series}, {level}: {error}\n", flush=True)
            continue
        forces = {name: value for name, value in found.items() if name.startswith("force ")}
        up_to = "".join(f", {value / 1e3:.1f} up to {name[len('force '):]}" for name, value in forces.items())
        told = (
            f"{found['steps']:.0f} steps, {1e3 * found['crush']:.2f} mm, {found['force'] / 1e3:.2f} kN{up_to}, "
            f"{found['plastic']:.0f} J of flow, {found['elastic']:.0f} J elastic, "
            f"{1e3 * found['sideways']:.1f} mm sideways at {1e3 * found['fold']:.1f} mm"
        )
        row = Row("tube", series, level, int(found["cells"]), [found["seconds"]], None, told, found)
        rows.append(row)
    for row in rows[:-1]:
        row.error = abs(row.found["force"] / rows[-1].found["force"] - 1.0)
    return rows


def pendulum(quick: bool, rounds: int) -> list[Row]:
    divisions, end = ((5, 1, 2), 0.004) if quick else ((10, 1, 2), motion.PENDULUM_END)
    exact = motion.pendulum(divisions, explicit=False, rtol=3e-3 if quick else 3e-4, end=end)
    rows = []
    for rtol in (2e-2,) if quick else (5e-2, 2e-2, 5e-3, 2e-3):
        found = motion.pendulum(divisions, explicit=False, rtol=rtol, end=end)
        rows.append(of_pendulum("implicit", f"rtol {rtol:g}", found, exact))
    found = motion.pendulum(divisions, explicit=True, end=end)
    rows.append(of_pendulum("explicit", "stable step", found, exact))
    for finer in [] if quick else [(10, 1, 2), (20, 1, 4), (40, 2, 8)]:
        for explicit in (False, True):
            found = motion.pendulum(finer, explicit=explicit, rtol=None if explicit else 2e-2, end=3e-3)
            row = of_pendulum("explicit" if explicit else "implicit", " x ".join(map(str, finer)), found, None)
            row.scene = "pendulum, 3 ms, implicit by rtol 0.02"
            rows.append(row)
    return rows


def of_pendulum(series: str, level: str, found: dict[str, float], exact: dict[str, float] | None) -> Row:
    error = None
    if exact is not None:
        error = max(abs(found[name] / exact[name] - 1.0) for name in ("bend", "work"))
    told = f"{found['steps']:.0f} steps, {np.degrees(found['bend']):.3f} degrees, {found['work']:.3f} J"
    return Row("pendulum", series, level, int(found["cells"]), [found["seconds"]], error, told, found)


PARTS: dict[str, Callable[[bool, int], list[Row]]] = {
    "cells": cells, "cylinder": cylinder, "large": large, "ring": ring, "slope": slope, "taylor": taylor, "tube": tube,
    "pendulum": pendulum,
}


def in_turns(scene: str, tasks: dict[str, Task], *, level: str, cells: int, rounds: int) -> list[Row]:
    """Run tasks one after the other, round by round."""
    rows = {name: Row(scene, name, level, cells, []) for name in tasks}
    for _ in range(rounds):
        for name, task in tasks.items():
            rows[name].found = task()
            rows[name].seconds.append(rows[name].found["seconds"])
    return list(rows.values())


def least(task: Callable[[], object], *, repeats: int = 7) -> float:
    """The least processor time of several runs, s."""
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        task()
        spent.append(time.process_time() - begin)
    return min(spent)


def compare(report: Report, rows: Sequence[Row]) -> None:
    """Keep other programs beside flexmbd on the finest level that both have of a scene."""
    for scene, series in dict.fromkeys((row.scene, row.series) for row in rows):
        own = {row.level: row for row in rows if (row.scene, row.series) == (scene, "flexmbd")}
        both = [row for row in rows if (row.scene, row.series) == (scene, series) and row.level in own]
        if series != "flexmbd" and both:
            last = both[-1]
            task = f"{last.cells} cells"
            report.beside(scene, task=task, peer=series, theirs=last.seconds, ours=own[last.level].seconds)


def table(rows: Sequence[Row]) -> str:
    """Markdown; ratios are of a program's time to flexmbd's on the same level, growth is from the level before."""
    lines = ["| scene | program | mesh or rtol | cells | s | times flexmbd's | growth | error | |", "|---" * 9 + "|"]
    before: dict[tuple[str, str], Row] = {}
    for row in rows:
        same = [one for one in rows if (one.scene, one.level) == (row.scene, row.level)]
        ours = next((one for one in same if one.series == "flexmbd"), row)
        ratios = [mine / other for mine, other in zip(row.seconds, ours.seconds, strict=True)]
        ratio = ""
        if ours is not row:
            ratio = f"{min(row.seconds) / min(ours.seconds):.1f} ({min(ratios):.1f} to {max(ratios):.1f})"
        last, growth = before.get((row.scene, row.series)), ""
        if last is not None and last.cells < row.cells:
            growth = f"n^{np.log(min(row.seconds) / min(last.seconds)) / np.log(row.cells / last.cells):.2f}"
        before[row.scene, row.series] = row
        error = "" if row.error is None else f"{row.error:.1e}"
        cells = (row.scene, row.series, row.level, row.cells, f"{min(row.seconds):.3g}", ratio, growth, error, row.told)
        lines.append("| " + " | ".join(map(str, cells)) + " |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())
