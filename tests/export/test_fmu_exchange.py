"""Machines for model exchange: CVode moves them as we do, and their derivatives are those of differences."""

import fmpy
import numpy as np
import pytest
from exported_bodies import soft_bar
from fmpy.validation import validate_fmu
from scipy.interpolate import PPoly
from units import Unit

import flexmbd as fm
from flexmbd.errors import ExportError

OUT = fm.output


class Cart:
    """A cart on a spring that carries a hub with a soft bar and a weight at its tip; a torque drives the hub."""

    def __init__(self):
        scene = self.scene = fm.System(gravity=(0.0, 0.0, -9.81))
        cart = scene.add(fm.RigidBody(3.0, (0.1, 0.1, 0.1)), name="cart")
        hub = scene.add(fm.RigidBody(1.0, (0.02, 0.02, 0.03)), name="hub")
        self.bar = scene.add(fm.FlexibleBody(soft_bar()), name="bar")
        weight = scene.add(fm.RigidBody(0.3, (1e-3, 2e-3, 3e-3), (0.02, 0.0, 0.01)), name="weight")
        self.rail = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), cart.frame(), name="rail")
        self.shaft = scene.connect(fm.joint.Revolute("y"), cart.frame(), hub.frame(), name="shaft")
        scene.connect(fm.joint.Fixed(), hub.frame(p=(0.1, 0.0, 0.0)), self.bar.frame("x_min"))
        self.pin = scene.connect(fm.joint.Universal("y", "z"), self.bar.frame("x_max"), weight.frame(), name="pin")
        scene.add_force(fm.force.JointSpring(self.rail, 300.0))
        scene.add_force(fm.force.JointSpring(self.shaft, 40.0))
        scene.add_force(fm.force.JointDamper(self.shaft, 0.2))
        scene.add_force(fm.force.JointTorque(self.shaft, fm.Sine(0.5, 9.0)))
        self.shaft.velocity = 1.5
        self.tip, self.grip = self.bar.frame("x_max"), weight.frame(p=(0.05, 0.0, 0.0))
        self.torque = fm.force.JointTorque(self.shaft, 0.4)
        wrench = {"force": (1.0, -0.5, 0.2), "torque": (0.0, 0.1, 0.0)}
        self.pull = fm.force.FrameForce(self.grip, axes=fm.force.Axes.FRAME, **wrench)

    def ports(self):
        outputs = {"tip": OUT.Position(self.tip), "grip": OUT.Velocity(self.grip), "turn": OUT.Rotation(self.grip)}
        outputs |= {"shaft": OUT.Position(self.shaft), "rate": OUT.Velocity(self.rail)}
        outputs |= {"jerked": OUT.Acceleration(self.rail), "q": OUT.Position(self.bar)}
        return {"inputs": {"torque": self.torque, "pull": self.pull}, "outputs": outputs}


@pytest.fixture(scope="module")
def cart(tmp_path_factory):
    """The unit of the cart."""
    folder, there = tmp_path_factory.mktemp("cart"), Cart()
    fm.export.fmu_machine(there.scene, folder / "cart.fmu", h=5e-5, model_exchange=True, **there.ports())
    return Unit(folder / "cart.fmu", folder / "unzipped")


def of(unit, causality):
    return [one.name for one in unit.description.modelVariables if one.causality == causality]


def states_of(unit):
    return [one.derivative.name for one in unit.description.modelVariables if one.derivative is not None]


def test_cvode_moves_it_as_we_do(cart):
    assert validate_fmu(str(cart.folder).replace("unzipped", "cart.fmu")) == []
    there = Cart()
    there.scene.add_force(there.torque)
    there.scene.add_force(there.pull)
    span, every = 0.1, 2e-4
    run = there.scene.simulate(span, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    result = fmpy.simulate_fmu(
        str(cart.folder), fmi_type="ModelExchange", solver="CVode", relative_tolerance=1e-8, stop_time=span,
        output_interval=every, output=["tip.x", "tip.z", "grip.vz", "shaft", "turn.Rxz"],
    )  # fmt: skip
    tip, grip = run.position(there.tip, t=result["time"]), run.velocity(there.grip, t=result["time"])
    expected = {"tip.x": tip[:, 0], "tip.z": tip[:, 2], "grip.vz": grip[:, 2]}
    expected["shaft"] = run.beta(there.shaft, t=result["time"])
    expected["turn.Rxz"] = run.rotation(there.grip, t=result["time"])[:, 0, 2]
    for name, values in expected.items():
        assert np.ptp(values) > 1e-2
        assert np.abs(result[name] - values).max() <= 1e-6 * np.abs(values).max(), name


def test_directional_derivatives_are_those_of_differences(cart):
    one = cart.instance(exchange=True, torque=0.7)
    states = states_of(cart)
    knowns, unknowns = [*of(cart, "input"), *states], [*(f"der({name})" for name in states), *of(cart, "output")]
    assert len(states) == 2 * (4 + soft_bar().n_modes)
    random = np.random.default_rng(2)
    n = len(states) // 2
    sizes = np.r_[np.full(n, 0.1), np.ones(n)]
    sizes[[k for k, name in enumerate(states) if "bar" in name]] *= 1e-2
    x, inputs = one.get(states) + sizes * random.normal(size=2 * n), random.normal(size=len(knowns) - 2 * n)
    change = np.r_[random.normal(size=len(inputs)), sizes * random.normal(size=2 * n)]
    one.set_states(x)
    one.fmu.setTime(0.05)

    def at(share):
        values = np.r_[inputs, x] + share * change
        one.set(dict(zip(of(cart, "input"), values, strict=False)))
        one.set_states(values[len(inputs) :])
        return one.get(unknowns)

    h = 1e-4  # differences of fourth order
    expected = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h)
    here = at(0.0)
    found = one.direction(unknowns, knowns, change)
    assert (one.get(unknowns) == here).all()
    assert np.abs(expected).min() > 0.0
    for name, a, b, size in zip(unknowns, found, expected, np.abs(here), strict=True):
        assert abs(a - b) <= 1e-7 * (abs(b) + size), name
    alone = one.direction(unknowns, ["torque"], [1.0])
    assert one.direction(unknowns, ["torque"], [1e-9]) * 1e9 == pytest.approx(alone, rel=1e-9, abs=1e-9)
    one.free()


def test_steps_in_co_simulation_are_the_same_as_ever(cart):
    """The one unit serves both kinds of host."""
    there, one = Cart(), cart.instance()
    there.scene.add_force(there.torque)
    there.scene.add_force(there.pull)
    run = there.scene.simulate(0.02, h=5e-5, integrator=fm.ExplicitRungeKutta())
    for _ in range(20):
        one.step(1e-3)
    expected = run.position(there.tip)[-1]
    assert np.abs(one.get(["tip.x", "tip.y", "tip.z"]) - expected).max() <= 1e-9
    with pytest.raises(Exception, match="failed"):
        one.direction(["shaft"], ["torque"], [1.0])
    one.free()


def test_machines_that_are_no_ordinary_differential_equations_are_refused(tmp_path):
    def refused(words, scene):
        with pytest.raises(ExportError, match=words):
            fm.export.fmu_machine(scene, tmp_path / "a.fmu", h=1e-3, model_exchange=True)

    there = Cart()
    there.scene.connect(fm.joint.Prismatic("z"), there.scene.ground.frame(p=(0.0, 0.0, -0.1)), there.grip)
    refused("closed loops", there.scene)
    there = Cart()
    there.rail.prescribe(fm.Sine(0.1, 2.0))
    refused("prescribed motions", there.scene)
    there = Cart()
    ball = there.scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
    there.scene.connect(fm.joint.Spherical(), there.grip, ball.frame())
    refused("quaternion", there.scene)
    there = Cart()
    jump = PPoly(np.array([[0.0, 1.0]]), [0.0, 0.1, 1.0])
    there.scene.add_force(fm.force.JointTorque(there.shaft, jump))
    refused("events", there.scene)


def test_begins_in_equilibrium(tmp_path):
    """Where the machine hangs at rest, it stays."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    arm = scene.add(fm.RigidBody(2.0, (0.01, 0.02, 0.02), (0.3, 0.0, 0.0)), name="arm")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), arm.frame(), name="hinge")
    scene.add_force(fm.force.JointSpring(hinge, 15.0))
    motor = scene.add_force(fm.force.JointTorque(hinge, 1.0))
    rest = scene.equilibrium()
    outputs = [OUT.Position(hinge), OUT.Velocity(hinge)]
    fm.export.fmu_machine(scene, tmp_path / "rest.fmu", h=1e-3, about=rest, inputs=[motor], outputs=outputs)
    angle = rest.beta(hinge)
    one = Unit(tmp_path / "rest.fmu", tmp_path / "one").instance()
    assert 0.1 < angle < 1.0
    for torque, moves in ((1.0, False), (1.5, True)):
        one.set({one.unit.description.modelVariables[1].name: torque})
        for _ in range(10):
            one.step(0.02)
        place, rate = one.get(of(one.unit, "output"))
        assert (abs(place - angle) > 1e-2) == moves
        assert moves or abs(rate) + abs(place - angle) < 1e-9
    one.free()
    with pytest.raises(fm.FlexmbdError, match="about"):
        fm.export.fmu_machine(scene, tmp_path / "a.fmu", h=1e-3, about=0.3)
