"""A block of 3 n x n x n quadratic bricks on the way to a million dofs: seconds and memory, stage by stage.

    ./run mpirun -n 2 python benchmarks/large_block.py 24           # 1 044 435 dofs, 20 modes
    ./run mpirun -n 2 python benchmarks/large_block.py 24 --no-count --no-geometric-stiffness
    ./run python benchmarks/large_block.py 9 --solver COMPRESSED    # 60 000 dofs by a solver that is named
    ./run python -m benchmarks large_block                          # a table of sizes and solvers, one and two ranks

20 modes: 6 static and 14 fixed-interface ones, both ends rigid. `--tetrahedra` takes six tetrahedra in place of a
brick: as many dofs, a sixth of the bandwidth of an element. Memory is the sum over the ranks of the peak of each
process, libraries and the mesh included, at the end of each stage.
"""

from __future__ import annotations

import argparse
import itertools
import json
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import reduction_case as case
from benchmark import Report

MINUTES = 12
PEERS: tuple[str, ...] = ()

MODES = 14
MARK = "large block: "


def quick(report: Report) -> None:
    """The two smallest."""
    _table(report, [(3, 1, "DIRECT"), (3, 1, "COMPRESSED")])


def full(report: Report) -> None:
    """Sizes by which the growth is told; the million is run by its own command."""
    sizes = (4, 6, 9, 14)
    _table(report, [(n, ranks, solver) for n in sizes for ranks in (1, 2) for solver in ("DIRECT", "COMPRESSED")])


def _table(report: Report, cases: list[tuple[int, int, str]]) -> None:
    report.table("dofs", "ranks", "solver", "assembly", "factor", "static", "loads", "modes", "rest", "total", "MB")
    rows: dict[tuple[int, str], list[tuple[int, float, float]]] = {}
    for n, ranks, solver in cases:
        row = _run(n, ranks, solver)
        seconds, dofs = row["seconds"], row["dofs"]
        named = ("assembly", "factor", "static shapes", "responses to loads", "modes")
        rest = row["total"] - sum(seconds[name] for name in named)
        cells = [f"{one:.2f}" for one in (*(seconds[name] for name in named), rest, row["total"])]
        cells.append(f"{row['peak']:.0f}")
        report.say(f"| {dofs} | {ranks} | {solver} | {' | '.join(cells)} |")
        rows.setdefault((ranks, solver), []).append((dofs, row["total"], row["peak"]))
    for (ranks, solver), found in rows.items():
        for (low, *before), (high, *after) in itertools.pairwise(found):
            powers = np.log(np.divide(after, before)) / np.log(high / low)
            growth = f"time ~ n^{powers[0]:.2f}, memory ~ n^{powers[1]:.2f}"
            report.say(f"{solver}, {ranks} ranks, {low} to {high} dofs: {growth}")


def _run(n: int, ranks: int, solver: str) -> dict:
    command = [sys.executable, str(Path(__file__)), str(n), "--solver", solver]
    command = ["mpirun", "-n", str(ranks), *command] if ranks > 1 else command
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith(MARK)).removeprefix(MARK))


def main() -> None:
    """One measurement, in this process or on the ranks that it was started with."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("n", type=int, help="bricks along the short edges; 24 gives a million dofs")
    parser.add_argument("--solver", choices=("DIRECT", "COMPRESSED", "ITERATIVE"), help="default: what fits")
    parser.add_argument("--no-count", action="store_true", help="modes are not counted by a second factor")
    parser.add_argument("--no-geometric-stiffness", action="store_true")
    parser.add_argument("--tetrahedra", action="store_true")
    arguments = parser.parse_args()

    from mpi4py import MPI

    from flexmbd import meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.forms import solid_linear
    from flexmbd.reduction import Solver, Truncation, craig_bampton
    from flexmbd.reduction.stages import Stages

    comm = MPI.COMM_WORLD
    began = [("mesh", time.perf_counter())]

    def begin(name: str) -> None:
        now, memory = time.perf_counter(), comm.allreduce(case.peak_memory()) / 1e6
        if comm.rank == 0:
            print(f"{now - began[0][1]:8.1f} s  {began[-1][0]} done, peak {memory:.0f} MB", flush=True)
        began.append((name, now))

    show = Stages.begin

    def watched(self: Stages, name: str) -> None:
        begin(name)
        show(self, name)

    Stages.begin = watched  # type: ignore[method-assign]
    n = arguments.n
    mesh = meshes.block(
        3.0, 1.0, 1.0, divisions=(3 * n, n, n), cell="tetrahedron" if arguments.tetrahedra else "hexahedron"
    )
    begin("assembly")
    ends = [Interface("x_min"), Interface("x_max")]
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=ends)
    body = craig_bampton(
        model,
        modes=Truncation(MODES, complete=not arguments.no_count),
        frame="x_min",
        geometric_stiffness=not arguments.no_geometric_stiffness,
        solver=None if arguments.solver is None else Solver[arguments.solver],
        progress=sys.stderr.isatty(),
    )
    begin("end")
    seconds = {name: end - start for (name, start), (_, end) in itertools.pairwise(began)}
    peak = comm.allreduce(case.peak_memory()) / 1e6
    if comm.rank == 0:
        dofs = int(model.K.getSize()[0])
        print(f"{dofs} dofs, {comm.size} ranks; {body.provenance['solver']}; {body.provenance['completeness']}")
        whole = {"dofs": dofs, "seconds": seconds, "total": sum(seconds.values()) - seconds["mesh"], "peak": peak}
        print(MARK + json.dumps(whole))


if __name__ == "__main__":
    main()
