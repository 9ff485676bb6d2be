"""Values that no machine has, and failures while an event is located: each one error, none from deep inside."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm


def pendulum(**mass):
    scene = fm.System()
    given = {"mass": 2.0, "inertia": (0.1, 0.1, 0.1), "com": (0.3, 0.0, 0.0)} | mass
    bob = scene.add(fm.RigidBody(**given), name="bob")
    hinge = scene.connect(fm.joint.Revolute(), scene.ground.frame(), bob.frame(), name="hinge")
    return scene, hinge, bob


def test_rows_of_a_table_beyond_all_memory():
    scene, _, _ = pendulum()
    run = scene.simulate(0.1)
    with pytest.raises(fm.SceneError, match=r"every = 1e-300 s makes 1e\+299 times"):
        run.table(every=1e-300)


@pytest.mark.parametrize("start", [np.array(0.0), np.float32(0.0), 0])
def test_times_of_any_kind_of_number(start):
    runs = [pendulum()[0].simulate(0.1, t_start=t, h=np.float32(2.0**-7)) for t in (start, 0.0)]
    np.testing.assert_array_equal(runs[0].x, runs[1].x)


def test_a_time_too_short_to_divide():
    with pytest.raises(fm.SceneError, match="t_end = 5e-324 s must lie after the start"):
        pendulum()[0].simulate(5e-324)


def test_steps_at_the_largest_time():
    """The distance to the next number is none there."""
    with pytest.raises((fm.SceneError, fm.SimulationError)):
        pendulum()[0].simulate(np.finfo(float).max, max_steps=5)


def test_integers_of_more_than_64_bits():
    scene, _, bob = pendulum()
    other = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="other")
    scene.connect(fm.joint.Distance(length=10**30), bob.frame((1.0, 0.0, 0.0)), other.frame(), name="rod")
    with pytest.raises(fm.AssemblyError, match=r"rod: distance stays open by 5\.000e\+29"):
        scene.simulate(0.1)


def test_nothing_set_on_a_joint_without_coordinates():
    """A weld that cannot be closed is told as such, and not as the coordinates of a joint that has none."""
    scene, _, bob = pendulum()
    far = scene.ground.frame((5.0, 0.0, 0.0))
    weld = scene.connect(fm.joint.Fixed(), far, bob.frame(), way=fm.Way.CONSTRAINTS, name="weld")
    weld.position = weld.velocity = []
    with pytest.raises(fm.SceneError, match="velocity of a Fixed takes 0"):
        weld.velocity = 3.0
    with pytest.raises(fm.AssemblyError, match="cannot be assembled: weld"):
        scene.simulate(0.1)


def test_what_lies_beneath_a_mask_is_no_number():
    _, hinge, _ = pendulum()
    with pytest.raises(fm.SceneError, match="position of a Revolute takes 1 finite"):
        hinge.position = [np.ma.masked]


def test_a_coordinate_that_is_an_array():
    scene, hinge, _ = pendulum()
    with pytest.raises(fm.SceneError, match="JointSpring on joint 'hinge'"):
        scene.add_force(fm.force.JointSpring(hinge, 1.0, coordinate=np.zeros(2)))


@pytest.mark.parametrize("method", [fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(), fm.RadauIIA()])
def test_a_force_that_fails_while_an_event_is_located(method):
    """The step over the event was taken; a shorter one, back towards the event, fails."""
    scene, hinge, _ = pendulum()
    seen = []

    def crossing(moment):
        seen.append(moment.t > 0.05)
        return moment.t - 0.05

    def torque(t):
        if any(seen):
            raise ValueError("worn out")
        return 0.0

    scene.add_force(fm.force.JointTorque(hinge, torque))
    with pytest.raises(fm.SimulationError, match=r"at t = 0\.0[0-9]+ s failed: ValueError: worn out") as caught:
        scene.simulate(0.1, events=[fm.Event(crossing)])
    assert caught.value.trajectory.t[-1] < 0.05


def beyond_energy():
    """A run whose rows are numbers, and whose energy and momentum are none: a rock that slides along, weightless."""
    scene = fm.System()
    rock = scene.add(fm.RigidBody(1e308, (1.0, 1.0, 1.0)), name="rock")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), rock.frame(), name="slide")
    slide.velocity = 1e3
    return scene.simulate(1e-3, h=1e-3, integrator=fm.ExplicitRungeKutta()), scene, rock


def test_answers_beyond_what_doubles_hold_are_told_by_name():
    run, _, rock = beyond_energy()
    assert np.isfinite(run.x).all()
    for ask, name in (
        (run.energy, "the energy"), (lambda: run.energy(t=[5e-4]), "the energy"), (run.momentum, "the momentum"),
        (lambda: run.table(energies=True), "the energy"),
    ):  # fmt: skip
        with pytest.raises(fm.SceneError, match=f"{name} is beyond what doubles hold at t = (0|0.0005) s"):
            ask()
    assert run.position(rock.frame()).shape == (len(run.t), 3)


def test_a_run_whose_energy_is_beyond_numbers_is_saved_nevertheless(tmp_path):
    run, scene, _ = beyond_energy()
    again = fm.Trajectory.load(run.save(tmp_path / "run.h5"), scene)
    np.testing.assert_array_equal(again.x, run.x)


@pytest.mark.parametrize("method", [fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(), fm.RadauIIA()])
@pytest.mark.timeout(60)
def test_a_machine_faster_than_every_step_ends(method):
    """Its rate asks for a step of nothing, by which no time passes."""
    scene = fm.System()
    block = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="block")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), block.frame(), name="slide")
    scene.add_force(fm.force.JointForce(slide, 1e300))
    with pytest.raises(fm.SimulationError, match="the simulation stopped at t = "):
        scene.simulate(1.0, integrator=method, max_steps=1000)
