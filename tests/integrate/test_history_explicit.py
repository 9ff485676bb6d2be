"""Bodies with history by central differences: momentum, energy, stable steps, subcycles."""

from __future__ import annotations

import numpy as np
import pytest
from spring_interior import ExplicitSprings, as_continuum, chain
from spring_machines import pendulum

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.rotation import from_quaternion
from flexmbd.run.stopped import SimulationError

EXPLICIT = fm.CentralDifference()
TURN = from_quaternion(np.array([0.8, 0.0, 0.6, 0.0]))


def momenta(run, body, interior):
    """Linear and angular momentum about the origin at the end, frames and interior together."""
    linear = interior.masses @ interior.v
    angular = (interior.masses[:, None] * np.cross(interior.x, interior.v)).sum(axis=0)
    for frame, part in zip(interior.frames, body.parts, strict=True):
        marker = part.frame(frame.com)
        p, v = run.position(marker)[-1], run.velocity(marker)[-1]
        R, w = run.rotation(marker)[-1], run.angular_velocity(marker)[-1]
        linear = linear + frame.mass * v
        angular = angular + frame.mass * np.cross(p, v) + R @ frame.inertia @ R.T @ w
    return linear, angular


def flying(kind, **options):
    scene = fm.System()
    interior = chain(kind, 2, R=[TURN, np.eye(3)], **options)
    body, (a, _) = as_continuum(scene, interior)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), a)
    free.position = [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0]
    free.velocity = [1.0, -2.0, 0.5, 2.0, 6.0, -4.0]
    return scene, body, interior


@pytest.mark.parametrize("subcycle", [False, True])
def test_a_free_body_keeps_its_momentum(subcycle):
    """Linear momentum to round-off where frames lie at their centres of mass; angular momentum to the order."""
    method, errors = fm.CentralDifference(subcycle=subcycle), []
    for h in (4e-3, 2e-3, 1e-3):
        scene, body, interior = flying(ExplicitSprings, stiffness=2e3, limit=2.0, hardening=300.0, com=(0.0, 0.0, 0.0))
        interior.share = 0.3 if subcycle else 1.0
        start = scene.simulate(1e-9, h=1e-9, integrator=method)
        before = momenta(start, body, interior)
        run = scene.simulate(0.2, h=h, integrator=method)
        after = momenta(run, body, interior)
        assert run.energies(body)["plastic"][-1] > 1e-3
        np.testing.assert_allclose(after[0], before[0], rtol=0, atol=1e-12 * np.abs(before[0]).max())
        errors.append(np.abs(after[1] - before[1]).max() / np.abs(before[1]).max())
    assert errors[0] < 1e-2
    assert errors[1] < 0.35 * errors[0], errors
    assert errors[2] < 0.35 * errors[1], errors


def test_a_step_above_the_stable_one_is_refused_with_the_limit():
    interior = chain(ExplicitSprings, 2, stiffness=2e3)
    scene, *_ = pendulum(interior, False)
    scene.start()
    limit = interior.stable_step()
    with pytest.raises(SceneError, match=rf"above the stable step at t = 0 s of body 'lattice', {limit:.4g} s"):
        scene.simulate(0.1, h=1.01 * limit, integrator=EXPLICIT)
    run = scene.simulate(0.1, h=0.99 * limit, integrator=EXPLICIT)
    assert run.t[-1] == 0.1


def test_the_step_follows_the_body():
    """0.9 of the stable step, asked for anew as it stiffens half-way, where a given step becomes too long."""
    interior = chain(ExplicitSprings, 2, stiffness=2e3)
    scene, *_ = pendulum(interior, False)
    advance = ExplicitSprings.advance

    def stiffen(*args):
        interior.share = 0.5 if interior.t > 0.1 else 1.0
        return advance(interior, *args)

    interior.advance = stiffen
    run = scene.simulate(0.2, integrator=EXPLICIT)
    assert "step explicitly" in scene.explain()
    steps = np.diff(run.t)
    assert steps[:-1].min() < 0.6 * steps.max()
    scene.start()
    np.testing.assert_allclose(steps[0], 0.9 * 1.0 * interior.stable_step() / interior.share, rtol=1e-12)
    interior.share = 1.0
    with pytest.raises(SimulationError, match=r"stable step at t = 0\.1\d* s of body 'lattice'") as failure:
        scene.simulate(0.2, h=0.8 * interior.stable_step(), integrator=EXPLICIT)
    assert 0.1 < failure.value.trajectory.t[-1] < 0.2


def test_subcycles_converge_to_the_same_motion():
    """The machine's step some times the body's: second order all the same, against steps of the body's own size."""
    def run(h, **how):
        interior = chain(ExplicitSprings, 2, stiffness=2e3)
        interior.share = 0.2
        scene, frames, *_ = pendulum(interior, False)
        return scene.simulate(0.2, h=h, integrator=fm.CentralDifference(**how)).position(frames[1])[-1]

    fine = run(2e-4)
    errors = [np.abs(run(h, subcycle=True) - fine).max() for h in (8e-3, 4e-3)]
    assert errors[0] < 3e-3
    assert errors[1] < 0.4 * errors[0], errors


def test_the_energy_account_closes():
    """Machine and interior together, what was spent on slip included, to the method's order."""
    ranges = []
    for h in (2e-3, 1e-3):
        options = {"stiffness": 2e3, "limit": 15.0, "hardening": 200.0}
        scene, _, _, body = pendulum(chain(ExplicitSprings, 2, **options), False)
        run = scene.simulate(0.3, h=h, integrator=EXPLICIT)
        parts = run.energies(body)
        assert set(parts) == {"kinetic", "elastic", "plastic", "gravitational"}
        assert np.diff(parts["plastic"]).min() >= 0.0
        assert parts["plastic"][-1] > 0.5
        ranges.append(np.ptp(run.energy().total + sum(parts.values())))
    assert ranges[0] < 0.05
    assert ranges[1] < 0.4 * ranges[0], ranges


def test_two_bodies_in_a_machine_do_not_touch_each_other():
    """Each held at one end, of unlike stiffness: they move as they would alone."""

    def held(*springs):
        scene = fm.System(gravity=(0.0, 0.0, -9.81))
        ends = []
        for stiffness in springs:
            body = scene.add(fm.ContinuumBody(chain(ExplicitSprings, 1, stiffness=stiffness)), name=f"k = {stiffness}")
            root, end = (body.frame(frame.name) for frame in body.interior.frames)
            scene.connect(fm.joint.Fixed(), scene.ground.frame(), root)
            ends.append(end)
        run = scene.simulate(0.2, h=1e-3, integrator=EXPLICIT)
        return [run.position(end) for end in ends]

    soft, stiff = held(1e3, 4e3)
    assert np.abs(soft - stiff).max() > 0.02
    for together, k in ((soft, 1e3), (stiff, 4e3)):
        (alone,) = held(k)
        np.testing.assert_allclose(together, alone, rtol=0, atol=1e-12)
