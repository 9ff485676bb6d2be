"""State equations solved with the machine: closed forms by every integrator, equilibria, linear machines, bad input."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from particles import particle_body

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.record.groups import DistributedLoads

METHODS = {
    "8(5,3)": fm.ExplicitRungeKutta(),
    "radau": fm.RadauIIA(),
    "alpha": fm.GeneralizedAlpha(),
    "energy-momentum": fm.EnergyMomentum(),
}
MASS, STIFFNESS, LAG, GAIN = 2.0, 30.0, 0.05, 3.0


def loaded_record():
    """A record with a distributed load."""
    record = particle_body(3, modes=2).record
    loads = DistributedLoads(("gas",), np.ones((1, 3)), np.ones((1, 3)), np.ones((1, 2)))
    return dataclasses.replace(record, loads=loads)


def cart(*, stiffness=STIFFNESS, way=None):
    """A mass on a slider, pushed by a signal."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = scene.add(fm.RigidBody(mass=MASS, inertia=(1.0, 1.0, 1.0)), name="cart")
    slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), body.frame(), name="slide", way=way)
    push = fm.Signal("push")
    scene.add_force(fm.force.JointForce(slide, push))
    if stiffness:
        slide.position, slide.velocity = 1.0, -0.5
        scene.add_force(fm.force.JointSpring(slide, stiffness))
    return scene, slide, push


@fm.compiled
def lag_compiled(t, z, u, out):
    out[0] = (-3.0 * u[0] - z[0]) / 0.05


def lag(t, z, u):
    return [(-GAIN * u[0] - z[0]) / LAG]


def lagged(rates=lag, unit=1.0):
    """The cart, pushed by a first-order actuator that follows its place; the force in units of ``unit`` N."""
    scene, slide, push = cart()

    def scaled(t, z, u):
        return [one / unit for one in rates(t, unit * z, u)]

    states = scene.add_states(
        rates if unit == 1.0 else scaled,
        initial=[2.0 / unit],
        scale=1.0 / unit,
        measurements=[fm.output.Position(slide)],
        outputs=None if unit == 1.0 else lambda t, z, u: unit * z,
        inputs=[push],
        name="actuator",
    )
    return scene, slide, states


#: x, v and the actuator's force.
EXACT = np.array([[0.0, 1.0, 0.0], [-STIFFNESS / MASS, 0.0, 1.0 / MASS], [-GAIN / LAG, 0.0, -1.0 / LAG]])


def exact(t):
    return np.array([scipy.linalg.expm(EXACT * one) @ [1.0, -0.5, 2.0] for one in t])


@pytest.mark.parametrize("name", METHODS)
def test_a_first_order_actuator_is_exact_to_rtol(name):
    """The largest error over rtol, of 1 m and of 1 N: seen 0.05 (8(5,3)) to 9 (alpha, the same at all tolerances)."""
    for rtol in (1e-3, 1e-5, 1e-10 if name == "8(5,3)" else 1e-6):
        scene, slide, states = lagged(lag_compiled)
        run = scene.simulate(1.5, rtol=rtol, integrator=METHODS[name])
        place, _, force = exact(run.t).T
        assert np.abs(run.beta(slide) - place).max() < 20.0 * rtol
        assert np.abs(run.states(states)[:, 0] - force).max() < 20.0 * rtol
        assert np.abs(run.drive(slide) - run.states(states)[:, 0]).max() < max(rtol, 1e-11)
        between = np.linspace(0.3, 1.2, 7)
        if rtol < 1e-4 and name != "8(5,3)":  # whose steps are longer than what is drawn between them allows
            assert np.abs(run.states(states, t=between)[:, 0] - exact(between)[:, 2]).max() < 40.0 * rtol


def test_central_differences_take_states_at_order_two():
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        scene, slide, states = lagged(lag_compiled)
        run = scene.simulate(1.5, h=h, integrator=fm.CentralDifference())
        place, _, force = exact(run.t).T
        errors.append([np.abs(run.beta(slide) - place).max(), np.abs(run.states(states)[:, 0] - force).max()])
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.2)


@pytest.mark.parametrize("name", METHODS)
def test_units_of_a_state_change_nothing(name):
    unit = 2.0**20
    one, other = (lagged(unit=size) for size in (1.0, unit))
    runs = [scene.simulate(1.0, rtol=1e-5, integrator=METHODS[name]) for scene, *_ in (one, other)]
    np.testing.assert_array_equal(runs[0].t, runs[1].t)
    np.testing.assert_array_equal(runs[0].states(one[2]), unit * runs[1].states(other[2]))


def test_states_stand_in_tables():
    scene, slide, states = lagged()
    run = scene.simulate(0.5)
    table = run.table(slide, states, t=[0.1, 0.3])
    np.testing.assert_array_equal(table.column("actuator.z[0]"), run.states(states, t=[0.1, 0.3])[:, 0])
    assert "actuator.z[0]" in run.table().names
    *_, foreign = lagged()
    with pytest.raises(SceneError, match="states 'actuator' are not in this scene"):
        run.table(foreign)


def test_states_are_no_bodies():
    scene, slide, _ = lagged()
    run = scene.simulate(0.5)
    np.testing.assert_allclose(run.energy().kinetic, 0.5 * MASS * run.beta_rate(slide) ** 2, rtol=1e-12)
    momentum = run.momentum()
    assert momentum.mass == MASS
    np.testing.assert_allclose(momentum.angular, 0.0, atol=1e-12)
    assert "1 state of equations" in scene.explain()
    assert "massless" not in scene.explain()


@pytest.mark.parametrize("name", METHODS)
def test_a_restart_goes_on_to_the_bit_and_a_kept_run_tells_the_same(name, tmp_path):
    scene, _, states = lagged()
    whole = scene.simulate(1.0, rtol=1e-5, integrator=METHODS[name], checkpoints=[0.4])
    again, _, there = lagged()
    kept = fm.Checkpoint.load(whole.checkpoints[0].save(tmp_path / "kept.npz"))
    rest = again.simulate(1.0, rtol=1e-5, integrator=METHODS[name], restart=kept)
    last = len(whole.t) - len(rest.t)
    np.testing.assert_array_equal(rest.states(there), whole.states(states)[last:])
    loaded = fm.Trajectory.load(whole.save(tmp_path / "run.h5"), again)
    np.testing.assert_array_equal(loaded.states(there), whole.states(states))
    other, *_ = lagged(lambda t, z, u: [-z[0]])
    with pytest.raises(SceneError, match="another scene"):
        other.simulate(1.0, rtol=1e-5, integrator=METHODS[name], restart=kept)


KP, KI, KD, FILTER, TARGET = 200.0, 2000.0, 30.0, 0.01, 0.3


def pendulum_with_pid():
    """A pendulum that a PID with a filtered derivative holds at an angle; as in Astrom and Hagglund 2006, eq. 3.21."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bob = scene.add(fm.RigidBody(mass=2.0, inertia=(0.1, 0.1, 0.1)), name="bob")
    hinge = scene.connect(fm.joint.Revolute(axis="z"), scene.ground.frame(), bob.frame((-0.5, 0.0, 0.0)), name="hinge")
    torque = fm.Signal("torque")
    scene.add_force(fm.force.JointTorque(hinge, torque))

    def rates(t, z, u):
        error = TARGET - u[0]
        return [error, (error - z[1]) / FILTER]

    def outputs(t, z, u):
        error = TARGET - u[0]
        return KP * error + KI * z[0] + KD * (error - z[1]) / FILTER

    pid = scene.add_states(
        rates, outputs=outputs, initial=[0.0, TARGET], scale=[0.1, TARGET], measurements=[fm.output.Position(hinge)],
        inputs=[torque], name="PID", names=["integral", "filtered"],
    )  # fmt: skip
    return scene, hinge, pid


def test_an_equilibrium_is_where_states_rest_too():
    scene, hinge, pid = pendulum_with_pid()
    rest = scene.equilibrium()
    assert float(rest.beta(hinge)) == pytest.approx(TARGET, abs=1e-12)
    weight = 2.0 * 9.81 * 0.5 * math.cos(TARGET)
    np.testing.assert_allclose(rest.states(pid), [weight / KI, 0.0], atol=1e-12)
    assert rest.unstable is None
    run = scene.simulate(0.5, about=rest)
    np.testing.assert_allclose(run.states(pid), np.broadcast_to(rest.states(pid), (len(run.t), 2)), atol=1e-9)


def test_a_linearised_machine_has_the_states_in_their_units():
    scene, hinge, _ = pendulum_with_pid()
    push = fm.force.JointTorque(hinge, 0.0)
    linear = scene.linearize(about=scene.equilibrium(), inputs=[push], outputs=[fm.output.Position(hinge)])
    assert linear.states == ("hinge.angle", "rate of hinge.angle", "PID.integral", "PID.filtered")
    inertia, weight = 0.1 + 2.0 * 0.25, -2.0 * 9.81 * 0.5 * math.sin(TARGET)
    A = np.array(
        [
            [0.0, 1.0, 0.0, 0.0],
            [(-KP - KD / FILTER - weight) / inertia, 0.0, KI / inertia, -KD / FILTER / inertia],
            [-1.0, 0.0, 0.0, 0.0],
            [-1.0 / FILTER, 0.0, 0.0, -1.0 / FILTER],
        ]
    )
    space = linear.state_space()
    np.testing.assert_allclose(space.A, A, rtol=1e-8, atol=1e-7)
    np.testing.assert_allclose(space.B[:, 0], [0.0, 1.0 / inertia, 0.0, 0.0], atol=1e-12)
    values = np.sort_complex(np.linalg.eigvals(A))
    np.testing.assert_allclose(np.sort_complex(linear.eigenvalues()), values, rtol=1e-7)
    s = 3.0j
    answer = space.C @ np.linalg.solve(s * np.eye(4) - A, space.B)
    np.testing.assert_allclose(linear.frequency_response([3.0])[0], answer, rtol=1e-7)


def test_a_hydraulic_cylinder_swings_at_its_oil_spring():
    """p' = (Q - A v) E / V and the force A p: the frequency is A sqrt(E / (V m)) (Merritt 1967, eq. 6-25)."""
    area, bulk, volume, flow = 1e-3, 1.2e9, 2e-4, 1e-5
    scene, slide, push = cart(stiffness=0.0)
    oil = scene.add_states(
        lambda t, z, u: [(flow - area * u[0]) * bulk / volume],
        outputs=lambda t, z, u: area * z[0],
        initial=[0.0], scale=1e5, measurements=[fm.output.Velocity(slide)], inputs=[push],
    )  # fmt: skip
    omega = area * math.sqrt(bulk / (volume * MASS))
    run = scene.simulate(0.1, rtol=1e-7)
    speed = flow / area * (1.0 - np.cos(omega * run.t))
    pressure = MASS * flow / area * omega * np.sin(omega * run.t) / area
    assert np.abs(run.beta_rate(slide) - speed).max() < 1e-5 * flow / area
    assert np.abs(run.states(oil)[:, 0] - pressure).max() < 1e-5 * np.abs(pressure).max()


def test_what_follows_frames_and_functions_is_the_same():
    scene, slide, states = lagged()
    run = scene.simulate(1.0, rtol=1e-8)
    for far in ([fm.output.Position(slide.child)], [lambda now: now.position(slide.child)]):
        other, there, push = cart()
        far = [fm.output.Position(there.child)] if isinstance(far[0], fm.output.Position) else [
            lambda now, frame=there.child: now.position(frame)
        ]  # fmt: skip
        same = other.add_states(lag, initial=[2.0], scale=1.0, measurements=far, inputs=[push])
        for name in ("radau", "8(5,3)"):
            found = other.simulate(1.0, rtol=1e-8, integrator=METHODS[name])
            assert abs(found.states(same)[-1, 0] - run.states(states)[-1, 0]) < 1e-6
        slide.velocity = there.velocity = 0.0
        slopes = [one.linearize(about=one.equilibrium()).state_space().A for one in (scene, other)]
        np.testing.assert_allclose(*slopes, rtol=1e-7, atol=1e-7)


def test_systems_of_scipy_are_taken_as_they_are():
    """A lag as a transfer function, and its sampled twin against the matrix exponential."""
    scene, slide, push = cart()
    system = scipy.signal.TransferFunction([-GAIN], [LAG, 1.0])
    states = scene.add_states(system, scale=10.0, measurements=[fm.output.Position(slide)], inputs=[push])
    run = scene.simulate(1.0, rtol=1e-9)
    end = scipy.linalg.expm(EXACT) @ [1.0, -0.5, 0.0]
    assert run.beta(slide)[-1] == pytest.approx(end[0], abs=1e-7)
    assert run.states(states).shape == (len(run.t), 1)

    period = 0.02
    space = system.to_ss()
    A, B, C, D, dt = scipy.signal.cont2discrete((space.A, space.B, space.C, space.D), period)
    scene, slide, push = cart()
    law = scene.add_controller(
        scipy.signal.dlti(A, B, C, D, dt=dt), measurements=[fm.output.Position(slide)], inputs=[push]
    )
    run = scene.simulate(0.5, rtol=1e-9)
    hold = scipy.linalg.expm(period * np.block([[EXACT[:2]], [np.zeros((1, 3))]]))
    x, z = np.array([1.0, -0.5]), 0.0
    for k, (y, u) in enumerate(zip(run.sampled(law).measurements[:, 0], run.sampled(law).inputs[:, 0], strict=True)):
        push_now = float((C * z + D * x[0])[0, 0])
        assert (y, u) == (pytest.approx(x[0], abs=1e-7), pytest.approx(push_now, abs=1e-6)), k
        x, z = (hold @ [*x, push_now])[:2], float((A * z + B * x[0])[0, 0])
    assert law.period == period


def test_a_state_equation_that_gives_nan_or_another_shape_is_named_with_the_time():
    @fm.compiled
    def nan_compiled(t, z, u, out):
        out[0] = math.nan if t > 0.25 else -z[0]

    for rates, told in (
        (lambda t, z, u: [math.nan if t > 0.25 else -z[0]], "as rates it gave .*nan.*, not finite"),
        (lambda t, z, u: [-z[0]] * (2 if t > 0.25 else 1), r"as rates it gave shape \(2,\), not shape \(1,\)"),
        (lambda t, z, u: 1.0 / (0.0 if t > 0.25 else 1.0), "division by zero"),
        (nan_compiled, "gave no finite number"),
    ):
        scene, _, push = cart()
        scene.add_states(rates, initial=[1.0], scale=1.0, inputs=[push], name="valve")
        for method in METHODS.values():
            with pytest.raises(fm.SimulationError, match=rf"states 'valve' at t = 0\.\d* s.*{told}") as caught:
                scene.simulate(1.0, integrator=method)
            assert 0.0 <= caught.value.trajectory.t[-1] <= 0.26
    scene, _, push = cart()
    scene.add_states(
        lag_compiled, initial=[1.0], scale=1.0, measurements=[0.0], outputs=lambda t, z, u: z[:0], inputs=[push]
    )
    with pytest.raises(SceneError, match=r"as outputs it gave shape \(0,\), not shape \(1,\)"):
        scene.simulate(1.0)


def test_wrong_states_are_told_when_they_are_given():
    scene, slide, push = cart()

    def add(rates=lag, *, initial=(0.0,), scale=1.0, scene=scene, inputs=(push,), **more):
        return scene.add_states(rates, initial=initial, scale=scale, inputs=inputs, **more)

    for wrong, told in (
        ({"initial": [math.nan]}, "initial values must be finite"),
        ({"initial": []}, "initial values"),
        ({"initial": None}, "give their values at the start"),
        ({"scale": 0.0}, "the scale must be"),
        ({"scale": [1.0, 2.0]}, "the scale must be"),
        ({"rates": 3.0}, "must be a function of t, z and u"),
        ({"inputs": [slide]}, "an input must be a signal"),
        ({"inputs": [push, fm.Signal("other")]}, "1 states cannot set 2 signals"),
        ({"measurements": [fm.output.Acceleration(slide)]}, "cannot follow accelerations"),
        ({"measurements": ["angle"]}, "what states follow"),
        ({"measurements": [fm.output.Position(slide.child), push]}, "cannot follow signals or data as well"),
        ({"names": ["a", "b"]}, "1 states need 1 distinct names"),
        ({"rates": fm.compiled(lambda t: t)}, "must take t, z, u and out"),
        ({"rates": scipy.signal.dlti([1.0], [1.0, -0.5], dt=0.1)}, "must be continuous"),
        ({"rates": scipy.signal.lti([1.0, 0.0, 0.0], [1.0, 2.0])}, "cannot be written as a state space"),
    ):
        with pytest.raises(SceneError, match=told):
            add(**wrong)
    with pytest.raises(SceneError, match="is continuous; sample it"):
        scene.add_controller(scipy.signal.lti([1.0], [1.0, 2.0]), inputs=[push])
    with pytest.raises(SceneError, match=r"sampled every 0\.1 s, and period is 0\.2 s"):
        scene.add_controller(scipy.signal.dlti([1.0], [1.0, -0.5], dt=0.1), period=0.2, inputs=[push])


@pytest.mark.parametrize("name", ["8(5,3)", "radau"])
def test_a_joint_held_by_constraints_and_a_frame_are_set_as_well(name):
    """The cart on constraints, whose force acts between frames; and pushed at its frame, whose place is asked."""
    ends = []
    for how in ("coordinates", "constraints", "frame"):
        way = fm.Way.COORDINATES if how == "coordinates" else fm.Way.CONSTRAINTS
        scene, slide, push = cart(stiffness=0.0, way=way)
        slide.position, slide.velocity = 1.0, -0.5
        frame = slide.child
        scene.add_force(fm.force.SpringDamper(scene.ground.frame(), frame, STIFFNESS, 0.0))
        followed = [lambda now, frame=frame: now.position(frame)[0]]
        if how == "frame":
            scene._forces.pop(0)
            scene.add_force(fm.force.FrameForce(frame, (push, 0.0, 0.0)))
        elif how == "coordinates":
            followed = [fm.output.Position(slide)]
        states = scene.add_states(lag, initial=[2.0], scale=1.0, measurements=followed, inputs=[push])
        run = scene.simulate(0.5, rtol=1e-8, integrator=METHODS[name])
        ends.append([run.position(frame)[-1, 0], run.velocity(frame)[-1, 0], run.states(states)[-1, 0]])
        np.testing.assert_allclose(ends[-1], exact([0.5])[0], atol=1e-6)


@pytest.mark.parametrize("name", ["8(5,3)", "radau"])
def test_a_distributed_load_is_set_as_well(name):
    """Its wrench on the frame and its forces on the modes, as a function of time of the same values sets them."""
    found = []
    for by_states in (True, False):
        scene, slide, _ = cart()
        beam = scene.add(fm.FlexibleBody(loaded_record()), name="beam")
        scene.connect(fm.joint.Fixed(), slide.child, beam.frame("root"))
        gas = fm.Signal("gas")
        factor = gas if by_states else lambda t: 2.0 * np.exp(-20.0 * t)
        scene.add_force(fm.force.DistributedLoad(beam, "gas", factor))
        if by_states:
            scene.add_states(lambda t, z, u: -20.0 * z, initial=[2.0], scale=1.0, inputs=[gas])
        run = scene.simulate(0.3, rtol=1e-8, integrator=METHODS[name])
        found.append(np.concatenate([run.q(beam)[-1], [run.beta(slide)[-1]]]))
    np.testing.assert_allclose(found[0], found[1], atol=1e-6 * abs(found[1]).max())
    assert abs(found[1][:-1]).max() > 1e-3 * abs(found[1]).max()


def test_signals_that_states_cannot_set_are_told_by_the_scene():
    scene, _, push = cart()
    for _ in range(2):
        scene.add_states(lag, initial=[0.0], scale=1.0, measurements=[0.0], inputs=[push])
    with pytest.raises(SceneError, match="states 'states 1' set the signal 'push' already"):
        scene.simulate(1.0)
    scene, _, push = cart()
    scene.add_states(lag, initial=[0.0], scale=1.0, measurements=[push], inputs=[push])
    with pytest.raises(SceneError, match="states follow the signal 'push', which they set"):
        scene.simulate(1.0)
    scene, _, push = cart()
    scene.add_states(lag, initial=[0.0], scale=1.0, measurements=[0.0], inputs=[fm.Signal("lost")])
    with pytest.raises(SceneError, match="no load of the scene has the signal 'lost'"):
        scene.simulate(1.0)
    scene, _, push = cart()
    scene.add_states(lag, initial=[0.0], scale=1.0, measurements=[0.0], inputs=[push], name="valve")
    scene.add_controller(lambda t, y: 0.0, period=0.1, inputs=[push])
    with pytest.raises(SceneError, match="'push' is set by states 'valve' already"):
        scene.simulate(1.0)


@pytest.mark.parametrize("name", METHODS)
def test_states_beside_what_remembers_change_nothing_of_it(name):
    """A spring that yields to and fro, with states that load nothing: whichever of them was added first, or none."""

    def swung(order):
        scene = fm.System()
        body = scene.add(fm.RigidBody(mass=1.0, inertia=(1.0, 1.0, 1.0)), name="cart")
        slide = scene.connect(fm.joint.Prismatic(axis="x"), scene.ground.frame(), body.frame(), name="slide")
        slide.position, slide.velocity = 0.0, 3.0
        spring = fm.force.PlasticJointSpring(slide, deformation=(0.0, 0.1, 1.1), force=(0.0, 10.0, 12.0))
        for what in order:
            if what == "spring":
                scene.add_force(spring)
            else:
                idle = fm.Signal("idle")
                scene.add_force(fm.force.JointForce(slide, idle))
                scene.add_states(lambda t, z, u: -z, initial=[0.0], scale=1.0, inputs=[idle])
        run = scene.simulate(3.0, rtol=1e-6, integrator=METHODS[name])
        return run.beta(slide)[-1], run.remembered(spring)["dissipated"][-1]

    alone = swung(["spring"])
    assert 0.5 * 1.0 * 3.0**2 > alone[1] > 3.9  # what the cart had, but for what still swings
    assert swung(["states", "spring"]) == pytest.approx(alone, rel=1e-9)
    assert swung(["spring", "states"]) == pytest.approx(alone, rel=1e-9)
    every = ["spring", "states"]
    assert swung(every) == swung(every[::-1])


def test_a_force_of_ones_own_with_states_after_one_that_remembers_is_refused():
    class Own:
        connections = frames = ()

        def __init__(self, states):
            self._states = states

        def check(self):
            self._states.check()

        def assemble(self, table):
            self._states.assemble(table)

    scene, slide, push = cart(stiffness=0.0)
    slide.position = 0.0
    scene.add_force(fm.force.PlasticJointSpring(slide, deformation=(0.0, 0.1, 1.1), force=(0.0, 10.0, 12.0)))
    scene.add_force(Own(fm.States(lambda t, z, u: -z, initial=[0.0], scale=1.0, inputs=[push], name="own")))
    with pytest.raises(SceneError, match="are coordinates, which come before what force elements remember"):
        scene.compile()
