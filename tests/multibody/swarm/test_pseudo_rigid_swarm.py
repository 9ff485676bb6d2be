"""Many free pseudo-rigid bodies: momenta, energy, and each body's own motion."""

import re
from pathlib import Path

import numpy as np
import pytest
from homogeneous_motion import motion, svk_stress

import flexmbd as fm
from flexmbd.errors import SceneError

GRAVITY = np.array([0.0, 0.5, -9.81])


def swarm(n, *, seed=0):
    """Boxes and ellipsoids lying askew, of several materials, deformed, spinning, vibrating."""
    rng = np.random.default_rng(seed)
    makers = (fm.Solid.box, fm.Solid.ellipsoid)
    straight = [makers[k % 2](rng.uniform(0.1, 0.3, 3), density=rng.uniform(500.0, 2000.0)) for k in range(n)]
    turns = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    solids = [
        fm.Solid(solid.mass, solid.volume, solid.com, R @ solid.second @ R.T)
        for solid, R in zip(straight, turns, strict=True)
    ]
    materials = [fm.StVenantKirchhoff(rng.uniform(0.5e5, 2e5), rng.uniform(0.0, 0.4)) for _ in range(n)]
    many = fm.PseudoRigidSwarm(solids, materials, r=rng.normal(size=(n, 3)), gravity=GRAVITY)
    many.v = rng.normal(size=(n, 3))
    many.F = many.F + 0.05 * rng.normal(size=(n, 3, 3))
    many.F_rate = 3.0 * rng.normal(size=(n, 3, 3))
    return many, solids, materials


def test_momenta_and_energy():
    """1000 steps, 37 bodies: momenta to round-off; energy to the square of the step, without drift."""
    errors = []
    for share in (0.1, 0.05):
        many, *_ = swarm(37)
        many.gravity = np.zeros(3)
        h, spans = share * many.stable_step(), []
        linear, angular, energy = many.linear_momentum(), many.angular_momentum(), many.energy().total
        for _ in range(100):
            many.step(h, 10)
            spans.append(many.energy().total / energy - 1.0)
        size = np.linalg.norm(angular, axis=1, keepdims=True)
        assert (abs(many.linear_momentum() - linear) < 1e-12 * np.linalg.norm(linear, axis=1, keepdims=True)).all()
        assert (abs(many.angular_momentum() - angular) < 1e-12 * size).all()
        errors.append(abs(np.array(spans)).max(axis=0))
        assert many.t == pytest.approx(1000 * h)
    first, second = np.max(errors[0]), np.max(errors[1])
    assert first < 0.02
    assert first / second == pytest.approx(4.0, rel=0.15)


def test_gravity_turns_nothing():
    """Centres fall by a parabola; the angular momentum changes by the weight's arm alone."""
    many, *_ = swarm(5)
    r, v, own = many.r, many.v, many.angular_momentum() - np.cross(many.r, many.linear_momentum())
    energy = many.energy()
    h = 0.1 * many.stable_step()
    many.step(h, 7)
    t = 7 * h
    assert many.r == pytest.approx(r + t * v + 0.5 * t * t * GRAVITY, abs=1e-15)
    assert many.angular_momentum() - np.cross(many.r, many.linear_momentum()) == pytest.approx(own, abs=1e-14)
    fall = many.energy().gravitational - energy.gravitational
    gained = 0.5 * many.mass * (np.sum(many.v**2, axis=1) - np.sum(v**2, axis=1))
    assert fall == pytest.approx(-gained, abs=1e-12 * many.mass.max() * 10.0)


def test_each_body_goes_its_own_way():
    """Against the matrix equation solved to 1e-12, and with order 2; 19 bodies do not fill a block."""
    errors = []
    for count in (200, 400):
        many, solids, materials = swarm(19, seed=2)
        F, rate = many.F, many.F_rate
        many.step(0.02 / count, count)
        exact = [
            motion(solid, lambda f, m=material: svk_stress(f, m), F[k], rate[k], np.array([0.0, 0.02]))[-1]
            for k, (solid, material) in enumerate(zip(solids, materials, strict=True))
        ]
        errors.append(abs(many.F - exact).max(axis=(1, 2)))
    assert errors[1].max() < 1e-4
    assert errors[0] / errors[1] == pytest.approx(np.full(19, 4.0), rel=0.05)
    R, U = many.polar()
    assert pytest.approx(many.F, abs=1e-14) == R @ U


def test_the_machine_agrees():
    """One body of a swarm, as a body of a machine."""
    solid, material = fm.Solid.ellipsoid((0.3, 0.2, 0.1), density=900.0), fm.StVenantKirchhoff(1e5, 0.25)
    U = np.diag([1.1, 0.95, 1.0])
    scene = fm.System(gravity=GRAVITY)
    body = scene.add(fm.PseudoRigidBody(solid, material, stretch=U))
    joint = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    joint.velocity = np.array([1.0, 0.0, 0.0, 2.0, 0.0, 4.0])
    eight = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
    run = scene.simulate(0.05, rtol=1e-10, integrator=eight)
    many = fm.PseudoRigidSwarm([solid], material, r=[[0.0, 0.0, 0.0]], gravity=GRAVITY)
    many.v, many.F = np.array([[1.0, 0.0, 0.0]]), U[None]
    many.F_rate = np.cross([2.0, 0.0, 4.0], U.T).T[None]
    many.step(0.05 / 4000, 4000)
    assert run.position(body.frame())[-1] == pytest.approx(many.r[0], abs=1e-12)
    assert run.deformation_gradient(body)[-1] == pytest.approx(many.F[0], abs=1e-6)
    energy = run.energy()
    assert energy.kinetic[0] + energy.elastic[0] == pytest.approx(many.energy().total[0], rel=1e-5)


def test_a_body_that_is_pressed_flat_is_named():
    many, *_ = swarm(40)
    many.F_rate = np.zeros((40, 3, 3))
    many.F_rate[33] = np.diag([-5000.0, 0.0, 0.0])
    before = many.F
    with pytest.raises(SceneError, match=r"body 33 of the swarm has det F = -.* from t = .* s on"):
        many.step(many.stable_step(), 3)
    assert many.F is before
    assert many.t == 0.0
    many.F_rate[33] = 0.0
    many.step(0.1 * many.stable_step())
    many.F[7] = -np.eye(3)
    with pytest.raises(SceneError, match="body 7 of the swarm has det F = -1"):
        many.step(1e-4)


SOLID, MATERIAL = fm.Solid.box((1.0, 1.0, 1.0), density=1.0), fm.StVenantKirchhoff(1.0, 0.0)


@pytest.mark.parametrize(
    ("solids", "materials", "r", "says"),
    [
        ([], MATERIAL, np.zeros((0, 3)), "a swarm of 0 solids"),
        ([SOLID] * 3, [MATERIAL] * 2, np.zeros((3, 3)), "3 solids and 2 materials"),
        ([SOLID] * 3, MATERIAL, np.zeros((2, 3)), r"r must be finite numbers of shape \(3, 3\), got shape \(2, 3\)"),
        ([SOLID], MATERIAL, [[0.0, np.nan, 0.0]], "r must be finite"),
    ],
)
def test_swarms_that_are_none(solids, materials, r, says):
    with pytest.raises(SceneError, match=says):
        fm.PseudoRigidSwarm(solids, materials, r=r)


@pytest.mark.parametrize("h", [0.0, -1.0, np.nan, np.inf])
def test_steps_that_are_none(h):
    many = fm.PseudoRigidSwarm([SOLID], MATERIAL, r=[[0.0, 0.0, 0.0]])
    with pytest.raises(SceneError, match="must be positive and finite"):
        many.step(h)
    with pytest.raises(SceneError, match="not negative"):
        many.step(1.0, -1)
    many.F_rate = np.zeros((1, 3))
    with pytest.raises(SceneError, match=r"F_rate must be finite numbers of shape \(1, 3, 3\)"):
        many.step(1.0)


def test_the_page_on_pseudo_rigid_bodies():
    """Its blocks without other energies run; the block hangs at its corner, and F = R U."""
    text = (Path(__file__).parents[3] / "docs" / "pseudo_rigid.md").read_text(encoding="utf-8")
    names = {}
    for block in re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        if "flexmbd.continuum" not in block:
            exec(compile(block, "pseudo_rigid.md", "exec"), names)
    assert pytest.approx(names["F"], abs=1e-13) == names["R"] @ names["U"]
    hook = names["run"].position(names["body"].frame((-0.15, 0.0, 0.0)))
    assert abs(hook).max() < 1e-8
    assert np.ptp(names["run"].energy().total) < 0.05 * np.ptp(names["run"].energy().gravitational)
    assert names["heap"].t > 0.0
