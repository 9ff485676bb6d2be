"""Sampled controllers: exact instants, held inputs, states, checkpoints, other programs' laws, bad input."""

import copy
import math

import numpy as np
import pytest
import scipy.linalg

import flexmbd as fm
from flexmbd.errors import ExportError, SceneError

METHODS = {
    "8(5,3)": fm.ExplicitRungeKutta(),
    "radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(),
    "energy-momentum": fm.EnergyMomentum(),
    "central differences": fm.CentralDifference(),
}
MASS, PERIOD = 2.0, 0.1


def cart(*, stiffness=0.0, damping=0.0):
    """A mass on a slider, pushed by a signal."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(mass=MASS, inertia=(1.0, 1.0, 1.0)), name="cart")
    slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), body.frame(), name="slide")
    slide.position, slide.velocity = 1.0, -0.5
    push = fm.Signal("push")
    scene.add_force(fm.force.JointForce(slide, push))
    if stiffness:
        scene.add_force(fm.force.JointSpring(slide, stiffness))
    if damping:
        scene.add_force(fm.force.JointDamper(slide, damping))
    return scene, slide, push


def state_of(slide):
    return [fm.output.Position(slide), fm.output.Velocity(slide)]


def held(stiffness, damping, period):
    """x and v (2,) after a period, from these and a held force: the matrix exponential (Franklin et al., eq. 4.58)."""
    A = np.array([[0.0, 1.0, 0.0], [-stiffness / MASS, -damping / MASS, 1.0 / MASS], [0.0, 0.0, 0.0]])
    step = scipy.linalg.expm(A * period)
    return step[:2, :2], step[:2, 2]


@pytest.mark.parametrize("name", METHODS)
def test_a_dead_beat_law_brings_a_double_integrator_to_rest_in_two_samples(name):
    scene, slide, push = cart()
    gain = np.array([MASS / PERIOD**2, 1.5 * MASS / PERIOD])
    law = scene.add_controller(lambda t, y: -gain @ y, period=PERIOD, measurements=state_of(slide), inputs=[push])
    h = 0.03 if name == "central differences" else None
    run = scene.simulate(1.0, integrator=METHODS[name], h=h)
    samples = run.sampled(law)
    A, B = held(0.0, 0.0, PERIOD)
    exact = [np.array([1.0, -0.5])]
    for _ in range(9):
        exact.append(A @ exact[-1] - B * (gain @ exact[-1]))
    assert samples.t.tolist() == [k * PERIOD for k in range(10)]
    np.testing.assert_allclose(samples.measurements, exact, atol=3e-14)
    np.testing.assert_allclose(samples.measurements[2:], 0.0, atol=3e-14)


@pytest.mark.parametrize("name", ["8(5,3)", "radau", "alpha", "energy-momentum"])
def test_an_oscillator_under_sampled_feedback_is_exact_to_rtol(name):
    """The largest error of positions, of 1 m, over rtol: seen 0.3 (8(5,3)) to 30 (energy-momentum)."""
    stiffness, damping, period = 300.0, 2.0, 0.05
    A, B = held(stiffness, damping, period)
    tolerances = [1e-3, 1e-5, 1e-7] if name != "8(5,3)" else [1e-3, 1e-6, 1e-10]
    for rtol in tolerances:
        scene, slide, push = cart(stiffness=stiffness, damping=damping)

        def law(t, y, total):
            total = total + period * y[:1]
            return 40.0 * total[0] - 5.0 * y[1] + 3.0 * math.sin(7.0 * t), total

        taken = scene.add_controller(law, period=period, measurements=state_of(slide), inputs=[push], state=[0.2])
        run = scene.simulate(1.02, rtol=rtol, integrator=METHODS[name])
        s, total, exact, forces = np.array([1.0, -0.5]), 0.2, [], []
        for k in range(21):
            total += period * s[0]
            force = 40.0 * total - 5.0 * s[1] + 3.0 * math.sin(7.0 * k * period)
            exact.append(s)
            forces.append(force)
            s = A @ s + B * force
        samples = run.sampled(taken)
        error = np.abs(samples.measurements[:, 0] - np.array(exact)[:, 0]).max()
        print(name, rtol, error / rtol)
        assert error < 60.0 * rtol
        assert samples.states.shape == (21, 1)
        np.testing.assert_allclose(samples.inputs[:, 0], forces, atol=2e3 * rtol)
        # between samples the force is what was held
        assert run.drive(slide)[run.t == samples.t[3]] == pytest.approx(samples.inputs[2], rel=1e-9)


def two_controllers():
    """A loop of 50 ms with a state, and one of 30 ms, 10 ms late, that sets what the first one follows."""
    scene, slide, push = cart(stiffness=50.0)
    target = fm.Signal("target", 0.1)

    def inner(t, y, total):
        error = y["target"] - y["x"]
        return 30.0 * error + total[0] - 4.0 * y["v"], total + 2.0 * error

    def outer(t, y):
        return [0.2 * math.cos(3.0 * t) + 0.1 * y[0]]

    told = {"x": fm.output.Position(slide), "v": fm.output.Velocity(slide), "target": target}
    first = scene.add_controller(inner, period=0.05, measurements=told, inputs=[push], state=[0.0], name="inner")
    far = [lambda now: now.position(slide.child)[0]]
    second = scene.add_controller(outer, period=0.03, offset=0.01, measurements=far, inputs=[target], name="outer")
    return scene, slide, first, second


@pytest.mark.parametrize(
    ("name", "fixed"), [(name, fixed) for name in METHODS for fixed in (False, True) if fixed or "central" not in name]
)
def test_a_restart_between_samples_and_at_one_goes_on_to_the_bit(name, fixed, tmp_path):
    scene, *_ = two_controllers()
    how = {"h": 0.007} if fixed else {"rtol": 1e-5}
    places = [0.163, 0.25, 0.31]
    whole = scene.simulate(0.5, integrator=METHODS[name], checkpoints=places, **how)
    for k, checkpoint in enumerate(whole.checkpoints):
        again, *_ = two_controllers()
        kept = fm.Checkpoint.load(checkpoint.save(tmp_path / "kept.npz"))
        rest = again.simulate(0.5, integrator=METHODS[name], restart=kept, checkpoints=places[k + 1 :], **how)
        last = len(whole.t) - len(rest.t)
        for part in ("t", "x", "v", "a"):
            np.testing.assert_array_equal(getattr(rest, part)[1:], getattr(whole, part)[last + 1 :])
        for ours, theirs in zip(rest.samples, whole.samples, strict=True):
            since = theirs.t >= places[k]
            for part in ("t", "measurements", "inputs", "states"):
                np.testing.assert_array_equal(getattr(ours, part), getattr(theirs, part)[since])


def test_no_sample_is_missed_or_doubled_whatever_else_ends_steps():
    scene, slide, first, second = two_controllers()
    asked = []
    scene.add_controller(
        lambda t, y: asked.append(t) or 0.0, period=1e-3, inputs=[idle := fm.Signal("idle")], name="clock"
    )
    scene.add_force(fm.force.FrameForce(slide.child, (0.0, idle, 0.0)))
    table = fm.Piecewise(lambda t: 1.0 if t < 0.0295 else 2.0 if t < 0.06 else 0.5, breaks=[0.0295, 0.06])
    scene.add_force(fm.force.FrameForce(slide.child, (table, 0.0, 0.0)))
    crossing = fm.Event(lambda now: float(now.beta(slide)) - 0.98, name="crossing")
    hit = fm.Event(lambda now: now.t - 0.05, action=lambda now: now.set_rate(slide, 0.3), name="hit")
    run = scene.simulate(0.3, rtol=1e-4, events=[crossing, hit], checkpoints=[0.1, 0.2])
    assert {one.name for one in run.events} == {"crossing", "hit"}
    assert run.sampled(first).t.tolist() == pytest.approx(np.arange(6) * 0.05, abs=1e-15)
    assert run.sampled(second).t.tolist() == pytest.approx(0.01 + np.arange(10) * 0.03, abs=1e-15)
    assert asked == [k * 1e-3 for k in range(300)]


def test_a_kept_run_tells_the_same_forces(tmp_path):
    scene, slide, first, _ = two_controllers()
    run = scene.simulate(0.3, rtol=1e-6)
    there, again_slide, *_ = two_controllers()
    again = fm.Trajectory.load(run.save(tmp_path / "run.h5"), there)
    ours = run.sampled(first)
    np.testing.assert_array_equal(again.samples[0].inputs, ours.inputs)
    np.testing.assert_array_equal(again.reaction(again_slide), run.reaction(slide))
    # Newton's law: at a sample's row the force is that of before it
    np.testing.assert_allclose(MASS * again.a[:, 0], again.drive(again_slide) - 50.0 * again.x[:, 0], atol=1e-12)
    copied, slide_there = copy.deepcopy((run, slide))
    np.testing.assert_array_equal(copied.drive(slide_there), run.drive(slide))


def test_samples_of_an_ensemble_are_those_of_single_runs():
    scene, slide, first, _ = two_controllers()
    spring = fm.force.JointSpring(slide, 10.0)
    scene.add_force(spring)
    machine = scene.compile(parameters={"k": fm.parameter.OfForce(spring, "stiffness")})
    found = machine.ensemble({"k": [5.0, 20.0, 40.0]}, {"u": lambda run: run.samples[0].inputs[:, 0]}, t_end=0.2)
    one = machine.simulate(0.2, k=20.0).sampled(first)
    np.testing.assert_array_equal(found.output("u")[1], one.inputs[:, 0])
    assert not np.array_equal(found.output("u")[0], found.output("u")[1])


@pytest.mark.parametrize("period", [0.0, -1e-3, math.nan, math.inf, "fast", True])
def test_a_period_must_be_a_positive_time(period):
    scene, _, push = cart()
    with pytest.raises(SceneError, match=r"controller 'governor': the period .* must be positive and finite"):
        scene.add_controller(lambda t, y: 0.0, period=period, inputs=[push], name="governor")


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ([1.0, 2.0], r"inputs of shape \(2,\), not \(1,\)"),
        ([[1.0]], r"inputs of shape \(1, 1\), not \(1,\)"),
        (math.nan, "inputs that are not finite"),
        (None, "inputs"),
        ("all", "inputs"),
    ],
)
def test_a_wrong_output_names_controller_and_time(answer, told):
    scene, _, push = cart()
    scene.add_controller(lambda t, y: 0.0 if t < 0.35 else answer, period=0.1, inputs=[push], name="governor")
    with pytest.raises(fm.SimulationError, match=r"controller 'governor' at t = 0\.4 s: it gave " + told) as caught:
        scene.simulate(1.0)
    assert caught.value.trajectory.t[-1] == pytest.approx(0.4)


def test_a_law_that_raises_and_a_state_of_another_shape_name_controller_and_time():
    scene, _, push = cart()
    law = scene.add_controller(lambda t, y: 1.0 / (0.2 - t), period=0.1, inputs=[push], name="governor")
    with pytest.raises(fm.SimulationError, match=r"'governor' at t = 0\.2 s: ZeroDivisionError") as caught:
        scene.simulate(1.0)
    assert isinstance(caught.value.__cause__.__cause__, ZeroDivisionError)
    assert len(caught.value.trajectory.sampled(law).t) == 2
    for answer, told in (
        (lambda t, y, z: (0.0, [1.0, 2.0]), r"a state of shape \(2,\), not \(1,\)"),
        (lambda t, y, z: 0.0, "must return"),
        (lambda t, y, z: (0.0, [math.nan]), "a state that are not finite"),
    ):
        scene, _, push = cart()
        scene.add_controller(answer, period=0.1, inputs=[push], state=[0.0])
        with pytest.raises(fm.SimulationError, match=told):
            scene.simulate(1.0)


def test_what_cannot_be_measured_or_set_is_told_when_it_is_given():
    scene, slide, push = cart()

    def add(*measurements, inputs=(push,), **more):
        return scene.add_controller(lambda t, y: 0.0, period=0.1, measurements=measurements, inputs=inputs, **more)

    with pytest.raises(SceneError, match="cannot be measured"):
        add("angle")
    with pytest.raises(SceneError, match="small rotations"):
        add(fm.output.Rotation(slide.child))
    with pytest.raises(SceneError, match="an input must be a signal"):
        add(inputs=[slide])
    with pytest.raises(SceneError, match="one signal or more"):
        add(inputs=[])
    with pytest.raises(SceneError, match="offset"):
        add(offset=-0.1)
    add(name="first")
    with pytest.raises(SceneError, match="'first' sets the signal 'push' already"):
        add()
    with pytest.raises(SceneError, match="jumps when it is set"):
        slide.prescribe(push)
    with pytest.raises(SceneError, match="finite"):
        fm.Signal("push", math.nan)
    lost = fm.Signal("lost")
    scene.add_controller(lambda t, y: 0.0, period=0.1, inputs=[lost])
    with pytest.raises(SceneError, match="no load of the scene has the signal 'lost'"):
        scene.simulate(0.1)
    foreign, _, push = cart()
    foreign.add_controller(lambda t, y: 0.0, period=0.1, inputs=[push], measurements=[fm.output.Position(slide)])
    with pytest.raises(fm.SimulationError, match="t = 0 s: joint 'slide' has no joint coordinate here"):
        foreign.simulate(0.1)


def test_checkpoints_of_other_controllers_are_refused():
    def made(gain, period=0.1):
        scene, slide, push = cart()
        if gain:
            scene.add_controller(lambda t, y: -gain * y, period=period, measurements=state_of(slide)[:1], inputs=[push])
        return scene

    kept = made(1.0).simulate(0.5, checkpoints=[0.25]).checkpoints[0]
    made(1.0).simulate(0.5, restart=kept)
    for other in (made(2.0), made(1.0, 0.2), made(0.0)):
        with pytest.raises(SceneError, match="other controllers"):
            other.simulate(0.5, restart=kept)


def test_a_machine_with_signals_leaves_in_no_fmu(tmp_path):
    scene, *_ = cart()
    with pytest.raises(ExportError, match=r"signals that they set \(push\)"):
        fm.export.fmu_machine(scene, tmp_path / "cart.fmu", h=1e-3)


def test_a_reaction_at_a_sample_is_to_what_was_held_before_it():
    scene, slide, push = cart()
    across = fm.Signal("across", 7.0)
    scene.add_force(fm.force.FrameForce(slide.child, (0.0, across, 0.0)))
    law = scene.add_controller(lambda t, y: [10.0 * t, 1.0 + t], period=0.1, inputs=[push, across])
    run = scene.simulate(0.45, rtol=1e-4)
    samples, held = run.sampled(law), -run.reaction(slide)[:, 1]
    before = np.concatenate([[7.0], samples.inputs[:, 1]])[np.searchsorted(samples.t, run.t, side="left")]
    np.testing.assert_allclose(held, before, rtol=1e-12)
    np.testing.assert_array_equal(samples.held([0.0, 0.05, 0.1])[:, 1], [1.0, 1.0, 1.1])
    assert -run.at(0.2501).reaction(slide)[1] == pytest.approx(1.2, rel=1e-12)
