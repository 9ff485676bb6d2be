"""Laws that are compiled functions of a point: against forms in UFL and closed forms, alone and in a machine."""

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg
from von_mises_law import STATE, STEEL, Metal, energies, von_mises

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    StrainMeasure,
    check_form,
    follow,
    law_form,
    prescribed_dofs,
)
from flexmbd.continuum.laws.logarithmic_strain import logarithmic_strain, pulled_back, tensor_of_strain
from flexmbd.errors import ConvergenceError, FormulationError
from flexmbd.forms import j2_plasticity as j2

COMM = MPI.COMM_WORLD
J2 = j2.Parameters(
    E=STEEL.E, nu=STEEL.nu, rho=STEEL.rho, yield_stress=STEEL.yield_stress,
    hardening=j2.LinearHardening(STEEL.hardening),
)  # fmt: skip
SIZE = 0.1


@cache
def form(strain=StrainMeasure.SMALL):
    return law_form(
        von_mises, Metal, trial=STEEL, state=STATE, strain=strain, energies=energies,
        scaled_yield=lambda p, factor: replace(p, yield_stress=factor * p.yield_stress),
    )  # fmt: skip


def block(formulation, parameters, *, comm=MPI.COMM_SELF, divisions=(1, 1, 1), ends=()):
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=divisions, comm=comm)
    interfaces = [Interface(name) for name in ends]
    return NonlinearModel(mesh, formulation, parameters, degree=1, interfaces=interfaces, cell_means=False)


@pytest.mark.parametrize("strain", [StrainMeasure.SMALL, StrainMeasure.LOGARITHMIC])
def test_the_suite_passes_it(strain):
    sheet = check_form(form(strain), comm=MPI.COMM_SELF)
    assert sheet.passed, sheet.text()
    verdicts = {line.name: line.verdict.value for line in sheet.results}
    asked = ["a history is kept", "dissipation", "consistent tangent, yielding", "unloading"]
    assert [verdicts[name] for name in asked] == ["PASS"] * 4
    assert verdicts["frame indifference, yielding"] == ("SKIP" if strain is StrainMeasure.SMALL else "PASS")


def check_same(ours, theirs):
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-11 * abs(theirs).max())


def test_a_path_of_small_strain_is_that_of_the_form_in_ufl():
    ours, theirs = block(form(), STEEL, divisions=(2, 2, 1)), block(j2, J2, divisions=(2, 2, 1))
    random = np.random.default_rng(3)
    for _ in range(6):
        step = random.uniform(-1, 1, ours.layout.n_local) * 4e-4 * SIZE
        check_same(ours.force(step), theirs.force(step))
        check_same(*(body.tangent(step).convert("aij").getValuesCSR()[2] for body in (ours, theirs)))
        ours.commit(step)
        theirs.commit(step)
        assert ours.energies() == pytest.approx(theirs.energies(), rel=1e-11)
        check_same(ours.stress()[0], theirs.stress()[0])
    assert theirs.history()[0][:, 6].min() > 0.0
    np.testing.assert_allclose(ours.history()[0][:, -1], theirs.history()[0][:, 6], rtol=1e-10)


def test_a_bar_pulled_far_follows_its_law_in_logarithmic_strain():
    """Kirchhoff's stress is T = E_t (h - sy/E) + sy at the logarithmic strain h, that across -(h - T/E)/2 - nu T/E."""
    body = block(form(StrainMeasure.LOGARITHMIC), STEEL)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z", "x_max": "x"})
    pulled = (held % 3 == 0) & (body.layout.node_x[held // 3, 0] > 0.5 * SIZE)
    path = follow(body, np.linspace(0.1, 1.0, 10), prescribed=held, displacement=lambda t: 0.6 * SIZE * t * pulled)
    h, p = np.log(1.6), STEEL
    rate = p.E * p.hardening / (p.E + p.hardening)
    stress = p.yield_stress + rate * (h - p.yield_stress / p.E)
    across = -(h - stress / p.E) / 2 - p.nu * stress / p.E
    force = stress * np.exp(2 * across) / np.exp(h + 2 * across) * SIZE**2
    assert path.steps[-1].reactions[pulled].sum() == pytest.approx(force, rel=1e-9)
    cauchy = body.stress()[0].reshape(-1, 3, 3)
    np.testing.assert_allclose(cauchy[:, 0, 0], stress / np.exp(h + 2 * across), rtol=1e-9)
    assert max(len(step.residuals) for step in path.steps) <= 9


def test_the_logarithmic_strain_and_its_derivatives():
    """Against scipy's logarithm and differences, with eigenvalues apart, two equal, and all equal."""
    tangent = np.diag(np.arange(1.0, 7.0))

    def answer(strain):
        own, squares, vectors = logarithmic_strain(strain)
        return own, *pulled_back(tangent @ own, tangent, squares, vectors)

    cases = [[0.1, -0.05, 0.2, 0.1, -0.2, 0.05], [0.2, 0.2, -0.1, 0.0, 0.0, 0.0], [0.3, 0.3, 0.3, 0.0, 0.0, 0.0]]
    for strain in map(np.array, cases):
        own, stress, slopes = answer(strain)
        logarithm = scipy.linalg.logm(np.eye(3) + 2 * tensor_of_strain(strain)) / 2
        np.testing.assert_allclose(tensor_of_strain(own), logarithm, atol=1e-14)
        # work: stress is the derivative of the law's energy, and the slopes that of the stress
        steps = 1e-5 * np.eye(6)
        energy = [(answer(strain + e)[0] ** 2 - answer(strain - e)[0] ** 2) @ np.arange(1.0, 7.0) / 4e-5 for e in steps]
        np.testing.assert_allclose(stress, energy, atol=1e-9)
        changes = [(answer(strain + e)[1] - answer(strain - e)[1]) / 2e-5 for e in steps]
        np.testing.assert_allclose(slopes, np.transpose(changes), atol=1e-8)


def test_trial_and_revert_leave_no_trace():
    body, other = block(form(), STEEL), block(form(), STEEL)
    steps = 1e-3 * SIZE * np.random.default_rng(1).uniform(-1, 1, (3, body.layout.n_local))
    for one in (body, other):
        one.commit(steps[0])
    body.force(steps[1])
    body.tangent(-steps[1])
    body.revert()
    for one in (body, other):
        one.commit(steps[2])
    np.testing.assert_array_equal(body.history()[0], other.history()[0])


def swing(formulation, parameters, *, comm=COMM, kind=ImplicitContinuum):
    """A bar that hangs on a hinge and is thrown about it: its root yields."""
    mesh = meshes.block(0.2, 0.02, 0.02, divisions=(6, 1, 1), comm=comm)
    body = NonlinearModel(
        mesh, formulation, parameters, degree=1, interfaces=[Interface("x_min"), Interface("x_max")], cell_means=False
    )
    scene = fm.System(gravity=(0.0, 0.0, -9.81), team=MpiTeam(comm))
    ball = fm.RigidBody(2.0, 1e-3 * np.ones(3))
    bar = scene.add(fm.ContinuumBody(kind(body, rigid_parts={"x_max": ball})), name="bar")
    hinge = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), bar.frame("x_min"))
    hinge.velocity = 40.0
    scene.add_force(fm.force.JointStop(hinge, lower=-10.0, upper=0.01, stiffness=2e5, transition=1e-3))
    return scene, bar


@pytest.mark.parametrize("kind", [ImplicitContinuum, ExplicitContinuum])
@pytest.mark.mpi
def test_in_a_machine_it_moves_as_the_form_in_ufl(kind, tmp_path):
    how = {"integrator": fm.GeneralizedAlpha(rho=0.9), "h": 2e-5} if kind is ImplicitContinuum else {}
    t_end = 6e-4 if kind is ImplicitContinuum else 1e-4
    runs = []
    for formulation, parameters in ((form(), STEEL), (j2, J2)):
        scene, bar = swing(formulation, parameters, kind=kind)
        file = COMM.bcast(tmp_path) / f"{formulation.__name__}.h5"
        run = scene.simulate(t_end, recording=fm.Recording(file, every=t_end / 4), **how)
        runs.append((run.position(bar.frame("x_max")), run.recorded(bar).values("plastic_strain", row=-1)))
    (ours, our_strain), (theirs, their_strain) = runs
    assert len(ours) == len(theirs)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)
    np.testing.assert_allclose(our_strain, their_strain, rtol=0, atol=1e-6 * their_strain.max())
    if kind is ImplicitContinuum:
        assert their_strain.max() > 1e-4


def test_a_restart_is_the_same_to_the_bit():
    scene, bar = swing(form(StrainMeasure.LOGARITHMIC), STEEL, comm=MPI.COMM_SELF)
    how = {"integrator": fm.GeneralizedAlpha(rho=0.9), "h": 4e-5}
    run = scene.simulate(6e-4, checkpoints=[3e-4], **how)
    again, same = swing(form(StrainMeasure.LOGARITHMIC), STEEL, comm=MPI.COMM_SELF)
    rest = again.simulate(6e-4, restart=run.checkpoints[0], **how)
    np.testing.assert_array_equal(rest.x[-1], run.x[-1])
    np.testing.assert_array_equal(rest.position(same.frame("x_max"))[-1], run.position(bar.frame("x_max"))[-1])


def test_viscosity_by_the_steps_length():
    """Maxwell's: held at a strain from t = 0 on, the stress falls as implicit Euler has it, (1 + dt/tau)^-n."""

    @dataclass(frozen=True)
    class Fluid:
        G: float
        tau: float
        rho: float

    def maxwell(step, p):
        factor = 1.0 / (1.0 + step.dt / p.tau)
        return factor * (step.stress + p.G * step.increment), factor * p.G * np.eye(6), step.state

    law = law_form(maxwell, Fluid, trial=Fluid(1e6, 2.0, 1000.0), dt=0.5)
    body = block(law, Fluid(1e6, 2.0, 1000.0))
    jump = np.zeros((body.layout.n_local // 3, 3))
    jump[:, 0] = 1e-3 * body.layout.node_x[:, 1]
    body.commit(jump.ravel(), dt=0.0)
    for n in range(4):
        np.testing.assert_allclose(body.stress()[0].reshape(-1, 3, 3)[:, 0, 1], 1e3 * 1.25**-n, rtol=1e-12)
        body.commit(0.0 * jump.ravel(), dt=0.5)
    with pytest.raises(FormulationError, match="say dt"):
        body.force(jump.ravel())


@dataclass(frozen=True)
class Bad:
    """A stiffness, and the fault that a law has where it is strained."""

    E: float
    fault: float
    rho: float = 1.0


def faulty(step, p):
    stress, tangent, state = p.E * (step.strain + step.increment), p.E * np.eye(6), step.state
    if np.abs(step.increment).max() > 1e-3:
        if p.fault == 1.0:
            raise ValueError
        if p.fault == 2.0:
            stress = np.zeros(5)
        if p.fault == 3.0:
            tangent = np.eye(5)
        if p.fault == 4.0:
            state = np.zeros(3)
        if p.fault == 6.0:
            stress[2] = np.nan
        if p.fault == 7.0:
            tangent[1, 1] = np.inf
        if p.fault == 8.0:
            state = state * np.nan
    return stress, tangent, state


TOLD = {
    1.0: "the law raised an error",
    2.0: r"the stress is not of the shape \(6,\)",
    3.0: r"the tangent is not of the shape \(6, 6\)",
    4.0: "the state is not of the shape that the law begins with",
    6.0: "the stress is not finite",
    7.0: "the tangent is not finite",
    8.0: "the state is not finite",
}


@cache
def faulty_form():
    return law_form(faulty, Bad, trial=Bad(1e6, 0.0), state={"nothing": [0.5]})


@pytest.mark.parametrize("fault", TOLD)
@pytest.mark.mpi
def test_what_a_law_returns_amiss_is_told_with_cell_and_point(fault):
    """On all ranks, though but one cell is strained."""
    body = block(faulty_form(), Bad(1e6, fault), comm=COMM, divisions=(4, 1, 1))
    x = body.layout.node_x
    step = np.zeros((body.layout.n_local // 3, 3))
    step[:, 0] = 0.01 * np.maximum(x[:, 0] - 0.75 * SIZE, 0.0)
    kind = FormulationError if fault < 5 else ConvergenceError
    where = r"point 0 of the cell around \(0\.0875, 0, 0\) m, whose history is strain \[0(, 0)*\], .*nothing \[0\.5\]"
    with pytest.raises(kind, match=f"faulty: {TOLD[fault]}, {where}"):
        body.step(step.ravel())
    body.step(1e-2 * step.ravel())
    assert (body.history()[0][:, -1] == 0.5).all()


def nothing(step, p):
    return step.stress, step.state


def biased(step, p):
    return step.stress + 1.0, np.eye(6), step.state


def short(step, p):
    return step.stress, np.eye(3), step.state


def unknown(step, p):
    return no_such_name(step)  # type: ignore[name-defined]  # noqa: F821


REFUSED: dict[str, tuple[Any, dict[str, Any], str]] = {
    "two arrays": (nothing, {}, "nothing: it must be law.step, p. .*, and returns UniTuple"),
    "what numba cannot compile": (unknown, {}, "unknown: numba cannot compile it as law(?s:.*)no_such_name"),
    "a stress at rest": (biased, {}, "biased: at rest there is the stress"),
    "a shape": (short, {}, r"short: at rest, .* the tangent is not of the shape \(6, 6\)"),
    "no density": (faulty, {"parameters": dataclass(frozen=True)(type("Dull", (), {"__annotations__": {"E": float}}))},
                   "trial must be an instance of Dull"),
    "whole numbers": (faulty, {"trial": Bad(1, 0.0)}, "must be floats, .* E are not"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_law_is_refused_when_it_is_made(case):
    law, given, told = REFUSED[case]
    with pytest.raises(FormulationError, match=told):
        law_form(law, given.get("parameters", Bad), trial=given.get("trial", Bad(1.0, 0.0)))


def test_a_law_whose_numbers_changed_outside_is_refused():
    """The compiled law keeps those of its compilation."""
    stiffness = 1.0

    def law(step, p):
        stress = stiffness * p.E * (step.strain + step.increment)
        return stress, stiffness * p.E * np.eye(6), step.state

    @dataclass(frozen=True)
    class Stiff:
        E: float = 1e9
        rho: float = 1e3

    made = law_form(law, Stiff, trial=Stiff())
    assert made.point_law(Stiff()).values(Stiff()).tolist() == [0.0, 1e9, 1e3]
    stiffness = 2.0
    with pytest.raises(FormulationError, match="law: numbers, arrays or functions"):
        block(made, Stiff())
