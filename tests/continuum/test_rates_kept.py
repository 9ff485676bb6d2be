"""Bodies whose forces depend on rates: restarts to the bit, the updated configuration, and their linear damping."""

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
    NonlinearModel,
    follow,
    load_form,
    prescribed_dofs,
)

TESTS = Path(__file__).parents[1]
FORMS = {
    "viscous": load_form(TESTS / "data" / "viscous_solid.py"),
    "Perzyna": load_form(TESTS.parent / "demos" / "rate_dependent_form" / "perzyna.py"),
    "updated": load_form(TESTS / "data" / "updated_perzyna.py"),
}
SELF = MPI.COMM_SELF
SIZE = 0.1


def parameters(kind):
    form = FORMS[kind]
    if kind == "viscous":
        return form.Parameters(mu=8e10, bulk=1.7e11, rho=800.0, eta=8e4, zeta=1e5)
    hardening = {} if kind == "updated" else {"hardening": 0.0}
    return form.Parameters(E=2e11, nu=0.3, rho=800.0, yield_stress=2e8, viscosity=2e6, **hardening)


def strut(kind, way):
    """A block on the ground, hit by a hammer on its other end."""
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=(2, 1, 1), cell="hexahedron", comm=SELF)
    ends = [Interface("x_min"), Interface("x_max")]
    body = NonlinearModel(mesh, FORMS[kind], parameters(kind), degree=1, interfaces=ends)
    make = {"implicit": ImplicitContinuum, "explicit": ExplicitContinuum}[way]
    hammer = fm.RigidBody(40.0, 16.0 * np.ones(3))
    scene = fm.System()
    one = scene.add(fm.ContinuumBody(make(body, rigid_parts={"x_max": hammer})), name="strut")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), one.frame("x_min"))
    head = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(p=(SIZE, 0.0, 0.0)), one.frame("x_max"))
    head.velocity = -4.0
    return scene, one


@pytest.mark.parametrize("way", ["implicit", "explicit"])
@pytest.mark.parametrize("kind", FORMS)
def test_a_restart_is_the_same_to_the_bit(kind, way, tmp_path):
    """From a file, in a machine that is built anew; the account of energies too."""
    how, h = (fm.GeneralizedAlpha(rho=0.8), 2e-6) if way == "implicit" else (fm.CentralDifference(), 1e-6)
    scene, one = strut(kind, way)
    whole = scene.simulate(8e-5, integrator=how, h=h, checkpoints=[4e-5])
    whole.checkpoints[0].save(tmp_path / "half.npz")
    lost = "viscous" if kind == "viscous" else "plastic"
    assert whole.energies(one)[lost][-1] > 1e-3 * whole.energy().kinetic[0]
    again, other = strut(kind, way)
    rest = again.simulate(8e-5, integrator=how, h=h, restart=fm.Checkpoint.load(tmp_path / "half.npz"))
    np.testing.assert_array_equal(rest.x[-1], whole.x[-1])
    np.testing.assert_array_equal(rest.v[-1], whole.v[-1])
    for name, series in whole.energies(one).items():
        assert rest.energies(other)[name][-1] == series[-1], name


def stress_of_bar(steps, *, strain, rate, p):
    """Cauchy stress, Pa, along a bar at the end of a pull at a steady rate of logarithmic strain, free across."""
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=(1, 1, 1), cell="hexahedron", comm=SELF)
    body = NonlinearModel(mesh, FORMS["updated"], p, degree=1)
    held = prescribed_dofs(body, {"x_min": "x", "y_min": "y", "z_min": "z", "x_max": "x"})
    pulled = (body.layout.node_x[held // 3, 0] > 0.9 * SIZE) & (held % 3 == 0)
    times = np.linspace(0.0, strain / rate, steps + 1)[1:]
    follow(body, times, prescribed=held, displacement=lambda t: SIZE * np.expm1(rate * t) * pulled, seconds=1.0)
    return body.stress()[0].reshape(-1, 3, 3)


def test_large_strain_from_the_updated_configuration_has_its_overstress():
    """Of first order in the step to the steady Cauchy stress sigma_y + viscosity times the rate of plastic strain.

    With Truesdell's rate of the form, E e + (2 d - (1 - 2 nu) e) sigma = 0 for the elastic part e of the stretching d.
    """
    E, nu, limit, viscosity, d = 2e11, 0.3, 2e8, 4e7, 2.0
    p = FORMS["updated"].Parameters(E=E, nu=nu, rho=7850.0, yield_stress=limit, viscosity=viscosity)
    exact = limit
    for _ in range(20):
        exact = limit + viscosity * d * (1 + 2 * exact / (E - (1 - 2 * nu) * exact))
    errors = []
    for steps in (50, 100, 200):
        found = stress_of_bar(steps, strain=0.2, rate=d, p=p)
        np.testing.assert_allclose(found[:, 0, 0], found[0, 0, 0], rtol=1e-8)
        assert abs(found[:, 1:, 1:]).max() < 1e-6 * found[0, 0, 0]
        errors.append(abs(found[0, 0, 0] / exact - 1))
    assert errors[2] < 1e-3
    np.testing.assert_allclose([errors[0] / errors[1], errors[1] / errors[2]], 2.0, rtol=0.03)
    slow = stress_of_bar(50, strain=0.2, rate=1e-4 * d, p=p)[0, 0, 0]
    assert slow == pytest.approx(limit, rel=2e-3)


def test_a_linear_machine_is_damped_by_the_dissipation():
    """A weight on a strut of spring k and damper tau k: omega (-ratio +- i sqrt(1 - ratio^2)); the strut is light."""
    mass, mu, ratio = 8.0, 1e6, 0.2
    omega = np.sqrt(2 * mu * SIZE / mass)
    tau = 2 * ratio / omega
    form = FORMS["viscous"]
    p = form.Parameters(mu=mu, bulk=2 / 3 * mu, rho=1e-3, eta=tau * mu, zeta=2 / 3 * tau * mu)
    mesh = meshes.block(SIZE, SIZE, SIZE, divisions=(2, 1, 1), comm=SELF)
    body = NonlinearModel(mesh, form, p, degree=1, interfaces=[Interface("x_min"), Interface("x_max")])
    ball = fm.RigidBody(mass, 0.01 * mass * np.ones(3))
    scene = fm.System()
    one = scene.add(fm.ContinuumBody(ImplicitContinuum(body, rigid_parts={"x_max": ball})), name="strut")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), one.frame("x_min"))
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=(SIZE, 0.0, 0.0)), one.frame("x_max"))
    values = np.array(scene.linearize().eigenvalues())
    slow = values[np.argmin(abs(values))]
    assert slow.real == pytest.approx(-ratio * omega, rel=1e-4)
    assert abs(slow.imag) == pytest.approx(omega * np.sqrt(1 - ratio**2), rel=1e-4)
