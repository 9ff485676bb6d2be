"""The modes of a reduction by each `eigensolver=`: blocks, blocks one by one, Krylov-Schur, slicing; and their count.

    ./run python benchmarks/eigensolver.py 19k 63k
    ./run mpirun -n 2 python benchmarks/eigensolver.py 19k 63k

The beam of `reduction_case.py`, both ends held: 16 modes, two of which only show whether the last one is one of a
pair. The time of the first factor, which the static shapes need, is not counted; those of slicing, which makes factors
of its own, are. The methods take turns, and the median of several ratios to blocks is given with its range. "One by
one" is our process with its columns solved for one after the other.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial

from mpi4py import MPI

import numpy as np
import reduction_case as case
from benchmark import Report

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.matrices import eigen
from flexmbd.forms import solid_linear
from flexmbd.reduction import KrylovSchur, SpectrumSlicing
from flexmbd.reduction.modes.signs import asymmetric_fields
from flexmbd.reduction.modes.slepc_search import slepc_search
from flexmbd.reduction.modes.sturm import count_below
from flexmbd.reduction.static_shapes.statics import Statics, body_statics

COUNT = case.FIXED_INTERFACE_MODES + 2
REPEATS = 5
MINUTES = 3.0
PEERS: tuple[str, ...] = ()

comm = MPI.COMM_WORLD


def quick(report: Report) -> None:
    """The mesh of 5000 dofs."""
    tell(report, ["5k"])


def full(report: Report) -> None:
    """Two meshes, on one rank; by hand also on two."""
    tell(report, ["19k", "63k"])


def tell(report: Report, sizes: list[str]) -> None:
    """A row for each mesh."""
    report.table("dofs", "ranks", "blocks, s", "one by one", "Krylov-Schur", "slicing", "the count")
    for name in sizes:
        report.say(measure(name))


def main() -> None:
    parser = argparse.ArgumentParser(description="Block Lanczos, Krylov-Schur and spectrum slicing.")
    parser.add_argument("sizes", nargs="*", default=["19k", "63k"], help=f"of {', '.join(case.FULL)}")
    arguments = parser.parse_args()
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
    statics: Statics, solve: Callable[[np.ndarray], np.ndarray], start: np.ndarray
) -> np.ndarray:
    return eigen.lowest_modes(solve, statics.M, start=start, count=COUNT).eigenvalues


def by_columns(statics: Statics, block: np.ndarray) -> np.ndarray:
    columns = [statics.solve(np.asfortranarray(block[:, [i]])) for i in range(block.shape[1])]
    return np.asfortranarray(np.hstack([block[:, :0], *columns]))


def by_slepc(statics: Statics, choice: KrylovSchur | SpectrumSlicing, start: np.ndarray) -> np.ndarray:
    search = slepc_search(statics, choice, start=start)
    search.find(COUNT)
    return search.eigenvalues[:COUNT]


def say(text: str) -> None:
    if comm.rank == 0:
        print(text, flush=True)


if __name__ == "__main__":
    main()
