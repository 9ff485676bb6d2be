"""Laws and loads that jump where nobody declared it: passed by steps of order 1, within rtol, and counted."""

from __future__ import annotations

import numpy as np
import pytest
from damped_contact import CONTACT, METHODS

import flexmbd as fm

STIFFNESS, DAMPING, RADIUS = CONTACT.stiffness, CONTACT.damping, CONTACT.radius


@fm.compiled
def contact(t, y, v):
    return -STIFFNESS * (y - RADIUS) - DAMPING * v if y < RADIUS else 0.0


@pytest.mark.parametrize("name", METHODS)
def test_contact_with_a_damper(name: str) -> None:
    """Two impacts, whose force jumps where they begin and where they end: errors of some rtol at each."""
    jumps = 0
    for rtol in (1e-4, 1e-5) if METHODS[name].order < 5 else (1e-4, 1e-6, 1e-8):
        scene, joints = CONTACT.scene(contact)
        run = scene.simulate(0.25, rtol=rtol, integrator=METHODS[name])
        assert max(CONTACT.errors(run, joints[0])) < 10.0 * rtol, rtol
        jumps += run.stats.jumps
    assert jumps > 0  # with the tightest tolerances they are passed within rounding


@pytest.mark.parametrize("name", ["8(5,3)", "alpha"])
def test_many_contacts_in_a_radian(name: str) -> None:
    """Twelve balls from different heights: all jumps of a radian share its rtol."""
    scene, joints = CONTACT.scene(contact, 12)
    for k, joint in enumerate(joints):
        joint.position = CONTACT.height * (1.0 + 0.01 * k)
    run = scene.simulate(0.2, rtol=1e-5, integrator=METHODS[name])
    for k, joint in enumerate(joints):
        alone = type(CONTACT)(height=CONTACT.height * (1.0 + 0.01 * k))
        assert max(alone.errors(run, joint)) < 10.0 * 1e-5


@pytest.mark.parametrize("name", METHODS)
def test_load_that_stops(name: str) -> None:
    """A mass on a spring, a force on it that ceases: as where the instant is declared."""
    rate, force, stops, rtol = 3.0, 5.0, 0.7, 1e-5
    scene = fm.System()
    mass = scene.add(fm.RigidBody(1.0, (1e-3,) * 3), name="mass")
    joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), mass.frame())
    joint.position = 0.1
    scene.add_force(fm.force.JointSpring(joint, rate**2))
    scene.add_force(fm.force.JointForce(joint, lambda t: force if t < stops else 0.0))
    run = scene.simulate(2.0, rtol=rtol, integrator=METHODS[name])
    rest = force / rate**2
    x, v = rest + (0.1 - rest) * np.cos(rate * stops), -(0.1 - rest) * rate * np.sin(rate * stops)
    s = 2.0 - stops
    exact = x * np.cos(rate * s) + v / rate * np.sin(rate * s)
    assert abs(run.beta(joint)[-1] - exact) < 20.0 * rtol
    assert run.stats.jumps <= 1


@pytest.mark.parametrize("name", METHODS)
def test_smooth_motions_have_none(name: str) -> None:
    """A stiff spring beside a soft one, let go, and a stop: steps are rejected, and nothing is taken for a jump."""
    scene = fm.System()
    joints = []
    for stiffness, position in ((1e6, 1e-3), (10.0, 0.2)):
        mass = scene.add(fm.RigidBody(1.0, (1e-3,) * 3), name=f"mass {stiffness:g}")
        joints.append(scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), mass.frame()))
        joints[-1].position = position
        scene.add_force(fm.force.JointSpring(joints[-1], stiffness))
    scene.add_force(fm.force.JointStop(joints[1], -0.1, 0.3, 1e4))
    run = scene.simulate(0.6, rtol=1e-4, integrator=METHODS[name])
    assert run.stats.jumps == 0


def test_endless_jumps_end_the_run() -> None:
    """Coulomb's friction that has come to rest jumps at every step: the run ends there, and says what to look for."""
    scene = fm.System()
    block = scene.add(fm.RigidBody(2.0, (1e-3,) * 3), name="block")
    joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame())
    joint.velocity = 1.0
    scene.add_force(fm.force.JointLaw(joint, lambda t, x, v: -3.0 * np.sign(v)))
    with pytest.raises(fm.SimulationError, match="jump") as failed:
        scene.simulate(2.0, rtol=1e-6, integrator=METHODS["8(5,3)"])
    assert abs(failed.value.trajectory.t[-1] - 2.0 / 3.0) < 1e-6
    assert failed.value.trajectory.stats.steps < 1000


@pytest.mark.parametrize("name", ["8(5,3)", "alpha"])
def test_restart_between_jumps(name: str) -> None:
    """A restart within a contact goes on to the bit, and an event behind it is found as without a checkpoint."""
    scene, joints = CONTACT.scene(contact)
    top = fm.Event(lambda m: m.beta_rate(joints[0]), direction=fm.Direction.FALLING, name="top")
    at = 0.1015
    whole = scene.simulate(0.2, rtol=1e-5, integrator=METHODS[name], checkpoints=[at], events=[top])
    rest = scene.simulate(0.2, rtol=1e-5, integrator=METHODS[name], restart=whole.checkpoints[0], events=[top])
    after = whole.t >= at
    np.testing.assert_array_equal(rest.x, whole.x[after])
    assert [one.t for one in rest.events] == [one.t for one in whole.events if one.t > at]
    assert rest.stats.jumps == whole.stats.jumps


def test_variants() -> None:
    """Variants of a compiled machine, whose runs are prepared where they can be, are scenes of those numbers."""
    scene, joints = CONTACT.scene(contact)
    machine = scene.compile(parameters={"mass": fm.parameter.Mass(joints[0].child.body)})
    for mass in (0.2, 0.3, 0.25):
        run = machine.simulate(0.2, mass=mass, rtol=1e-5)
        alone = type(CONTACT)(mass=mass)
        assert max(alone.errors(run, joints[0])) < 10.0 * 1e-5
