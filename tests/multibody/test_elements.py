"""Force elements against closed forms: laws on coordinates and wrenches between frames."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import flexmbd as fm
from flexmbd.errors import SceneError


def wheel(inertia=0.25):
    scene = fm.System()
    disc = scene.add(fm.RigidBody(2.0, (inertia, inertia, inertia)), name="disc")
    return scene, disc, scene.connect(fm.joint.Revolute(), scene.ground.frame(), disc.frame(), name="hinge")


def test_a_joint_spring_and_damper_make_an_oscillator():
    """I b'' + c b' + k (b - r) = 0: decay and period in closed form, whichever way the damping is given."""
    k, c, rest, inertia = 25.0, 0.8, 0.1, 0.25
    for apart in (False, True):
        scene, _, hinge = wheel(inertia)
        scene.add_force(fm.force.JointSpring(hinge, k, rest, 0.0 if apart else c))
        if apart:
            scene.add_force(fm.force.JointDamper(hinge, c))
        hinge.position = 0.4
        run = scene.simulate(2.0, rtol=1e-7)
        decay = c / (2.0 * inertia)
        omega = np.sqrt(k / inertia - decay**2)
        swing = np.cos(omega * run.t) + decay / omega * np.sin(omega * run.t)
        exact = rest + 0.3 * np.exp(-decay * run.t) * swing
        np.testing.assert_allclose(run.beta(hinge), exact, atol=2e-6)


def test_the_energy_of_a_spring_is_counted():
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointSpring(hinge, 25.0, 0.1))
    hinge.position = 0.4
    run = scene.simulate(2.0, rtol=1e-7)
    energy = run.energy()
    np.testing.assert_allclose(energy.spring, 12.5 * (run.beta(hinge) - 0.1) ** 2, rtol=1e-12)
    np.testing.assert_allclose(energy.total, 12.5 * 0.09, rtol=1e-5)
    assert energy.spring.min() < 1e-2 * energy.spring.max()  # it was exchanged


def test_a_spring_by_its_characteristic():
    """A table resists by its spline and goes on straight outside; its energy is the spline's integral."""
    deflection = np.linspace(-0.3, 0.3, 7)
    force = 20.0 * deflection + 90.0 * deflection**3
    spline = CubicSpline(deflection, force)
    scene, _, hinge = wheel()
    scene.add_force(fm.force.JointSpring(hinge, fm.Table(deflection, force), rest=0.2))
    hinge.position = 0.9
    start = scene.start()
    expected = -(float(spline(0.3)) + 0.4 * float(spline(0.3, 1))) / 0.25
    assert start.a[0] == pytest.approx(expected, rel=1e-12)
    run = scene.simulate(1.5, rtol=1e-7)
    stretch = run.beta(hinge) - 0.2
    inside = np.abs(stretch) < 0.3
    stored = np.array([spline.integrate(0.0, s) for s in stretch[inside]])
    np.testing.assert_allclose(run.energy().spring[inside], stored, atol=1e-12)
    total = run.energy().total
    np.testing.assert_allclose(total, total[0], rtol=1e-5)
    assert inside.any()
    assert not inside.all()


def test_elements_that_no_joint_takes():
    scene, disc, hinge = wheel()
    ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    socket = scene.connect(fm.joint.Spherical(), disc.frame(), ball.frame(), name="socket")
    with pytest.raises(SceneError, match="JointSpring on joint 'socket': a Spherical has no coordinate that is one"):
        scene.add_force(fm.force.JointSpring(socket, 1.0))
    with pytest.raises(SceneError, match="coordinate 1 of joint 'hinge': a Revolute has coordinates 0 to 0"):
        scene.add_force(fm.force.JointDamper(hinge, 1.0, coordinate=1))
    with pytest.raises(SceneError, match=r"stiffness = -1\.0 must not be negative"):
        scene.add_force(fm.force.JointSpring(hinge, -1.0))
    with pytest.raises(SceneError, match="damping = nan is not a finite number"):
        scene.add_force(fm.force.JointDamper(hinge, np.nan))
    _, _, foreign = wheel()
    with pytest.raises(SceneError, match="'hinge' is not in this scene"):
        scene.add_force(fm.force.JointDamper(foreign, 1.0))
