"""Machines stepped from outside: to the bit as a run, with inputs held or linear; copies, snapshots, pickles."""

from __future__ import annotations

import copy
import math
import pickle
import subprocess
import sys
import warnings
from itertools import pairwise

import mechanisms
import numpy as np
import pytest
from damped_contact import CONTACT
from spring_interior import ImplicitSprings, as_continuum, chain

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.run.stepping import Integration

METHODS = {
    "5(4)": fm.ExplicitRungeKutta(),
    "radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(),
    "energy-momentum": fm.EnergyMomentum(),
    "central differences": fm.CentralDifference(),
}
MASS, STIFFNESS = 2.0, 300.0


def cart(*, stiffness=0.0, initial=0.3):
    """A mass on a slider, pushed by a signal."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(mass=MASS, inertia=(1.0, 1.0, 1.0)), name="cart")
    slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), body.frame(), name="slide")
    slide.position, slide.velocity = 1.0, -0.5
    push = fm.Signal("push", initial)
    scene.add_force(fm.force.JointForce(slide, push))
    if stiffness:
        scene.add_force(fm.force.JointSpring(slide, stiffness))
    return scene, slide, push


def pendulum(amplitude=0.3):
    """Two links in space that fall, of which a sine drives one and a signal the other."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    upper, lower = (
        scene.add(fm.RigidBody(1.0, (0.01, 0.02, 0.03), (0.2, 0.0, 0.01)), name=name) for name in ("upper", "lower")
    )
    shoulder = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), upper.frame())
    elbow = scene.connect(fm.joint.Spherical(), upper.frame((0.4, 0.0, 0.0)), lower.frame())
    scene.add_force(fm.force.JointTorque(shoulder, fm.Sine(amplitude, 7.0)))
    push = fm.Signal("torque")
    scene.add_force(fm.force.FrameForce(lower.frame((0.3, 0.0, 0.0)), (push, 0.0, 0.1)))
    return scene, elbow, push, lower.frame((0.3, 0.0, 0.0))


def crank():
    """A slider-crank with a loop, and a signal on its crank."""
    machine = mechanisms.slider_crank(0.3, 1.0, speed=10.0)
    return machine.scene


SCENES = {"pendulum": lambda: pendulum()[0], "slider-crank": crank}


def bodies_of(scene):
    return scene.compile().bodies


def places(scene):
    """Outputs that tell all positions and velocities of its bodies."""
    frames = [body.frame() for body in bodies_of(scene)]
    return [ask(frame) for frame in frames for ask in (fm.output.Position, fm.output.Velocity, fm.output.Acceleration)]


def told(run, scene):
    """The same of a trajectory, row by row."""
    frames = [body.frame() for body in bodies_of(scene)]
    parts = [part for frame in frames for part in (run.position(frame), run.velocity(frame), run.acceleration(frame))]
    return np.hstack(parts)


def state(stepper):
    now = stepper.now
    return np.concatenate([[stepper.t], now.x, now.v, now.a, now.multipliers])


def rows_of(run):
    kept = slice(None) if run.kept_rows is None else list(run.kept_rows)
    return np.hstack([run.t[:, None], run.x, run.v, run.a, run.row_multipliers[:, kept]])


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("which", SCENES)
def test_fixed_steps_one_by_one_are_the_rows_of_a_run(name, which):
    """To the bit, but for the end of the run, whose time is not the sum of its steps."""
    h, n = 1e-3, 60
    scene = SCENES[which]()
    run = scene.simulate(n * h, h=h, integrator=METHODS[name])
    stepper = scene.stepper(h=h, integrator=METHODS[name])
    found = [state(stepper)]
    for _ in range(n):
        stepper.step(h)
        found.append(state(stepper))
    np.testing.assert_array_equal(found[:-1], rows_of(run)[:-1])
    np.testing.assert_allclose(found[-1], rows_of(run)[-1], rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("which", SCENES)
def test_one_long_step_is_a_whole_run(name, which):
    scene = SCENES[which]()
    run = scene.simulate(0.05, h=1e-3, integrator=METHODS[name])
    stepper = scene.stepper(h=1e-3, integrator=METHODS[name])
    stepper.step(0.05)
    np.testing.assert_array_equal(state(stepper), rows_of(run)[-1])


@pytest.mark.parametrize("name", METHODS)
def test_rows_of_fixed_steps_do_not_hang_on_where_the_run_ends(name):
    """Of machines that begin at rest, too, whose rate the end of the run once told."""
    scene = SCENES["pendulum"]()
    short, long = (scene.simulate(t_end, h=1e-3, integrator=METHODS[name]) for t_end in (0.01, 0.7))
    n = len(short.t) - 1
    np.testing.assert_array_equal(rows_of(short)[:n], rows_of(long)[:n])


@pytest.mark.parametrize("name", ["5(4)", "central differences"])
@pytest.mark.parametrize("which", SCENES)
def test_steps_under_error_control_are_those_of_a_run_with_checkpoints_there(name, which):
    scene, stops = SCENES[which](), [0.013, 0.02, 0.1, 0.25]
    run = scene.simulate(0.25, rtol=1e-5, integrator=METHODS[name], checkpoints=stops)
    stepper = scene.stepper(rtol=1e-5, integrator=METHODS[name], horizon=0.25)
    for stop, checkpoint in zip(stops, run.checkpoints, strict=True):
        stepper.step_to(stop)
        kept = checkpoint.snapshot.state
        expected = np.concatenate([[stop], kept.x, kept.v, kept.a, kept.multipliers])
        np.testing.assert_array_equal(state(stepper), expected)


@pytest.mark.parametrize("name", METHODS)
def test_without_a_horizon_steps_are_a_chain_of_restarts(name):
    scene, restart = SCENES["pendulum"](), None
    h = None if name != "central differences" else 1e-3
    stepper = scene.stepper(rtol=1e-5, h=h, integrator=METHODS[name])
    for stop in (0.02, 0.03, 0.1):
        run = scene.simulate(stop, rtol=1e-5, h=h, integrator=METHODS[name], restart=restart, checkpoints=[stop])
        restart = run.checkpoints[-1]
        stepper.step_to(stop)
        np.testing.assert_array_equal(state(stepper), rows_of(run)[-1])
        stepper.snapshot()  # which drops the factors, as a checkpoint does


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("which", ["pendulum", "cart"])
def test_held_inputs_are_those_of_a_sampled_controller(name, which):
    """To the bit: both end steps where the inputs jump and begin anew there.

    Nothing else follows the time, which just before a jump is a few units of round-off less.
    """
    period, n = 1.0 / 64.0, 12
    forces = [math.sin(3.0 * k + 1.0) for k in range(n)]
    scene, _, push, *_ = pendulum(0.0) if which == "pendulum" else cart(stiffness=STIFFNESS)
    stepper = scene.stepper(h=period / 4.0, integrator=METHODS[name], inputs=[push])
    for force in forces:
        stepper.step(period, force)
    scene.add_controller(lambda t, y: forces[round(t / period)], period=period, measurements=[], inputs=[push])
    run = scene.simulate(n * period, h=period / 4.0, integrator=METHODS[name])
    np.testing.assert_array_equal(state(stepper), rows_of(run)[-1])


@pytest.mark.parametrize("name", METHODS)
def test_linear_inputs_go_straight(name):
    """A free mass under forces that are linear between samples: the third integral of their slopes."""
    scene, slide, push = cart()
    how = {"rtol": 1e-9} if name != "central differences" else {"h": 1e-4}
    told = {"x": fm.output.Position(slide), "v": fm.output.Velocity(slide)}
    stepper = scene.stepper(inputs={"f": push}, outputs=told, interpolation="linear", integrator=METHODS[name], **how)
    x, v, before = 1.0, -0.5, 0.3
    for dt, force in ((0.1, 5.0), (0.05, -3.0), (0.2, -3.0), (0.02, None), (0.1, 8.0)):
        y = stepper.step(dt, None if force is None else {"f": force})
        after = before if force is None else force
        x += v * dt + (before / 2.0 + (after - before) / 6.0) * dt**2 / MASS
        v += 0.5 * (before + after) * dt / MASS
        before = after
        assert y["x"] == pytest.approx(x, rel=2e-7)
        assert y["v"] == pytest.approx(v, rel=2e-7)
    assert stepper.inputs == {"f": 8.0}


def test_values_of_inputs_are_given_in_many_ways():
    """A number, a list, an array, a mapping of some; all give the same, and what is not given stays."""
    scene, slide, push = cart()
    other = fm.Signal("brake")
    scene.add_force(fm.force.JointForce(slide, other))
    ways = [[2.0, -0.5], np.array([2.0, -0.5]), (2, -0.5), {"push": 2.0, "brake": -0.5}, np.float32([2.0, -0.5])]
    ends = []
    for way in ways:
        stepper = scene.stepper(h=1e-2, inputs=[push, other])
        stepper.step(0.1, {"push": 1.0})
        stepper.step(0.1, way)
        stepper.step(0.1)
        ends.append(state(stepper))
    for end in ends:
        np.testing.assert_array_equal(end, ends[0])
    v = -0.5 + 0.1 * (1.0 + 1.5 + 1.5) / MASS
    assert ends[0][2] == pytest.approx(v, rel=1e-12)


@pytest.mark.parametrize("which", SCENES)
def test_outputs_are_those_of_a_trajectory(which):
    """Frames, and of the first joint's coordinates too; a function of the instant; by names the same."""
    scene = SCENES[which]()
    run = scene.simulate(0.02, h=1e-3, integrator=fm.GeneralizedAlpha())
    asked = [*places(scene), lambda now: now.rotation(bodies_of(scene)[0].frame()).ravel()]
    stepper = scene.stepper(h=1e-3, integrator=fm.GeneralizedAlpha(), outputs=asked)
    by_name = {"all": asked[0], "time": lambda now: now.t}
    named = scene.stepper(h=1e-3, integrator=fm.GeneralizedAlpha(), outputs=by_name)
    expected = np.hstack([told(run, scene), run.rotation(bodies_of(scene)[0].frame()).reshape(len(run.t), 9)])
    np.testing.assert_allclose(stepper.outputs(), expected[0], rtol=1e-14, atol=1e-14)
    for k in range(1, 20):
        y, again = stepper.step(1e-3), named.step(1e-3)
        np.testing.assert_allclose(y, expected[k], rtol=1e-12, atol=1e-12)
        np.testing.assert_array_equal(again["all"], y[:3])
        assert again["time"] == stepper.t == run.t[k]


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("which", SCENES)
def test_a_copy_is_independent_and_a_snapshot_is_gone_on_from_to_the_bit(name, which):
    scene = SCENES[which]()
    stepper = scene.stepper(h=1e-3, integrator=METHODS[name])
    begin = state(stepper)
    stepper.step(0.02)
    twin, kept, here = stepper.copy(), stepper.snapshot(), state(stepper)
    twin.step(0.015)
    np.testing.assert_array_equal(state(stepper), here)
    stepper.step(0.007)
    stepper.step(0.008)
    end, of_twin = state(stepper), state(twin)
    np.testing.assert_allclose(end, of_twin, rtol=1e-9, atol=1e-9)  # the pieces end otherwise
    for one in (stepper, twin, copy.copy(twin)):
        one.restore(kept)
        np.testing.assert_array_equal(state(one), here)
        one.step(0.007)
        one.step(0.008)
        np.testing.assert_array_equal(state(one), end)
        one.restore()
        np.testing.assert_array_equal(state(one), begin)


@pytest.mark.parametrize("interpolation", ["held", "linear"])
def test_inputs_are_part_of_a_snapshot(interpolation):
    scene, _, push = cart(stiffness=STIFFNESS)
    stepper = scene.stepper(h=1e-2, inputs=[push], interpolation=interpolation)
    stepper.step(0.05, 40.0)
    kept = stepper.snapshot()
    stepper.step(0.05)
    end = state(stepper)
    twin = stepper.copy()
    stepper.step(0.05, -7.0)
    for one in (stepper, twin):
        one.restore(kept)
        assert one.inputs == {"push": 40.0}
        one.step(0.05)
        np.testing.assert_array_equal(state(one), end)


def test_controllers_and_states_of_the_machine_go_along():
    """A sampled law with a state, beside an input from outside: copies and restores are those of going on."""
    scene, slide, push = cart(stiffness=STIFFNESS)
    steer = fm.Signal("steer")
    scene.add_force(fm.force.JointForce(slide, steer))

    def law(t, y, total):
        return -5.0 * total[0], total + y

    measured = [fm.output.Position(slide)]
    scene.add_controller(law, period=0.03, measurements=measured, inputs=[steer], state=[0.0])
    run = scene.simulate(0.5, h=0.01, integrator=fm.GeneralizedAlpha())
    stepper = scene.stepper(h=0.01, integrator=fm.GeneralizedAlpha(), inputs=[push])
    stepper.step(0.5)
    np.testing.assert_array_equal(state(stepper), rows_of(run)[-1])
    stepper.restore()
    stepper.step(0.1)
    kept = stepper.snapshot()
    stepper.step(0.2, 3.0)
    end = state(stepper)
    for one in (stepper, stepper.copy()):
        one.restore(kept)
        one.step(0.2, 3.0)
        np.testing.assert_array_equal(state(one), end)


@pytest.mark.parametrize("interpolation", ["held", "linear"])
def test_a_controller_follows_an_input(interpolation):
    """A wish from outside, which stands in no load: what the law is given at its samples, on the way of the input."""
    scene, slide, push = cart(initial=0.0)
    wish = fm.Signal("wish", 1.0)
    seen = []

    def law(t, y):
        seen.append((t, y["wish"]))
        return 40.0 * (y["wish"] - y["x"]) - 12.0 * y["v"]

    measured = {"wish": wish, "x": fm.output.Position(slide), "v": fm.output.Velocity(slide)}
    scene.add_controller(law, period=0.05, measurements=measured, inputs=[push])
    with pytest.raises(SceneError, match="no controller sets it, nor a stepper's input"):
        scene.stepper(h=0.01)
    stepper = scene.stepper(h=0.01, inputs=[wish], outputs=[fm.output.Position(slide)], interpolation=interpolation)
    stepper.step(0.1, 2.0)
    stepper.step(0.1, 0.5)
    expected = [2.0, 2.0, 0.5, 0.5] if interpolation == "held" else [1.0, 1.5, 2.0, 1.25]
    np.testing.assert_allclose(seen, np.column_stack([[0.0, 0.05, 0.1, 0.15], expected]), rtol=1e-14)
    assert stepper.step(5.0)[0] == pytest.approx(0.5, abs=1e-3)


LAW = fm.Switched(
    lambda t, y, v, side: 0.0 if side > 0.0 else -CONTACT.stiffness * (y - CONTACT.radius) - CONTACT.damping * v,
    when=lambda t, y, v: y - CONTACT.radius,
)


def test_laws_that_switch_do_so_in_a_stepper():
    scene, joints = CONTACT.scene(LAW)
    rtol = 1e-7
    run = scene.simulate(0.25, rtol=rtol, checkpoints=[0.1, 0.2, 0.25])
    stepper = scene.stepper(rtol=rtol, horizon=0.25, outputs=[fm.output.Position(joints[0])])
    stepper.step_to(0.1)
    kept = stepper.snapshot()
    for stop in (0.2, 0.25):
        y = stepper.step_to(stop)
    np.testing.assert_array_equal(state(stepper), rows_of(run)[-1])
    assert run.stats.switches > 0
    end, twin = y, stepper.copy()
    for one in (stepper, twin):
        one.restore(kept)
        one.step_to(0.2)
        np.testing.assert_array_equal(one.step_to(0.25), end)


AFRESH = """
import pickle, sys
import numpy as np
stepper, frame = pickle.load(open(sys.argv[1], "rb"))
y = [stepper.step(0.013, 0.4) for _ in range(3)]
now = stepper.now
np.save(sys.argv[2], np.concatenate([*y, [stepper.t], now.x, now.v, now.position(frame)]))
"""


@pytest.mark.parametrize("name", ["5(4)", "alpha"])
def test_a_pickled_stepper_goes_on_to_the_bit_in_a_new_process(name, tmp_path):
    scene, elbow, push, tip = pendulum()
    outputs = [fm.output.Velocity(elbow), fm.output.Position(tip)]
    stepper = scene.stepper(h=1e-3, integrator=METHODS[name], inputs=[push], outputs=outputs)
    stepper.step(0.1, 0.2)
    (tmp_path / "stepper").write_bytes(pickle.dumps((stepper, tip)))
    command = [sys.executable, "-c", AFRESH, str(tmp_path / "stepper"), str(tmp_path / "end.npy")]
    subprocess.run(command, check=True)
    y = [stepper.step(0.013, 0.4) for _ in range(3)]
    now = stepper.now
    here = np.concatenate([*y, [stepper.t], now.x, now.v, now.position(tip)])
    np.testing.assert_array_equal(np.load(tmp_path / "end.npy"), here)
    again = copy.deepcopy(stepper)
    again.restore()
    stepper.restore()
    np.testing.assert_array_equal(again.step(0.01), stepper.step(0.01))


def coupled(dt, interpolation):
    """The place of the first of two masses at 1 s, each in a stepper, the force of the spring between them outside.

    In a step it is held at its value before, or goes straight to where it would be as it changed in the last step.
    """
    places, stiffness, force = [1.0, -0.4], 15.0, -21.0
    steppers = []
    for place, sign in zip(places, (1.0, -1.0), strict=True):
        scene, slide, push = cart(stiffness=20.0, initial=sign * force)
        slide.position, slide.velocity = place, 0.0
        tell = [fm.output.Position(slide)]
        steppers.append(scene.stepper(h=1e-3, inputs=[push], outputs=tell, interpolation=interpolation))
    for _ in range(round(1.0 / dt)):
        before, force = force, stiffness * (places[1] - places[0])
        given = 2.0 * force - before if interpolation == "linear" else force
        places = [one.step(dt, sign * given)[0] for one, sign in zip(steppers, (1.0, -1.0), strict=True)]
    return places[0]


@pytest.mark.parametrize(("interpolation", "order"), [("held", 1), ("linear", 2)])
def test_order_of_coupling_two_steppers(interpolation, order):
    """Against the closed form of two masses on three springs, their sum and their difference."""
    exact = 0.5 * (0.6 * math.cos(math.sqrt(20.0 / MASS)) + 1.4 * math.cos(math.sqrt(50.0 / MASS)))
    errors = [abs(coupled(dt, interpolation) - exact) for dt in (1.0 / 64.0, 1.0 / 128.0, 1.0 / 256.0)]
    rates = [math.log2(coarse / fine) for coarse, fine in pairwise(errors)]
    assert rates == pytest.approx([order, order], abs=0.25)


def test_bad_input_is_refused_and_moves_nothing():
    scene, slide, push = cart()
    stepper = scene.stepper(h=1e-3, inputs=[push], outputs=[fm.output.Position(slide)])
    stepper.step(0.01, 2.0)
    here = state(stepper)
    for dt in (-0.1, 0.0, math.nan, math.inf, "1", True, None, 1e-30, [0.1]):
        with pytest.raises(SceneError, match=r"forward alone|one finite number \(s\)"):
            stepper.step(dt, 3.0)
    with pytest.raises(SceneError, match=r"stands at t = 0\.01 s and goes forward alone, not to t = 0\.005 s"):
        stepper.step_to(0.005)
    with pytest.raises(SceneError, match="no input 'pull'; it has 'push'"):
        stepper.step(0.1, {"pull": 1.0})
    for given in ([1.0, 2.0], math.nan, [math.inf], "1", True, [[1.0]], {"push": math.nan}, {"push": [1.0]}, []):
        with pytest.raises(SceneError, match=r"finite number|must be 1 finite numbers"):
            stepper.step(0.1, given)
    np.testing.assert_array_equal(state(stepper), here)
    assert stepper.inputs == {"push": 2.0}
    with pytest.raises(SceneError, match="no input 'pull'; it has none"):
        scene.stepper(h=1e-3).step(0.1, {"pull": 1.0})
    with pytest.raises(SceneError, match="must be 0 finite numbers, of no input"):
        scene.stepper(h=1e-3).step(0.1, 1.0)


def test_wrong_steppers_are_refused():
    scene, slide, push = cart()
    lost = fm.Signal("lost")
    cases = [
        (dict(inputs=[lost]), "no load of the scene has the signal 'lost', and no controller measures it"),
        (dict(inputs=[push, push]), "different signals of different names"),
        (dict(inputs=[fm.Signal("push"), push]), "different signals of different names"),
        (dict(inputs=["push"]), "an input must be a signal"),
        (dict(inputs=push), "inputs must be a list of signals"),
        (dict(inputs={"": push}), "an input's name"),
        (dict(outputs=[push]), "cannot be the signal 'push'"),
        (dict(outputs=[slide]), "cannot be measured"),
        (dict(outputs=fm.output.Position(slide)), "outputs must be a list"),
        (dict(outputs=[fm.output.Position(cart()[1])]), "another scene|no joint coordinate here"),
        (dict(interpolation="cubic"), 'interpolation must be "held" or "linear"'),
        (dict(horizon=-1.0), "horizon = -1.0 s must be positive"),
        (dict(h=0.0), "the step h = 0.0 s must be positive"),
        (dict(rtol=2.0), "rtol = 2.0"),
        (dict(integrator="fast"), "integrator must be"),
    ]
    for how, message in cases:
        with pytest.raises(SceneError, match=message):
            scene.stepper(**{"h": 1e-3, **how})
    scene.add_controller(lambda t, y: 0.0, period=0.1, measurements=[], inputs=[push], name="governor")
    with pytest.raises(SceneError, match="its signal is set by controller 'governor' already"):
        scene.stepper(h=1e-3, inputs=[push])


def test_a_snapshot_of_another_machine_is_refused():
    scene, _, push = cart()
    stepper = scene.stepper(h=1e-3, inputs=[push])
    others = [cart(stiffness=1.0)[0].stepper(h=1e-3), scene.stepper(h=2e-3, inputs=[push]), scene.stepper(h=1e-3)]
    for other in others:
        with pytest.raises(SceneError, match="of another machine"):
            stepper.restore(other.snapshot())
    with pytest.raises(SceneError, match="what is restored must be what stepper"):
        stepper.restore(0.1)
    stepper.restore(scene.stepper(h=1e-3, inputs=[push]).snapshot())


def test_bodies_with_history_are_refused_by_name():
    scene = fm.System()
    _, (end, *_) = as_continuum(scene, chain(ImplicitSprings, stiffness=1e3))
    scene.connect(fm.joint.Free(), scene.ground.frame(), end)
    with pytest.raises(SceneError, match=r"bodies with history cannot be stepped from outside \('lattice'\)"):
        scene.stepper(h=1e-3)


def test_a_step_that_fails_leaves_a_machine_that_can_go_back():
    scene, slide, push = cart()
    scene.add_force(fm.force.JointForce(slide, lambda t: 1.0 / 0.0 if t > 0.2 else 0.0))
    stepper = scene.stepper(h=0.01, inputs=[push], outputs=[fm.output.Position(slide)])
    stepper.step(0.1)
    kept = stepper.snapshot()
    with pytest.raises(fm.SimulationError, match="ZeroDivisionError") as caught:
        stepper.step(0.5)
    assert caught.value.trajectory.t[-1] == stepper.t == pytest.approx(0.19)
    stepper.restore(kept)
    assert stepper.t == 0.1
    y = stepper.step(0.1)
    assert y[0] == pytest.approx(1.0 - 0.5 * 0.2 + 0.5 * 0.3 / MASS * 0.2**2)


def test_what_a_run_warns_of_a_stepper_does():
    """A bushing that is turned beyond half a revolution; once, and not before."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="wheel")
    joint = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame())
    joint.velocity = 100.0
    scene.add_force(fm.force.Bushing(scene.ground.frame(), body.frame(), np.eye(6), 1e-3 * np.eye(6)))
    stepper = scene.stepper(h=1e-3, integrator=fm.ExplicitRungeKutta())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stepper.step(0.02)
    with pytest.warns(fm.RangeWarning, match="turned") as caught:
        stepper.step(0.5)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        stepper.step(0.5)


def test_what_is_pressed_flat_ends_the_step_in_which_it_is():
    body = fm.PseudoRigidBody(fm.Solid.box((0.3, 0.2, 0.1), density=900.0), fm.StVenantKirchhoff(1e5, 0.3))
    scene = fm.System()
    scene.add(body, name="block")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    for side in (-1.0, 1.0):
        end = body.frame((side * 0.15, 0.0, 0.0))
        scene.add_force(fm.force.FrameForce(end, force=(-side * 2000.0, 0.0, 0.0)))
    with pytest.raises(fm.SimulationError, match="pressed flat") as of_run:
        scene.simulate(1.0, rtol=1e-6)
    flat, stepper = of_run.value.trajectory.t[-1], scene.stepper(rtol=1e-6)
    stepper.step_to(flat - 1e-3)
    with pytest.raises(fm.SimulationError, match="'block' has det F = -"):
        stepper.step(2e-3)
    assert flat - 1e-3 < stepper.t < flat + 2e-3
    stepper.restore()
    stepper.step(1e-3)


def test_loops_that_a_motion_tears_are_told():
    """Not at once, for that is looked at now and then: after as many steps as were made before, at most."""
    scene = fm.System()
    plate = scene.add(fm.RigidBody(1.0, (1e-2, 2e-2, 3e-2)), name="plate")
    drive = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), plate.frame(), name="driven")
    drive.prescribe(fm.Sine(0.5, 10.0, phase=0.5 * np.pi, offset=-0.5))
    pin = (0.5, 0.0, 0.0)
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(pin), plate.frame(pin), name="second")
    stepper = scene.stepper(h=1e-3)

    def ten_steps():
        for _ in range(10):
            stepper.step(1e-3)

    with pytest.raises(fm.SimulationError, match=r"forbid .*'driven.angle'.*second"):
        ten_steps()


def test_a_system_has_no_parameters_to_step_with():
    scene, *_ = cart(stiffness=STIFFNESS)
    with pytest.raises(fm.SceneError, match=r"no parameter 'm'; it has none: compile\(parameters="):
        scene.stepper(h=1e-2, values={"m": 9.0})


@pytest.mark.parametrize("values", [5, "m", ["m"], True, 0])
def test_values_are_a_mapping(values):
    scene, *_ = cart(stiffness=STIFFNESS)
    machine = scene.compile(parameters={"m": fm.parameter.Mass(bodies_of(scene)[0])})
    for one in (scene, machine):
        with pytest.raises(fm.SceneError, match="values must be a mapping of parameters"):
            one.stepper(h=1e-2, values=values)
    with pytest.raises(fm.SceneError, match="values must be a mapping of parameters"):
        machine.variant(values)


def test_system_and_compiled_machine_have_one_stepper():
    """Its arguments stand once."""
    assert fm.System.stepper is fm.CompiledMachine.stepper


def test_steppers_and_runs_of_one_machine_do_not_meet():
    """Nor do their inputs, which one of them holds while another one's change."""
    scene, _, push = cart(stiffness=STIFFNESS)
    machine = scene.compile(parameters={"m": fm.parameter.Mass(bodies_of(scene)[0])})
    one, heavy = machine.stepper(h=1e-2, inputs=[push]), machine.stepper(h=1e-2, inputs=[push], values={"m": 9.0})
    twin = one.copy()
    alone = scene.stepper(h=1e-2, inputs=[push])
    for force in (3.0, -8.0, 20.0):
        one.step(0.05, force)
        heavy.step(0.05, 100.0)
        twin.step(0.05, -force)
        machine.simulate(0.1)
        one.step(0.05)
        for _ in range(2):
            alone.step(0.05, force)
    np.testing.assert_array_equal(state(one), state(alone))
    assert not np.array_equal(state(heavy), state(alone))


def test_a_step_costs_no_search_where_nothing_is_to_be_looked_for(monkeypatch):
    """Nothing of a step is copied or kept: many steps leave no more rows than a few."""
    scene, _, push = cart(stiffness=STIFFNESS)
    stepper = scene.stepper(h=1e-2, inputs=[push])
    calls = []
    snapshot = Integration.snapshot
    monkeypatch.setattr(Integration, "snapshot", lambda self: calls.append(1) or snapshot(self))
    for k in range(3000):
        stepper.step(1e-2, float(k % 3))
    assert not calls
    integration = stepper._stepping._integration
    assert integration.stored.count == 1
    assert not integration.departures
