"""Forces between all pairs of a group: orbits in closed form, what is kept, the tangent, and what is refused."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.scene_file.reading import read_scene
from flexmbd.scene_file.scene_builder import build

SUN, YEAR, AU, G = 1.98847e30, 3.15576e7, 1.495978707e11, 6.6743e-11


@fm.compiled
def softened(t, data, a, b, r, rate, out):
    """Plummer's softened attraction, data: G and the length."""
    whole = np.sqrt(r * r + data[1] * data[1])
    out[0] = -data[0] * a[0] * b[0] * r / whole**3
    return -data[0] * a[0] * b[0] / whole


@fm.compiled
def elastic_balls(t, data, a, b, r, rate, out):
    """Balls of the radii a and b that press and damp each other, as long as they overlap."""
    deep = a[0] + b[0] - r
    if deep > 0.0:
        out[0] = data[0] * deep - data[1] * rate * deep


def group(places, velocities, masses, *, body=fm.PointMass):
    scene, bodies = fm.System(), []
    for place, velocity, mass in zip(places, velocities, masses, strict=True):
        one = scene.add(body(mass) if body is fm.PointMass else body(mass, (mass, mass, mass), (0.1, 0.2, -0.1)))
        joint = fm.joint.Translation() if body is fm.PointMass else fm.joint.Free()
        flight = scene.connect(joint, scene.ground.frame(), one.frame())
        turned = () if body is fm.PointMass else (1.0, 0.0, 0.0, 0.0)
        flight.position, flight.velocity = (*place, *turned), (*velocity, *(0.1,) * (3 * bool(turned)))
        bodies.append(one)
    return scene, bodies


def test_keplers_ellipse_in_metres_and_kilograms():
    """A comet at its perihelion, after 0.3 years, by Kepler's equation."""
    a, e = 1.7 * AU, 0.6
    mass = 1e25
    mu = G * (SUN + mass)
    speed = np.sqrt(mu / a * (1 + e) / (1 - e))
    share = mass / (SUN + mass)
    x, v = np.array([a * (1 - e), 0, 0]), np.array([0, speed, 0])
    scene, (sun, comet) = group([-share * x, (1 - share) * x], [-share * v, (1 - share) * v], [SUN, mass])
    scene.add_force(fm.force.Gravitation([sun, comet]))
    t = 0.3 * YEAR
    run = scene.simulate(t, rtol=1e-10)
    anomaly = brentq(lambda E: E - e * np.sin(E) - np.sqrt(mu / a**3) * t, 0.0, 10.0, xtol=1e-14)
    place = a * np.array([np.cos(anomaly) - e, np.sqrt(1 - e**2) * np.sin(anomaly), 0.0])
    found = run.position(comet.frame())[-1] - run.position(sun.frame())[-1]
    assert np.linalg.norm(found - place) < 1e-8 * a
    assert run.stats.steps < 200


FIGURE_EIGHT = (
    np.array([[0.97000436, -0.24308753, 0], [-0.97000436, 0.24308753, 0], [0, 0, 0]]),
    np.array([[0.466203685, 0.43236573, 0], [0.466203685, 0.43236573, 0], [-0.93240737, -0.86473146, 0]]),
)


@pytest.mark.parametrize(
    ("method", "error"),
    [
        (fm.ExplicitRungeKutta(), 1e-5),
        (fm.RadauIIA(), 1e-5),
        (fm.GeneralizedAlpha(), 1e-3),
        (fm.EnergyMomentum(), 1e-3),
    ],
    ids=lambda one: type(one).__name__,
)
def test_three_bodies_go_round_a_figure_of_eight(method, error):
    """Chenciner & Montgomery 2000: after the period 6.32591398 all are where they were."""
    scene, bodies = group(*FIGURE_EIGHT, [1.0, 1.0, 1.0])
    scene.add_force(fm.force.Gravitation(bodies, G=1.0))
    run = scene.simulate(6.32591398, integrator=method, rtol=1e-7)
    back = [run.position(one.frame())[-1] for one in bodies]
    assert np.abs(back - FIGURE_EIGHT[0]).max() < error
    momentum, energy = run.momentum(), run.energy().total
    assert np.abs(momentum.linear).max() < 1e-8
    if isinstance(method, fm.EnergyMomentum):
        assert np.ptp(energy) < 1e-11 * abs(energy[0])
        assert np.abs(momentum.angular - momentum.angular[0]).max() < 1e-11


@pytest.mark.parametrize("body", [fm.PointMass, fm.RigidBody], ids=["points", "rigid"])
def test_lagranges_triangle_turns_as_a_whole(body):
    """Equal sides of unequal masses: omega^2 = G (m1 + m2 + m3) / side^3."""
    masses, side = np.array([1.0, 2.0, 3.5]), 4.0
    corners = side * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0]])
    corners -= masses @ corners / masses.sum()
    omega = np.sqrt(masses.sum() / side**3)
    scene, bodies = group(corners, np.cross([0, 0, omega], corners), masses)
    if body is fm.RigidBody:
        scene, bodies = group(corners - [0.1, 0.2, -0.1], np.zeros((3, 3)), masses, body=body)
        for joint, corner in zip(scene._connections, corners, strict=True):
            joint.velocity = (*np.cross([0, 0, omega], corner), 0.0, 0.0, 0.0)
    scene.add_force(fm.force.Gravitation(bodies, G=1.0))
    period = 2 * np.pi / omega
    run = scene.simulate(period / 3, rtol=1e-9)
    turn = np.array([[-0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), -0.5, 0], [0, 0, 1]])
    for one, corner in zip(bodies, corners, strict=True):
        found = run.position(one.frame(p=one.com))[-1]
        assert np.abs(found - turn @ corner).max() < 1e-6


def test_a_law_of_ones_own_is_what_scipy_integrates():
    rng = np.random.default_rng(3)
    n, data = 6, (0.7, 0.4)
    x, v, m = rng.normal(size=(n, 3)), 0.3 * rng.normal(size=(n, 3)), rng.uniform(0.5, 2.0, n)

    def rates(t, state):
        place, speed = state.reshape(2, n, 3)
        d = place[None] - place[:, None]
        whole = np.sqrt((d**2).sum(axis=2) + data[1] ** 2)
        pulls = data[0] * m[None, :, None] * d / whole[..., None] ** 3
        return np.concatenate([speed.ravel(), pulls.sum(axis=1).ravel()])

    expected = solve_ivp(rates, (0, 2.0), np.concatenate([x.ravel(), v.ravel()]), rtol=1e-11, atol=1e-12).y[:, -1]
    scene, bodies = group(x, v, m)
    scene.add_force(fm.force.BetweenPairs([one.frame() for one in bodies], softened, own=m, data=data))
    run = scene.simulate(2.0, rtol=1e-10)
    found = np.array([run.position(one.frame())[-1] for one in bodies])
    np.testing.assert_allclose(found.ravel(), expected[: 3 * n], atol=1e-7)
    momentum = run.momentum()
    assert np.abs(momentum.linear - momentum.linear[0]).max() < 1e-13
    assert np.ptp(run.energy().total) < 1e-8 * abs(run.energy().total[0])


def test_two_balls_bounce_with_the_momentum_that_they_had():
    scene, balls = group([[0, 0, 0], [1.0, 0.1, 0]], [[1.0, 0, 0], [-1.0, 0, 0]], [1.0, 2.0])
    frames = [ball.frame() for ball in balls]
    scene.add_force(fm.force.BetweenPairs(frames, elastic_balls, own=[[0.2], [0.2]], data=(2000.0, 100.0)))
    run = scene.simulate(1.0, rtol=1e-7, max_step=1e-2)
    momentum = run.momentum()
    assert np.abs(momentum.linear - momentum.linear[0]).max() < 1e-10
    assert np.abs(momentum.angular - momentum.angular[0]).max() < 1e-6
    kinetic = run.energy().kinetic
    assert 0.05 * kinetic[0] < kinetic[-1] < 0.95 * kinetic[0]


def machine(*, law):
    """A hinged arm, a rigid body that flies on it, a point on a rail and the ground, attracting each other."""
    scene = fm.System(gravity=(0.2, -1.0, 0.4))
    arm = scene.add(fm.RigidBody(1.3, (0.02, 0.03, 0.04), (0.2, 0.1, 0.0)))
    kite = scene.add(fm.RigidBody(0.7, (0.02, 0.03, 0.04), (0.1, 0.3, -0.1)))
    bead = scene.add(fm.PointMass(0.5))
    scene.connect(fm.joint.Universal("z", "y"), scene.ground.frame(), arm.frame())
    scene.connect(fm.joint.Free(), arm.frame(p=(0.7, 0.0, 0.2)), kite.frame())
    scene.connect(fm.joint.Prismatic((1.0, 2.0, 0.5)), scene.ground.frame(p=(0.3, -0.5, 0.9)), bead.frame())
    if law is None:
        scene.add_force(fm.force.Gravitation([arm, kite, bead], G=3.0))
    else:
        frames = [arm.frame(p=(0.4, 0.1, 0.2)), kite.frame(p=(0.1, 0.0, 0.3)), bead.frame()]
        frames.append(scene.ground.frame(p=(1.0, 1.0, 1.0)))
        scene.add_force(fm.force.BetweenPairs(frames, law, own=[1.0, 2.0, 1.5, 0.7], data=(2.0, 0.3)))
    return scene.compile().scene


@fm.compiled
def dragging(t, data, a, b, r, rate, out):
    out[0] = -data[0] * a[0] * b[0] * r - data[1] * rate * (1.0 + r)


@pytest.mark.parametrize("law", [None, softened, dragging], ids=["gravitation", "softened", "dragging"])
def test_the_tangent_is_the_derivative_of_the_residual(law):
    scene = machine(law=law)
    rng = np.random.default_rng(5)
    x, v, a = scene.start.copy(), rng.normal(size=scene.nv), rng.normal(size=scene.nv)
    start = scene.start.copy()
    retract(scene.plan, start, 0.4 * rng.normal(size=scene.nv), x)
    work, out = new_work(scene.plan), np.zeros(scene.nv)
    sizes = np.ones((2, scene.nv))
    tw = new_tangent_work(scene.plan, scene.nv, sizes=sizes)
    none = np.zeros(0)

    def at(move, quicker):
        moved = x.copy()
        retract(scene.plan, x, move, moved)
        residual(scene.plan, work, moved, v + quicker, a, none, out)
        return out.copy()

    for per_x, per_v in ((1.0, 0.0), (0.0, 1.0), (0.6, 1.7)):
        matrix = np.zeros((scene.nv, scene.nv))
        tangent(scene.plan, work, tw, x, v, a, none, per_x, per_v, 0.0, matrix)
        h = 1e-5
        for k, unit in enumerate(np.eye(scene.nv)):
            slope = (at(h * per_x * unit, h * per_v * unit) - at(-h * per_x * unit, -h * per_v * unit)) / (2 * h)
            assert np.abs(matrix[:, k] - slope).max() < 1e-6 * max(1.0, np.abs(matrix).max())


def test_variants_attract_by_the_masses_that_they_have():
    def last(mass, *, anew):
        scene, bodies = group([[0, 0, 0], [1.0, 0, 0]], [[0, 0, 0], [0, 0.5, 0]], [mass if anew else 1.0, 2.0])
        scene.add_force(fm.force.Gravitation(bodies, G=1.0))
        if anew:
            return scene.simulate(0.4, rtol=1e-9).position(bodies[1].frame())[-1]
        machine = scene.compile(parameters={"m": fm.parameter.Mass(bodies[0])})
        return machine.simulate(0.4, rtol=1e-9, m=mass).position(bodies[1].frame())[-1]

    np.testing.assert_array_equal(last(3.0, anew=False), last(3.0, anew=True))
    assert np.abs(last(3.0, anew=True) - last(1.0, anew=True)).max() > 0.05


def test_a_variant_of_the_constant_and_of_what_is_fixed():
    scene, bodies = group([[0, 0, 0], [1.0, 0, 0]], [[0, 0, 0], [0, 0.5, 0]], [1.0, 2.0], body=fm.RigidBody)
    pull = scene.add_force(fm.force.Gravitation(bodies, G=1.0))
    machine = scene.compile(parameters={"G": fm.parameter.OfForce(pull, "G")})
    strong, weak = (machine.simulate(0.3, G=value).position(bodies[0].frame())[-1, 0] for value in (2.0, 0.1))
    assert strong > weak
    with pytest.raises(SceneError, match="no argument 'bodies'"):
        scene.compile(parameters={"b": fm.parameter.OfForce(pull, "bodies")})
    with pytest.raises(SceneError, match="acts at its centre of mass"):
        scene.compile(parameters={"c": fm.parameter.CentreOfMass(bodies[0])})


@fm.compiled
def wrong_energy(t, data, a, b, r, rate, out):
    out[0] = -1.0 / r**2
    return -1.0 / r**2


def test_what_is_no_group_and_no_law_is_refused():
    scene, bodies = group([[0, 0, 0], [1.0, 0, 0], [1.0, 0.0, 0.0]], np.zeros((3, 3)), [1.0, 1.0, 1.0])
    frames = [one.frame() for one in bodies]
    for wrong, text in (
        (lambda: fm.force.Gravitation(bodies[:1]), "two or more"),
        (lambda: fm.force.Gravitation([bodies[0], bodies[0]]), "twice"),
        (lambda: fm.force.Gravitation(frames), "PointMass"),
        (lambda: fm.force.Gravitation(bodies, G=0.0), "positive"),
        (lambda: fm.force.BetweenPairs(bodies, softened), "frames"),
        (lambda: fm.force.BetweenPairs(frames, softened, own=[1.0, 2.0]), "each of the 3"),
        (lambda: fm.force.BetweenPairs(frames, lambda *_: 0.0), "flexmbd.compiled"),
        (lambda: fm.force.BetweenPairs(frames, fm.compiled(lambda t: t)), "flexmbd.compiled"),
        (lambda: fm.force.BetweenPairs(frames, softened, own=[1.0, 2.0, np.nan]), "finite"),
    ):
        with pytest.raises(SceneError, match=text):
            wrong()
    meeting = scene.add_force(fm.force.Gravitation(bodies))
    with pytest.raises(SceneError, match="body 2 and body 3 meet"):
        scene.start()
    scene._forces.remove(meeting)
    scene.add_force(fm.force.BetweenPairs(frames[:2], wrong_energy))
    with pytest.raises(SceneError, match=r"body 1 and body 2.*is not that of the energy"):
        scene.start()


def test_a_scene_file_has_groups(tmp_path):
    (tmp_path / "laws.py").write_text(
        "import numpy as np\nimport flexmbd as fm\n@fm.compiled\ndef soft(t, data, a, b, r, rate, out):\n"
        "    out[0] = -data[0] * a[0] * b[0] * r\n    return 0.5 * data[0] * a[0] * b[0] * r * r\n"
    )
    path = tmp_path / "stars.toml"
    stars = "".join(
        f'[[body]]\nname = "s{i}"\npoint = true\nmass = {i + 1}\n'
        f'[[joint]]\nname = "j{i}"\nkind = "translation"\nchild = "s{i}"\nposition = [{i}, 0, 0]\n'
        for i in range(2)
    )
    path.write_text(
        stars + '[[force]]\nkind = "gravitation"\nbodies = ["s0", "s1"]\nG = 2\n'
        '[[force]]\nkind = "between_pairs"\ngroup = ["s0", "s1"]\nlaw = "laws.py:soft"\nown = [[1.0], [3.0]]\n'
        "data = [0.5]\n[simulate]\nt_end = 0.1\n"
    )
    built = build(read_scene(path))
    start = built.system.start()
    np.testing.assert_allclose(start.a[[0, 3]], [4.0 + 1.5, -(4.0 + 1.5) / 2], rtol=1e-12)
