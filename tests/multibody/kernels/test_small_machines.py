"""Machines of any size: no number may be taken for round-off because its unit is another's."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm


def slider_crank(size):
    """Of masses as ever and lengths times ``size``, in a gravity that is as many times as large."""
    scene = fm.System(gravity=(0.0, -9.81 * size, 0.0))
    crank = scene.add(fm.RigidBody(0.4, np.array([2e-4, 3e-4, 4e-4]) * size**2, (0.03 * size, 0.0, 0.0)), name="crank")
    rod = scene.add(fm.RigidBody(0.8, np.array([3e-4, 7e-3, 7.2e-3]) * size**2, (0.14 * size, 0.0, 0.0)), name="rod")
    piston = scene.add(fm.RigidBody(0.3, np.array([1e-4, 1e-4, 1e-4]) * size**2), name="piston")
    turn = fm.joint.Revolute("z")
    j1 = scene.connect(turn, scene.ground.frame(), crank.frame())
    j2 = scene.connect(turn, crank.frame(p=(0.08 * size, 0.0, 0.0)), rod.frame())
    scene.connect(turn, rod.frame(p=(0.3 * size, 0.0, 0.0)), piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame(), way=fm.Way.CONSTRAINTS)
    j1.position, j1.velocity = 0.5, 10.0
    return scene, j1, j2


@pytest.mark.parametrize("exponent", [-30, -24, -10, 24])
def test_angular_accelerations_do_not_depend_on_the_size(exponent):
    """From kilometres to nanometres: a closed loop's translations in m beside its rotations in rad."""
    found = []
    for size in (1.0, 2.0**exponent):
        scene, *joints = slider_crank(size)
        start = scene.start()
        found.append(np.concatenate([start.a[start.scene.index.joints[joint].v] for joint in joints]))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-11)
