"""Fixed steps of explicit methods beyond their stability are refused, just below it they run: by closed forms."""

import math
import warnings

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import parameter as vary

CENTRAL = fm.CentralDifference()

# Where |R| = 1 on the imaginary axis and on the negative real one.  Of order 4: 8^(1/2), and the root of
# 24 + 12 z + 4 z^2 + z^3; of Dormand & Prince from their stability polynomials.
LIMITS = {
    fm.Pair.CLASSICAL_4: (math.sqrt(8.0), 2.785293563),
    fm.Pair.DORMAND_PRINCE_5: (0.99868, 3.306578),
    fm.Pair.DORMAND_PRINCE_8: (5.96037, 6.393729),
}


def sliders(rate, *, decay=0.0, count=1, mass=1.0, length=1.0):
    """Masses on springs and dampers, the last of the given rate and decay (1/s); its own joint; size of a metre."""
    scene = fm.System()
    for k in range(count):
        body = scene.add(fm.RigidBody(mass, 3 * (mass * length**2,), (length, 0, 0)), name=f"b{k}")
        joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame(), name=f"j{k}")
        joint.position = 1e-3 * length
        share = (k + 1) / count
        if rate:
            scene.add_force(fm.force.JointSpring(joint, mass * (share * rate) ** 2))
        if decay:
            scene.add_force(fm.force.JointDamper(joint, mass * share * decay))
    return scene, joint


def is_refused(scene, h, steps, method):
    """Whether a run of so many steps is refused; it is broken off after some."""
    try:
        scene.simulate(steps * h, h=h, integrator=method, max_steps=20)
    except fm.SimulationError:
        return False
    except fm.SceneError as reason:
        return "beyond the stability" in str(reason)
    return False


@pytest.mark.filterwarnings("ignore::flexmbd.errors.StepsWarning")  # just below its limit a step is inaccurate
@pytest.mark.parametrize("count", [1, 5, 40])
@pytest.mark.parametrize("pair", fm.Pair)
def test_a_runge_kutta_method_is_refused_beyond_its_exact_limits(pair, count):
    method = fm.ExplicitRungeKutta(pair)
    for k, limit in enumerate(LIMITS[pair]):
        for size in (1e-3, 1.0, 1e6):
            rate = 1.0 / size
            given = {"rate": rate} if k == 0 else {"rate": 0.0, "decay": rate}
            scene, _ = sliders(**given, count=count, mass=size**2, length=1.0 / size)
            steps = 3e6 if pair is fm.Pair.DORMAND_PRINCE_5 and k == 0 else 1500  # grows by 7e-6 a step at 1.01
            assert is_refused(scene, 1.01 * limit * size, steps, method)
            assert not is_refused(scene, 0.99 * limit * size, steps, method)


@pytest.mark.parametrize("count", [1, 40])
def test_central_differences_are_refused_beyond_two_over_the_frequency(count):
    scene, _ = sliders(700.0, count=count)
    assert is_refused(scene, 1.01 * 2.0 / 700.0, 1500, CENTRAL)
    assert not is_refused(scene, 0.99 * 2.0 / 700.0, 1500, CENTRAL)


@pytest.mark.parametrize("corrected", [True, False])
def test_central_differences_with_dampers_grow_as_predicted(corrected):
    """What is refused grows when it is run, and what is not does not."""
    method = fm.CentralDifference(corrected=corrected)
    for rate, decay in ((0.0, 1.0), (1.0, 1.0), (1.0, 0.3)):
        scene, joint = sliders(rate, decay=decay)
        joint.velocity = 1e-3
        steps = np.linspace(0.61, 1.97, 35)
        refused = np.array([is_refused(scene, h, 3000, method) for h in steps])
        edge = steps[np.argmax(refused)]
        assert not refused[0]
        assert refused[steps >= edge].all()
        if not corrected:  # h^2 w^2 + 4 h c = 4
            assert edge == pytest.approx((2.0 / (decay + math.hypot(rate, decay))), rel=0.05)
        for h, grows in ((0.92 * edge, False), (1.02 * edge, True)):
            run = scene.simulate(25.0 * h, h=h, integrator=method)  # too short to be refused, long enough to tell
            speed = np.abs(run.beta_rate(joint)).ravel()
            assert (speed[-8:].max() > speed[-16:-8].max()) == grows


def test_the_step_that_is_named_is_stable_and_nearly_the_longest():
    scene, _ = sliders(5.0, decay=0.4)
    with pytest.raises(fm.SceneError) as refused:
        scene.simulate(2e3, h=0.9, integrator=fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4))
    h = float(str(refused.value).split("Take h = ")[1].split()[0])
    assert not is_refused(scene, h, 2e3 / h, fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4))
    assert is_refused(scene, 1.02 * h, 2e3 / h, fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4))


def test_what_grows_by_itself_is_not_refused():
    """An inverted pendulum falls over, by physics: exp(t (g/l)^(1/2)) is 1e9; beside what is nearly too fast."""
    scene = fm.System(gravity=(0, -9.81, 0))
    bob = scene.add(fm.RigidBody(1.0, (1e-9,) * 3, (0, 1.0, 0)))
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame())
    hinge.position = 1e-13
    fast = scene.add(fm.RigidBody(1.0, (1.0,) * 3))
    rail = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), fast.frame())
    scene.add_force(spring := fm.force.JointSpring(rail, 1.0))
    machine = scene.compile(parameters={"k": vary.OfForce(spring, "stiffness")})
    for method, reach in ((fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4), 2.8), (CENTRAL, 1.99)):
        with pytest.raises(fm.SceneError, match="beyond the stability"):
            machine.simulate(7.0, h=0.02, integrator=method, k=(1.1 * reach / 0.02) ** 2)
        run = machine.simulate(7.0, h=0.02, integrator=method, k=(reach / 0.02) ** 2)
        grown = run.beta(hinge).ravel()[-1] / 1e-13
        assert grown == pytest.approx(math.cosh(7.0 * math.sqrt(9.81)), rel=0.05)


def test_a_loop_counts_by_the_motions_that_it_leaves():
    """Two equal sliders that a loop holds together: the stiff spring between them moves nothing."""
    scene = fm.System()
    a, b = (scene.add(fm.RigidBody(1.0, (1.0,) * 3), name=name) for name in "ab")
    first = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), a.frame(), name="first")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), b.frame(), name="second")
    scene.connect(fm.joint.Fixed(), a.frame(), b.frame(), name="tie")
    scene.add_force(fm.force.JointSpring(first, 200.0))  # of both: 10 1/s
    limit = math.sqrt(8.0) / 10.0
    method = fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4)
    assert is_refused(scene, 1.01 * limit, 1500, method)
    assert not is_refused(scene, 0.99 * limit, 1500, method)


def stopped_slider(stiffness):
    """A slider that meets a stop, undamped, at 1 m/s."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0,) * 3))
    joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame(), name="rail")
    joint.velocity = 1.0
    scene.add_force(fm.force.JointStop(joint, lower=-0.1, upper=0.1, stiffness=stiffness, transition=1e-3))
    return scene, joint


def test_a_stop_that_is_met_on_the_way_is_told():
    """At its start nothing vibrates; within the stop 1000 1/s do."""
    for pair in (fm.Pair.DORMAND_PRINCE_5, fm.Pair.DORMAND_PRINCE_8):
        scene, joint = stopped_slider(1e6)
        with pytest.warns(fm.StepsWarning, match=r"'rail\.displacement'") as told:
            run = scene.simulate(2.0, h=4e-3, integrator=fm.ExplicitRungeKutta(pair))
        assert len(told) == 1
        assert abs(abs(run.beta_rate(joint).ravel()[-1]) - 1.0) > 0.1  # it is wrong indeed
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            run = scene.simulate(2.0, h=2e-4, integrator=fm.ExplicitRungeKutta(pair))
        assert abs(run.beta_rate(joint).ravel()[-1]) == pytest.approx(1.0, rel=1e-3)


def dropped_ball():
    """A ball that falls onto a floor on which it would vibrate by 10^4 1/s."""
    scene = fm.System(gravity=(0, 0, -9.81))
    ball = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="ball")
    joint = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame(), name="rail")
    joint.position = 0.2
    ground = fm.contact.HalfSpace(scene.ground.frame())
    scene.touch(ground, fm.contact.Sphere(ball.frame(), 0.1), fm.contact.PowerLaw(k=1e8))
    return scene, joint


@pytest.mark.parametrize(
    ("build", "long", "short"), [(dropped_ball, 1e-3, 1e-5), (lambda: stopped_slider(1e6), 4e-3, 2e-4)]
)
def test_what_is_met_on_the_way_is_told_by_impulses_too(build, long, short):
    """At its start nothing vibrates, and Moreau-Jean takes smooth contact as any force, at fixed steps."""
    scene, joint = build()
    with pytest.warns(fm.StepsWarning, match=r"beyond the stability .*'rail\.displacement'") as told:
        run = scene.simulate(0.5, h=long, integrator=fm.MoreauJean())
    assert len(told) == 1
    right = scene.simulate(0.5, rtol=1e-6)
    end = right.beta(joint).ravel()[-1]
    assert abs(run.beta(joint).ravel()[-1] - end) > 0.1 * abs(end)  # it is wrong indeed
    limit = float(str(told[0].message).split("Take h = ")[1].split()[0])
    assert short < limit < long
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = scene.simulate(0.5, h=short, integrator=fm.MoreauJean())
    assert run.beta(joint).ravel()[-1] == pytest.approx(end, abs=5e-4)


def test_what_is_met_on_the_way_is_told_of_runs_that_are_stepped():
    """Each call is a step, which knows nothing of the run's length."""
    scene, _ = dropped_ball()
    stepped = scene.stepper(h=1e-3, integrator=fm.MoreauJean())
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        for _ in range(300):
            stepped.step(1e-3)
    assert ["beyond the stability" in str(one.message) for one in told] == [True]


def beside_a_blow(scene):
    """A body strikes a hard floor by 200 m/s: its impulse is far more than what stops the ball."""
    fast = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="fast")
    rail = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(p=(5.0, 0.0, 0.0)), fast.frame())
    rail.position, rail.velocity = 0.3, -200.0
    scene.touch(fm.contact.HalfSpace(scene.ground.frame()), fm.contact.Sphere(fast.frame(), 0.1), fm.contact.Hard())


def under_a_sampled_law(scene):
    """No stretch of steps between two samples is long enough for a disturbance to grow."""
    push = fm.Signal("push")
    body = scene.add(fm.RigidBody(1.0, (1e-2,) * 3), name="pushed")
    rail = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=(0.0, 5.0, 0.0)), body.frame())
    scene.add_force(fm.force.JointForce(rail, push))
    scene.add_controller(lambda t, y: 0.0, period=1e-3, inputs=[push])


@pytest.mark.parametrize("what", [beside_a_blow, under_a_sampled_law])
def test_what_else_a_machine_does_hides_nothing_that_is_met(what):
    scene, _ = dropped_ball()
    what(scene)
    with pytest.warns(fm.StepsWarning, match=r"beyond the stability .*'rail\.displacement'"):
        scene.simulate(0.5, h=1e-3, integrator=fm.MoreauJean())


def test_variants_in_prepared_runs_are_refused_alike():
    scene, joint = sliders(1.0)
    scene.add_force(spring := fm.force.JointSpring(joint, 0.0))
    machine = scene.compile(parameters={"k": vary.OfForce(spring, "stiffness")})
    settings = {"h": 1.0, "integrator": fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4)}
    for k, refused in ((0.0, False), (6.5, False), (7.5, True), (1.0, False), (9.0, True)):  # 1 + k to 8
        if refused:
            with pytest.raises(fm.SceneError, match="beyond the stability"):
                machine.simulate(1e3, k=k, **settings)
        else:
            assert np.abs(machine.simulate(1e3, k=k, **settings).beta(joint)).max() < 1.1e-3


def test_a_unit_for_other_programs_is_refused_alike(tmp_path):
    scene, _ = sliders(1000.0)
    classical = fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4)
    with pytest.raises(fm.SceneError, match=r"Take h = 0\.00282 s"):
        fm.export.fmu_machine(scene, tmp_path / "slider.fmu", h=2.86e-3, integrator=classical, binary=False)
    assert not list(tmp_path.iterdir())
