"""The modes by blocks, by SLEPc's Krylov-Schur and by spectrum slicing: the same, all of them, and counted."""

import functools
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse
from full_model import gather

from flexmbd import meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.continuum.contract import formulation
from flexmbd.continuum.matrices.eigen import BlockLanczos
from flexmbd.coupling import Coupling
from flexmbd.errors import ConvergenceError, ReductionError
from flexmbd.forms import solid_linear
from flexmbd.reduction import BlockMethod, KrylovSchur, Solver, SpectrumSlicing, Truncation, craig_bampton
from flexmbd.reduction.modes import fixed_modes, sturm
from flexmbd.reduction.modes.krylov_schur import KrylovSchurSearch
from flexmbd.reduction.modes.signs import asymmetric_fields
from flexmbd.reduction.modes.sturm import count_below
from flexmbd.reduction.modes.truncation import MOST
from flexmbd.reduction.static_shapes.body_statics import body_statics
from flexmbd.reduction.static_shapes.interior_stiffness import HeldFactor

pytestmark = pytest.mark.mpi

DATA = Path(__file__).parents[1] / "data"
STEEL = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7800.0)
RIGID, AVERAGED = Coupling.RIGID, Coupling.AVERAGED
METHODS = [BlockMethod(), KrylovSchur(), SpectrumSlicing()]


@functools.cache
def cube(*names, coupling=RIGID, form="solid_linear"):
    """Of three cells along each edge: most of its frequencies are double or threefold."""
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(3, 3, 3), degree=1)
    interfaces = [Interface(name, coupling=coupling) for name in names]
    chosen = formulation.load_form(form)
    parameters = STEEL if form == "solid_linear" else chosen.reference().parameters
    return ContinuumModel(mesh, chosen, parameters, degree=2, interfaces=interfaces)


def reduced(model, *, modes=14, **how):
    frame = model.interfaces[0].name if model.interfaces else None
    return craig_bampton(model, modes=modes, frame=frame, geometric_stiffness=False, **how)


@pytest.mark.parametrize("method", METHODS[1:], ids=["Krylov-Schur", "slicing"])
@pytest.mark.parametrize("names", [(), ("x_min",), ("x_min", "x_max")], ids=["free", "held", "two ends"])
def test_all_find_the_same(names, method):
    exact, found = (reduced(cube(*names), eigensolver=one) for one in (None, method))
    assert found.stiffness == pytest.approx(exact.stiffness, rel=1e-10)
    assert abs(found.gram - exact.gram).max() < 1e-7 * abs(exact.gram).max()
    assert found.provenance["completeness"].startswith("counted, ")
    assert (found.provenance["eigensolver"], exact.provenance["eigensolver"]) == (repr(method), "BlockMethod()")


@pytest.mark.parametrize("method", METHODS, ids=["blocks", "Krylov-Schur", "slicing"])
def test_by_frequency_and_by_tolerance(method):
    model = cube("x_min")
    below = Truncation(below_hz=2000.0)
    plain, ours = (craig_bampton(model, modes=below, frame="x_min", eigensolver=one) for one in (None, method))
    assert ours.stiffness[:6] == pytest.approx(plain.stiffness[:6], rel=1e-9)
    assert ours.provenance["fixed-interface modes"] == plain.provenance["fixed-interface modes"]
    # how many modes a tolerance takes depends on how many are known
    exact = craig_bampton(model, modes=150, frame="x_min", geometric_stiffness=False).frequencies()[:6]
    close = Truncation(tol=1e-2)
    found = craig_bampton(model, modes=close, frame="x_min", eigensolver=method, geometric_stiffness=False)
    assert found.n_modes < 100
    assert np.all(found.frequencies()[:6] ** 2 <= 1.01 * exact**2)


@pytest.mark.parametrize("method", METHODS[:2], ids=["blocks", "Krylov-Schur"])
def test_more_modes_below_a_frequency_than_are_looked_for_uncounted(method):
    """Two thirds of all the modes of a part: their number is counted first, and each is that of the dense pencil."""
    model = cube("x_min")
    exact = exact_eigenvalues("x_min")
    assert len(exact) > 700 > 600 > MOST
    n = 600 + int(np.argmax(exact[600:650] / exact[599:649]))
    below = float(np.sqrt(np.sqrt(exact[n - 1] * exact[n]))) / (2.0 * np.pi)
    with body_statics(model, frame="x_min") as statics:
        start = np.asfortranarray(asymmetric_fields(model)[statics.mask])
        found = fixed_modes.fixed_interface_modes(statics, Truncation(below_hz=below), start=start, eigensolver=method)
    assert found.count == n
    assert found.provenance["completeness"].startswith(f"counted, {n} below")
    bound = 10.0 * np.finfo(float).eps * np.maximum(exact[-1] / exact[:n], exact[:n] / exact[0])
    assert np.all(abs(found.modes.eigenvalues[:n] / exact[:n] - 1.0) <= bound)


def test_a_frequency_above_all_that_a_part_has():
    """Gives all modes there are; memory that does not suffice for them is told before they are looked for."""
    mesh = meshes.block(1.0, 0.8, 0.7, divisions=(2, 1, 1), cell="tetrahedron", degree=1)
    model = ContinuumModel(mesh, solid_linear, STEEL, degree=1, interfaces=[Interface("x_min")])
    body = craig_bampton(model, modes=Truncation(below_hz=1e9), frame="x_min", geometric_stiffness=False)
    dofs = MPI.COMM_WORLD.allreduce(model.n_owned)
    assert int(body.provenance["fixed-interface modes"]) == dofs - 12
    with pytest.raises(ReductionError, match=f"the interior has {dofs - 12} dofs"):
        craig_bampton(model, modes=dofs, frame="x_min")


@pytest.mark.parametrize("solver", [Solver.DIRECT, Solver.COMPRESSED])
def test_counts_in_the_place_of_the_factor(monkeypatch, solver):
    """Where two factors do not fit in memory the first is given up, and made again where it is needed."""
    model = cube("x_min")
    limits, released = iter([10**6, None]), []
    monkeypatch.setattr(sturm, "memory_limit", lambda comm: next(limits))
    original = HeldFactor.release
    monkeypatch.setattr(HeldFactor, "release", lambda self: (released.append(self), original(self)))
    with body_statics(model, frame="x_min", solver=solver) as statics:
        loads = np.ones((int(statics.mask.sum()), 1), order="F")
        before = statics.solve(loads)
        shift = float(np.sqrt(exact_eigenvalues("x_min")[3] * exact_eigenvalues("x_min")[4]))
        # a factor of so few dofs takes more than one MB
        assert count_below(statics, shift) == 4
        assert len(released) == 1
        assert statics.solve(loads) == pytest.approx(before, rel=1e-12)


def test_modes_below_a_frequency_that_do_not_fit_in_memory(monkeypatch):
    monkeypatch.setattr(fixed_modes, "memory_limit", lambda comm: 10**6)
    with pytest.raises(ReductionError, match=r"modes lie below 20000 Hz; .*MB are left: take a lower below_hz"):
        craig_bampton(cube("x_min"), modes=Truncation(below_hz=2e4), frame="x_min")


@functools.cache
def exact_eigenvalues(name):
    """By the flexibility, which has the low ones to the last digits, and the high ones to eps lambda / lambda_1."""
    k, m = held_pencil(cube(name))
    return 1.0 / scipy.linalg.eigh(m, k, eigvals_only=True)[::-1]


def held_pencil(model):
    """Stiffness and mass, dense, with all interfaces at rest: rigid ones node by node, others in the mean."""
    k, m = (gather(one).toarray() for one in (model.K, model.M))
    first = model.K.getOwnershipRange()[0]
    rows = []
    for one in model.interfaces:
        columns = np.zeros((len(k), 6 if hasattr(one, "average") else len(k)))
        own = one.dofs < model.n_owned
        dofs = one.dofs[own] + first
        if hasattr(one, "average"):
            columns[dofs] = one.average[own]
        else:
            columns[dofs, dofs] = 1.0
        rows.append(model.comm.allreduce(columns))
    held = np.hstack([np.zeros((len(k), 0)), *rows])
    free = scipy.linalg.null_space(held.T) if held.shape[1] else np.eye(len(k))
    return free.T @ k @ free, free.T @ m @ free


@pytest.mark.parametrize("form", ["solid_linear", "solid_mixed", "enhanced_strain"])
@pytest.mark.parametrize("coupling", [RIGID, AVERAGED])
@pytest.mark.parametrize("names", [(), ("x_min",), ("x_min", "x_max")], ids=["free", "one", "two"])
def test_counts_against_dense_eigenvalues(names, coupling, form):
    """Of unknowns without mass too, in which the energy is largest (pressures) or least (enhanced strains)."""
    enhanced = form == "enhanced_strain"
    cell, degree = ("hexahedron", 1) if enhanced else ("tetrahedron", 2)
    mesh = meshes.block(1.0, 0.8, 0.7, divisions=(2, 1, 1), cell=cell, degree=1)
    chosen = formulation.load_form(DATA / "enhanced_strain.py" if enhanced else form)
    interfaces = [Interface(name, coupling=coupling) for name in names]
    p = chosen.reference().parameters
    model = ContinuumModel(mesh, chosen, p, degree=degree, interfaces=interfaces, condense=False)
    k, m = held_pencil(model)
    massless = int(np.sum(~np.any(abs(m) > 1e-14 * abs(m).max(), axis=1)))
    assert (massless > 0) == (form != "solid_linear")
    if massless:
        # their own equations, without mass, are solved for them
        order = np.argsort(~np.any(abs(m) > 1e-14 * abs(m).max(), axis=1), kind="stable")
        k, m = k[np.ix_(order, order)], m[np.ix_(order, order)]
        n = len(k) - massless
        k, m = k[:n, :n] - k[:n, n:] @ np.linalg.solve(k[n:, n:], k[n:, :n]), m[:n, :n]
    exact = scipy.linalg.eigh(k, m, eigvals_only=True)[0 if names else 6 :]
    with body_statics(model, frame=names[0] if names else None) as statics:
        for i in (0, 3, 8):
            shift = 0.5 * (exact[i] + exact[i + 1]) if exact[i + 1] > 1.001 * exact[i] else None
            if shift is not None:
                assert count_below(statics, shift) == i + 1
        assert count_below(statics, 0.5 * exact[0]) == 0


@pytest.mark.parametrize("how", [8, Truncation(below_hz=400.0), Truncation(tol=1e-3)], ids=["number", "below", "tol"])
def test_a_bar_with_enhanced_strains(how):
    """Its bending is the beam's, less the shear of the second mode; counted as any body's is."""
    form = formulation.load_form(DATA / "enhanced_strain.py")
    material = form.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    mesh = meshes.block(1.0, 0.03, 0.02, divisions=(12, 1, 1), degree=1)
    model = ContinuumModel(mesh, form, material, degree=1, interfaces=[Interface("x_min")])
    body = craig_bampton(model, modes=how, frame="x_min", geometric_stiffness=False)
    found = body.frequencies(clamped=["x_min"])
    beam = 1.875104**2 / (2 * np.pi) * np.sqrt(2.1e11 / 12 / 7850.0)
    assert found[:2] == pytest.approx([0.02 * beam, 0.03 * beam], rel=0.01)
    assert body.provenance["completeness"].startswith("counted, ")
    if how == 8:
        # round-off of the condensed pencil beside its largest eigenvalue
        k, m = held_pencil(model)
        order = np.argsort(~np.any(abs(m) > 1e-14 * abs(m).max(), axis=1), kind="stable")
        n = int(np.sum(np.any(abs(m) > 1e-14 * abs(m).max(), axis=1)))
        k, m = k[np.ix_(order, order)], m[np.ix_(order, order)]
        k = k[:n, :n] - k[:n, n:] @ np.linalg.solve(k[n:, n:], k[n:, :n])
        exact = np.sqrt(1.0 / scipy.linalg.eigh(m[:n, :n], k, eigvals_only=True)[::-1][:4]) / (2 * np.pi)
        assert found[:4] == pytest.approx(exact, rel=1e-6)


class Careless(BlockLanczos):
    """A search that leaves out a mode until it is told that some are missing; or for ever."""

    learns = True

    def __init__(self, *arguments, **more):
        self.told = False
        super().__init__(*arguments, **more)

    @property
    def eigenvalues(self):
        return self._all if self.told and self.learns else np.delete(self._all, [3] if len(self._all) > 3 else [])

    @eigenvalues.setter
    def eigenvalues(self, values):
        self._all = values

    def modes(self, count):
        whole = super().modes(count + 1)
        if self.told and self.learns:
            return type(whole)(self._all[:count], whole.shapes[:, :count])
        return type(whole)(self.eigenvalues[:count], np.delete(whole.shapes, 3, axis=1)[:, :count])

    def search_below(self, eigenvalue, number):
        self.told = True
        super().search_below(eigenvalue, number)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")  # clusters seem to be others
def test_a_mode_that_was_left_out_is_found(monkeypatch):
    model = cube("x_min", "x_max")
    exact = reduced(model)
    monkeypatch.setattr(fixed_modes.eigen, "BlockLanczos", Careless)  # type: ignore[attr-defined]
    assert reduced(model).stiffness == pytest.approx(exact.stiffness, rel=1e-10)
    # nothing else tells
    wrong = reduced(model, modes=Truncation(14, complete=False))
    assert wrong.provenance["completeness"] == "not counted"
    n = min(len(wrong.stiffness), len(exact.stiffness))  # clusters seem to be others
    assert abs(wrong.stiffness[:n] / exact.stiffness[:n] - 1.0).max() > 0.01


def test_a_mode_that_stays_away_is_told(monkeypatch):
    monkeypatch.setattr(fixed_modes.eigen, "BlockLanczos", Careless)  # type: ignore[attr-defined]
    monkeypatch.setattr(Careless, "learns", False)
    with pytest.raises(ConvergenceError, match=r"found \d+ of \d+|are missing"):
        reduced(cube("x_min", "x_max"))


def springs(n, prefix):
    """A search on a cube of n^3 unit masses on springs, and its eigenvalues."""
    chain = scipy.sparse.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n))
    one = scipy.sparse.eye_array(n)
    kron = scipy.sparse.kron
    k = kron(kron(chain, one), one) + kron(kron(one, chain), one) + kron(kron(one, one), chain)
    along = 2.0 - 2.0 * np.cos(np.pi * np.arange(1, n + 1) / (n + 1))
    exact = np.sort((along[:, None, None] + along[None, :, None] + along[None, None, :]).reshape(-1))
    factor = scipy.sparse.linalg.splu(scipy.sparse.csc_matrix(k))
    mass = PETSc.Mat().createAIJ((n**3, n**3), nnz=1, comm=MPI.COMM_WORLD)
    for i in range(*mass.getOwnershipRange()):
        mass[i, i] = 1.0
    mass.assemble()
    own = slice(*mass.getOwnershipRange())

    def solve(block):
        return np.asfortranarray(factor.solve(np.concatenate(MPI.COMM_WORLD.allgather(block)))[own])

    start = np.random.default_rng(5).normal(size=(n**3, 1))[own]
    return KrylovSchurSearch(solve, solve, mass, start=start, size=n**3, prefix=prefix), exact


def test_what_krylov_schur_leaves_out_by_its_defaults():
    """Copies of threefold eigenvalues of a cube of springs, and none once they are looked for or the basis is large."""
    search, exact = springs(9, "by_default_")
    search.find(20)
    shift = 0.5 * (exact[19] + exact[20])
    assert search.count_below(shift) < 20
    search.search_below(shift, 20)
    assert search.eigenvalues[:20] == pytest.approx(exact[:20], rel=1e-10)
    options = PETSc.Options("with_more_")
    options["eps_ncv"] = 80
    search, _ = springs(9, "with_more_")
    search.find(20)
    assert search.eigenvalues[:20] == pytest.approx(exact[:20], rel=1e-10)
    options.delValue("eps_ncv")


def test_the_options_are_those_of_the_prefix():
    options = PETSc.Options("hasty_")
    options["eps_max_it"] = 1
    options["eps_ncv"] = 20
    try:
        with pytest.raises(ConvergenceError, match="take a larger basis, -hasty_eps_ncv"):
            reduced(cube("x_min"), eigensolver=KrylovSchur(prefix="hasty_"))
        assert reduced(cube("x_min"), eigensolver=KrylovSchur()).n_modes == 14
    finally:
        for name in ("eps_max_it", "eps_ncv"):
            options.delValue(name)


def test_without_a_factor_nothing_is_counted():
    model = cube("x_min", "x_max")
    exact = reduced(model, modes=2)
    for method in METHODS[:2]:
        body = reduced(model, modes=2, solver=Solver.ITERATIVE, eigensolver=method)
        assert body.provenance["completeness"].startswith("not counted, for there is no factor; searched again")
        assert body.stiffness == pytest.approx(exact.stiffness, rel=1e-9)
    with pytest.raises(ReductionError, match="spectrum slicing takes"):
        reduced(model, solver=Solver.ITERATIVE, eigensolver=SpectrumSlicing())


def test_bad_input():
    with pytest.raises(ReductionError, match="eigensolver must be BlockMethod"):
        reduced(cube("x_min"), eigensolver="slepc")
    with pytest.raises(ReductionError, match="spectrum slicing takes rigid interfaces"):
        reduced(cube("x_min", coupling=AVERAGED), eigensolver=SpectrumSlicing())
