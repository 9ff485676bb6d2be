"""The memory that a reduction says it takes beside what it takes, and its stages."""

import subprocess
import sys

from mpi4py import MPI

import pytest

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import ReductionError
from flexmbd.forms import solid_linear
from flexmbd.reduction import craig_bampton
from flexmbd.reduction.stages import STAGES

COMM = MPI.COMM_WORLD
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)

# The peak of a process is that of all its past: this one has none. Prints estimate and peak, bytes.
PEAK = """
import sys
from pathlib import Path
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import Solver, craig_bampton
from flexmbd.reduction.static_shapes.body_statics import body_statics

def taken(name):
    return 1024 * int(Path("/proc/self/status").read_text().partition(name + ":")[2].split()[0])

def beam(cells):
    mesh = meshes.block(3.0, 1.0, 1.0, divisions=(3 * cells, cells, cells))
    return ContinuumModel(
        mesh, solid_linear, solid_linear.Parameters(2.1e11, 0.3, 7850.0), degree=2,
        interfaces=[Interface("x_min"), Interface("x_max")],
    )

solver = Solver[sys.argv[1]]
craig_bampton(beam(2), modes=4, frame="x_min", solver=solver)  # loads libraries and compiles
model = beam(int(sys.argv[2]))
with body_statics(model, frame="x_min", solver=solver, modes=14) as statics:
    estimate = statics.memory
Path("/proc/self/clear_refs").write_text("5")
before = taken("VmRSS")
craig_bampton(model, modes=14, frame="x_min", solver=solver)
print(estimate, taken("VmHWM") - before)
"""


@pytest.mark.parametrize(("solver", "cells"), [("DIRECT", "6"), ("ITERATIVE", "5")])
def test_estimate_beside_the_true_peak(solver, cells):
    """Within a factor of 1.5 either way."""
    done = subprocess.run([sys.executable, "-c", PEAK, solver, cells], capture_output=True, text=True, check=True)
    estimate, peak = map(int, done.stdout.split()[-2:])
    assert peak / 1.5 < estimate < 1.5 * peak, (estimate, peak)


@pytest.mark.mpi
def test_stages(capfd):
    mesh = meshes.block(1.0, 0.2, 0.3, divisions=(4, 1, 1))
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])
    plain, body = (craig_bampton(model, modes=2, frame="x_min", progress=shown) for shown in (False, True))
    shown = capfd.readouterr().err
    if COMM.rank == 0:
        assert f"{STAGES[-1]}: {len(STAGES)}/{len(STAGES)}" in shown
        assert "MB beside K and M" in shown
        assert (f"so small a part takes one rank no longer than {COMM.size}" in shown) == (COMM.size > 1)
    else:
        assert STAGES[-1] not in shown
    assert body.stiffness.tobytes() == plain.stiffness.tobytes()
    with pytest.raises(ReductionError, match="progress"):
        craig_bampton(model, modes=2, frame="x_min", progress="yes")
