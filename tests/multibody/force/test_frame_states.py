"""Forces between frames with states, loads on frames by states and signals, against scipy's integrators."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.errors import SceneError

METHODS = {
    "explicit": (fm.ExplicitRungeKutta(), 1e-10),
    "radau": (fm.RadauIIA(), 1e-9),
    "alpha": (fm.GeneralizedAlpha(), 1e-7),
    "energy": (fm.EnergyMomentum(), 1e-7),
    "auto": ("auto", 1e-9),
}


@fm.compiled
def cylinder(t, data, z, u, d, R, rate, spin, out):
    """Pressures (Pa) on both sides of a piston, filled by a valve's flow (m^3/s) and by what the rod displaces."""
    area, ring, volume, bulk, leak, length = data[0], data[1], data[2], data[3], data[4], data[5]
    along = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    speed = (d[0] * rate[0] + d[1] * rate[1] + d[2] * rate[2]) / along
    through = leak * (z[0] - z[1])
    push = area * z[0] - ring * z[1]
    for k in range(3):
        out[k] = push * d[k] / along
    out[6] = bulk / (volume + area * (along - length)) * (u[0] - area * speed - through)
    out[7] = bulk / (volume - ring * (along - length)) * (ring * speed - u[0] + through)


@dataclass(frozen=True, eq=False)
class Cylinder(fm.force.BetweenFrames, fm.force.WithStates):
    """A hydraulic cylinder between two eyes, without any body of its own."""

    frame_F: fm.Frame
    frame_G: fm.Frame
    flow: object
    bulk: float = 2e7
    start: float = 1e5
    size: object = 1e5
    law: object = cylinder

    def check(self):
        fm.force.check_numbers(self.what, positive={"bulk": self.bulk})

    def assemble(self, table):
        numbers = [2e-3, 1.5e-3, 8e-4, self.bulk, 1e-10, 0.6]
        states = {"head": self.start, "ring": 1.3 * self.start}
        table.frame_states(
            self.law, self.what, self.frame_F, self.frame_G, states=states, scale=self.size, numbers=numbers,
            inputs=[self.flow],
        )  # fmt: skip


MASS, REACH, EYE, FOOT = 12.0, 0.8, 0.5, np.array([0.3, -0.5])
INERTIA = 0.9


def crane(flow, **choice):
    """A boom on a hinge about z, raised by a cylinder from its foot to an eye on the boom."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    boom = scene.add(fm.RigidBody(MASS, (0.1, INERTIA, INERTIA), (REACH, 0.0, 0.0)), name="boom")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), boom.frame())
    force = scene.add_force(Cylinder(scene.ground.frame(p=(*FOOT, 0.0)), boom.frame(p=(EYE, 0.0, 0.0)), flow, **choice))
    return scene, hinge, force


def crane_rates(t, y, flow):
    """Angle, its rate and both pressures, by the moment of the piston's force about the hinge."""
    angle, speed, head, ring = y
    eye = EYE * np.array([np.cos(angle), np.sin(angle)])
    d = eye - FOOT
    length = np.hypot(*d)
    n = d / length
    growth = n @ (EYE * speed * np.array([-np.sin(angle), np.cos(angle)]))
    push = 2e-3 * head - 1.5e-3 * ring
    moment = push * (eye[0] * n[1] - eye[1] * n[0]) - MASS * 9.81 * REACH * np.cos(angle)
    through = 1e-10 * (head - ring)
    return [
        speed,
        moment / (INERTIA + MASS * REACH**2),
        2e7 / (8e-4 + 2e-3 * (length - 0.6)) * (flow(t) - 2e-3 * growth - through),
        2e7 / (8e-4 - 1.5e-3 * (length - 0.6)) * (1.5e-3 * growth - flow(t) + through),
    ]


def crane_end(flow, t=0.5):
    start = [0.0, 0.0, 1e5, 1.3e5]
    return solve_ivp(crane_rates, (0.0, t), start, args=(flow,), method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


@pytest.mark.parametrize("name", METHODS)
def test_a_hydraulic_cylinder(name):
    """Without a body of its own, by every integrator; a restart is the same to the bit."""
    method, rtol = METHODS[name]
    scene, hinge, force = crane(fm.Sine(2e-4, 9.0))
    run = scene.simulate(0.5, rtol=rtol, integrator=method, checkpoints=[0.2])
    assert len(scene._bodies) == 1
    expected = crane_end(lambda t: 2e-4 * np.sin(9.0 * t))
    found = [run.beta(hinge)[-1], run.beta_rate(hinge)[-1], *run.states(force)[-1]]
    close = 1e-9 if name == "explicit" else 1e-7 if name in ("radau", "auto") else 2e-5
    np.testing.assert_allclose(np.array(found) / expected, 1.0, atol=close)
    again = scene.simulate(0.5, rtol=rtol, integrator=method, restart=run.checkpoints[0])
    np.testing.assert_array_equal(again.x[-1], run.x[-1])
    np.testing.assert_array_equal(again.v[-1], run.v[-1])


def test_by_a_controllers_signal():
    """A valve set at equal times and held; what the machine measures decides it."""
    flow = fm.Signal("flow")
    scene, hinge, _ = crane(flow)
    measured = [fm.output.Position(hinge)]
    scene.add_controller(lambda t, y: -2e-3 * (y[0] - 0.1), period=0.05, measurements=measured, inputs=[flow])
    run = scene.simulate(0.5, rtol=1e-10, integrator=fm.ExplicitRungeKutta())
    y = np.array([0.0, 0.0, 1e5, 1.3e5])
    for k in range(10):
        held = -2e-3 * (y[0] - 0.1)
        span = (0.05 * k, 0.05 * (k + 1))
        args = (lambda t, held=held: held,)
        y = solve_ivp(crane_rates, span, y, args=args, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert run.beta(hinge)[-1] == pytest.approx(y[0], rel=1e-9)


def test_it_rests_and_is_linearised():
    """At rest the pressures bear the boom; eigenvalues are those of the equations, differenced."""
    scene, hinge, force = crane(0.0)
    rest = scene.equilibrium()
    start = np.array([float(np.squeeze(rest.beta(hinge))), 0.0, *rest.states(force)])
    np.testing.assert_allclose(crane_rates(0.0, start, lambda t: 0.0)[1], 0.0, atol=1e-9)
    A = np.zeros((4, 4))
    for k, size in enumerate((1.0, 1.0, 1e5, 1e5)):
        for c, weight in ((1, 2.0 / 3.0), (2, -1.0 / 12.0)):
            for sign in (1.0, -1.0):
                moved = start + sign * c * 1e-3 * size * np.eye(4)[k]
                A[:, k] += sign * weight / (1e-3 * size) * np.array(crane_rates(0.0, moved, lambda t: 0.0))
    found = np.sort_complex(scene.linearize(about=rest).eigenvalues())
    expected = np.sort_complex(np.linalg.eigvals(A))
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


def test_other_numbers_in_a_compiled_machine():
    """Its numbers vary from run to run, and states at the start and their sizes: as a scene built anew with them."""
    scene, hinge, force = crane(fm.Sine(2e-4, 9.0))
    for what, value in (("bulk", 5e6), ("start", 2e5), ("size", 3e5)):
        machine = scene.compile(parameters={what: fm.parameter.OfForce(force, what)})
        run = machine.simulate(0.2, rtol=1e-8, **{what: value})
        other, same, cylinder = crane(fm.Sine(2e-4, 9.0), **{what: value})
        anew = other.simulate(0.2, rtol=1e-8)
        np.testing.assert_array_equal(run.beta(hinge), anew.beta(same))
        np.testing.assert_array_equal(run.states(force), anew.states(cylinder))


@pytest.mark.parametrize("name", METHODS)
def test_states_that_set_forces_on_frames(name):
    """A lag drives an actuator between two eyes, a component of a force on a frame, and a torque on the joint."""
    method, rtol = METHODS[name]
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    boom = scene.add(fm.RigidBody(MASS, (0.1, INERTIA, INERTIA), (REACH, 0.0, 0.0)), name="boom")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), boom.frame())
    push, side, turn = fm.Signal("push"), fm.Signal("side"), fm.Signal("turn")
    eye = boom.frame(p=(EYE, 0.0, 0.0))
    scene.add_force(fm.force.LineForce(scene.ground.frame(p=(*FOOT, 0.0)), eye, push))
    scene.add_force(fm.force.FrameForce(eye, (0.0, side, 0.0), axes=fm.force.Axes.FRAME))
    scene.add_force(fm.force.JointTorque(hinge, turn))

    @fm.compiled
    def rates(t, z, u, out):
        out[0] = (300.0 + 400.0 * (0.2 - u[0]) - 60.0 * u[1] - z[0]) / 0.05
        out[1] = z[0] - 20.0 * z[1]

    @fm.compiled
    def outputs(t, z, u, out):
        out[0], out[1], out[2] = z[0], 0.5 * z[1], -2.0 * z[1] - 3.0 * u[1]

    states = scene.add_states(
        rates, initial=[100.0, 2.0], scale=(100.0, 10.0), outputs=outputs, inputs=[push, side, turn],
        measurements=[fm.output.Position(hinge), fm.output.Velocity(hinge)],
    )  # fmt: skip

    def of_machine(t, y):
        angle, speed, lag, slow = y
        place = EYE * np.array([np.cos(angle), np.sin(angle)])
        n = (place - FOOT) / np.hypot(*(place - FOOT))
        moment = lag * (place[0] * n[1] - place[1] * n[0]) + 0.5 * slow * EYE - 2.0 * slow - 3.0 * speed
        moment -= MASS * 9.81 * REACH * np.cos(angle)
        chased = (300.0 + 400.0 * (0.2 - angle) - 60.0 * speed - lag) / 0.05
        return [speed, moment / (INERTIA + MASS * REACH**2), chased, lag - 20.0 * slow]

    start = [0.0, 0.0, 100.0, 2.0]
    expected = solve_ivp(of_machine, (0.0, 0.5), start, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    run = scene.simulate(0.5, rtol=rtol, integrator=method)
    found = [run.beta(hinge)[-1], run.beta_rate(hinge)[-1], *run.states(states)[-1]]
    close = 1e-9 if name == "explicit" else 1e-7 if name in ("radau", "auto") else 2e-5
    np.testing.assert_allclose(np.array(found) / expected, 1.0, atol=close)


@fm.compiled
def pushing(t, data, z, u, d, R, rate, spin, out):
    along = np.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
    for k in range(3):
        out[k] = u[0] * d[k] / along


@dataclass(frozen=True, eq=False)
class Pushing(fm.force.BetweenFrames):
    """A law of its inputs alone."""

    frame_F: fm.Frame
    frame_G: fm.Frame
    value: object

    def check(self):
        pass

    def assemble(self, table):
        table.frame_states(pushing, self.what, self.frame_F, self.frame_G, states={}, inputs=[self.value])


def test_a_force_along_a_line():
    """As a law without states by its input; as an input of a linear machine its arm about the hinge."""
    ends = []
    for kind in (Pushing, fm.force.LineForce):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        boom = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.2, 0.0, 0.0)), name="boom")
        hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), boom.frame())
        foot, eye = scene.ground.frame(p=(*FOOT, 0.0)), boom.frame(p=(EYE, 0.0, 0.0))
        scene.add_force(kind(foot, eye, fm.Sine(3.0, 20.0, offset=4.0)))
        ends.append(scene.simulate(0.5, rtol=1e-9, integrator=fm.ExplicitRungeKutta()).beta(hinge)[-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-12)
    scene._forces.clear()
    scene.add_force(fm.force.JointSpring(hinge, 40.0))
    rest = scene.equilibrium()
    linear = scene.linearize(about=rest, inputs=[fm.force.LineForce(foot, eye, 0.0)])
    angle = float(np.squeeze(rest.beta(hinge)))
    place = EYE * np.array([np.cos(angle), np.sin(angle)])
    n = (place - FOOT) / np.hypot(*(place - FOOT))
    assert linear.V[0, 0] == pytest.approx(place[0] * n[1] - place[1] * n[0], rel=1e-12)


def test_what_is_wrong_is_told():
    flow = fm.Signal("flow")
    scene, _, force = crane(flow)
    for choice, text in (
        ({"start": np.nan}, "states at the start must be finite"),
        ({"size": 0.0}, "size of each state in its unit, positive"),
        ({"size": (1.0, 2.0, 3.0)}, "size of each state in its unit, positive"),
        ({"law": fm.compiled(lambda t, beta, rate: 0.0)}, r"function of \(t, data, z, u, d, R, rate, spin, out\)"),
        ({"law": lambda *given: None}, "made by flexmbd.compiled"),
        ({"bulk": -1.0}, "bulk"),
    ):
        with pytest.raises(SceneError, match=text):
            crane(flow, **choice)[0].compile()
    # states set what another one's states follow
    scene.add_states(lambda t, z, u: -z, initial=[1.0], scale=1.0, inputs=[flow], name="pump")
    with pytest.raises(SceneError, match=r"'pump'.*states follow the signal 'flow'"):
        scene.compile()

    class Markless(fm.force.BetweenFrames):
        frame_F, frame_G = force.frames

        def check(self):
            pass

        def assemble(self, table):
            states = {"head": 1.0, "ring": 1.0}
            table.frame_states(cylinder, self.what, *self.frames, states=states, numbers=[1.0] * 6, inputs=[0.0])

    bare, *_ = crane(0.0)
    other = Markless()
    other.frame_F, other.frame_G = bare._forces[0].frames
    bare.add_force(other)
    with pytest.raises(SceneError, match=r"is a fm.force.WithStates.*\['head', 'ring'\]"):
        bare.compile()
    foreign, *_ = crane(0.0)
    with pytest.raises(SceneError, match="not in this scene"):
        foreign.simulate(0.01).states(force)
    with pytest.raises(SceneError, match=r"LineForce.*not a finite number"):
        bare.add_force(fm.force.LineForce(other.frame_F, other.frame_G, np.inf))


def test_states_come_before_what_elements_remember():
    """Whichever force is added first."""
    runs = []
    for order in (1, -1):
        scene, hinge, force = crane(fm.Sine(2e-4, 9.0))
        plastic = fm.force.PlasticJointSpring(hinge, (0.0, 0.01, 0.2), (0.0, 50.0, 70.0))
        scene._forces[:] = [force, plastic][::order]
        runs.append(scene.simulate(0.2, rtol=1e-8).beta(hinge)[-1])
    assert runs[0] == pytest.approx(runs[1], abs=1e-12)


def test_a_law_that_fails_is_named():
    @fm.compiled
    def broken(t, data, z, u, d, R, rate, spin, out):
        out[6] = 1.0 / (0.1 - t) if t < 0.1 else np.nan
        out[7] = 0.0

    scene, _, _ = crane(0.0, law=broken)
    with pytest.raises(fm.SimulationError, match=r"Cylinder"):
        scene.simulate(0.5, rtol=1e-6, integrator=fm.ExplicitRungeKutta())


# ------------------------------------------------------------------------------------------- bushings alike in frames


def bushing_scene(*, exchanged, symmetric=True, damping=0.0):
    """Two bodies that fly, on a bushing between frames far apart and turned."""
    rng = np.random.default_rng(5)
    half = rng.standard_normal((6, 6))
    K = half @ half.T * np.outer([30.0] * 3 + [3.0] * 3, [30.0] * 3 + [3.0] * 3)
    scene = fm.System()
    parts = (1.3, (0.05, 0.06, 0.07), (0.2, 0.05, -0.1)), (0.9, (0.02, 0.03, 0.04), (0.1, 0.05, -0.02))
    bodies = [scene.add(fm.RigidBody(*part)) for part in parts]
    joints = [scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame()) for body in bodies]
    turn = Rotation.from_rotvec([0.5, -0.9, 0.7]).as_quat(scalar_first=True)
    joints[1].position = (0.2, 0.1, -0.3, *turn)
    joints[0].velocity, joints[1].velocity = (0.1, 0.2, 0.0, 1.0, -0.5, 0.3), (0.0, 0.3, -0.2, -0.4, 0.8, 0.2)
    ends = [bodies[0].frame(p=(0.1, 0.2, 0.0)), bodies[1].frame(p=(-0.1, 0.1, 0.1))]
    if exchanged:
        ends.reverse()
    scene.add_force(fm.force.Bushing(ends[0], ends[1], K, damping * K, symmetric=symmetric))
    return scene, bodies


def test_exchanged_frames_move_alike():
    """With springs and dampers in all directions; one in the axes of F does not."""
    places = {}
    for symmetric in (True, False):
        for exchanged in (False, True):
            scene, bodies = bushing_scene(exchanged=exchanged, symmetric=symmetric, damping=0.01)
            run = scene.simulate(0.2, h=1e-3, integrator=fm.ExplicitRungeKutta())
            places[symmetric, exchanged] = np.concatenate([run.position(body.frame())[-1] for body in bodies])
    np.testing.assert_allclose(places[True, True], places[True, False], atol=1e-12)
    assert np.abs(places[False, True] - places[False, False]).max() > 1e-3
    assert np.abs(places[True, True] - places[False, False]).max() > 1e-3


def test_it_keeps_energy_and_momentum():
    for method, rtol, loose in ((fm.ExplicitRungeKutta(), 1e-10, 1e-8), (fm.EnergyMomentum(), 1e-5, 1e-3)):
        scene, *_ = bushing_scene(exchanged=False)
        run = scene.simulate(0.1, rtol=rtol, integrator=method)
        energy, momentum = run.energy(), run.momentum()
        assert np.ptp(energy.spring) > 0.1 * energy.total[0]
        assert np.ptp(energy.total) < 1e-9 * energy.total[0]
        assert np.ptp(momentum.angular, axis=0).max() < loose * np.abs(momentum.angular).max()


def test_half_way_axes_by_hand():
    """At rest: force and moment of stiffness (k, 0) on a frame turned by a quarter and moved along x of F."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="body")
    R = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    held = scene.connect(fm.joint.Fixed(), scene.ground.frame(p=(0.3, 0.0, 0.0), R=R), body.frame())
    stiffness = (100.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    bushing = scene.add_force(fm.force.Bushing(scene.ground.frame(), body.frame(), stiffness, symmetric=True))
    # seen from axes turned by 45 degrees d is 0.3 (cos, -sin); the spring along their x pulls it back
    c = np.sqrt(0.5)
    force = -100.0 * 0.3 * c * np.array([c, c, 0.0])
    # energy k (0.3 cos(angle / 2))^2 / 2, less by a turn: its slope by the angle is -k 0.09 sin(angle) / 4
    torque = np.array([0.0, 0.0, 100.0 * 0.09 * 1.0 / 4.0])
    reaction = scene.at_start().reaction(held)[0]
    np.testing.assert_allclose(R @ reaction[:3], -force, atol=1e-12)
    np.testing.assert_allclose(R @ reaction[3:], -torque, atol=1e-12)
    with pytest.raises(SceneError, match="symmetric"):
        scene.add_force(replace(bushing, symmetric="yes"))
