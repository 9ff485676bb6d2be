"""What users say twice and differently is told, not taken."""

from __future__ import annotations

import numpy as np
import pytest
from machines import pendulum

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.fingerprint import fingerprint
from flexmbd.multibody.team import Alone


@pytest.mark.parametrize("way", [fm.Way.COORDINATES, fm.Way.CONSTRAINTS])
@pytest.mark.parametrize("what", ["position", "velocity"])
def test_a_prescribed_joint_starts_where_its_motion_has_it(way, what):
    scene = fm.System()
    wheel = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.25)), name="wheel")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), wheel.frame(), name="hinge", way=way)
    hinge.prescribe(fm.Sine(0.5, 2.0, offset=0.3))
    right = {"position": 0.3, "velocity": 1.0}[what]
    setattr(hinge, what, right)
    np.testing.assert_allclose(scene.simulate(0.1).position(wheel.frame()), 0.0, atol=1e-12)
    setattr(hinge, what, right + 0.1)
    with pytest.raises(SceneError, match=rf"'hinge': its {what} was set to {right + 0.1:g}.* starts at {right:g}"):
        scene.simulate(0.1)


def _moved(value, rate, acceleration, *, python):
    if python:
        return lambda t: (value(t), rate(t), acceleration(t))
    return fm.Motion(fm.compiled(value), fm.compiled(rate), fm.compiled(acceleration))


@pytest.mark.parametrize("python", [True, False])
@pytest.mark.parametrize(
    ("motion", "what"),
    [
        ((lambda t: 3.0 * t, lambda t: 3.0, lambda t: 0.0), None),
        ((lambda t: np.sin(9e2 * t), lambda t: 9e2 * np.cos(9e2 * t), lambda t: -8.1e5 * np.sin(9e2 * t)), None),
        ((lambda t: 1e6 + 1e-3 * t, lambda t: 1e-3, lambda t: 0.0), None),
        ((lambda t: 3.0 * t, lambda t: 2.0, lambda t: 0.0), "rate"),
        ((lambda t: 0.5, lambda t: 1.0, lambda t: 0.0), "rate"),
        ((lambda t: t**2, lambda t: 2.0 * t, lambda t: 1.0), "acceleration"),
        ((lambda t: np.sin(50.0 * t), lambda t: np.cos(50.0 * t), lambda t: -np.sin(50.0 * t)), "rate"),
    ],
)
def test_a_motion_whose_derivatives_are_others_is_refused(python, motion, what):
    scene, _, hinge = pendulum()
    hinge._position = None
    hinge.prescribe(_moved(*motion, python=python))
    if what is None:
        scene.simulate(0.01, rtol=1e-3)
        return
    with pytest.raises(SceneError, match=rf"motion of joint .* as its {what}, but its .* a second"):
        scene.simulate(0.01)


def driven(law, *, compiled=False):
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointTorque(hinge, fm.compiled(law) if compiled else law))
    return scene


def _torque(strength):
    return lambda t: strength * t


@pytest.mark.parametrize("compiled", [True, False])
def test_a_restart_with_another_torque_function_is_refused(compiled):
    run = driven(_torque(2.0), compiled=compiled).simulate(0.2, checkpoints=[0.1])
    (checkpoint,) = run.checkpoints
    again = driven(_torque(2.0), compiled=compiled).simulate(0.2, restart=checkpoint)
    assert again.x[-1].tobytes() == run.x[-1].tobytes()
    for other in (_torque(3.0), lambda t: 2.0 * t + 0.0 * t**2, lambda t: 4.0 * t):
        with pytest.raises(SceneError, match="functions differ"):
            driven(other, compiled=compiled).simulate(0.2, restart=checkpoint)


def test_what_a_function_notes_does_not_tell_it_apart():
    calls, count = [], 0
    table = np.array([1.0, 2.0])

    def torque(t):
        nonlocal count
        count += 1
        calls.append(t)
        return float(table @ [1.0, t])

    before = fingerprint(torque)
    torque(1.0)
    assert (count, len(calls)) == (1, 1)
    assert fingerprint(torque) == before
    table[1] = 3.0
    assert fingerprint(torque) != before


class _LastOfTwo(Alone):
    """Stands for rank 1: of what is agreed, rank 0 has what the same call gave before."""

    size = 2
    is_root = False

    def __init__(self, root):
        self.answers = iter(root)

    def agree(self, x):
        return next(self.answers)


class _Root(Alone):
    size = 2

    def __init__(self):
        self.told = []

    def agree(self, x):
        self.told.append(x)
        return x


@pytest.mark.parametrize("other", ["mass", "angle", None])
def test_scenes_that_differ_between_ranks_are_told(other):
    def build(team, *, mass=1.0, angle=0.3):
        scene = fm.System(team=team)
        arm = scene.add(fm.RigidBody(mass, (0.1, 0.1, 0.1), (1.0, 0.0, 0.0)), name="arm")
        scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame()).position = angle
        return scene

    root = _Root()
    build(root).start()
    scene = build(_LastOfTwo(root.told), **({} if other is None else {other: 1.5}))
    if other is None:
        scene.start()
        return
    with pytest.raises(SceneError, match="the scene differs between ranks"):
        scene.start()
