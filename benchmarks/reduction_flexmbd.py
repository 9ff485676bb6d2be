"""One measurement of flexmbd's reduction: `python reduction_flexmbd.py mesh.npz report.json [geometric] [iterative]`.

Runs under mpirun as well. Started by reduction.py.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import reduction_case as case

from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.grid.tagged_mesh import TaggedMesh, from_arrays
from flexmbd.forms import solid_linear
from flexmbd.reduction import Solver, craig_bampton

# The functions whose time makes the columns of the table; those of geometric stiffness run only where that is wanted.
STAGES = (
    ("flexmbd.reduction.static_shapes.interior_stiffness", "_factor", "factor"),
    ("flexmbd.reduction.static_shapes.interior_stiffness", "_iteration", "factor"),
    ("flexmbd.reduction.static_shapes.interior_stiffness", "continued", "static"),
    ("flexmbd.reduction.modes.fixed_modes", "fixed_interface_modes", "modes"),
    ("flexmbd.reduction.optional_groups", "responses", "geometric"),
    ("flexmbd.reduction.stiffening.stretch_modes", "stretch_modes", "geometric"),
    ("flexmbd.reduction.stiffening.geometric_stiffness", "stiffening", "geometric"),
)


def main(mesh_file: str, report_file: str, *, geometric: bool, solver: Solver) -> None:
    comm = MPI.COMM_WORLD
    watch = case.Stopwatch(comm.barrier)
    for module, function, name in STAGES:
        _instrument(watch, module, function, name)
    mesh = _mesh(comm, mesh_file)
    before = comm.allreduce(case.peak_memory())
    with watch.stage("total"):
        with watch.stage("assembly"):
            steel = solid_linear.Parameters(E=case.E, nu=case.NU, rho=case.RHO)
            ends = [Interface("start"), Interface("end")]
            model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=ends)
        body = craig_bampton(
            model, modes=case.FIXED_INTERFACE_MODES, frame="start", geometric_stiffness=geometric, solver=solver
        )
    peak = comm.allreduce(case.peak_memory())
    report = {
        "dofs": 3 * model.space.dofmap.index_map.size_global,
        "ranks": comm.size,
        "seconds": watch.seconds,
        "memory": {"before": before, "peak": peak},
        "frequencies": [float(f) for f in np.sqrt(body.stiffness) / (2.0 * np.pi)],
    }
    if comm.rank == 0:
        case.write_report(report_file, report)


def _mesh(comm: MPI.Comm, path: str) -> TaggedMesh:
    points, cells = case.read_mesh(Path(path)) if comm.rank == 0 else (None, None)
    small = 1e-9
    ends = {"start": lambda x: x[0] < small, "end": lambda x: x[0] > case.LENGTH - small}
    return from_arrays(comm, points, cells, degree=1, facet_groups=ends)


def _instrument(watch: case.Stopwatch, module: str, function: str, name: str) -> None:
    """Put a watched function in the place of the function, wherever it was imported to."""
    original: Any = getattr(importlib.import_module(module), function)
    watched = watch.watch(original, name)
    for loaded in [other for key, other in sys.modules.items() if key.startswith("flexmbd")]:
        for attribute, value in list(vars(loaded).items()):
            if value is original:
                setattr(loaded, attribute, watched)


if __name__ == "__main__":
    method = Solver.ITERATIVE if "iterative" in sys.argv[3:] else Solver.DIRECT
    main(sys.argv[1], sys.argv[2], geometric="geometric" in sys.argv[3:], solver=method)
