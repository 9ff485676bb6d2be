"""The integrator that a scene gets when none is named."""

from __future__ import annotations

import numpy as np
import pytest
from machines import pendulum, slider_crank
from particles import particle_body

import flexmbd as fm
from flexmbd.errors import SceneError


def with_spring(stiffness):
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointSpring(hinge, stiffness, rest=np.pi))
    return scene


def with_friction():
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointFriction(hinge, 0.1, 0.01))
    return scene


def with_penalty():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="bob")
    scene.connect(fm.joint.Free(), scene.ground.frame(), bob.frame())
    scene.connect(fm.joint.Spherical(), scene.ground.frame(), bob.frame(), enforce=fm.Penalty(1e5))
    return scene


def flexible():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.FlexibleBody(particle_body(3, modes=4).record), name="flexible")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    return scene


@pytest.mark.parametrize(
    ("scene", "arguments", "chosen", "why"),
    [
        (lambda: pendulum()[0], {}, "8(5,3)", "nothing stiff"),
        (lambda: pendulum()[0], {"rtol": 1e-3}, "5(4)", "nothing stiff"),
        (lambda: slider_crank()[0], {}, "8(5,3)", "nothing stiff"),
        (lambda: pendulum()[0], {"h": 1e-3}, "generalized-alpha", "fixed steps"),
        (lambda: with_spring(5.0), {}, "8(5,3)", "nothing stiff"),
        (lambda: with_spring(1e6), {}, "Radau", "springs and dampers of 1e+03 1/s"),
        (with_friction, {}, "generalized-alpha", "abrupt forces: friction"),
        (with_penalty, {}, "Radau", "penalties"),
        (flexible, {}, "Radau", "modes of flexible bodies"),
    ],
)
def test_what_is_stiff_is_run_by_an_implicit_method(scene, arguments, chosen, why):
    machine = scene()
    said = machine.explain(**arguments).splitlines()[-1]
    assert said.startswith("integrator: ")
    assert chosen in said
    assert why in said
    run = machine.simulate(0.01, **arguments)
    assert chosen in run.stats.integrator
    named = machine.simulate(0.01, integrator="auto", **arguments)
    np.testing.assert_array_equal(run.x, named.x)


def test_a_method_by_a_name_that_there_is_none_of():
    with pytest.raises(SceneError, match=r"integrator must be a method, as fm.RadauIIA\(\), or \"auto\", got 'euler'"):
        pendulum()[0].simulate(1.0, integrator="euler")


def test_a_method_that_was_named_is_told():
    scene = pendulum()[0]
    assert scene.explain(integrator=fm.GeneralizedAlpha()).endswith(
        "integrator: generalized-alpha, rho = 0.8, order 2 (as asked)"
    )
    with pytest.raises(SceneError, match=r"integrator must be a method, as fm\.RadauIIA"):
        scene.explain(integrator="euler")
