"""The block Lanczos method against dense solutions, SLEPc, and eigenvalues that are known."""

from mpi4py import MPI
from petsc4py import PETSc
from slepc4py import SLEPc

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
import scipy.sparse.linalg

from flexmbd.continuum.matrices.eigen import BlockLanczos, lowest_modes
from flexmbd.errors import ConvergenceError


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
def test_more_modes_than_there_are():
    k, m, _ = graded(14)
    with pytest.raises(ConvergenceError, match="found 14 of 15 "):
        solve(k, m, start=random_start(14), count=15)


@pytest.mark.mpi
def test_start_inside_an_invariant_space():
    """Two eigenvectors, exact to the bit: nothing leads out of them but fresh directions."""
    k, m = np.diag(np.arange(1.0, 31.0)), np.eye(30)
    eigenvalues, shapes = solve(k, m, start=m[:, [0, 3]], count=6)
    assert eigenvalues == pytest.approx(np.arange(1.0, 7.0), rel=1e-12)
    assert abs(abs(shapes[:6]) - np.eye(6)).max() < 1e-9


@pytest.mark.mpi
@pytest.mark.parametrize("count", [5, 13, 14, 30])
def test_more_copies_than_start_vectors(count):
    """Thirteen blades on one hub: the start block of four finds four copies of each mode by itself."""
    k, m, exact = graded(12)
    blades = scipy.sparse.eye_array(13)
    found, _ = solve(
        scipy.sparse.kron(blades, k),
        scipy.sparse.kron(blades, m),
        start=random_start(13 * 12),
        count=count,
        limit=156,
    )
    assert found == pytest.approx(np.repeat(exact, 13)[:count], rel=1e-10)


@pytest.mark.mpi
def test_copies_that_differ_a_little():
    """Nine blades, their eigenvalues some 1e-10 apart: the start block does not take them for equal."""
    k, m, exact = graded(12)
    scale = 1.0 + 3e-10 * np.arange(9)
    found, _ = solve(
        scipy.sparse.kron(scipy.sparse.diags_array(scale), k),
        scipy.sparse.kron(scipy.sparse.eye_array(9), m),
        start=random_start(9 * 12),
        count=11,
        limit=108,
    )
    assert found == pytest.approx(np.sort(np.outer(exact, scale).reshape(-1))[:11], rel=2e-11)


def saddle_point(n, constraints, compliance):
    """Stiffness and mass of n displacements under linear constraints, with a multiplier for each.

    Also the eigenvalues, by the displacements' flexibility; of rigid constraints on their null space.
    """
    k, m, _ = graded(n)
    b = np.random.default_rng(11).normal(size=(constraints, n))
    whole = np.block([[k, b.T], [b, -compliance * np.eye(constraints)]])
    mass = scipy.linalg.block_diag(m, np.zeros((constraints, constraints)))
    if compliance > 0.0:
        flexibility = np.linalg.inv(whole)[:n, :n]
        root = np.linalg.cholesky(m)
        return whole, mass, np.sort(1.0 / np.linalg.eigvalsh(root.T @ flexibility @ root))
    z = scipy.linalg.null_space(b)
    return whole, mass, scipy.linalg.eigh(z.T @ k @ z, z.T @ m @ z, eigvals_only=True)


@pytest.mark.mpi
@pytest.mark.parametrize("compliance", [0.0, 1e-9, 1e-2])
@pytest.mark.parametrize("count", [3, 22])
def test_rows_without_mass(compliance, count):
    """A saddle point, as of a body with its pressure: an indefinite K and a semidefinite M."""
    k, m, exact = saddle_point(30, 8, compliance)
    eigenvalues, shapes = solve(k, m, start=random_start(38), count=count, limit=38)
    assert eigenvalues == pytest.approx(exact[:count], rel=1e-8)
    assert abs(shapes.T @ m @ shapes - np.eye(count)).max() < 1e-10
    # the multipliers as well
    residual = k @ shapes - m @ shapes * eigenvalues
    assert np.linalg.norm(residual) < 1e-8 * np.linalg.norm(k @ shapes)


@pytest.mark.mpi
def test_fewer_modes_than_rows_with_mass():
    """All there are on the null space of eight rigid constraints."""
    k, m, _ = saddle_point(30, 8, 0.0)
    with pytest.raises(ConvergenceError, match="found 22 of 23 "):
        solve(k, m, start=random_start(38), count=23)


def process(k, m, *, start, limit):
    """A process, and how many columns it has solved for."""
    mass = to_petsc(m)
    own = slice(*mass.getOwnershipRange())
    factor = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(k))
    solved = []

    def inverse(block):
        solved.append(block.shape[1])
        return factor.solve(np.concatenate(MPI.COMM_WORLD.allgather(block)))[own]

    start = np.asfortranarray(start[own])
    return BlockLanczos(inverse, mass, start=start, limit=limit), solved, own


@pytest.mark.mpi
def test_process_goes_on_where_it_stood():
    k, exact = laplacian(9)
    lanczos, solved, own = process(k, scipy.sparse.eye_array(729), start=random_start(729), limit=600)
    for count in (4, 9, 9, 30):
        lanczos.find(count)
        assert lanczos.eigenvalues[:count] == pytest.approx(exact[:count], rel=1e-11)
    in_parts = sum(solved)
    once, solved, _ = process(k, scipy.sparse.eye_array(729), start=random_start(729), limit=600)
    once.find(30)
    assert in_parts == sum(solved)
    # products with the modes without the modes
    block = np.random.default_rng(2).normal(size=(729, 3))[own]
    shapes = lanczos.modes(30).shapes
    expected = MPI.COMM_WORLD.allreduce(block.T @ shapes)
    assert abs(lanczos.products(block, 30) - expected).max() < 1e-12


@pytest.mark.mpi
@pytest.mark.parametrize("bound", [0.05, 0.3, 0.9, 1.4, 2.0])
def test_all_modes_up_to_an_eigenvalue(bound):
    """As many as Sylvester's law of inertia counts."""
    k, exact = laplacian(9)
    lanczos, _, _ = process(k, scipy.sparse.eye_array(729), start=random_start(729), limit=600)
    lanczos.find_beyond(bound, most=400)
    _, d, _ = scipy.linalg.ldl(k.toarray() - bound * np.eye(729))
    inertia = int(np.sum(np.linalg.eigvalsh(d) < 0.0))
    assert int(np.sum(lanczos.eigenvalues < bound)) == inertia == int(np.sum(exact < bound))
    assert lanczos.eigenvalues[-1] > bound
    assert lanczos.count_below(bound) <= inertia


@pytest.mark.mpi
def test_too_many_modes_below_an_eigenvalue():
    """Known from the Ritz values, long before the modes have converged."""
    k, _ = laplacian(9)
    lanczos, solved, _ = process(k, scipy.sparse.eye_array(729), start=random_start(729), limit=600)
    lanczos.find_beyond(20.0, most=40)
    assert lanczos.count_below(20.0) > 40
    assert sum(solved) <= 60


@pytest.mark.mpi
def test_large_basis():
    """Several panels of stored vectors, and the modes looked for now and then only."""
    k, exact = laplacian(9)
    eigenvalues, shapes = solve(
        k, scipy.sparse.eye_array(729), start=random_start(729, width=8), count=150
    )
    assert eigenvalues == pytest.approx(exact[:150], rel=1e-10)
    assert abs(shapes.T @ shapes - np.eye(150)).max() < 1e-11


@pytest.mark.mpi
def test_no_modes():
    k, m, _ = graded(10)
    eigenvalues, shapes = solve(k, m, start=random_start(10), count=0)
    assert eigenvalues.shape == (0,)
    assert shapes.shape == (10, 0)
