"""The block Lanczos method against dense solutions, SLEPc, and eigenvalues that are known."""

from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

from flexmbd.errors import ConvergenceError
from flexmbd.reduction.eigen import lowest_modes


def to_petsc(matrix):
    """A matrix that every rank has in full, spread by rows."""
    matrix = scipy.sparse.csr_array(matrix)
    spread = PETSc.Mat().create(MPI.COMM_WORLD)
    spread.setSizes(matrix.shape)
    spread.setType(PETSc.Mat.Type.AIJ)
    spread.setUp()
    first, last = spread.getOwnershipRange()
    rows = matrix[first:last]
    csr = (rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data)
    return PETSc.Mat().createAIJ(
        ((last - first, None), (last - first, None)), csr=csr, comm=MPI.COMM_WORLD
    )


def solve(k, m, *, start, **arguments):
    """The lowest modes, with the shapes gathered to (n, count) on every rank."""
    mass = to_petsc(m)
    own = slice(*mass.getOwnershipRange())
    factor = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(k))

    def inverse(block):
        return factor.solve(np.concatenate(MPI.COMM_WORLD.allgather(block)))[own]

    found = lowest_modes(inverse, mass, start=np.asfortranarray(start[own]), **arguments)
    return found.eigenvalues, np.concatenate(MPI.COMM_WORLD.allgather(found.shapes))


def random_start(n, width=4):
    return np.random.default_rng(5).normal(size=(n, width))


def laplacian(n):
    """Stiffness of a cube of n^3 unit masses on springs, and its eigenvalues, many of them equal."""
    chain = scipy.sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    one = scipy.sparse.eye_array(n)
    cube = sum(
        scipy.sparse.kron(scipy.sparse.kron(a, b), c)
        for a, b, c in ((chain, one, one), (one, chain, one), (one, one, chain))
    )
    along = 2.0 - 2.0 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))
    every = along[:, None, None] + along[None, :, None] + along[None, None, :]
    return cube.tocsr(), np.sort(every.reshape(-1))


def graded(n):
    """A dense stiffness and mass with eigenvalues over four decades, known to twelve digits."""
    root = np.eye(n) + 0.2 * np.random.default_rng(3).normal(size=(n, n)) / np.sqrt(n)
    eigenvalues = np.geomspace(1.0, 1e4, n)
    return root.T @ (eigenvalues[:, None] * root), root.T @ root, eigenvalues


@pytest.mark.mpi
@pytest.mark.parametrize("count", [1, 7, 20])
def test_eigenvalues_and_shapes(count):
    k, m, exact = graded(60)
    eigenvalues, shapes = solve(k, m, start=random_start(60), count=count)
    assert eigenvalues == pytest.approx(exact[:count], rel=1e-10)
    assert abs(shapes.T @ m @ shapes - np.eye(count)).max() < 1e-11
    residual = k @ shapes - m @ shapes * eigenvalues
    assert np.linalg.norm(residual) < 1e-9 * np.linalg.norm(k @ shapes)


@pytest.mark.mpi
def test_all_modes_of_a_small_problem():
    k, m, exact = graded(14)
    eigenvalues, shapes = solve(k, m, start=random_start(14), count=14)
    assert eigenvalues == pytest.approx(exact, rel=1e-9)
    assert abs(shapes.T @ m @ shapes - np.eye(14)).max() < 1e-10


def slepc_eigenvalues(k, m, count):
    """Krylov-Schur from one start vector."""
    solver = SLEPc.EPS().create(MPI.COMM_WORLD)
    solver.setOperators(to_petsc(k), to_petsc(m))
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setDimensions(count)
    solver.setTolerances(1e-12, 500)
    transformation = solver.getST()
    transformation.setType(SLEPc.ST.Type.SINVERT)
    transformation.getKSP().setType(PETSc.KSP.Type.PREONLY)
    transformation.getKSP().getPC().setType(PETSc.PC.Type.CHOLESKY)
    transformation.getKSP().getPC().setFactorSolverType(PETSc.Mat.SolverType.MUMPS)
    solver.setTarget(0.0)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.solve()
    return np.sort([solver.getEigenvalue(i).real for i in range(count)])


@pytest.mark.mpi
def test_slepc_finds_the_same_where_no_eigenvalues_are_equal():
    k, m, _ = graded(60)
    found, _ = solve(k, m, start=random_start(60), count=10)
    assert found == pytest.approx(slepc_eigenvalues(k, m, 10), rel=1e-10)


@pytest.mark.mpi
@pytest.mark.parametrize("count", [4, 7, 16, 20, 40])
def test_all_copies_of_equal_eigenvalues(count):
    """Threefold ones, where Krylov-Schur from one vector leaves copies out without a word."""
    k, exact = laplacian(9)
    found, _ = solve(k, scipy.sparse.eye_array(729), start=random_start(729), count=count)
    assert found == pytest.approx(exact[:count], rel=1e-11)


@pytest.mark.mpi
def test_start_block_of_deficient_rank():
    k, m, exact = graded(40)
    start = random_start(40)
    start[:, 2] = start[:, 0] - start[:, 1]
    start[:, 3] = 0.0
    eigenvalues, shapes = solve(k, m, start=start, count=6)
    assert eigenvalues == pytest.approx(exact[:6], rel=1e-10)
    assert abs(shapes.T @ m @ shapes - np.eye(6)).max() < 1e-11


@pytest.mark.mpi
def test_limit_is_reached():
    k, m, _ = graded(60)
    with pytest.raises(
        ConvergenceError, match=r"found [0-9] of 10 .* in 4 steps and 16 vectors; .*fewer modes"
    ):
        solve(k, m, start=random_start(60), count=10, limit=19)


@pytest.mark.mpi
def test_start_inside_an_invariant_space_is_not_taken_for_all():
    """Two eigenvectors, exact to the bit: nothing leads out of them, and no mode is made up."""
    k, m = np.diag(np.arange(1.0, 31.0)), np.eye(30)
    with pytest.raises(ConvergenceError, match=r"found 2 of 4 .* in 1 steps and 2 vectors"):
        solve(k, m, start=m[:, [0, 3]], count=4)


@pytest.mark.mpi
def test_no_modes():
    k, m, _ = graded(10)
    eigenvalues, shapes = solve(k, m, start=random_start(10), count=0)
    assert eigenvalues.shape == (0,)
    assert shapes.shape == (10, 0)
