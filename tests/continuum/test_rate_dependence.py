"""Forms that take the length of the step: Perzyna's bar against closed forms, and who refuses them without a time."""

import warnings
from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    follow,
    load_form,
    prescribed_dofs,
)
from flexmbd.continuum.interior.halved_steps import HalvedSteps
from flexmbd.errors import FormulationError, SceneError

FILE = Path(__file__).parents[2] / "demos" / "rate_dependent_form" / "perzyna.py"
FORM = load_form(FILE)
E, YIELD, ETA, RATE = 2.0e11, 2.0e8, 4.0e7, 2.0
METAL = FORM.Parameters(E=E, nu=0.3, rho=7850.0, yield_stress=YIELD, hardening=0.0, viscosity=ETA)
SIZE = 0.1


def bar(*, ends=(), parameters=METAL, comm=MPI.COMM_WORLD):
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=(2, 1, 1), comm=comm)
    return NonlinearModel(mesh, FORM, parameters, degree=1, interfaces=[Interface(name) for name in ends])


def pulled_stress(times):
    """Stress, Pa, along a bar that is pulled at RATE, free across, at the instants (s)."""
    body = bar()
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z", "x_max": "x"})
    pulled = body.layout.node_x[held // 3, 0] > 0.9 * SIZE
    pulled &= held % 3 == 0
    path = follow(body, times, prescribed=held, displacement=lambda t: RATE * t * SIZE * pulled, seconds=1.0)
    return [body.comm.allreduce(step.reactions[pulled].sum()) / SIZE**2 for step in path.steps]


@pytest.mark.mpi
def test_a_bar_pulled_at_a_steady_rate_comes_to_its_overstress():
    """sigma_y + eta e, to round-off whatever the step once it is steady; on the way there of first order in it."""
    first = YIELD / (E * RATE)
    since = 2 * ETA / E  # twice the time in which the overstress settles
    exact = YIELD + ETA * RATE * (1 - np.exp(-2.0))
    errors = []
    for n in (10, 20, 40):
        found = pulled_stress([first, *(first + since * np.arange(1, n + 1) / n)])
        assert found[0] == pytest.approx(YIELD, rel=1e-9)
        errors.append(abs(found[-1] - exact) / exact)
    assert errors[2] < 4e-3
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, rtol=0.06)
    late = first + 40 * ETA / E
    assert pulled_stress([first, *np.linspace(first, late, 40)[1:]])[-1] == pytest.approx(YIELD + ETA * RATE, rel=1e-9)


def test_no_time_to_flow_is_no_flow():
    """A jump in no time is elastic, at any size; the same held for long ends at the yield stress."""
    body = bar(comm=MPI.COMM_SELF)
    shear = np.array([[0.0, 0.01, 0.0], [0.01, 0.0, 0.0], [0.0, 0.0, 0.0]])
    jump = (body.layout.node_x @ shear).ravel()
    body.commit(jump, dt=0.0)
    stress = body.stress()[0].reshape(-1, 3, 3)
    np.testing.assert_allclose(stress[:, 0, 1], 0.02 * E / 2.6, rtol=1e-12)
    body.commit(0.0 * jump, dt=1e4 * ETA / E)
    stress = body.stress()[0].reshape(-1, 3, 3)
    np.testing.assert_allclose(np.sqrt(3) * stress[:, 0, 1], YIELD, rtol=2e-3)
    assert body.energies()["plastic"] > 0.0


@pytest.mark.parametrize("way", ["implicit", "explicit"])
@pytest.mark.mpi
def test_a_hammer_meets_more_stress_in_a_strut_of_such_a_metal(way):
    """Of a hammer on a strut the greatest force exceeds the yield force by the overstress of its own rate.

    Once the strut flows the hammer slows by m v' = -A (sigma_y + eta v / L): v = (v1 + w) exp(-b t) - w with
    b = A eta / (m L) and w = L sigma_y / eta, its crush the integral; the elastic part is small.
    """
    mass, speed, flow = 400.0, 4.0, 2.0e6
    p = FORM.Parameters(E=2e11, nu=0.0, rho=800.0, yield_stress=2e8, hardening=0.0, viscosity=flow)
    body = bar(ends=("x_min", "x_max"), parameters=p)
    hammer = fm.RigidBody(mass, 0.4 * mass * np.ones(3))
    make = ImplicitContinuum if way == "implicit" else ExplicitContinuum
    scene = fm.System(team=MpiTeam(MPI.COMM_WORLD))
    strut = scene.add(fm.ContinuumBody(make(body, rigid_parts={"x_max": hammer})), name="strut")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), strut.frame("x_min"))
    head = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(p=(SIZE, 0.0, 0.0)), strut.frame("x_max"))
    head.velocity = -speed
    how = fm.GeneralizedAlpha(rho=0.8) if way == "implicit" else fm.CentralDifference()
    run = scene.simulate(4e-4, integrator=how, h=2e-6)
    area, length = SIZE**2, SIZE
    decay, yielding = area * flow / (mass * length), length * 2e8 / flow
    t = run.t[-1]
    crush = (speed + yielding) / decay * (1 - np.exp(-decay * t)) - yielding * t
    assert -(run.position(strut.frame("x_max"))[-1, 0] - SIZE) == pytest.approx(crush, rel=0.03)


MAXWELL = load_form(Path(__file__).parents[1] / "data" / "maxwell.py")
GEL = MAXWELL.Parameters(K=1e7, mu=1e6, g=(2e6, 1e6), tau=(0.01, 0.1), rho=1100.0)


@pytest.mark.parametrize("steps", [8, 32])
def test_two_half_updates_tell_the_error_of_one(steps):
    """A Maxwell solid sheared at a steady rate: stress 2 mu e + sum 2 g tau r (1 - exp(-t / tau)), in closed form."""
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, MAXWELL, GEL, degree=1)
    halved, end = HalvedSteps(body), 0.05
    shear = np.array([[0.0, 0.01, 0.0], [0.01, 0.0, 0.0], [0.0, 0.0, 0.0]])
    whole = (body.layout.node_x @ shear).ravel()
    elastic = np.linalg.norm(body.force(whole, dt=0.0))  # of mu + g
    errors, exact = [], []
    for k in range(1, steps + 1):
        body.commit(whole / steps, dt=end / steps)
        halved.follow(whole / steps, end / steps)
        t = k * end / steps
        stress = GEL.mu * t / end + sum(
            g * tau / end * (1 - np.exp(-t / tau)) for g, tau in zip(GEL.g, GEL.tau, strict=True)
        )
        exact.append(stress / (GEL.mu + sum(GEL.g)) * elastic)
        errors.append(np.linalg.norm(body.force(0.0 * whole, dt=0.0)) - exact[-1])
    true = np.abs(errors).max() / np.max(exact)
    assert halved.error == pytest.approx(true, rel=0.3 if steps == 8 else 0.1)


def test_error_control_tells_what_it_does_not_see():
    """Steps by rtol are too long for the relaxation; given ones, and those below a small max_step, say nothing."""
    mesh = meshes.block(0.2, 0.03, 0.03, divisions=(4, 1, 1), comm=MPI.COMM_SELF)
    gel = NonlinearModel(mesh, MAXWELL, GEL, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])
    scene = fm.System(gravity=(0.0, 0.0, -1.0))
    body = scene.add(fm.ContinuumBody(ImplicitContinuum(gel)), name="gel")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("x_min"))
    with warnings.catch_warnings():
        warnings.simplefilter("error", fm.ToleranceWarning)
        scene.simulate(0.02, h=2e-3)
        scene.simulate(0.02, rtol=0.02, max_step=4e-4)
    with pytest.warns(fm.ToleranceWarning, match=r"forces of body 'gel' are off by some .* give a smaller max_step"):
        scene.simulate(0.05, rtol=1e-3)


def test_rest_and_small_motions_are_refused():
    body = bar(ends=("x_min", "x_max"), comm=MPI.COMM_SELF)
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    strut = scene.add(fm.ContinuumBody(ImplicitContinuum(body)), name="strut")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), strut.frame("x_min"))
    with pytest.raises(SceneError, match=r"stress that depends on rates.*Let it come to rest in a simulation"):
        scene.linearize()
    held = prescribed_dofs(body, {"x_min": "xyz"})
    with pytest.raises(FormulationError, match="perzyna depend on rates, and a loading has no time of its own"):
        follow(body, [1.0], prescribed=held)


HALF = {
    "an update that does not take it": (
        "update(u, state, p, *, dt, mean=None)", "update(u, state, p, *, mean=None)", "update must take 'dt'"
    ),
    "no length to try": ("    dt: float = 1e-3\n", "", r"reference\(\)\.dt must be a positive float.*got None"),
    "no history": ("def state(p)", "def _state(p)", "dt, the length of the step, goes with state, which is missing"),
}


@pytest.mark.parametrize("case", HALF)
def test_half_a_declaration_is_refused(tmp_path, case):
    old, new, told = HALF[case]
    text = FILE.read_text()
    assert old in text
    path = tmp_path / "my_form.py"
    path.write_text(text.replace(old, new))
    with pytest.raises(FormulationError, match=told):
        load_form(path)
