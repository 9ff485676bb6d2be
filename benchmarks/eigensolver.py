"""The modes of a reduction by blocks of solves, beside solves one by one and SLEPc's Krylov-Schur method.

    ./run python benchmarks/eigensolver.py 19k 63k
    ./run mpirun -n 2 python benchmarks/eigensolver.py 19k 63k

The beam of `reduction_case.py`, both ends held: 16 modes, two of which only show whether the last one is one of a
pair. The time of the factor is not counted. The methods take turns, and the least of several times is given. "One by
one" is our process with its columns solved for one after the other. Krylov-Schur, on a factor of its own, has one start
vector and as many basis vectors as are best here; it does not find all copies of equal frequencies.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial

from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import reduction_case as case

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface, eigen
from flexmbd.forms import solid_linear
from flexmbd.reduction.signs import asymmetric_fields
from flexmbd.reduction.statics import Statics, body_statics

COUNT = case.FIXED_INTERFACE_MODES + 2
REPEATS = 5
BASIS = 32  # vectors for Krylov-Schur; 24, 40 and 60 take longer

comm = MPI.COMM_WORLD


def main() -> None:
    parser = argparse.ArgumentParser(description="Block Lanczos beside solves one by one and Krylov-Schur.")
    parser.add_argument("sizes", nargs="*", default=["19k", "63k"], help=f"of {', '.join(case.FULL)}")
    parser.add_argument("--basis", type=int, default=BASIS, help="basis vectors for Krylov-Schur")
    arguments = parser.parse_args()
    say("| dofs | ranks | blocks, s | one by one, s | ratio | Krylov-Schur, s | ratio |")
    say("|---|---|---|---|---|---|---|")
    for name in arguments.sizes:
        say(measure(name, basis=arguments.basis))


def measure(name: str, *, basis: int) -> str:
    """A row of the table."""
    steel = solid_linear.Parameters(E=case.E, nu=case.NU, rho=case.RHO)
    ends = [Interface("start"), Interface("end")]
    mesh = meshes.beam(case.LENGTH, case.WIDTH, case.WIDTH, h=case.CELL_SIZE[name], degree=1, comm=comm)
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=ends)
    with body_statics(model, frame="start") as statics:
        start = np.asfortranarray(asymmetric_fields(model)[statics.mask])
        blocks = partial(block_lanczos, statics, statics.solve, start)
        one_by_one = partial(block_lanczos, statics, partial(by_columns, statics), start)
        rows = []
        exact = blocks()
        for _ in range(REPEATS):
            solver = prepared_krylov_schur(model, statics, basis=basis)
            took = [seconds(method, exact) for method in (blocks, one_by_one, partial(krylov_schur, solver))]
            rows.append(took)
            solver.destroy()
    ours, single, krylov = np.min(rows, axis=0)
    times = f"{ours:.3f} | {single:.3f} | {single / ours:.2f} | {krylov:.3f} | {krylov / ours:.2f}"
    return f"| {model.K.getSize()[0]} | {comm.size} | {times} |"


def seconds(method: Callable[[], np.ndarray], exact: np.ndarray) -> float:
    """How long a method takes; its eigenvalues must be the known ones."""
    comm.barrier()
    began = time.perf_counter()
    found = method()
    comm.barrier()
    took = time.perf_counter() - began
    assert abs(found / exact - 1.0).max() < 1e-8
    return took


def block_lanczos(
    statics: Statics, solve: Callable[[np.ndarray], np.ndarray], start: np.ndarray
) -> np.ndarray:
    return eigen.lowest_modes(solve, statics.M, start=start, count=COUNT).eigenvalues


def by_columns(statics: Statics, block: np.ndarray) -> np.ndarray:
    columns = [statics.solve(np.asfortranarray(block[:, [i]])) for i in range(block.shape[1])]
    return np.asfortranarray(np.hstack([block[:, :0], *columns]))


def prepared_krylov_schur(model: ContinuumModel, statics: Statics, *, basis: int) -> SLEPc.EPS:
    """Shift and invert at zero, with the factor made."""
    dofs = np.flatnonzero(statics.mask).astype(PETSc.IntType) + model.K.getOwnershipRange()[0]
    rows = PETSc.IS().createGeneral(dofs, comm=comm)
    stiffness = model.K.createSubMatrix(rows, rows)
    stiffness.setOption(PETSc.Mat.Option.SPD, True)
    solver = SLEPc.EPS().create(comm)
    solver.setOperators(stiffness, statics.M)
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setDimensions(COUNT, basis)
    solver.setTolerances(eigen.TOLERANCE, 100)
    solver.setTarget(0.0)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    transformation = solver.getST()
    transformation.setType(SLEPc.ST.Type.SINVERT)
    transformation.getKSP().setType(PETSc.KSP.Type.PREONLY)
    transformation.getKSP().getPC().setType(PETSc.PC.Type.CHOLESKY)
    transformation.getKSP().getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    solver.setUp()
    return solver


def krylov_schur(solver: SLEPc.EPS) -> np.ndarray:
    solver.solve()
    return np.sort([solver.getEigenvalue(i).real for i in range(COUNT)])


def say(text: str) -> None:
    if comm.rank == 0:
        print(text, flush=True)


if __name__ == "__main__":
    main()
