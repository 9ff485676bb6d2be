"""Impacts on stops: what a contact leaves in velocities stays, so no method may count it as a vibration's error.

Against the equation of motion of one coordinate by scipy's pair of order 8 with steps far below the contact.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from particles import particle_body
from scipy.integrate import solve_ivp

import flexmbd as fm

MASS, LENGTH, SPIN_INERTIA = 0.5, 0.1, 4e-3
INERTIA = SPIN_INERTIA + MASS * LENGTH**2
T_END, LIMIT, START = 2.0, 0.4, 0.33
#: stiffness (N m/rad), damping (s/rad), transition (rad); of a contact of 1 ms, of 10 ms, of 0.1 s, of one that rests.
STOPS = {
    "hard": (5e4, 0.0, 1e-3),
    "abrupt": (5e4, 0.0, 1e-5),
    "middling": (500.0, 0.0, 1e-3),
    "soft": (5.0, 0.0, 1e-3),
    "damped": (500.0, 0.2, 1e-3),
}
METHODS = {
    "8(5,3)": (fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8), (1e-4, 1e-6, 1e-8)),
    "5(4)": (fm.ExplicitRungeKutta(), (1e-4, 1e-6, 1e-8)),
    "Radau": (fm.RadauIIA(), (1e-4, 1e-5, 1e-6, 1e-7, 1e-8)),
    "generalized-alpha": (fm.GeneralizedAlpha(), (1e-4, 1e-5, 1e-6)),
    "energy-momentum": (fm.EnergyMomentum(), (1e-4, 1e-5, 1e-6)),
}


@cache
def exact(stop):
    stiffness, damping, transition = STOPS[stop]

    def push(depth, rate):
        if depth <= 0.0:
            return 0.0
        part = min(depth, transition)
        force = stiffness * (part * part / (2.0 * transition) + max(0.0, depth - transition))
        return force * max(0.0, 1.0 + damping * rate)

    def equation(t, y):
        torque = push(-LIMIT - y[0], -y[1]) - push(y[0] - LIMIT, y[1]) - MASS * 9.81 * LENGTH * np.cos(y[0])
        return y[1], torque / INERTIA

    contact = np.sqrt(INERTIA / stiffness)
    run = solve_ivp(equation, (0.0, T_END), (START, 0.0), method="DOP853", rtol=1e-12, atol=1e-13, max_step=contact)
    return run.y[0, -1]


def pendulum(stop):
    stiffness, damping, transition = STOPS[stop]
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    body = scene.add(fm.RigidBody(MASS, (1e-3, SPIN_INERTIA, SPIN_INERTIA), (LENGTH, 0.0, 0.0)), name="body")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame(), name="hinge")
    limits = {"lower": -LIMIT, "upper": LIMIT}
    scene.add_force(fm.force.JointStop(hinge, **limits, stiffness=stiffness, damping=damping, transition=transition))
    hinge.position = START
    return scene, hinge


@pytest.mark.parametrize("stop", STOPS)
@pytest.mark.parametrize("method", METHODS)
def test_impacts_are_as_exact_as_rtol_asks(method, stop):
    """Two seconds hold up to ten impacts, at places where no step ends: up to 50 rtol.

    A pendulum that meets no stop ends at 40 rtol after as long.
    """
    integrator, tolerances = METHODS[method]
    errors = []
    for rtol in tolerances:
        scene, hinge = pendulum(stop)
        run = scene.simulate(T_END, rtol=rtol, integrator=integrator)
        errors.append(abs(run.beta(hinge)[-1].item() - exact(stop)) / rtol)
    assert max(errors) < 100.0, errors


@cache
def exact_from(stop, starts, t_end):
    """(k,) angles at t_end (s) from rest at each of the starts (rad)."""
    stiffness, _, transition = STOPS[stop]

    def push(depth):
        part = np.clip(depth, 0.0, transition)
        return stiffness * (part * part / (2.0 * transition) + np.maximum(0.0, depth - transition))

    def equation(t, y):
        angle, rate = y.reshape(2, -1)
        torque = push(-LIMIT - angle) - push(angle - LIMIT) - MASS * 9.81 * LENGTH * np.cos(angle)
        return np.concatenate([rate, torque / INERTIA])

    y, longest = np.concatenate([starts, np.zeros(len(starts))]), 0.3 * np.sqrt(INERTIA / stiffness)
    run = solve_ivp(equation, (0.0, t_end), y, method="DOP853", rtol=1e-12, atol=1e-13, max_step=longest)
    return run.y[: len(starts), -1]


@pytest.mark.parametrize("stop", ["hard", "abrupt"])
@pytest.mark.parametrize(("method", "most"), [("Radau", 40.0), ("8(5,3)", 5.0)])
def test_no_impact_is_missed_wherever_steps_end(method, most, stop):
    """Forty starts, one impact each: contacts lie in all ways between the ends of steps and their stages.

    With the factors of a contact Newton's corrections are small, also where the contact is over and all is wrong; and
    of a contact within a step no estimate of an order means an error.
    """
    starts, t_end = tuple(np.linspace(-0.3, 0.3, 40)), 0.45
    exact = exact_from(stop, starts, t_end)
    apart = np.abs(exact) < LIMIT - 0.02  # in a contact angles are anything but proportional to times
    assert apart.sum() > 20
    for rtol in (1e-4, 1e-5):
        errors = []
        for start in np.array(starts)[apart]:
            scene, hinge = pendulum(stop)
            hinge.position = start
            run = scene.simulate(t_end, rtol=rtol, integrator=METHODS[method][0])
            errors.append(run.beta(hinge)[-1].item())
        errors = np.abs(np.array(errors) - exact[apart]) / rtol
        assert errors.max() < most


def test_impacts_of_elastic_bodies():
    """A body of modes of 2200 to 4500 rad/s, which no step resolves, swings against a stop of its hinge."""
    record = particle_body(3, modes=4, damping=0.1).record
    stiff = replace(record, stiffness=1e5 * record.stiffness)

    def fall(start, integrator, rtol):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        body = scene.add(fm.FlexibleBody(stiff), name="body")
        hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("root"))
        scene.add_force(fm.force.JointStop(hinge, start - 0.3, start + 0.3, 2e4))
        hinge.position = start
        return scene.simulate(1.0, rtol=rtol, integrator=integrator).beta(hinge)[-1].item()

    for start in np.linspace(0.1, 0.6, 8):
        exact = fall(start, METHODS["8(5,3)"][0], 1e-9)
        # at 1e-4 the step that meets the stop is as long as the impact, and one start of eight is 18 rtol off by chance
        assert abs(fall(start, METHODS["Radau"][0], 1e-5) - exact) < 15.0 * 1e-5


def chain(law):
    """Three rods, the outer two held by stiff springs that users write."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    before = scene.ground.frame()
    hinges = []
    for k in range(3):
        rod = scene.add(fm.RigidBody(MASS, (1e-3, SPIN_INERTIA, SPIN_INERTIA), (LENGTH, 0.0, 0.0)), name=f"rod {k}")
        hinges.append(scene.connect(fm.joint.Revolute("z"), before, rod.frame(), name=f"hinge {k}"))
        before = rod.frame(p=(2.0 * LENGTH, 0.0, 0.0))
    for hinge in hinges[1:]:
        scene.add_force(law(hinge))
    hinges[0].position = START
    return scene, hinges


@pytest.mark.parametrize("method", ["generalized-alpha", "Radau", "energy-momentum"])
def test_a_stiffness_that_stays_costs_no_steps(method):
    """A user's stiff law, whose vibration of 1e-5 rad no step need follow, takes the steps of a spring."""
    @fm.compiled
    def law(t, angle, rate):
        return -1e4 * angle - 1e-2 * rate

    steps = []
    for hold in (
        lambda hinge: fm.force.JointSpring(hinge, 1e4, damping=1e-2),
        lambda hinge: fm.force.JointLaw(hinge, law),
    ):
        scene, _ = chain(hold)
        steps.append(scene.simulate(0.5, rtol=1e-4, integrator=METHODS[method][0]).stats.steps)
    assert steps[1] < 1.3 * steps[0]
    assert steps[1] < 500  # the vibration turns through 1 500 radians
