"""One measurement of flexmbd's reduction: `python reduction_flexmbd.py mesh.npz report.json [geometric] [iterative]`.

Runs under mpirun as well. Started by reduction.py. The stages are those that the progress bar shows.
"""

from __future__ import annotations

import itertools
import sys
import time
from pathlib import Path

from mpi4py import MPI

import numpy as np
import reduction_case as case

from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, from_arrays
from flexmbd.forms import solid_linear
from flexmbd.reduction import Solver, craig_bampton
from flexmbd.reduction.stages import Stages


class Clock:
    """When each stage began, and the peak of the memory by then, of all ranks together."""

    def __init__(self, comm: MPI.Comm) -> None:
        self._comm = comm
        self._marks: list[tuple[str, float, int]] = []

    def begin(self, name: str) -> None:
        """A stage begins, or with "end" the last one ends. Collective."""
        memory = self._comm.allreduce(case.peak_memory())
        self._marks.append((name, time.perf_counter(), memory))

    @property
    def seconds(self) -> dict[str, float]:
        """By stage, and the total."""
        found = {name: end - begin for (name, begin, _), (_, end, _) in itertools.pairwise(self._marks)}
        return {**found, "total": sum(found.values())}

    @property
    def memory(self) -> dict[str, int]:
        """Bytes: the peak before the first stage, at the end of each, and of all."""
        found = {name: memory for (name, _, _), (_, _, memory) in itertools.pairwise(self._marks)}
        return {"before": self._marks[0][2], **found, "peak": self._marks[-1][2]}


def main(mesh_file: str, report_file: str, *, geometric: bool, solver: Solver | None) -> None:
    comm = MPI.COMM_WORLD
    clock = Clock(comm)

    class Watched(Stages):
        def begin(self, name: str) -> None:
            clock.begin(name)

    Stages.begin = Watched.begin  # type: ignore[method-assign]
    mesh = _mesh(comm, mesh_file)
    clock.begin("assembly")
    steel = solid_linear.Parameters(E=case.E, nu=case.NU, rho=case.RHO)
    ends = [Interface("start"), Interface("end")]
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=ends)
    body = craig_bampton(
        model, modes=case.FIXED_INTERFACE_MODES, frame="start", geometric_stiffness=geometric, solver=solver
    )
    clock.begin("end")
    report = {
        "dofs": 3 * model.space.dofmap.index_map.size_global,
        "ranks": comm.size,
        "seconds": clock.seconds,
        "memory": clock.memory,
        "solver": body.provenance["solver"],
        "frequencies": [float(f) for f in np.sqrt(body.stiffness) / (2.0 * np.pi)],
    }
    if comm.rank == 0:
        case.write_report(report_file, report)


def _mesh(comm: MPI.Comm, path: str) -> TaggedMesh:
    points, cells = case.read_mesh(Path(path)) if comm.rank == 0 else (None, None)
    small = 1e-9
    ends = {"start": lambda x: x[0] < small, "end": lambda x: x[0] > case.LENGTH - small}
    return from_arrays(comm, points, cells, degree=1, facet_groups=ends)


if __name__ == "__main__":
    method = Solver.ITERATIVE if "iterative" in sys.argv[3:] else None
    main(sys.argv[1], sys.argv[2], geometric="geometric" in sys.argv[3:], solver=method)
