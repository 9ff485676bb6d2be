"""Users' functions called from inside the step: what they give, and what happens where they fail."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.errors import SimulationError


def wheel():
    scene = fm.System()
    disc = scene.add(fm.RigidBody(2.0, (0.25, 0.25, 0.25)), name="disc")
    return scene, scene.connect(fm.joint.Revolute(), scene.ground.frame(), disc.frame(), name="hinge")


def test_a_compiled_function_of_time_that_gives_no_number():
    scene, hinge = wheel()
    scene.add_force(fm.force.JointTorque(hinge, fm.compiled(lambda t: np.sqrt(0.3 - t))))
    with pytest.raises(SimulationError, match=r"JointTorque on joint 'hinge': at t = 0\.3.* no finite") as caught:
        scene.simulate(1.0, rtol=1e-6)
    past = caught.value.trajectory
    assert 0.2 < past.t[-1] <= 0.3
    exact = (0.3**1.5 - (0.3 - past.t) ** 1.5) * 2.0 / 3.0 / 0.25
    np.testing.assert_allclose(past.beta_rate(hinge), exact, atol=1e-4)
