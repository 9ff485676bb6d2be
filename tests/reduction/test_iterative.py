"""Conjugate gradients with multigrid in the place of a factor: the same records, and when they are taken."""

from mpi4py import MPI

import numpy as np
import pytest
from bracket import INTERFACES, bracket

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.compat import cell_nodes
from flexmbd.continuum.grid import tagged_mesh
from flexmbd.errors import ConvergenceError, ReductionError
from flexmbd.forms import solid_linear, solid_mixed
from flexmbd.reduction import Solver, craig_bampton, guyan
from flexmbd.reduction.static_shapes import conjugate_gradients, factor
from flexmbd.reduction.static_shapes.statics import body_statics

pytestmark = pytest.mark.mpi

COMM = MPI.COMM_WORLD
RIGID, AVERAGED = fm.Coupling.RIGID, fm.Coupling.AVERAGED
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)


def coupled(couplings, degree):
    """The bracket with some of its interfaces."""
    return bracket(
        interfaces=[
            Interface(name, INTERFACES[name].origin, INTERFACES[name].axes, coupling)
            for name, coupling in couplings.items()
        ],
        degree=degree,
    )


CASES = {
    "attached": ({"root": RIGID, "tip": RIGID}, "root"),
    "floating": ({"root": RIGID, "tip": AVERAGED, "pad": RIGID}, None),
    "averaged": ({"tip": AVERAGED, "root": AVERAGED}, "tip"),
    "free": ({}, None),
}


def difference(found, expected):
    return abs(found - expected).max(initial=0) / abs(expected).max(initial=1e-300)


@pytest.mark.parametrize("case", CASES)
def test_same_record_as_by_a_factor(case):
    couplings, frame = CASES[case]
    model = coupled(couplings, 1)
    exact, body = (
        craig_bampton(model, modes=2, frame=frame, geometric_stiffness=case == "attached", solver=solver)
        for solver in (Solver.DIRECT, Solver.ITERATIVE)
    )
    assert exact.provenance["solver"] == "direct"
    assert body.provenance["solver"] == "conjugate gradients, multigrid"
    assert body.stiffness == pytest.approx(exact.stiffness, rel=1e-10)
    assert difference(body.gram, exact.gram) < 1e-10
    if case == "attached":
        assert difference(body.geometric.K, exact.geometric.K) < 1e-9
    for one, other in zip(body.interfaces, exact.interfaces, strict=True):
        assert difference(one.modes, other.modes) < 1e-9
    mine = body.stiffness.tobytes() + body.gram.tobytes()
    assert all(other == mine for other in COMM.allgather(mine))


def test_loads_of_any_number_and_of_nothing():
    model = coupled({"root": RIGID}, 1)
    loads = np.random.default_rng(COMM.rank).normal(size=(model.n_owned, 19))
    loads[:, [3, 8]] = 0.0
    # what differs by powers of ten is solved for to the same number of digits
    loads[:, 5] *= 1e9
    loads[:, 6] *= 1e-9
    found = []
    for solver in Solver:
        with body_statics(model, frame="root", solver=solver) as statics:
            found.append(np.vstack(COMM.allgather(statics.static_response(loads))))
    exact, u = found
    assert not u[:, [3, 8]].any()
    size = abs(exact).max(axis=0)
    size[[3, 8]] = 1.0
    assert (abs(u - exact).max(axis=0) / size).max() < 1e-11


def iterations(monkeypatch, divisions):
    """Of the static shapes of a block."""
    counts = []
    original = conjugate_gradients.ConjugateGradients._iterate

    def counted(self, loads, size):
        x, count = original(self, loads, size)
        counts.append(count)
        return x, count

    monkeypatch.setattr(conjugate_gradients.ConjugateGradients, "_iterate", counted)
    mesh = meshes.block(1.0, 0.2, 0.3, divisions=divisions)
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])
    guyan(model, frame="x_min", geometric_stiffness=False, solver=Solver.ITERATIVE)
    monkeypatch.undo()
    return max(counts)


def test_iterations_do_not_grow_with_the_mesh(monkeypatch):
    """Eight times the cells; one-level methods need twice as many iterations."""
    coarse, fine = (iterations(monkeypatch, divisions) for divisions in ((10, 2, 3), (20, 4, 6)))
    assert fine <= 1.35 * coarse
    assert fine < 40


def block(form, parameters, divisions):
    mesh = meshes.block(0.9, 0.4, 0.4, divisions=divisions, cell="tetrahedron")
    return ContinuumModel(mesh, form, parameters, degree=2, interfaces=[Interface("x_min")])


def solver_of(model):
    """What takes the place of None."""
    return guyan(model, frame=model.interfaces[0].name, geometric_stiffness=False).provenance["solver"]


def has_memory(monkeypatch, size, *, rank=None):
    """Let the computer have so many bytes left, or that rank's."""
    if rank is None or rank == COMM.rank:
        monkeypatch.setattr(factor, "available_memory", lambda: size)


@pytest.mark.parametrize("rank", [None, 0, COMM.size - 1])
def test_without_memory_for_a_factor_it_iterates(monkeypatch, rank):
    model = block(solid_linear, STEEL, (7, 4, 4))
    assert solver_of(model) == "direct"
    # of which a part of 0.7, but at least 1 MB for each rank
    has_memory(monkeypatch, 2 * 10**6, rank=rank)
    assert solver_of(model) == "conjugate gradients, multigrid"
    with pytest.raises(ReductionError, match=r"would take \d+ MB, and \d MB are there.*solver=Solver.ITERATIVE"):
        guyan(model, frame="x_min", solver=Solver.DIRECT)


def test_where_the_memory_is_not_known_a_factor_is_made(monkeypatch):
    has_memory(monkeypatch, None)
    assert solver_of(coupled({"root": RIGID, "tip": RIGID}, 1)) == "direct"


def test_memory_that_is_left():
    left = factor.available_memory()
    assert left is None or 2**20 < left < 2**50
    limit = factor.memory_limit(COMM)
    assert all(other == limit for other in COMM.allgather(limit))


def test_pressures_need_a_factor(monkeypatch):
    rubber = solid_mixed.Parameters(E=1e6, nu=0.49, rho=1000.0)
    model = block(solid_mixed, rubber, (5, 3, 3))
    with pytest.raises(ReductionError, match=r"solid_mixed is not positive definite.*solver=Solver.DIRECT"):
        craig_bampton(model, modes=1, frame="x_min", solver=Solver.ITERATIVE)
    assert solver_of(model) == "direct"
    has_memory(monkeypatch, 2 * 10**6)
    with pytest.raises(ReductionError, match="would take"):
        craig_bampton(model, modes=1, frame="x_min")


def test_no_convergence_says_what_is_left(monkeypatch):
    monkeypatch.setattr(conjugate_gradients, "_ITERATIONS", 4)
    monkeypatch.setattr(conjugate_gradients, "_STARTS", 2)
    model = coupled({"root": RIGID, "tip": RIGID}, 2)
    with pytest.raises(ConvergenceError, match=r"left a residual of .* after 8 iterations, bound 1e-10"):
        craig_bampton(model, modes=2, frame="root", solver=Solver.ITERATIVE)


def test_a_loose_piece_is_refused(monkeypatch):
    """Beside one that an interface holds."""
    monkeypatch.setattr(tagged_mesh, "check_connected", lambda mesh: None)
    source = meshes.block(0.3, 0.1, 0.1, divisions=(3, 1, 1), comm=MPI.COMM_SELF).mesh
    points, cells = source.geometry.x, cell_nodes(source)
    mesh = tagged_mesh.from_arrays(
        COMM,
        np.vstack([points, points + np.array([0.0, 1.0, 0.0])]),
        np.vstack([cells, cells + len(points)]),
        cell="hexahedron",
        degree=1,
        facet_groups={"foot": lambda x: (x[0] < 1e-9) & (x[1] < 0.5)},
    )
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=[Interface("foot")])
    with pytest.raises((ReductionError, ConvergenceError), match="connected to no interface"):
        craig_bampton(model, modes=2, frame="foot", solver=Solver.ITERATIVE)


def test_solvers_that_are_none():
    model = coupled({"root": RIGID}, 1)
    with pytest.raises(ReductionError, match=r"must be Solver.DIRECT, Solver.ITERATIVE or None, got 'iterative'"):
        craig_bampton(model, modes=1, frame="root", solver="iterative")
    if COMM.size > 1:
        with pytest.raises(ReductionError, match=r"solver is .*DIRECT.* on rank 0 and .*ITERATIVE.* on rank 1"):
            craig_bampton(
                model, modes=1, frame="root", solver=Solver.ITERATIVE if COMM.rank == 1 else Solver.DIRECT
            )
