"""A compressed factor, or multigrid, with conjugate gradients: the same records, and when they are taken."""

import resource
from pathlib import Path

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
from flexmbd.files.memory import available_memory
from flexmbd.forms import solid_linear, solid_mixed
from flexmbd.reduction import Solver, craig_bampton, guyan
from flexmbd.reduction.static_shapes import conjugate_gradients, factor, memory
from flexmbd.reduction.static_shapes.body_statics import body_statics

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

NAMES = {
    Solver.DIRECT: "direct",
    Solver.COMPRESSED: "compressed factor, conjugate gradients",
    Solver.ITERATIVE: "conjugate gradients, multigrid of the degrees",
}
# where there is no lower degree
ALGEBRAIC = "conjugate gradients, multigrid"


def difference(found, expected):
    return abs(found - expected).max(initial=0) / abs(expected).max(initial=1e-300)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("solver", "degree"), [(Solver.COMPRESSED, 1), (Solver.ITERATIVE, 1), (Solver.ITERATIVE, 2)])
def test_same_record_as_by_a_factor(case, solver, degree):
    couplings, frame = CASES[case]
    model = coupled(couplings, degree)
    exact, body = (
        craig_bampton(model, modes=2, frame=frame, geometric_stiffness=case == "attached", solver=one)
        for one in (Solver.DIRECT, solver)
    )
    assert exact.provenance["solver"] == "direct"
    assert body.provenance["solver"] == (ALGEBRAIC if (solver, degree) == (Solver.ITERATIVE, 1) else NAMES[solver])
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
    exact = found[0]
    size = abs(exact).max(axis=0)
    size[[3, 8]] = 1.0
    for u in found[1:]:
        assert not u[:, [3, 8]].any()
        assert (abs(u - exact).max(axis=0) / size).max() < 1e-11


def iterations(monkeypatch, divisions):
    """Of the static shapes of a block."""
    counts = []
    original = conjugate_gradients.ConjugateGradients._iterate

    def counted(self, *arguments, **named):
        x, count = original(self, *arguments, **named)
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
        monkeypatch.setattr(memory, "available_memory", lambda: size)


@pytest.mark.parametrize("rank", [None, 0, COMM.size - 1])
def test_the_quickest_solver_that_fits_in_memory(monkeypatch, rank):
    """A factor of so few dofs is not smaller when compressed; and none is begun in vain."""
    model = block(solid_linear, STEEL, (9, 5, 5))
    assert solver_of(model) == NAMES[Solver.DIRECT]
    beside = memory.workspace(model, shapes=18, modes=0)
    for room, chosen in ((100e6, Solver.DIRECT), (1.02 * memory.multigrid_memory(model), Solver.ITERATIVE)):
        has_memory(monkeypatch, int((room + beside) / memory._SHARE), rank=rank)
        assert solver_of(model) == NAMES[chosen]
    with pytest.raises(ReductionError, match=r"would take \d+ MB, and \d+ MB are available.*Solver.COMPRESSED or"):
        guyan(model, frame="x_min", solver=Solver.DIRECT)
    has_memory(monkeypatch, int(beside), rank=rank)
    with pytest.raises(ReductionError, match=r"multigrid .* take \d+ MB, and 0 MB are available.*take fewer modes"):
        guyan(model, frame="x_min")


def reserved():
    """Bytes of this process's addresses, touched or not."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def test_a_factor_reserves_no_more_than_its_size_asks(monkeypatch):
    """What is reserved beyond the computer's memory keeps a process from forking, though nothing of it is touched."""
    has_memory(monkeypatch, 20 * 10**9)
    model = block(solid_linear, STEEL, (9, 5, 5))
    before = reserved()
    guyan(model, frame="x_min", geometric_stiffness=False)
    assert reserved() - before < 10**9


def test_a_factor_that_wants_more_than_most_gets_it(monkeypatch):
    model = block(solid_linear, STEEL, (9, 5, 5))
    usual = guyan(model, frame="x_min", geometric_stiffness=False)
    tried = []
    monkeypatch.setattr(factor, "_allowances", lambda dofs, limit: tried.append(limit) or [2 * 10**6, limit])
    body = guyan(model, frame="x_min", geometric_stiffness=False)
    assert tried
    np.testing.assert_allclose(body.stiffness, usual.stiffness, rtol=1e-10)


def test_where_the_memory_is_not_known_a_factor_is_made(monkeypatch):
    has_memory(monkeypatch, None)
    assert solver_of(coupled({"root": RIGID, "tip": RIGID}, 1)) == "direct"


def test_memory_that_is_left():
    left = available_memory()
    assert left is None or 2**20 < left < 2**50
    limit = memory.memory_limit(COMM)
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
    with pytest.raises(ConvergenceError, match=r"left a residual of .* after 4 iterations, bound 1e-10"):
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
    every = "Solver.DIRECT, Solver.COMPRESSED, Solver.ITERATIVE or None"
    with pytest.raises(ReductionError, match=rf"must be {every}, got 'iterative'"):
        craig_bampton(model, modes=1, frame="root", solver="iterative")
    if COMM.size > 1:
        with pytest.raises(ReductionError, match=r"solver is .*DIRECT.* on rank 0 and .*ITERATIVE.* on rank 1"):
            craig_bampton(
                model, modes=1, frame="root", solver=Solver.ITERATIVE if COMM.rank == 1 else Solver.DIRECT
            )
