"""Bodies beyond what their records know, bushings beyond what they measure: told once each; what is within is not."""

import re
import warnings

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.beams import DiscreteFrame, discrete_body
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import beam_timoshenko
from flexmbd.reduction import craig_bampton, prestressed

SECTION = beam_timoshenko.Parameters.rectangle(
    2.1e9, 0.0, 7850.0, width=0.04, height=0.02, orientation=(0.0, 1.0, 0.0)
)
ENDS = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
ARM = {"arm": [("root", "tip")]}
BENDING = 2.1e9 * 0.04 * 0.02**3 / 12.0  # N m^2, across the thin side


def lumped(frame="root", section=SECTION):
    rod = DiscreteFrame(ENDS, ARM, {"arm": section}, divisions={"arm": 8})
    return discrete_body(rod, interfaces=["root", "tip"], frame=frame, modes=6)


def model():
    mesh = meshes.frame(ENDS, ARM, divisions={"arm": 8}, degree=2)
    ends = [Interface("root"), Interface("tip")]
    return ContinuumModel(mesh, {"arm": (beam_timoshenko, SECTION)}, degree=2, interfaces=ends)


@pytest.fixture(scope="module")
def stiffened():
    return craig_bampton(model(), modes=6, frame="root")


def said(ask, *args, **how):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", fm.RangeWarning)
        ask(*args, **how)
    return [str(one.message) for one in caught if issubclass(one.category, fm.RangeWarning)]


def turning(record, spin, *, axis="z", at="root"):
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="arm")
    hub = scene.connect(fm.joint.Revolute(axis), scene.ground.frame(), body.frame(at))
    hub.velocity = spin
    return scene


def percent(text):
    return float(re.search(r"about ([+-][\d.e]+) %", text)[1])


@pytest.mark.parametrize("frame", ["root", None])
@pytest.mark.parametrize("ask", ["run", "equilibrium", "linearize"])
def test_a_body_without_stiffening_is_told_by_about_how_much_it_is_too_soft(frame, ask, stiffened):
    """Against the frequency across the plane of the spin, which the spin raises and a record with stiffening has."""
    if frame is None and ask == "linearize":
        pytest.skip("a frame that a joint's rows carry round has no steady equations")
    record = lumped(frame)
    first = np.sqrt(lumped().stiffness[0])
    how = {
        "run": lambda scene: scene.simulate(0.05, rtol=1e-4),
        "equilibrium": fm.System.equilibrium,
        "linearize": lambda scene: scene.linearize(about=scene.equilibrium()),
    }[ask]
    share = 0.5
    texts = said(how, turning(record, share * first))
    assert len(texts) == 1
    assert "flexible body 'arm' turns with" in texts[0]
    assert "no stiffening by the tension of the centrifugal force" in texts[0]
    scene = turning(stiffened, share * first)
    found = scene.linearize(about=scene.equilibrium()).eigenvalues().imag
    across = found[found > 0.9 * first].min()
    assert percent(texts[0]) == pytest.approx(100.0 * (first**2 / across**2 - 1.0), rel=0.1)
    assert not said(how, turning(record, 0.05 * first))
    assert not said(how, turning(stiffened, share * first))


def test_a_shaft_that_turns_about_itself_is_not_stretched():
    first = np.sqrt(lumped().stiffness[0])
    assert not said(turning(lumped(), 1.5 * first, axis="x").simulate, 0.05, rtol=1e-4)


def test_stiffening_that_counts_twice_is_told(stiffened):
    """Of a body prestressed by a spin, in a machine that turns so; at rest, or about another axis, it is right."""
    first = np.sqrt(stiffened.stiffness[0])
    spin = np.array([0.0, 0.0, 0.5 * first])
    record = craig_bampton(prestressed(model(), frame="root", angular_velocity=spin), modes=6, frame="root")
    texts = said(turning(record, spin[2]).simulate, 0.05, rtol=1e-4)
    assert [bool(re.search("prestressed by a spin of .* counts twice", text)) for text in texts] == [True]
    raised = record.stiffness[0] / stiffened.stiffness[0] - 1.0
    assert percent(texts[0]) == pytest.approx(100.0 * raised / (1.0 + raised), rel=0.1)
    assert len(said(turning(record, -spin[2]).simulate, 0.05, rtol=1e-4)) == 1
    for other in (turning(record, 0.0), turning(record, spin[2], axis="y"), turning(record, 0.05 * spin[2])):
        assert not said(other.simulate, 0.05, rtol=1e-4)


def loaded(record, *, force=(0.0, 0.0, 0.0), torque=(0.0, 0.0, 0.0)):
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("root"))
    scene.add_force(fm.force.FrameForce(body.frame("tip"), force=force, torque=torque))
    return scene


@pytest.mark.parametrize("ask", [fm.System.equilibrium, lambda scene: scene.simulate(1.0, rtol=1e-3)])
@pytest.mark.parametrize("turned", [0.15, 0.3])
def test_a_body_that_bends_a_lot_is_told(ask, turned, stiffened):
    """A force P turns the end by P L^2 / 2 EI, and one that comes at once by nearly twice as much."""
    force = 2.0 * turned * BENDING
    size = turned if ask is fm.System.equilibrium else 1.9 * turned
    for record in (stiffened, lumped()):
        texts = said(ask, loaded(record, force=(0.0, 0.0, force)))
        assert len(texts) == (size > 0.25)
        assert all("'arm' bends: its interfaces 'root' and 'tip' turn by" in text for text in texts)
    if ask is fm.System.equilibrium and turned > 0.25:
        assert re.search(r"turn by 0\.3 rad .* off by about [45] %", texts[0])


def test_a_twist_about_the_line_between_the_interfaces_is_no_bending():
    record = lumped()
    stiffness = 1.0 / (record.interface("tip").modes[3] ** 2 @ (1.0 / record.stiffness))
    assert not said(loaded(record, torque=(0.5 * stiffness, 0.0, 0.0)).equilibrium)


def wheel(speed, stiffness=1.0, *, frame=None):
    """An inertia of 0.1 kg m^2 on a bushing of 1 N m / rad."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="wheel")
    joint = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame())
    turn = (0.0, 0.0, 0.0, 0.0, 0.0, stiffness)
    inner = scene.ground.frame(R=np.eye(3) if frame is None else frame)
    scene.add_force(fm.force.Bushing(inner, body.frame(), turn))
    joint.velocity = speed
    return scene, joint


TURNED = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("speed", [-12.0, 12.0, 200.0])
@pytest.mark.parametrize("turned", [False, True])
def test_a_bushing_beyond_half_a_revolution_is_told_when(speed, turned):
    """From where its ends, not the joint's coordinate, are half a revolution apart."""
    scene, joint = wheel(speed, frame=TURNED if turned else None)
    run = {}
    texts = said(lambda: run.update(it=scene.simulate(0.5, rtol=1e-6)))
    assert len(texts) == 1
    assert "its ends are turned by half a revolution" in texts[0]
    when = float(re.search(r"t = ([\d.e-]+) s", texts[0])[1])
    t, angle = run["it"].t, run["it"].beta(joint).ravel() + (np.pi / 2.0 if turned else 0.0)
    beyond = t[np.flatnonzero(abs(angle) > np.pi)[0]]
    assert when == pytest.approx(beyond, rel=1e-4)


def test_a_bushing_that_swings_below_half_a_revolution_is_right():
    """Up to 3 rad; and one that resists no turn may wind up."""
    scene, _ = wheel(3.0 * np.sqrt(10.0))
    assert not said(scene.simulate, 4.0, rtol=1e-6)
    scene, _ = wheel(30.0, stiffness=0.0)
    assert not said(scene.simulate, 1.0, rtol=1e-6)


def test_of_an_ensemble_each_limit_is_told_once():
    scene, joint = wheel(0.0)
    machine = scene.compile(parameters={"speed": [fm.parameter.InitialVelocity(joint)]})
    asked = {"t_end": 0.5, "rtol": 1e-4, "integrator": fm.ExplicitRungeKutta()}
    speeds, outputs = {"speed": np.full(4, 20.0)}, {"turn": lambda run: run.beta(joint)[-1]}
    assert len(said(lambda: machine.ensemble(speeds, outputs, workers=1, **asked))) == 1
    assert len(said(lambda: [machine.simulate(**asked, speed=20.0) for _ in range(3)])) == 3


def test_long_runs_are_looked_at_to_their_end():
    """A body that comes to speed in its last rows, of a thousand."""
    record = lumped()
    first = np.sqrt(record.stiffness[0])
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="arm")
    hub = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame("root"))

    def late(t):
        s = max(t - 0.9, 0.0)
        return 20.0 * first * s**3, 60.0 * first * s**2, 120.0 * first * s

    hub.prescribe(late)
    texts = said(scene.simulate, 1.0, h=1e-3, integrator=fm.GeneralizedAlpha())
    assert [text for text in texts if "no stiffening" in text]
    assert not said(scene.simulate, 0.91, h=1e-3, integrator=fm.GeneralizedAlpha())


def test_a_scene_within_its_range_says_nothing(stiffened):
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    arm = scene.add(fm.FlexibleBody(stiffened), name="arm")
    weight = scene.add(fm.RigidBody(mass=0.01, inertia=(1e-6,) * 3), name="weight")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame("root"))
    scene.connect(fm.joint.Fixed(), arm.frame("tip"), weight.frame())
    scene.add_force(fm.force.Bushing(scene.ground.frame(), arm.frame("root"), (0, 0, 0, 0, 0, 1.0)))
    assert not said(scene.simulate, 0.5, rtol=1e-5)
