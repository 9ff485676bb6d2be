"""Strains of exact beams that are functions of time: closed forms, what work they do, what they leave alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp
from scipy.interpolate import PPoly

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.forms import beam_timoshenko

LENGTH, RAMP = 2.0, 0.8
SOFT = beam_timoshenko.Parameters.rectangle(1e7, 0.0, 500.0, width=0.1, height=0.1, orientation=(0.0, 1.0, 0.0))
# from nothing to 1 within RAMP, smoothly, and so it stays
RISE = PPoly(
    np.array([[6 / RAMP**5, 0.0], [-15 / RAMP**4, 0.0], [10 / RAMP**3, 0.0], [0.0] * 2, [0.0] * 2, [0.0, 1.0]]),
    [0.0, RAMP, 2 * RAMP],
)


def strip(n: int, strain: object, **more: object) -> fm.ExactBeam:
    """A beam along x."""
    points = {"clamp": (0.0, 0.0, 0.0), "tip": (LENGTH, 0.0, 0.0)}
    return fm.ExactBeam(points, {"rod": [("clamp", "tip")]}, {"rod": SOFT}, n, strain={"rod": strain}, **more)


def clamped(n: int, strain: object, **more: object) -> tuple[fm.System, fm.ExactBeam]:
    """The beam on the ground."""
    scene = fm.System()
    beam = scene.add(strip(n, strain, **more), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    return scene, beam


def rolled(factor: float) -> PPoly:
    """The curvature (rad/m) of a factor times a full circle, in time."""
    return PPoly(factor * 2 * np.pi / LENGTH * RISE.c, RISE.x)


AMPLITUDE, OMEGA, TAU = 0.02, 9.0, 0.02


def swell(t):
    """A stretch with its rate and acceleration."""
    s, c = np.sin(OMEGA * t), np.cos(OMEGA * t)
    return AMPLITUDE * s, AMPLITUDE * OMEGA * c, -AMPLITUDE * OMEGA**2 * s


@pytest.mark.parametrize(
    ("integrator", "strain", "rtol", "most"),
    [
        (fm.RadauIIA(), fm.Sine(AMPLITUDE, OMEGA), 1e-8, 1e-7),
        (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), swell, 1e-9, 1e-7),
        (fm.GeneralizedAlpha(), fm.Sine(AMPLITUDE, OMEGA), 1e-7, 1e-5),
        (fm.EnergyMomentum(), fm.Sine(AMPLITUDE, OMEGA), 1e-5, 1e-5),
    ],
    ids=["Radau IIA", "8(5,3), a callable", "generalized-alpha", "energy-momentum"],
)
def test_a_stretch_that_swells_drives_a_weight(integrator, strain, rtol, most):
    """m u'' + c (u' - r') + k (u - r) = 0, r being the given stretch times the length; the resultant is k (u - r)."""
    scene, beam = clamped(1, (strain, 0.0, 0.0, 0.0, 0.0, 0.0), viscosity=TAU)
    weight = scene.add(fm.RigidBody(10.0, (1.0, 1.0, 1.0)), name="weight")
    scene.connect(fm.joint.Fixed(), beam.frame("tip"), weight.frame())
    m, k = 10.0 + 0.5 * beam.mass, SOFT.E * SOFT.A / LENGTH

    def slopes(t, y):
        r, rate, _ = np.multiply(LENGTH, swell(t))
        return y[1], -(TAU * k * (y[1] - rate) + k * (y[0] - r)) / m

    exact = solve_ivp(slopes, (0.0, 1.5), (0.0, 0.0), rtol=1e-11, atol=1e-13).y[0, -1]
    run = scene.simulate(1.5, rtol=rtol, integrator=integrator)
    gone = run.position(beam.frame("tip"))[-1] - [LENGTH, 0.0, 0.0]
    assert gone == pytest.approx([exact, 0.0, 0.0], abs=most * LENGTH)
    normal = run.resultants(beam)[-1, 0, 0]
    assert normal == pytest.approx(k * (exact - LENGTH * swell(1.5)[0]), abs=most * k * LENGTH)


def test_a_curvature_rolls_it_up_to_a_full_circle():
    """At any time the slack beam is an arc; in motion viscosity brings it to the circle, without stress."""
    strain = (0.0, 0.0, 0.0, 0.0, 0.0, rolled(1.0))
    scene, beam = clamped(4, strain)
    half = scene.equilibrium(t=0.5 * RAMP)
    angle = 2 * np.pi * float(RISE(0.5 * RAMP))
    arc = LENGTH / angle * np.array([np.sin(angle), 1 - np.cos(angle), 0.0])
    assert half.position(beam.frame("tip")) == pytest.approx(arc, abs=1e-9)
    scene, beam = clamped(4, strain, viscosity=0.5)
    run = scene.simulate(12.0, rtol=1e-6)
    assert run.position(beam.frame("tip"))[-1] == pytest.approx(np.zeros(3), abs=1e-5 * LENGTH)
    middle = LENGTH / np.pi * np.array([0.0, 1.0, 0.0])
    assert run.position(beam.frame("rod.2"))[-1] == pytest.approx(middle, abs=1e-5 * LENGTH)
    assert np.abs(run.resultants(beam)[-1]).max() < 1e-4 * SOFT.E * SOFT.Iz * 2 * np.pi / LENGTH
    assert run.energy().total[-1] < 1e-6 * run.energy().total.max()


@pytest.mark.parametrize("viscosity", [0.0, 0.02])
def test_the_work_of_the_strain_is_what_energy_grows_by(viscosity):
    """And what viscosity takes, which is the integral of s' C s' of its resultants, is missing of it."""
    strain = (0.0, 0.0, 0.0, fm.Sine(0.3, 5.0), 0.0, rolled(0.4))
    scene, beam = clamped(3, strain, viscosity=viscosity)
    run = scene.simulate(1.0, rtol=1e-9, integrator=fm.RadauIIA())
    t = np.linspace(0.0, 1.0, 2001)
    worked = simpson(run.strain_power(beam, t=t), x=t)
    grown = np.diff(run.energy(t=t[[0, -1]]).total)[0]
    assert worked > 1.0
    if viscosity:
        taken = 0.0
        for k, one in enumerate(beam.elements):
            rate = np.gradient(run.resultants(beam, t=t)[:, k], t, axis=0, edge_order=2)  # K s'
            taken += simpson(viscosity * np.einsum("ki,ij,kj->k", rate, np.linalg.inv(one.stiffness), rate), x=t)
        assert taken > 0.1
        assert grown == pytest.approx(worked - taken, abs=1e-4 * worked)
    else:
        assert grown == pytest.approx(worked, rel=1e-6)


def test_a_free_beam_that_curls_keeps_its_momenta():
    """Energy-momentum: what acts inside moves no centre of mass; its balance of energy errs by steps squared."""
    scene = fm.System()
    curl = PPoly(0.6 * np.pi / LENGTH * RISE.c, RISE.x)
    beam = scene.add(strip(4, (0.0, 0.0, 0.0, 0.2, 0.0, curl)), name="worm")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), beam.frame("clamp"))
    flight.velocity = (0.1, 0.0, 0.0, 0.0, 0.0, 0.3)
    errors = []
    for h in (1e-3, 5e-4):
        run = scene.simulate(1.2, h=h, integrator=fm.EnergyMomentum())
        momentum = run.momentum()
        for part in (momentum.linear, momentum.angular):
            assert np.abs(part - part[0]).max() < 1e-9 * np.abs(part[0]).max()
        grown = np.diff(run.energy().total[[0, -1]])[0]
        errors.append(abs(grown - simpson(run.strain_power(beam), x=run.t)) / grown)
    assert errors[1] < 0.3 * errors[0] < 2e-3


def test_a_restart_goes_on_to_the_bit():
    scene, beam = clamped(2, (0.0, 0.0, 0.0, 0.0, 0.0, swell), viscosity=0.01)
    whole = scene.simulate(0.4, rtol=1e-6, checkpoints=[0.2])
    rest = scene.simulate(0.4, rtol=1e-6, restart=whole.checkpoints[0])
    np.testing.assert_array_equal(rest.x[-1], whole.x[-1])
    np.testing.assert_array_equal(rest.strain_power(beam)[-1], whole.strain_power(beam)[-1])


def test_a_function_is_called_once_for_all_elements():
    calls: list[float] = []

    def counted(t):
        calls.append(t)
        return swell(t)

    asked = []
    for n in (1, 4):
        calls.clear()
        clamped(n, (0.0, 0.0, 0.0, 0.0, 0.0, counted))[0].simulate(1e-3, h=5e-4, integrator=fm.CentralDifference())
        asked.append(len(calls))
    assert asked[0] == asked[1]


def test_each_element_may_have_a_strain_of_its_own():
    """Two that bend to either side: the tip ends beside the axis, as two arcs one after the other have it."""
    bends = [(0.0, 0.0, 0.0, 0.0, 0.0, rolled(share)) for share in (0.1, -0.1)]
    scene, beam = clamped(2, bends)
    angle = 0.1 * np.pi
    bent = scene.equilibrium(t=2 * RAMP)
    first = 0.5 * LENGTH / angle * np.array([np.sin(angle), 1 - np.cos(angle), 0.0])
    assert bent.position(beam.frame("tip")) == pytest.approx(2 * first, abs=1e-9)
    assert bent.rotation(beam.frame("tip")) == pytest.approx(np.eye(3), abs=1e-9)


@pytest.mark.parametrize(
    ("strain", "more", "text"),
    [
        ((0.0, 0.0, 0.0, 0.0, swell), {}, r"shape \(6,\)"),
        ([(0.0, 0.0, 0.0, 0.0, 0.0, swell)] * 2, {}, r"shape \(3, 6\)"),
        ((np.nan, 0.0, 0.0, 0.0, 0.0, swell), {}, "finite"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, "much"), {}, "str is not a function of time"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, fm.compiled(lambda t: 0.1 * t)), {}, "rate and acceleration"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, fm.Signal("muscle")), {}, "jumps"),
        (
            (0.0, 0.0, 0.0, 0.0, 0.0, PPoly([[0.0, 1.0]], [0.0, 1.0, 2.0])),
            {"viscosity": 0.01},
            r"strain 5 of 'rod' of beam 'beam' jumps at t = 1 s, which the beam's viscosity",
        ),
    ],
)
def test_bad_strains_of_time(strain, more, text):
    with pytest.raises(SceneError, match=text):
        clamped(3, strain, **more)


def test_a_callable_without_rates_is_told_by_name():
    scene, _ = clamped(1, (0.0, 0.0, 0.0, 0.0, 0.0, lambda t: 0.1 * t))
    with pytest.raises(SceneError, match=r"strain 5 of 'rod' of beam 'beam' at t = 0 s") as failed:
        scene.simulate(0.1)
    assert "shape" in str(failed.value) + str(failed.value.__cause__)
