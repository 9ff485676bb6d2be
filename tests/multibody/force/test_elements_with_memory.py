"""Elasto-plastic springs and hinges: exact piecewise motions, Masing's rule, memories wherever states go."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from bilinear_oscillator import BilinearOscillator

import flexmbd as fm
from flexmbd.ensemble import Sampled
from flexmbd.errors import RecordError, SceneError
from flexmbd.force import PlasticJointSpring, PlasticSpring
from flexmbd.output import Acceleration, Position, Velocity

STIFFNESS, YIELDS, HARDENING, MASS, LOAD, FREQUENCY = 1e4, 100.0, 2500.0, 2.0, 120.0, 31.0
BILINEAR = (YIELDS / STIFFNESS, YIELDS / STIFFNESS + 0.01), (YIELDS, YIELDS + HARDENING * 0.01)
CURVE = (0.0, 0.01, 0.02, 0.05), (0.0, 100.0, 130.0, 160.0)
METHODS = {
    "5(4)": fm.ExplicitRungeKutta(),
    "8(5,3)": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8),
    "alpha": fm.GeneralizedAlpha(),
    "radau": fm.RadauIIA(),
    "energy-momentum": fm.EnergyMomentum(),
    "central": fm.CentralDifference(),
}


def slider(curve=CURVE, *, kinematic=1.0, speed=6.0, mass=MASS, inertia=1.0, load=None):
    """A mass on an elasto-plastic spring."""
    scene = fm.System(gravity=(0.0, 0.0, 0.0))
    body = scene.add(fm.RigidBody(mass, (inertia,) * 3), name="body")
    joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame(), name="slide")
    spring = scene.add_force(PlasticJointSpring(joint, *curve, kinematic=kinematic))
    if load is not None:
        scene.add_force(fm.force.JointForce(joint, load))
    joint.velocity = speed
    return scene, joint, spring


@pytest.mark.parametrize("kinematic", [True, False])
@pytest.mark.parametrize("name", METHODS)
def test_exact_motion_over_several_yields(name, kinematic):
    """Harmonic motions between the events: error over rtol is of the order that these methods have elsewhere."""
    exact = BilinearOscillator(MASS, STIFFNESS, YIELDS, HARDENING, LOAD, FREQUENCY, kinematic)
    x, v, plastic, events = exact.end(0.0, 1.0, 1.0)
    assert events >= 4
    tight = name in ("5(4)", "8(5,3)", "radau")
    for rtol in (1e-3, 1e-4, 1e-6, 1e-8) if tight else (1e-3, 1e-4, 1e-5):
        scene, joint, spring = slider(BILINEAR, kinematic=float(kinematic), speed=1.0, load=fm.Sine(LOAD, FREQUENCY))
        run = scene.simulate(1.0, rtol=rtol, integrator=METHODS[name])
        fastest = np.abs(run.beta_rate(joint)).max()
        most = 100.0 if tight else 200.0
        assert abs(run.beta(joint)[-1] - x) < most * rtol  # of the machine's extent, 1 m
        assert abs(run.beta_rate(joint)[-1] - v) < most * rtol * fastest
        assert abs(run.remembered(spring)["plastic_deformation"][-1] - plastic) < most * rtol


@pytest.mark.parametrize("kinematic", [1.0, 0.0, 0.4])
@pytest.mark.parametrize("name", METHODS)
def test_work_is_stored_or_dissipated(name, kinematic):
    scene, _, spring = slider(kinematic=kinematic)
    run = scene.simulate(0.5, rtol=1e-4, integrator=METHODS[name])
    energy, lost = run.energy(), run.remembered(spring)["dissipated"]
    assert lost[-1] > 0.5 * energy.total[0]
    assert (np.diff(lost) >= 0.0).all()
    assert abs(energy.total + lost - energy.total[0]).max() < 5e-3 * energy.total[0]


def test_energies_balance_with_rtol():
    scene, _, spring = slider(kinematic=0.4)
    run = scene.simulate(0.5, rtol=1e-9, integrator=METHODS["8(5,3)"])
    total = run.energy().total + run.remembered(spring)["dissipated"]
    assert abs(total - total[0]).max() < 1e-7 * total[0]


def led(kinematic, *, scale=1.0):
    """The force that drives the slider along x(t), and x."""
    scene, joint, spring = slider(speed=None, kinematic=kinematic)
    places = np.array([0.0, 0.035, -0.01, 0.02, -0.04, 0.045])
    t = np.arange(len(places), dtype=float)
    joint.prescribe(fm.Table(t, scale * places, monotone=True))
    run = scene.simulate(t[-1], h=1e-3, integrator=METHODS["5(4)"])
    inertia = MASS * run.a[:, 0]
    return run.beta(joint), run.drive(joint) - inertia, spring, run


def monotone(x):
    """The curve itself, of either sign."""
    return np.sign(x) * np.interp(abs(x), [*CURVE[0], 10.0], [*CURVE[1], 160.0 + 1000.0 * 9.95])


def masing(places):
    """Forces at turning points by Masing's rule: branches are the curve at twice the scale, and rejoin older ones."""
    forces, stack = [0.0], [(0.0, 0.0)]
    for x in places[1:]:
        force = None
        while True:
            base, anchor = stack[-1]
            if len(stack) == 1:
                force = monotone(x)
                break
            force = anchor + 2.0 * monotone(0.5 * (x - base))
            before = stack[-2][0] if len(stack) > 2 else -base
            if (x - before) * np.sign(x - base) <= 0.0:
                break
            stack = stack[:-2] if len(stack) > 2 else stack[:1]
        stack.append((x, force))
        forces.append(force)
    return np.array(forces)


def test_masing_s_rule():
    """Kinematic hardening on a way of five turns, among them a small loop within a large one."""
    x, force, _, run = led(1.0)
    at = [int(np.argmin(abs(run.t - k))) for k in range(6)]
    # what the drive gives beyond inertia is what the spring takes
    np.testing.assert_allclose(force[at], masing(x[at]), atol=1e-9)
    assert len({round(value, 6) for value in force[at]}) == 6


def test_isotropic_hardening_yields_at_the_force_reached():
    x, force, spring, run = led(0.0)
    first, second = (int(np.argmin(abs(run.t - k))) for k in (1, 2))
    assert force[first] == pytest.approx(monotone(0.035), rel=1e-12)
    # from the turn it unloads by the elastic slope over twice the force reached, then follows the curve from there
    reached, elastic = force[first], 2.0 * force[first] / 1e4
    assert x[first] - x[second] > elastic
    plastic = run.remembered(spring)["plastic_deformation"]
    inside = (run.t > 1.0) & (x > x[first] - 0.999 * elastic) & (run.t < 2.0)
    assert np.ptp(plastic[inside]) == 0.0
    slope = 1000.0  # of the curve's last piece, on which it was: dF = slope dx
    assert force[second] == pytest.approx(-reached - slope * (x[first] - x[second] - elastic), rel=1e-9)


def test_along_a_line_as_on_a_joint():
    ends = []
    for line in (False, True):
        scene, joint, spring = slider()
        if line:
            scene = fm.System(gravity=(0.0, 0.0, 0.0))
            body = scene.add(fm.RigidBody(MASS, (1.0, 1.0, 1.0)), name="body")
            joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
            ends_at = scene.ground.frame(p=(-0.5, 0.0, 0.0)), body.frame()
            spring = scene.add_force(PlasticSpring(*ends_at, *CURVE, length=0.5))
            joint.velocity = 6.0
        for name in ("5(4)", "radau", "alpha", "energy-momentum"):
            run = scene.simulate(0.3, h=2e-4, integrator=METHODS[name])
            kept = run.remembered(spring)
            ends.append([run.beta(joint)[-1], kept["plastic_deformation"][-1], kept["dissipated"][-1]])
    np.testing.assert_allclose(ends[:4], ends[4:], rtol=1e-8)


def test_in_millimetres():
    """N, mm, t: the same motion by fixed steps, and within rtol by error control."""
    curve = np.multiply(CURVE[0], 1e3), CURVE[1]
    for how, apart in (({"h": 5e-4}, 1e-12), ({"rtol": 1e-6}, 1e-6)):
        ends = []
        for length, scene in ((1.0, slider()), (1e3, slider(curve, mass=1e-3 * MASS, inertia=1e3, speed=6e3))):
            run = scene[0].simulate(0.5, integrator=METHODS["5(4)"], **how)
            kept = run.remembered(scene[2])
            ends.append([run.beta(scene[1])[-1] / length, kept["dissipated"][-1] / length, run.stats.steps])
        np.testing.assert_allclose(ends[0][0], ends[1][0], atol=apart)
        np.testing.assert_allclose(ends[0][1], ends[1][1], rtol=1e3 * apart)
        assert ends[0][2] == pytest.approx(ends[1][2], rel=0.02)


@pytest.mark.parametrize("name", METHODS)
def test_restart_is_the_same_to_the_bit(name, tmp_path):
    scene, *_ = slider(kinematic=0.4)
    how = {"rtol": 1e-4, "integrator": METHODS[name]}
    whole = scene.simulate(0.3, checkpoints=[0.1], **how)
    kept = fm.Checkpoint.load(whole.checkpoints[0].save(tmp_path / "kept.npz"))
    rest = scene.simulate(0.3, restart=kept, **how)
    np.testing.assert_array_equal(rest.x, whole.x[-len(rest.t) :])
    again = scene.simulate(0.3, checkpoints=[0.1], **how)
    np.testing.assert_array_equal(again.x, whole.x)  # a run leaves no trace in its scene


def test_variants_are_to_the_bit_scenes_of_their_own():
    scene, joint, spring = slider()
    named = {"force": fm.parameter.OfForce(spring, "force"), "v": fm.parameter.InitialVelocity(joint)}
    machine = scene.compile(parameters=named)
    for factor in (1.0, 0.7, 1.3):
        force = tuple(factor * f for f in CURVE[1])
        own = slider((CURVE[0], force), speed=5.0)[0].simulate(0.2, rtol=1e-5, integrator=METHODS["5(4)"])
        run = machine.simulate(0.2, rtol=1e-5, integrator=METHODS["5(4)"], force=force, v=5.0)
        np.testing.assert_array_equal(run.x, own.x)


@pytest.mark.parametrize("how", [{"rtol": 1e-5}, {"h": 1e-3}])
@pytest.mark.parametrize("name", METHODS)
def test_ensembles_sample_the_same(name, how):
    """Speeds, yield forces and starts, some beyond yield: sampled, by trajectories, and by scenes of their own."""
    how = {"t_end": 0.2, "integrator": METHODS[name], **how}
    scene, joint, spring = slider(kinematic=0.4)
    joint.position = 0.0
    named = {
        "v": fm.parameter.InitialVelocity(joint), "x": fm.parameter.InitialPosition(joint),
        "force": fm.parameter.OfForce(spring, "force"),
    }  # fmt: skip
    machine = scene.compile(parameters=named)
    force = np.multiply.outer([1.0, 0.7, 1.3, 1.0], CURVE[1])
    given = {"v": np.array([2.0, 4.0, 6.0, 2.0]), "x": np.array([0.0, 0.03, -0.02, 0.0]), "force": force}
    times = np.linspace(0.0, 0.2, 9)
    sampled = {
        "x": Sampled(Position(joint), t=times), "v": Sampled(Velocity(joint), t=times),
        "a": Sampled(Acceleration(joint), t=times),
    }  # fmt: skip
    by_run = sampled | {"lost": lambda run: run.remembered(spring)["dissipated"][-1]}
    quick, long = (machine.ensemble(given, outputs, **how) for outputs in (sampled, by_run))
    assert quick.done.all()
    for output in sampled:
        np.testing.assert_array_equal(quick.output(output), long.output(output))
    for k in range(4):
        own, hinge, element = slider((CURVE[0], force[k]), kinematic=0.4, speed=given["v"][k])
        hinge.position = given["x"][k]
        run = own.simulate(**how)
        np.testing.assert_array_equal(quick.output("x")[k], run.beta(hinge, t=times))
        np.testing.assert_array_equal(quick.output("v")[k], run.beta_rate(hinge, t=times))
        assert long.output("lost")[k] == run.remembered(element)["dissipated"][-1] > 0.0
    np.testing.assert_array_equal(quick.output("x")[0], quick.output("x")[3])  # none remembers those before it


@pytest.mark.parametrize("name", METHODS)
def test_a_kept_trajectory_gives_memories_back_to_the_bit(name, tmp_path):
    scene, _, spring = slider(kinematic=0.4)
    run = scene.simulate(0.2, rtol=1e-4, integrator=METHODS[name])
    scene, _, spring_2 = slider(kinematic=0.4)
    again = fm.Trajectory.load(run.save(tmp_path / "run.h5"), scene)
    assert run.remembered(spring)["plastic_way"][-1] > 0.0
    for t in (None, np.linspace(0.0, 0.2, 23)):
        kept, read = run.remembered(spring, t=t), again.remembered(spring_2, t=t)
        assert kept.keys() == read.keys()
        for key, series in kept.items():
            np.testing.assert_array_equal(read[key], series)
    np.testing.assert_array_equal(again.energy().spring, run.energy().spring)
    scene, *_ = slider(kinematic=0.3)
    with pytest.raises(RecordError, match="another machine"):
        fm.Trajectory.load(tmp_path / "run.h5", scene)


def test_a_load_that_jumps_and_an_impact():
    """Steps end at a jump; an event that turns the velocity round makes the spring unload from where it is."""
    ends = []
    for integrator, rtol in (("8(5,3)", 1e-9), ("5(4)", 1e-5), ("alpha", 1e-5), ("radau", 1e-5)):
        scene, joint, spring = slider(speed=1.0, load=fm.Piecewise(lambda t: 90.0 if t < 0.1 else -150.0, breaks=[0.1]))
        bounce = fm.Event(
            lambda m, j=joint: m.beta(j) - 0.012, name="bounce", direction=fm.Direction.RISING,
            action=lambda m, j=joint: m.set_rate(j, -0.6 * m.beta_rate(j)),
        )
        run = scene.simulate(0.3, rtol=rtol, integrator=METHODS[integrator], events=[bounce])
        ends.append([run.beta(joint)[-1], run.remembered(spring)["plastic_deformation"][-1]])
    np.testing.assert_allclose(ends[1:], ends[:1] * 3, atol=2e-4)


def test_equilibrium_and_linear_machine():
    """A load beyond yield: the curve's deformation; small vibrations about it unload, so the elastic slope counts."""
    scene, joint, spring = slider(speed=None, load=145.0)
    point = scene.equilibrium()
    assert point.beta(joint) == pytest.approx(0.035, rel=1e-9)
    assert point.remembered(spring)["plastic_deformation"] == pytest.approx(0.035 - 145.0 / 1e4, rel=1e-9)
    linear = scene.linearize(about=point)
    np.testing.assert_allclose(linear.frequencies(), np.sqrt(1e4 / MASS) / (2.0 * np.pi), rtol=1e-9)
    run = scene.simulate(0.2, about=point, rtol=1e-6)
    assert np.ptp(run.beta(joint)) < 1e-9
    assert np.ptp(run.remembered(spring)["plastic_deformation"]) < 1e-12


def test_a_start_beyond_yield_counts_as_loaded_from_rest():
    scene, joint, spring = slider(speed=0.0)
    joint.position = 0.035
    run = scene.simulate(0.05, rtol=1e-8)
    assert run.remembered(spring)["plastic_deformation"][0] == pytest.approx(0.035 - 145.0 / 1e4, rel=1e-12)
    assert run.a[0, 0] == pytest.approx(-145.0 / MASS, rel=1e-12)


def hinges(n):
    """A chain that falls on plastic hinges, bent by its weight."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    inner, springs = scene.ground, []
    for k in range(n):
        body = scene.add(fm.RigidBody(0.5, (1e-3, 5e-3, 5e-3), (0.1, 0.0, 0.0)), name=f"link {k}")
        start = inner.frame() if k == 0 else inner.frame(p=(0.2, 0.0, 0.0))
        joint = scene.connect(fm.joint.Revolute("z"), start, body.frame())
        most = 0.1 * (n - k) ** 1.5
        springs.append(scene.add_force(PlasticJointSpring(joint, (0.02, 0.5), (most, 1.4 * most))))
        inner = body
    return scene, springs


def test_a_chain_of_plastic_hinges_by_all_methods():
    """Trees by implicit methods in O(bodies) among them; each hinge's plastic angle."""
    ends = []
    for name, rtol in (("8(5,3)", 1e-9), ("5(4)", 1e-6), ("radau", 1e-6), ("alpha", 1e-5)):
        scene, springs = hinges(8)
        run = scene.simulate(0.15, rtol=rtol, integrator=METHODS[name])
        ends.append([run.remembered(one)["plastic_deformation"][-1] for one in springs])
    assert np.abs(ends[0]).max() > 0.01
    np.testing.assert_allclose(ends[1:], ends[:1] * 3, atol=2e-4)


def test_copies_and_answers():
    scene, joint, spring = slider()
    run = scene.simulate(0.1, rtol=1e-5)
    other, same = copy.deepcopy((run, spring))
    np.testing.assert_array_equal(other.remembered(same)["dissipated"], run.remembered(spring)["dissipated"])
    assert set(run.remembered(spring)) >= {"deformation", "plastic_deformation", "plastic_way", "dissipated"}
    np.testing.assert_array_equal(run.remembered(spring)["deformation"], run.beta(joint))
    assert "PlasticJointSpring on joint 'slide'" in scene.explain()
    with pytest.raises(SceneError, match="remembers nothing"):
        run.remembered(fm.force.JointSpring(joint, 1.0))


@pytest.mark.parametrize(
    ("deformation", "force", "kinematic", "words"),
    [
        ((0.0, 0.01, 0.02), (0.0, 100.0, 90.0), 1.0, "force falls from 100 to 90 after the deformation 0.01"),
        ((0.0, 0.01, 0.02), (0.0, 0.0, 90.0), 1.0, "no elastic slope"),
        ((0.0, 0.02, 0.01), (0.0, 100.0, 110.0), 1.0, "must grow from 0; after 0.02 comes 0.01"),
        ((-0.01, 0.01), (-100.0, 100.0), 1.0, "must grow from 0"),
        ((0.0, 0.01, np.nan), (0.0, 100.0, 110.0), 1.0, "finite numbers"),
        ((0.0, 0.01), (0.0, 100.0, 110.0), 1.0, "of equal length"),
        ((0.0, 0.01, 0.02), (0.0, 100.0, 200.0), 1.0, "never yields"),
        ((0.0, 0.01, 0.02), (1.0, 100.0, 110.0), 1.0, "at deformation 0 is 1, not 0"),
        ((0.0, 0.01, 0.02, 0.03), (0.0, 100.0, 110.0, 150.0), 1.0, "kinematic hardening needs falling slopes"),
        ((0.0, 0.01, 0.02, 0.03), (0.0, 100.0, 110.0, 250.0), 0.0, "not below the elastic slope"),
        ((0.0, 0.01, 0.02), (0.0, 100.0, 110.0), 1.5, "kinematic = 1.5"),
        ((), (), 1.0, "no elastic slope"),
    ],
)
def test_what_is_no_curve(deformation, force, kinematic, words):
    with pytest.raises(SceneError, match=words):
        slider((deformation, force), kinematic=kinematic)


def test_isotropic_hardening_takes_a_curve_that_stiffens_again():
    slider(((0.0, 0.01, 0.02, 0.03), (0.0, 100.0, 110.0, 150.0)), kinematic=0.0)[0].simulate(0.1, rtol=1e-3)
