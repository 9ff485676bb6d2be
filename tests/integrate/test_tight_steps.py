"""Short steps of stiff machines: what round-off of places makes of velocities within a step passes for no error."""

from __future__ import annotations

import numpy as np

import flexmbd as fm


def whirling_pair(*, far):
    """Two bodies on a stiff spring that turn about each other at 2 rad/s, ``far`` metres from the origin."""
    scene = fm.System()
    frames = []
    for name, x, speed in (("left", far, 1.0), ("right", far + 1.0, -1.0)):
        body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=name)
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position, free.velocity = (x, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (0.0, speed, 0.0, 0.0, 0.0, 0.0)
        frames.append(body.frame())
    scene.add_force(fm.force.SpringDamper(*frames, stiffness=1e12, length=1.0))
    return scene, frames


def test_a_stiff_pair_takes_no_more_steps_a_kilometre_away():
    """A place of 1 km, rounded to 1e-13 m, is moved back by the spring within a step of some 1e-4 s, at 1e-9 m/s."""
    steps = []
    for far in (0.0, 1e3):
        scene, (left, right) = whirling_pair(far=far)
        run = scene.simulate(0.5, rtol=1e-6, integrator=fm.RadauIIA(), max_steps=5000)
        apart = run.position(right)[-1] - run.position(left)[-1]
        np.testing.assert_allclose(apart, [np.cos(1.0), -np.sin(1.0), 0.0], atol=1e-5)
        steps.append(run.stats.steps)
    assert steps[1] < 1.5 * steps[0]
