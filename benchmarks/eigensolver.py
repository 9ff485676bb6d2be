"""The modes of a reduction by each `eigensolver=`: blocks, blocks one by one, Krylov-Schur, slicing; and their count.

    ./run python benchmarks/eigensolver.py 19k 63k
    ./run mpirun -n 2 python benchmarks/eigensolver.py 19k 63k
    ./run python benchmarks/eigensolver.py --parts

The beam of `reduction_case.py`, both ends held: 16 modes, two of which only show whether the last one is one of a
pair; and 10, 64 and 200 modes of a slender beam, a thick block, a thin plate and a connecting rod by blocks and by
Krylov-Schur, by the processor's time (`--parts`). The time of the first factor, which the static shapes need, is not
counted; those of slicing, which makes factors of its own, are. The methods take turns, and the median of several ratios
to blocks is given with its range. "One by one" is our process with its columns solved for one after the other.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from mpi4py import MPI

import numpy as np
import reduction_case as case
from benchmark import Report

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh
from flexmbd.continuum.matrices import eigen
from flexmbd.forms import solid_linear
from flexmbd.reduction import KrylovSchur, SpectrumSlicing
from flexmbd.reduction.modes.signs import asymmetric_fields
from flexmbd.reduction.modes.slepc_search import slepc_search
from flexmbd.reduction.modes.sturm import count_below
from flexmbd.reduction.static_shapes.body_statics import body_statics
from flexmbd.reduction.static_shapes.statics import Statics

COUNT = 16
REPEATS = 5
MINUTES = 3.0
PEERS: tuple[str, ...] = ()

comm = MPI.COMM_WORLD


def quick(report: Report) -> None:
    """The mesh of 5000 dofs."""
    tell(report, ["5k"])
    tell_parts(report, list(PARTS)[:1])


def full(report: Report) -> None:
    """Two meshes, on one rank; by hand also on two; and the parts."""
    tell(report, ["19k", "63k"])
    tell_parts(report, list(PARTS))


def tell(report: Report, sizes: list[str]) -> None:
    """A row for each mesh."""
    report.table("dofs", "ranks", "blocks, s", "one by one", "Krylov-Schur", "slicing", "the count")
    for name in sizes:
        report.say(measure(name))


def tell_parts(report: Report, names: list[str]) -> None:
    """Rows of blocks and Krylov-Schur, whose modes are the same, by the processor's time."""
    report.say()
    report.table("part", "dofs", "modes", "blocks, ms", "Krylov-Schur over blocks")
    for name in names:
        model = PARTS[name]()
        with body_statics(model, frame=model.interfaces[0].name) as statics:
            start = np.asfortranarray(asymmetric_fields(model)[statics.mask])
            for count in (12, 66, 202):
                rows = np.array([_processor_times(statics, start, count) for _ in range(3)])
                ratios = rows[:, 1] / rows[:, 0]
                told = f"{np.median(ratios):.2f} ({ratios.min():.2f} to {ratios.max():.2f})"
                dofs, spent = model.K.getSize()[0], 1e3 * np.median(rows[:, 0])
                report.say(f"| {name} | {dofs} | {count - 2} | {spent:.0f} | {told} |")


def _processor_times(statics: Statics, start: np.ndarray, count: int) -> list[float]:
    taken, found = [], []
    for method in (partial(block_lanczos, statics, statics.solve), partial(by_slepc, statics, KrylovSchur())):
        began = time.process_time()
        found.append(method(start, count))
        taken.append(time.process_time() - began)
    assert abs(found[1] / found[0] - 1.0).max() < 1e-8
    return taken


def _slender(h: float) -> ContinuumModel:
    return _with_ends(meshes.beam(case.LENGTH, case.WIDTH, case.WIDTH, h=h, degree=1), "start", "end")


def _thick(n: int) -> ContinuumModel:
    mesh = meshes.block(1.0, 0.7, 0.6, divisions=(3 * n // 2, n, n), cell="tetrahedron")
    return _with_ends(mesh, "x_min", "x_max")


def _thin(n: int) -> ContinuumModel:
    return _with_ends(meshes.block(1.0, 0.7, 0.01, divisions=(3 * n // 2, n, 1)), "x_min", "x_max")


def _with_ends(mesh: TaggedMesh, *ends: str) -> ContinuumModel:
    steel = solid_linear.Parameters(E=case.E, nu=case.NU, rho=case.RHO)
    return ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=list(map(Interface, ends)))


PARTS = {
    "block, coarse": partial(_thick, 3), "slender beam, coarse": partial(_slender, 0.04),
    "plate, coarse": partial(_thin, 8), "block": partial(_thick, 5), "plate": partial(_thin, 17),
    "connecting rod": lambda: _with_ends(meshes.connecting_rod(h=9e-3, degree=1), "big_end", "small_end"),
    "slender beam": partial(_slender, 0.0172), "block, fine": partial(_thick, 8),
}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description="Block Lanczos, Krylov-Schur and spectrum slicing.")
    parser.add_argument("sizes", nargs="*", default=["19k", "63k"], help=f"of {', '.join(case.FULL)}")
    parser.add_argument("--parts", action="store_true", help="blocks and Krylov-Schur on parts of several kinds")
    arguments = parser.parse_args()
    if arguments.parts:
        tell_parts(Report(Path()), list(PARTS))
        return
    say("| dofs | ranks | blocks, s | one by one | Krylov-Schur | slicing | the count |")
    say("|---|---|---|---|---|---|---|")
    for name in arguments.sizes:
        say(measure(name))


def measure(name: str) -> str:
    """A row of the table."""
    steel = solid_linear.Parameters(E=case.E, nu=case.NU, rho=case.RHO)
    ends = [Interface("start"), Interface("end")]
    mesh = meshes.beam(case.LENGTH, case.WIDTH, case.WIDTH, h=case.CELL_SIZE[name], degree=1, comm=comm)
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=ends)
    with body_statics(model, frame="start") as statics:
        start = np.asfortranarray(asymmetric_fields(model)[statics.mask])
        exact = block_lanczos(statics, statics.solve, start)
        shift = 0.5 * (exact[-2] + exact[-1])
        methods = (
            partial(block_lanczos, statics, statics.solve, start),
            partial(block_lanczos, statics, partial(by_columns, statics), start),
            partial(by_slepc, statics, KrylovSchur(), start),
            partial(by_slepc, statics, SpectrumSlicing(), start),
            partial(count_below, statics, shift),
        )
        rows = np.array([[seconds(method, exact) for method in methods] for _ in range(REPEATS)])
    ratios = rows[:, 1:] / rows[:, :1]
    times = [f"{np.median(r):.2f} ({r.min():.2f} to {r.max():.2f})" for r in ratios.T]
    return f"| {model.K.getSize()[0]} | {comm.size} | {np.median(rows[:, 0]):.3f} | {' | '.join(times)} |"


def seconds(method: Callable[[], np.ndarray | int], exact: np.ndarray) -> float:
    """How long a method takes; its eigenvalues, or their number, must be the known ones."""
    comm.barrier()
    began = time.perf_counter()
    found = method()
    comm.barrier()
    took = time.perf_counter() - began
    if isinstance(found, int):
        assert found == COUNT - 1
    else:
        assert abs(found / exact - 1.0).max() < 1e-8
    return took


def block_lanczos(
    statics: Statics, solve: Callable[[np.ndarray], np.ndarray], start: np.ndarray, count: int = COUNT
) -> np.ndarray:
    return eigen.lowest_modes(solve, statics.M, start=start, count=count).eigenvalues


def by_columns(statics: Statics, block: np.ndarray) -> np.ndarray:
    columns = [statics.solve(np.asfortranarray(block[:, [i]])) for i in range(block.shape[1])]
    return np.asfortranarray(np.hstack([block[:, :0], *columns]))


def by_slepc(
    statics: Statics, choice: KrylovSchur | SpectrumSlicing, start: np.ndarray, count: int = COUNT
) -> np.ndarray:
    search = slepc_search(statics, choice, start=start)
    search.find(count)
    return search.eigenvalues[:count]


def say(text: str) -> None:
    if comm.rank == 0:
        print(text, flush=True)


if __name__ == "__main__":
    main()
