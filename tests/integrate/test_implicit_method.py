"""Methods by the weights of a step: their amplification, what is refused of them, the families of generalized-alpha."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from machines import pendulum, slider_crank
from spring_interior import ImplicitSprings, as_continuum

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.integrate import ImplicitMethod

V0, A0, U1, V1, A1 = 1, 2, 3, 4, 5
GAMMA = 1.0 - math.sqrt(0.5)


@fm.compiled
def newmark(data, h, h_before, nodes, u, v, memory):
    beta, gamma = data[0], data[1]
    nodes[0] = 1.0
    u[0, V0], u[0, A0], u[0, A1] = h, (0.5 - beta) * h * h, beta * h * h
    v[0, V0], v[0, A0], v[0, A1] = 1.0, (1.0 - gamma) * h, gamma * h


@fm.compiled
def singly_diagonal(data, h, h_before, nodes, u, v, memory):
    """Alexander's L-stable Runge-Kutta method of order 2, of two stages."""
    g, v0, v1, a1, v2, a2 = data[0], 1, 4, 5, 7, 8
    nodes[0], nodes[1] = g, 1.0
    v[0, v0], v[0, a1] = 1.0, g * h
    u[0, v1] = g * h
    v[1, v0], v[1, a1], v[1, a2] = 1.0, (1.0 - g) * h, g * h
    u[1, v1], u[1, v2] = (1.0 - g) * h, g * h


@fm.compiled
def backward_euler(data, h, h_before, nodes, u, v, memory):
    nodes[0] = 1.0
    v[0, 1], v[0, 5], u[0, 4] = 1.0, h, h


@fm.compiled
def looks_ahead(data, h, h_before, nodes, u, v, memory):
    nodes[0] = nodes[1] = 1.0
    v[0, 1], v[0, 5], v[0, 8] = 1.0, h, h
    u[0, 4] = h


@fm.compiled
def open_at_the_end(data, h, h_before, nodes, u, v, memory):
    nodes[0] = 0.5
    v[0, 1], v[0, 5], u[0, 4] = 1.0, h, h


@fm.compiled
def no_acceleration(data, h, h_before, nodes, u, v, memory):
    nodes[0] = 1.0
    v[0, 1], v[0, 2], u[0, 1] = 1.0, h, h


def vibration(stiffness, damping=0.0):
    """A mass of 2 kg on a spring and a damper, let go at 0.3 m."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(2.0, (1.0, 1.0, 1.0)), name="body")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
    scene.add_force(fm.force.JointSpring(slide, stiffness, damping=damping))
    slide.position = 0.3
    return scene


def test_a_stage_at_a_time_is_the_runge_kutta_method():
    """Steps of Alexander's method on a damped vibration against its amplification, far beyond accuracy."""
    method = ImplicitMethod("SDIRK2", singly_diagonal, stages=2, numbers=(GAMMA,))
    for h in (0.01, 0.3):
        run = vibration(50.0, 3.0).simulate(10 * h, h=h, rtol=1e-12, integrator=method)
        rates = np.array([[0.0, 1.0], [-25.0, -1.5]])
        stage = np.linalg.inv(np.eye(2) - GAMMA * h * rates)
        step = stage @ (np.eye(2) + (1.0 - GAMMA) * h * rates @ stage)
        y = np.array([0.3, 0.0])
        for k in range(11):
            np.testing.assert_allclose([run.x[k, 0], run.v[k, 0]], y, atol=1e-12)
            y = step @ y


def test_newmark_is_newmark():
    """Average acceleration keeps a vibration's energy exactly, whatever the step."""
    method = ImplicitMethod("Newmark", newmark, numbers=(0.25, 0.5))
    run = vibration(50.0).simulate(20.0, h=0.5, rtol=1e-12, integrator=method)
    energy = 0.5 * 2.0 * run.v[:, 0] ** 2 + 0.5 * 50.0 * run.x[:, 0] ** 2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-10)
    assert np.abs(np.diff(run.x[:, 0])).max() > 0.3  # a step is more than half a period


def test_generalized_alpha_is_its_weights():
    """Of alpha_m = alpha_f = 0 it is Newmark's method with gamma = 1/2, on a loop as well."""
    scene = slider_crank()[0]
    one = ImplicitMethod("Newmark", newmark, numbers=(0.25, 0.5))
    how = {"h": 1e-3, "rtol": 1e-10}
    ours = scene.simulate(0.2, integrator=one, **how)
    theirs = scene.simulate(0.2, integrator=fm.GeneralizedAlpha(1.0, family=fm.AlphaFamily.HILBER_HUGHES_TAYLOR), **how)
    for name in ("x", "v", "multipliers"):
        a, b = getattr(ours, name), getattr(theirs, name)
        np.testing.assert_allclose(a, b, atol=1e-9 * np.abs(b).max())


def test_order_one_is_held_to_rtol():
    """Backward Euler: the error at the end is in proportion to rtol, with more steps than by order 2."""
    method = ImplicitMethod("backward Euler", backward_euler, order=1)
    scene, _, _ = pendulum()
    best = scene.simulate(1.0, rtol=1e-10, integrator=fm.ExplicitRungeKutta())
    errors, steps = [], []
    for rtol in (1e-3, 1e-4):
        run = scene.simulate(1.0, rtol=rtol, integrator=method)
        errors.append(np.abs(run.x[-1] - best.x[-1]).max())
        steps.append(run.stats.steps)
    assert errors[1] < 60.0 * 1e-4
    assert 7.0 < errors[0] / errors[1] < 14.0
    assert 7.0 < steps[1] / steps[0] < 14.0


@pytest.mark.parametrize("family", list(fm.AlphaFamily))
@pytest.mark.parametrize("rho", [0.5, 0.8])
def test_families_have_their_spectral_radius(family, rho):
    """What is left of an unresolved vibration falls by rho a step."""
    method = fm.GeneralizedAlpha(rho, family=family)
    run = vibration(2e12).simulate(0.8, h=0.01, rtol=1e-12, integrator=method)
    sizes = np.abs(run.x[:, 0])
    late = np.maximum.reduceat(sizes, np.arange(0, 80, 20))  # of stretches of twenty steps
    np.testing.assert_allclose((late[3] / late[1]) ** (1.0 / 40.0), rho, rtol=0.1)
    orders = []
    scene, _, _ = pendulum()
    best = scene.simulate(1.0, rtol=1e-11, integrator=fm.ExplicitRungeKutta())
    errors = [np.abs(scene.simulate(1.0, h=1.0 / n, integrator=method).v[-1] - best.v[-1]).max() for n in (200, 400)]
    orders.append(np.log2(errors[0] / errors[1]))
    assert min(orders) > 1.9


def test_hht_has_no_small_rho():
    with pytest.raises(SceneError, match=r"HHT-alpha has a rho between 0.5 .* and 1, got 0.3: .*CHUNG_HULBERT"):
        fm.GeneralizedAlpha(0.3, family=fm.AlphaFamily.HILBER_HUGHES_TAYLOR)


@pytest.mark.parametrize(
    ("said", "relation", "options"),
    [
        (r"BDF says order 2, but with equal steps it shows (0\.9|1\.0)\d on a linear", backward_euler, {"order": 2}),
        (r"with equal steps it shows 1\.\d+", newmark, {"numbers": (0.25, 0.6)}),
        (r"stage 1 hangs on itself or on later ones", looks_ahead, {"stages": 2}),
        (r"nodes must lie in the step and end with 1, got \[0\.5\]", open_at_the_end, {}),
        (r"u and v of stage 1 must grow with the acceleration at its end", no_acceleration, {}),
        (r"failed for h = 0\.001, h_before = 0\.0 with 1 stages .*: index", singly_diagonal, {"numbers": (0.3,)}),
        (r"stages must be at least 1, got 0", newmark, {"stages": 0}),
        (r"numbers must be a list, each a finite number", newmark, {"numbers": (np.nan, 0.5)}),
        (r"relation must be fm\.compiled of f\(data, h, h_before", fm.compiled(lambda t: t), {}),
    ],
)  # fmt: skip
def test_weights_that_are_none_are_refused(said, relation, options):
    with pytest.raises(SceneError, match=said):
        ImplicitMethod("BDF", relation, **options)


def test_steps_that_change_show_an_order_too():
    """Backward differences whose weights are those of equal steps alone."""

    @fm.compiled
    def equal(data, h, h_before, nodes, u, v, memory):
        nodes[0] = 1.0
        last, own = (1.0 / 3.0, 2.0 / 3.0 * h) if h_before > 0.0 else (0.0, h)
        v[0, 1], v[0, 7], v[0, 5] = 1.0 + last, -last, own
        u[0, 6], u[0, 4] = last, own
        memory[0, 3] = memory[1, 1] = 1.0

    with pytest.raises(SceneError, match=r"BDF2 says order 2, but with steps that double and halve it shows [01]\.\d+"):
        ImplicitMethod("BDF2", equal, memories=2)


def test_bodies_with_history_are_refused():
    scene = fm.System()
    interior = ImplicitSprings([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [0, 1], [(0, 1)], [0.1, 0.1], stiffness=40.0)
    _, (held, _) = as_continuum(scene, interior)
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), held)
    with pytest.raises(SceneError, match=r"Newmark cannot run bodies with history .*: their interiors step along"):
        scene.simulate(0.1, h=1e-2, integrator=ImplicitMethod("Newmark", newmark, numbers=(0.25, 0.5)))


def test_a_method_is_pickled():
    method = ImplicitMethod("Newmark", newmark, numbers=(0.25, 0.5))
    scene = pendulum()[0]
    one, other = (
        scene.simulate(0.1, h=1e-2, integrator=each) for each in (method, pickle.loads(pickle.dumps(method)))
    )
    np.testing.assert_array_equal(one.x, other.x)
