"""Laws that jump with the state, `fm.Switched`: located as events are, on smooth steps of either side."""

from __future__ import annotations

import numpy as np
import pytest
from damped_contact import CONTACT, METHODS

import flexmbd as fm

STIFFNESS, DAMPING, RADIUS = CONTACT.stiffness, CONTACT.damping, CONTACT.radius
HIGH, LOW = 4.0, 1.0  # N/m


@fm.compiled
def contact(t, y, v, side):
    return 0.0 if side > 0.0 else -STIFFNESS * (y - RADIUS) - DAMPING * v


@fm.compiled
def gap(t, y, v):
    return y - RADIUS


@fm.compiled
def contact_of_state(t, x, v, out, side):
    if side < 0.0:
        out[0] = -STIFFNESS * (x[0] - RADIUS) - DAMPING * v[0]


@fm.compiled
def gap_of_state(t, x, v, out):
    out[0] = x[0] - RADIUS


SWITCHED = fm.Switched(contact, when=gap)
PLAIN = fm.Switched(
    lambda t, y, v, side: 0.0 if side > 0.0 else -STIFFNESS * (y - RADIUS) - DAMPING * v,
    when=lambda t, y, v: y - RADIUS,
)


def slider(law, *, mass: float = 1.0, position: float = 0.0, velocity: float = 0.0):
    """A mass that slides without gravity, with a law."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(mass, (1e-3,) * 3), name="mass")
    joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame(), name="slide")
    joint.position, joint.velocity = position, velocity
    scene.add_force(fm.force.JointLaw(joint, law))
    return scene, joint


@pytest.mark.parametrize("name", METHODS)
def test_contact_with_a_damper(name: str) -> None:
    """The closed form by pieces, to some rtol; no jump is left to error control; Python gives the same to the bit."""
    tight = (1e-4, 1e-5) if METHODS[name].order < 5 else (1e-4, 1e-6, 1e-8)
    for rtol in tight:
        scene, joints = CONTACT.scene(SWITCHED)
        run = scene.simulate(0.25, rtol=rtol, integrator=METHODS[name])
        assert max(CONTACT.errors(run, joints[0])) < 10.0 * rtol, rtol
        assert (run.stats.jumps, run.stats.switches) == (0, 4)
    scene, joints = CONTACT.scene(PLAIN)
    again = scene.simulate(0.25, rtol=rtol, integrator=METHODS[name])
    np.testing.assert_array_equal(again.x, run.x)


@pytest.mark.parametrize("name", ["alpha", "5(4)"])
def test_fixed_steps_keep_their_order(name: str) -> None:
    """Steps end on switches and lead back to where equal ones would have led."""
    errors, low = [], type(CONTACT)(height=0.051)
    for h in (8e-5, 4e-5):
        scene, joints = low.scene(SWITCHED)
        run = scene.simulate(0.02, h=h, integrator=METHODS[name])
        errors.append(max(low.errors(run, joints[0])))
    assert errors[1] < 1.4 * 0.5 ** METHODS[name].order * errors[0]


def test_forces_of_the_state() -> None:
    """A switched `StateForce`, compiled and in Python, is the same law."""
    ends = []
    for force in (
        fm.Switched(contact_of_state, when=gap_of_state),
        fm.Switched(
            lambda t, x, v, side: np.where(side > 0.0, 0.0, -STIFFNESS * (x[:1] - RADIUS) - DAMPING * v),
            when=lambda t, x, v: x[0] - RADIUS,
        ),
    ):
        scene, joints = CONTACT.scene(lambda t, y, v: 0.0)
        scene.add_force(fm.force.StateForce(force))
        run = scene.simulate(0.25, rtol=1e-7, integrator=METHODS["8(5,3)"])
        assert max(CONTACT.errors(run, joints[0])) < 10.0 * 1e-7
        assert run.stats.switches == 4
        ends.append(run.x[-1, :1])
    np.testing.assert_allclose(*ends, rtol=1e-12)


def test_equal_balls_at_one_instant() -> None:
    """Two switches at the same instant: each ball moves as one alone does."""
    scene, joints = CONTACT.scene(SWITCHED, 2)
    run = scene.simulate(0.25, rtol=1e-7, integrator=METHODS["8(5,3)"])
    assert run.stats.switches == 8
    for joint in joints:
        assert max(CONTACT.errors(run, joint)) < 10.0 * 1e-7
    assert run.beta(joints[0])[-1] == pytest.approx(run.beta(joints[1])[-1], rel=1e-12)


@pytest.mark.parametrize("name", ["8(5,3)", "Radau"])
def test_period_of_a_bilinear_spring(name: str) -> None:
    """A force that bends at zero: half a period of each stiffness."""
    law = fm.Switched(lambda t, x, v, side: -(HIGH if side > 0.0 else LOW) * x, when=lambda t, x, v: x)
    scene, joint = slider(law, position=1.0)
    period = np.pi * (1.0 / np.sqrt(HIGH) + 1.0 / np.sqrt(LOW))
    run = scene.simulate(3.0 * period, rtol=1e-9, integrator=METHODS[name])
    assert abs(run.beta(joint)[-1] - 1.0) + abs(run.beta_rate(joint)[-1]) < 1e-7
    assert run.stats.switches == 6
    assert run.beta(joint).min() == pytest.approx(-2.0, abs=0.1)


def test_grazing() -> None:
    """A ball thrown up to where a ceiling would push it just touches it, and falls as if there were none."""
    speed = 2.0
    top = speed**2 / (2.0 * 9.81)
    ceiling = fm.Switched(lambda t, y, v, side: -500.0 if side > 0.0 else 0.0, when=lambda t, y, v: y - top)
    scene, joints = CONTACT.scene(ceiling)
    joints[0].position, joints[0].velocity = 0.0, speed
    run = scene.simulate(0.4, rtol=1e-8)
    assert run.beta(joints[0])[-1] == pytest.approx(speed * 0.4 - 0.5 * 9.81 * 0.4**2, abs=1e-5)


def test_backlash_by_two_switches() -> None:
    """A mass between two springs, with play: free flights and half sines."""
    play, stiffness = 0.3, 50.0

    def spring(wall):
        return fm.Switched(
            lambda t, x, v, side: -stiffness * (x - wall) if side * wall > 0.0 else 0.0, when=lambda t, x, v: x - wall
        )

    scene, joint = slider(spring(play), velocity=1.0)
    scene.add_force(fm.force.JointLaw(joint, spring(-play)))
    period = 4.0 * play + 2.0 * np.pi / np.sqrt(stiffness)
    run = scene.simulate(period, rtol=1e-9, integrator=METHODS["8(5,3)"])
    assert abs(run.beta(joint)[-1]) + abs(run.beta_rate(joint)[-1] - 1.0) < 1e-7
    assert run.stats.switches == 4


def test_hysteresis() -> None:
    """A relay that lets go at 1 and pulls again at -1: parabolas, whose speeds follow from the work on the way."""

    def relay(t, x, v, side):
        return -1.0 if side > 0.0 else 1.0

    def passed(t, x, v, side):
        return x + 1.0 if side > 0.0 else x - 1.0

    scene, joint = slider(fm.Switched(relay, when=passed), position=-1.5)
    assert scene.start().a[0] == 1.0
    run = scene.simulate(9.0, rtol=1e-9, integrator=METHODS["8(5,3)"])
    # with 1 from -1.5 to 1, then with -1, beyond 1 and back to -1; then with 1
    up = np.sqrt(5.0)
    turns = up + 2.0 * up  # it is at 1 again, with -up
    down = np.sqrt(up**2 + 4.0)
    back = turns + (down - up)
    s = 9.0 - back
    assert run.beta(joint)[-1] == pytest.approx(-1.0 - down * s + 0.5 * s * s, abs=1e-7)
    assert run.stats.switches == 2


@pytest.mark.parametrize("name", METHODS)
def test_friction_comes_to_rest(name: str) -> None:
    """Coulomb's friction ends a motion in a closed form's time; that it would stick then is refused by name."""
    friction = fm.Switched(lambda t, x, v, side: -3.0 * side, when=lambda t, x, v: v)
    scene, joint = slider(friction, mass=2.0, velocity=1.0)
    with pytest.raises(fm.SimulationError, match=r"JointLaw on joint 'slide'.*slide or stick") as failed:
        scene.simulate(2.0, rtol=1e-6, integrator=METHODS[name])
    run = failed.value.trajectory
    assert run.t[-1] == pytest.approx(2.0 / 3.0, abs=1e-12)
    rest = fm.Event(lambda m: m.beta_rate(joint), stop=True, name="rest")
    run = scene.simulate(2.0, rtol=1e-6, integrator=METHODS[name], events=[rest])
    assert run.beta(joint)[-1] == pytest.approx(1.0 / 3.0, abs=1e-6)


def test_friction_is_reversed() -> None:
    """A spring strong enough goes on against the friction: half a period, and two friction ways less."""
    stiffness, friction = 10.0, 1.0
    law = fm.Switched(lambda t, x, v, side: -stiffness * x - friction * side, when=lambda t, x, v: v)
    scene, joint = slider(law, position=1.0)
    half = np.pi / np.sqrt(stiffness)
    run = scene.simulate(2.0 * half, rtol=1e-9, integrator=METHODS["8(5,3)"])
    assert run.beta(joint, t=[half, 2.0 * half]) == pytest.approx([-0.8, 0.6], abs=1e-7)
    with pytest.raises(fm.SimulationError, match="slide or stick") as failed:
        scene.simulate(10.0, rtol=1e-9, integrator=METHODS["8(5,3)"])
    assert failed.value.trajectory.beta(joint)[-1] == pytest.approx(0.0, abs=0.1)


def test_endless_switching() -> None:
    """A force that twists into the origin switches ever faster, up to a finite time, and is stopped there."""
    law = fm.Switched(lambda t, x, v, side: -side, when=lambda t, x, v: x)
    scene, joint = slider(law, position=1.0)
    scene.add_force(fm.force.JointLaw(joint, fm.Switched(lambda t, x, v, side: -0.5 * side, when=lambda t, x, v: v)))
    with pytest.raises(fm.SimulationError, match=r"switches endlessly|slide or stick") as failed:
        scene.simulate(20.0, rtol=1e-6, integrator=METHODS["8(5,3)"])
    # from 1 with -1/2 to the origin, there at speed 1: then it stops in 2/3 s, comes back, and so on by sqrt(1/3)
    ends = 2.0 + (1.0 / 1.5 + np.sqrt(1.0 / 3.0) / 0.5) / (1.0 - np.sqrt(1.0 / 3.0))
    assert failed.value.trajectory.t[-1] == pytest.approx(ends, abs=1e-4)


def test_impact_that_reverses_friction() -> None:
    """An event that sets velocities changes the side of a law of velocities."""
    friction = fm.Switched(lambda t, x, v, side: -side, when=lambda t, x, v: v)
    scene, joint = slider(friction, velocity=2.0)
    wall = fm.Event(lambda m: m.beta(joint) - 1.0, action=lambda m: m.set_rate(joint, -m.beta_rate(joint)))
    run = scene.simulate(1.5, rtol=1e-9, events=[wall])
    speed = np.sqrt(2.0)
    s = 1.5 - (2.0 - speed)
    assert run.beta(joint)[-1] == pytest.approx(1.0 - speed * s + 0.5 * s * s, abs=1e-8)


@pytest.mark.parametrize("name", ["8(5,3)", "alpha", "Radau"])
@pytest.mark.parametrize("at", [0.05, 0.1015])
def test_restart(name: str, at: float) -> None:
    """A restart in flight or in contact goes on to the bit."""
    scene, _ = CONTACT.scene(SWITCHED)
    whole = scene.simulate(0.2, rtol=1e-5, integrator=METHODS[name], checkpoints=[at])
    rest = scene.simulate(0.2, rtol=1e-5, integrator=METHODS[name], restart=whole.checkpoints[0])
    np.testing.assert_array_equal(rest.x, whole.x[whole.t >= at])
    assert rest.stats.switches == whole.stats.switches


def test_start_on_the_switch() -> None:
    """A start at zero is on the side that it moves to."""
    scene, joints = CONTACT.scene(SWITCHED)
    joints[0].position = RADIUS
    for speed, force in ((1.0, 0.0), (-1.0, DAMPING)):
        joints[0].velocity = speed
        assert scene.start().a[0] == pytest.approx(force / CONTACT.mass - 9.81)


def test_variants_and_copies() -> None:
    """Other values of parameters, in an ensemble too, and a pickled scene: each a scene of its own."""
    scene, joints = CONTACT.scene(SWITCHED)
    machine = scene.compile(parameters={"mass": fm.parameter.Mass(joints[0].child.body)})
    for mass in (0.2, 0.3, 0.25):
        alone = type(CONTACT)(mass=mass)
        run = machine.simulate(0.2, mass=mass, rtol=1e-7)
        assert max(alone.errors(run, joints[0])) < 10.0 * 1e-7


def test_forces_are_told_on_the_right_side() -> None:
    """What a law exerts follows the side that each row has: of the two rows at a switch, before it and after it."""
    scene, joints = CONTACT.scene(SWITCHED)
    run = scene.simulate(0.11, rtol=1e-8)
    before, last = np.flatnonzero(np.diff(run.t) == 0.0)
    y, v = run.beta(joints[0]), run.beta_rate(joints[0])
    exerted = np.zeros(len(y))
    inside = slice(before + 1, last + 1)
    exerted[inside] = -STIFFNESS * (y[inside] - RADIUS) - DAMPING * v[inside]
    np.testing.assert_allclose(np.ravel(run.drive(joints[0])), exerted, rtol=1e-9, atol=1e-9)
    assert run.at(run.t[last] - 1e-5).beta(joints[0]) < RADIUS


def test_explain_and_refusals(tmp_path) -> None:
    """What is watched is said; laws without a side, and doors that know no switches, are refused by name."""
    scene, joints = CONTACT.scene(SWITCHED)
    assert "JointLaw on joint 'drop 0': its switch is located" in scene.explain()
    with pytest.raises(fm.SceneError, match="last argument of the law must be `side`"):
        fm.Switched(lambda t, y, v: 0.0, when=gap)
    with pytest.raises(fm.SceneError, match="side"):
        fm.Switched(gap, when=gap)
    with pytest.raises(fm.SceneError, match="other arguments"):
        scene.add_force(fm.force.JointLaw(joints[0], fm.Switched(contact_of_state, when=gap_of_state)))
    bad, _ = CONTACT.scene(fm.Switched(contact, when=lambda t, y, v: np.nan))
    with pytest.raises(fm.SceneError, match="the switch of JointLaw on joint 'drop 0'"):
        bad.simulate(0.1)


@pytest.mark.parametrize("form", ["compiled", "plain", "frame"])
def test_states_that_switch(form: str) -> None:
    """A sink fills at one rate and drains at another, by where a mass that swings is: integrals of known times."""

    def plain(t, z, u, side):
        return [2.0 if side > 0.0 else -1.0]

    @fm.compiled
    def rates(t, z, u, out, side):
        out[0] = 2.0 if side > 0.0 else -1.0

    @fm.compiled
    def place(t, z, u, out):
        out[0] = u[0]

    scene, joint = slider(lambda t, x, v: -4.0 * x, velocity=1.0)
    followed = fm.output.Position(joint)
    if form == "frame":
        followed = lambda now: now.position(joint.child)[:1]  # noqa: E731
    when = place if form == "compiled" else lambda t, z, u: u[0]
    law = fm.Switched(rates if form == "compiled" else plain, when=when)
    states = scene.add_states(law, initial=[0.5], scale=1.0, measurements=[followed])
    half = np.pi / 2.0
    run = scene.simulate(2.5 * half, rtol=1e-8, integrator=METHODS["8(5,3)"])
    assert run.states(states)[-1, 0] == pytest.approx(0.5 + 2.0 * half - half + 2.0 * 0.5 * half, abs=1e-6)
    assert run.stats.switches == 2
    assert "its switch is located" in scene.explain()


def test_equilibria_are_of_the_side_that_they_begin_on() -> None:
    """A ball that lies on its contact is found from within; what lies beyond a switch is refused by name."""
    scene, joints = CONTACT.scene(SWITCHED)
    joints[0].position = RADIUS - 1e-4
    point = scene.equilibrium()
    assert point.beta(joints[0]) == pytest.approx(RADIUS - CONTACT.mass * 9.81 / STIFFNESS, rel=1e-9)
    law = fm.Switched(lambda t, x, v, side: -4.0 * x - (2.0 if side > 0.0 else 0.0), when=lambda t, x, v: x)
    scene, _ = slider(law, position=0.3)
    with pytest.raises(fm.SceneError, match="beyond the switch of JointLaw on joint 'slide'"):
        scene.equilibrium()


def test_an_fmu_takes_no_switches(tmp_path) -> None:
    """Users' functions cannot leave: told by the element's name."""
    scene, _ = CONTACT.scene(SWITCHED)
    with pytest.raises(fm.FlexmbdError, match="JointLaw on joint 'drop 0'"):
        fm.export.fmu_machine(scene, tmp_path / "ball.fmu", h=1e-3)


def test_a_function_of_the_state_may_write_into_what_it_is_given():
    """The machine's state is not the one that `when` gets."""

    def law(t, x, v, side):
        return np.array([-2000.0 * x[0] if side < 0.0 else -9.81])

    def clean(t, x, v):
        return x[0]

    def careless(t, x, v):
        found = float(x[0])
        x[:], v[:] = np.nan, np.nan
        return found

    ends = []
    for when in (clean, careless):
        scene = fm.System()
        ball = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)), name="ball")
        slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), ball.frame())
        slide.position = 0.05
        scene.add_force(fm.force.StateForce(fm.Switched(law, when=when)))
        run = scene.simulate(0.4, rtol=1e-6)
        assert run.stats.switches > 0
        ends.append(run.x[-1])
    np.testing.assert_array_equal(*ends)
