"""Motion between steps: exact at their ends, of order 6, 5 and 4 between, turns included."""

from __future__ import annotations

import numpy as np
import pytest
from machines import pendulum

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.algebra.so3 import quaternion_exp, quaternion_product
from flexmbd.multibody.kernels.sampling.interpolation import interpolate

PLAIN = np.array([[4, 3]])
QUATERNIONS = np.array([[0, 0]])


def conical(t, *, spin=5.0):
    """A frame in conical motion beside a sine: quaternion and value, rates in body axes, accelerations.

    R = exp(z 3t) exp(y 1.1) exp(z spin t): its spin is known in closed form.
    """
    outer = quaternion_exp((0.0, 0.0, 3.0 * t))
    tilt = quaternion_exp((0.0, 1.1, 0.0))
    inner = quaternion_exp((0.0, 0.0, spin * t))
    q = quaternion_product(quaternion_product(outer, tilt), inner)
    s, c = np.sin(1.1), np.cos(1.1)
    turn = spin * t
    # the outer axis seen from the body: exp(-z spin t) exp(-y 1.1) z
    w = (-3.0 * s * np.cos(turn), 3.0 * s * np.sin(turn), 3.0 * c + spin)
    dw = (3.0 * spin * s * np.sin(turn), 3.0 * spin * s * np.cos(turn), 0.0)
    return (
        np.array([*q, np.sin(4.0 * t)]),
        np.array([*w, 4.0 * np.cos(4.0 * t)]),
        np.array([*dw, -16.0 * np.sin(4.0 * t)]),
    )


def between(t0, h, s, *, spin=5.0, axis=(0.0, 0.0, 0.0)):
    x, v, a = np.zeros(5), np.zeros(4), np.zeros(4)
    ends = *conical(t0, spin=spin), *conical(t0 + h, spin=spin)
    interpolate(PLAIN, QUATERNIONS, np.array([axis]), np.zeros(4), h, s, *ends, x, v, a)  # type: ignore[call-arg]
    return x, v, a


def test_orders_between_the_ends():
    """Largest errors over many intervals and places, for h halved twice."""
    errors = []
    for h in (0.1, 0.05, 0.025):
        worst = np.zeros(3)
        for t0 in np.arange(0.0, 2.0, 0.1):
            for s in (0.2, 0.5, 0.7):
                found, exact = between(t0, h, s), conical(t0 + s * h)
                worst = np.maximum(worst, [np.abs(f - e).max() for f, e in zip(found, exact, strict=True)])
        errors.append(worst)
    orders = np.log2(np.array(errors)[:-1] / np.array(errors)[1:])
    np.testing.assert_allclose(orders[-1], (6.0, 5.0, 4.0), atol=0.25)
    assert errors[-1][0] < 1e-9


def test_a_round_body_spins_as_fast_as_it_likes():
    """An interval of 6 rad of spin about its axis, which moves by 0.03 rad: as good as without the spin."""
    errors = {}
    for axis in ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        found, exact = between(0.3, 0.01, 0.6, spin=600.0, axis=axis), conical(0.306, spin=600.0)
        errors[axis[2]] = [np.abs(f - e)[:3].max() for f, e in zip(found, exact, strict=True)]
    assert errors[0.0][0] > 1e-3
    np.testing.assert_array_less(errors[1.0], [1e-13, 1e-10, 1e-6])


@pytest.mark.parametrize("h", [0.1, 0.7])
def test_exact_at_both_ends_even_for_turns_beyond_half(h):
    """0.7 s turn the frame by more than four radians: the quaternion's sign tells which way."""
    for s in (0.0, 1.0):
        for found, exact in zip(between(0.3, h, s), conical(0.3 + s * h), strict=True):
            np.testing.assert_allclose(found, exact, rtol=0.0, atol=2e-11)


@pytest.mark.parametrize(("frequency", "straight"), [(3.1, False), (3.2, True)])
def test_a_mode_that_the_interval_does_not_resolve_stays_between_its_values(frequency, straight):
    """Of accelerations that contradict the positions, as round-off in a stiff mode does, the quintic makes a swing."""
    plain, none = np.array([[0, 0]]), np.zeros((0, 2), np.int64)
    ends = [np.array([value]) for value in (1.0, 0.5, 1e3, 2.0, -0.5, 1e3)]
    found = [np.zeros(1) for _ in range(3)]
    interpolate(plain, none, np.zeros((0, 3)), np.array([frequency]), 1.0, 0.25, *ends, *found)  # type: ignore[call-arg]
    if straight:
        np.testing.assert_allclose(np.ravel(found), [1.25, 0.25, 1e3], rtol=1e-14)
    else:
        assert found[0][0] > 10.0


def test_a_trajectory_gives_its_rows_back_and_velocities_between():
    scene, bob, hinge = pendulum()
    run = scene.simulate(1.0, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    for part, rows in zip(run.motion(run.t), (run.x, run.v, run.a), strict=True):
        np.testing.assert_array_equal(part, rows)
    t = np.linspace(0.0, 1.0, 57)
    angle, rate = run.beta(hinge, t=t), run.beta_rate(hinge, t=t)
    np.testing.assert_allclose(0.5 * rate**2, 9.81 * -np.sin(angle), atol=3e-7)  # energy
    tip = bob.frame(p=(1.0, 0.0, 0.0))
    place, velocity = run.position(tip, t=t), run.velocity(tip, t=t)
    np.testing.assert_allclose(velocity[:, 0], -rate * place[:, 1], atol=1e-12)
    np.testing.assert_allclose(run.angular_velocity(tip, t=t)[:, 2], rate, atol=1e-12)
    inward = np.einsum("ki,ki->k", run.acceleration(tip, t=t), place)
    np.testing.assert_allclose(inward, -(rate**2), atol=1e-9)


@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(("pair", "share"), [(fm.Pair.DORMAND_PRINCE_5, 1.0), (fm.Pair.DORMAND_PRINCE_8, 30.0)])
def test_error_between_the_steps_against_rtol(rtol, pair, share):
    """The pendulum against a run with rtol 1e-12; long steps of order 8 lose some digits between."""
    scene, _, hinge = pendulum()
    fine = scene.simulate(5.0, rtol=1e-12, integrator=fm.ExplicitRungeKutta())
    run = scene.simulate(5.0, rtol=rtol, integrator=fm.ExplicitRungeKutta(pair))
    at_ends = np.abs(run.beta(hinge) - fine.beta(hinge, t=run.t)).max()
    everywhere = np.abs(run.beta(hinge, t=fine.t) - fine.beta(hinge)).max()
    assert everywhere < 1.5 * at_ends + share * rtol


@pytest.mark.parametrize("unit", [1e-9, 1.0])
def test_a_time_outside_is_refused_however_short_the_run(unit):
    scene = fm.System()
    block = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    slide.velocity = 1.0
    run = scene.simulate(unit)
    assert run.motion(0.5 * unit)[0][0, 0] == pytest.approx(0.5 * unit, rel=1e-9)
    with pytest.raises(SceneError, match="lies outside the trajectory"):
        run.motion(1.1 * unit)
