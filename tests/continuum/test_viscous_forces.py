"""Viscous forces of a formulation's dissipation in bodies with history, against closed forms of decaying vibrations."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest
import scipy.linalg

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    follow,
    load_form,
    lumped_mass,
    prescribed_dofs,
)
from flexmbd.errors import FormulationError

FILE = Path(__file__).parents[1] / "data" / "viscous_solid.py"
FORM = load_form(FILE)


def solid(*, mu, tau, rho, divisions=(2, 1, 1), ends=(), comm=MPI.COMM_WORLD, form=FORM):
    """A block whose stress goes with the strain along each axis alone (nu = 0), and viscosity tau times that."""
    p = form.Parameters(mu=mu, bulk=2 / 3 * mu, rho=rho, eta=tau * mu, zeta=2 / 3 * tau * mu)
    mesh = meshes.block(0.1, 0.1, 0.1, divisions=divisions, comm=comm)
    return NonlinearModel(mesh, form, p, degree=1, interfaces=[Interface(name) for name in ends])


@pytest.mark.mpi
def test_a_weight_on_a_viscous_strut_settles_as_one_on_spring_and_damper():
    """m x'' + c x' + k x = m g with k = E A / L, c = tau k, from rest; and its account of energies."""
    mass, mu, g = 8.0, 1e6, 0.1
    k = 2 * mu * 0.1
    omega = np.sqrt(k / mass)
    ratio = 0.2
    body = solid(mu=mu, tau=2 * ratio / omega, rho=1.0, ends=("x_min", "x_max"))
    ball = fm.RigidBody(mass, 0.01 * mass * np.ones(3))
    scene = fm.System(gravity=(g, 0.0, 0.0), team=MpiTeam(MPI.COMM_WORLD))
    strut = scene.add(fm.ContinuumBody(ImplicitContinuum(body, rigid_parts={"x_max": ball})), name="strut")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), strut.frame("x_min"))
    run = scene.simulate(0.06, integrator=fm.GeneralizedAlpha(rho=0.9), h=2.5e-4)
    x = run.position(strut.frame("x_max"))[:, 0] - 0.1
    swing, still = omega * np.sqrt(1 - ratio**2), mass * g / k
    decay = np.exp(-ratio * omega * run.t)
    phase = np.cos(swing * run.t) + ratio * omega / swing * np.sin(swing * run.t)
    exact = still * (1 - decay * phase)
    assert abs(x - exact).max() < 8e-3 * still
    undamped = still * (1 - np.cos(omega * run.t))
    assert abs(undamped - exact).max() > 0.5 * still
    parts, machine = run.energies(strut), run.energy()
    total = machine.kinetic + machine.gravitational + sum(parts.values())
    assert abs(total - total[0]).max() < 0.01 * parts["viscous"][-1]
    # what damper and spring have in the end is the work of the weight
    assert parts["viscous"][-1] == pytest.approx(mass * g * exact[-1] - k * exact[-1] ** 2 / 2, rel=0.03)


def modes(body):
    """Angular frequencies and shapes of the free body with lumped masses, and these and the stiffness."""
    matrix = body.tangent(np.zeros(body.layout.n_local), dt=0.0)
    start, columns, values = matrix.getValuesCSR()
    K = np.zeros(matrix.getSize())
    K[np.repeat(np.arange(len(K)), np.diff(start)), columns] = values
    masses = lumped_mass(body)
    squares, shapes = scipy.linalg.eigh(K, np.diag(masses))
    return np.sqrt(np.maximum(squares, 0.0)), shapes, masses, K


def test_an_explicit_run_decays_mode_by_mode():
    """q = v0 / omega_d exp(-ratio omega t) sin omega_d t of a free body that begins with a mode's velocities."""
    body = solid(mu=1e6, tau=5e-4, rho=1000.0, comm=MPI.COMM_SELF)
    omegas, shapes, masses, _ = modes(body)
    k = int(np.argmax(omegas > 1.0))
    omega, shape = omegas[k], shapes[:, k]
    ratio = 5e-4 * omega / 2
    assert 0.05 < ratio < 0.3
    size = 1e-4
    run = ExplicitRun(body, velocity=lambda x: size * shape.reshape(-1, 3))
    X, swing = run.motion.x.copy(), omega * np.sqrt(1 - ratio**2)
    t = 2.2 / omega
    account = run.simulate(t, h=run.stable_step / 20)
    q = shape @ (masses * (run.motion.x - X).ravel()) / size
    exact = np.exp(-ratio * omega * t) * np.sin(swing * t) / swing
    assert q == pytest.approx(exact, rel=2e-3)
    assert abs(exact - np.sin(omega * t) / omega) > 0.1 * exact
    assert account["viscous"][-1] > 0.1 * account["kinetic"][0]
    assert account.error < 0.01


@pytest.mark.parametrize("tau", [1e-4, 1e-3])
def test_the_stable_step_is_that_of_the_damped_recursion(tau):
    """x2 - 2 x1 + x0 + h^2 M^-1 K x1 + h M^-1 C (x1 - x0) = 0 with C = tau K: just below it bounded, above not."""
    body = solid(mu=1e6, tau=tau, rho=1000.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    _, _, masses, K = modes(body)
    A = K / masses[:, None]
    h = ExplicitRun(body).stable_step
    undamped = 2 / np.sqrt(np.linalg.eigvals(A).real.max())
    assert h < 0.97 * undamped

    def radius(h):
        one = np.eye(len(A))
        first = 2 * one - h**2 * A - h * tau * A
        step = np.block([[first, -(one - h * tau * A)], [one, 0 * one]])
        # rigid motions are double roots of one, split by round-off
        return abs(np.linalg.eigvals(step)).max()

    assert radius(0.999 * h) < 1 + 1e-5
    assert radius(1.001 * h) > 1 + 1e-4


@pytest.mark.mpi
def test_slow_loading_needs_to_know_the_time():
    """A block pulled at the rate e has the stress E e t + tau E e: elastic and viscous."""
    mu, tau, rate = 1e6, 0.5, 1e-5
    body = solid(mu=mu, tau=tau, rho=1.0)
    held = prescribed_dofs(body, {"x_min": "xyz", "x_max": "xyz"})
    x = body.layout.node_x.reshape(-1)[held] * (np.arange(len(held)) >= 0)
    along = x * (held % 3 == 0)
    with pytest.raises(FormulationError, match="a loading has no time of its own; give follow seconds="):
        follow(body, [1.0], prescribed=held, displacement=lambda t: rate * t * along)
    with pytest.raises(FormulationError, match="seconds must be positive and finite, got 0"):
        follow(body, [1.0], prescribed=held, displacement=lambda t: rate * t * along, seconds=0.0)
    path = follow(body, [0.5, 1.0], prescribed=held, displacement=lambda t: rate * t * along, seconds=2.0)
    pulled = body.layout.node_x.reshape(-1, 3)[held // 3, 0] > 0.05
    force = body.comm.allreduce(path.steps[-1].reactions[pulled & (held % 3 == 0)].sum())
    # the load parameter grows by one in two seconds
    expected = 2 * mu * 0.01 * (rate * 1.0 + tau * rate / 2.0)
    assert force == pytest.approx(expected, rel=1e-4)
    with pytest.raises(FormulationError, match=r"length of the step is not given; say dt \(s\)"):
        body.force(np.zeros(body.layout.n_local))


def test_forces_without_a_bound_are_refused_explicitly(tmp_path):
    path = tmp_path / "my_form.py"
    path.write_text(FILE.read_text().replace("rate) / 2, Q", "rate) / 2 + p.eta * ufl.inner(rate, rate) ** 2, Q"))
    body = solid(mu=1e6, tau=1e-4, rho=1.0, form=load_form(path), comm=MPI.COMM_SELF)
    with pytest.raises(FormulationError, match="explicit steps have no stable length"):
        ExplicitRun(body)
