"""Velocities that loops forbid are told where they change by more than a tenth: a parallelogram's cranks turn alike."""

import warnings

import numpy as np
import pytest

import flexmbd as fm


def parallelogram(first, second, size=1.0):
    """Two cranks of equal length and the coupler between them; the hinges at the ground."""
    scene = fm.System()
    bodies = [scene.add(fm.RigidBody(1.0, (size**2,) * 3, (0.1 * size, 0, 0)), name=name) for name in ("a", "b", "c")]
    hinge = fm.joint.Revolute("z")
    one = scene.connect(hinge, scene.ground.frame(), bodies[0].frame(), name="one")
    scene.connect(hinge, bodies[0].frame(p=(0.2 * size, 0, 0)), bodies[1].frame(), name="pin").position = -1.0
    two = scene.connect(hinge, scene.ground.frame(p=(0.6 * size, 0, 0)), bodies[2].frame(), name="two")
    scene.connect(hinge, bodies[1].frame(p=(0.6 * size, 0, 0)), bodies[2].frame(p=(0.2 * size, 0, 0)), name="end")
    one.position, two.position = 1.0, 1.0
    one.velocity, two.velocity = first, second
    return scene, one, two


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("first", "second"), [(15.0, -30.0), (15.0, 0.0), (1e-3, 2e-3)])
def test_velocities_that_do_not_go_together_are_told_once(first, second, size):
    scene, one, two = parallelogram(first, second, size)
    with pytest.warns(fm.StartWarning, match="loops forbid the velocities") as told:
        run = scene.simulate(1e-3)
    assert len(told) == 1
    rates = [run.beta_rate(joint).ravel()[0] for joint in (one, two)]
    assert rates[0] == pytest.approx(rates[1], rel=1e-9)
    for name, given, rate in zip(("one", "two"), (first, second), rates, strict=True):
        assert f"'{name}.angle' was set to {given:.4g} and begins with {rate:.4g}" in str(told[0].message)


@pytest.mark.parametrize(("first", "second"), [(15.0, 15.0), (15.0, None), (None, None), (0.0, 0.0), (15.0, 15.5)])
def test_velocities_that_go_together_say_nothing(first, second):
    scene, one, two = parallelogram(first, second)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = scene.simulate(1e-3)
    assert np.isclose(run.beta_rate(one).ravel()[0], run.beta_rate(two).ravel()[0])
