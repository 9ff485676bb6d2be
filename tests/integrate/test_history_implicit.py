"""Bodies with history by generalized-alpha: convergence, history, rejected steps, energy."""

from __future__ import annotations

import pickle
from itertools import pairwise

import numpy as np
import pytest
from spring_interior import ImplicitSprings, as_continuum, chain
from spring_machines import loop, pendulum

import flexmbd as fm
from flexmbd.errors import ConvergenceError
from flexmbd.integrate.alpha import interiors as alpha_interiors
from flexmbd.multibody.bodies.continuum_body import Scheme
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.run.stopped import SimulationError

IMPLICIT = fm.GeneralizedAlpha()


def newton_sizes(monkeypatch, scene, method, **how):
    """Corrections of Newton's iterations, step by step."""
    sizes = []
    iterate, set_out = alpha_interiors.newton_iteration, alpha_interiors.begin_step
    monkeypatch.setattr(
        alpha_interiors, "newton_iteration", lambda *args: (sizes[-1].append(iterate(*args)), sizes[-1][-1])[1]
    )
    monkeypatch.setattr(alpha_interiors, "begin_step", lambda *args: (sizes.append([]), set_out(*args))[1])
    run = scene.simulate(integrator=method, **how)
    return sizes, run


@pytest.mark.parametrize(("machine", "index"), [(pendulum, 2), (loop, 3)])
def test_newton_converges_quadratically(machine, index, monkeypatch):
    """Large steps, a hardening spring, large turns: each correction is at most some times the last one's square."""
    method = fm.GeneralizedAlpha(index=index)
    scene, *_ = machine(chain(ImplicitSprings, 2, stiffness=2e3, cubic=2e5), False)
    sizes, run = newton_sizes(monkeypatch, scene, method, t_end=0.4, h=0.02, rtol=1e-10)
    assert run.stats.rejected == 0
    pairs = [(a, b) for step in sizes for a, b in pairwise(step) if a < 0.1 and b > 1e-12]
    assert len(pairs) >= 20
    assert max(b / a**2 for a, b in pairs) < 20.0, pairs


def slip_bar():
    """A spring that slips, drawn to and fro between two frames: the force that it takes."""
    scene = fm.System()
    points = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    interior = ImplicitSprings(points, [0, 1], [(0, 1)], [0.0, 0.0], stiffness=1e4, limit=30.0, hardening=2e3)
    _, (a, b) = as_continuum(scene, interior)
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), a)
    amplitude, rate = 0.01, 2.0 * np.pi
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=(1.0, 0.0, 0.0)), b)
    slide.prescribe(fm.Sine(amplitude, rate))
    return scene, slide, interior


def returned(elongations, k, limit, hardening):
    """Forces of a spring that slips, point by point, by bisection of what it must fulfil: an independent way."""
    slip = slipped = 0.0
    forces = []
    for e in elongations:
        force = k * (e - slip)
        if abs(force) > limit + hardening * slipped:
            low, high = 0.0, abs(force) / k
            for _ in range(200):
                step = 0.5 * (low + high)
                beyond = abs(force) - k * step > limit + hardening * (slipped + step)
                low, high = (step, high) if beyond else (low, step)
            slip, slipped = slip + np.sign(force) * step, slipped + step
            force = k * (e - slip)
        forces.append(force)
    return np.array(forces)


def test_a_slipping_spring_follows_its_law():
    scene, slide, interior = slip_bar()
    run = scene.simulate(2.0, h=0.01, rtol=1e-10, integrator=IMPLICIT)
    e = run.beta(slide)
    want = returned(e[1:], 1e4, 30.0, 2e3)
    mass = interior.frames[1].mass
    inertia = mass * run.a[1:, run.scene.index.joints[slide].v.start]
    np.testing.assert_allclose(run.drive(slide)[1:] - inertia, want, atol=1e-6)
    assert np.ptp(want) > 60.0


class Failing(ImplicitSprings):
    """Fails in given trials, after a state was worked out and half kept; counts what is committed and reverted."""

    def fail_at(self, trials):
        self.failures, self.commits, self.reverts = set(trials), 0, 0
        return self

    def trial(self, t_end, h, scheme, motion):
        answer = super().trial(t_end, h, scheme, motion)
        if self.trials in self.failures:
            raise ConvergenceError("an element is inverted")
        return answer

    def commit(self):
        super().commit()
        self.commits += 1

    def revert(self):
        super().revert()
        self.reverts += 1


def test_rejected_steps_leave_no_trace():
    """Steps that fail or err too much are reverted; what is kept goes on as a run that begins there would."""
    options = {"stiffness": 2e3, "limit": 15.0, "hardening": 200.0}
    smooth, frames, *_ = pendulum(chain(ImplicitSprings, 1, **options), False)
    fine = smooth.simulate(0.1, rtol=1e-6, integrator=IMPLICIT)
    interior = chain(Failing, 1, **options).fail_at([7, 40, 41, 95])
    scene, others, *_ = pendulum(interior, False)
    run = scene.simulate(0.1, rtol=1e-5, integrator=IMPLICIT)
    assert run.stats.rejected == interior.reverts >= 4
    assert run.stats.steps == interior.commits
    np.testing.assert_allclose(run.position(others[1])[-1], fine.position(frames[1])[-1], atol=2e-4)
    # the same steps by hand, without a rejection among them
    again = chain(ImplicitSprings, 1, **options)
    replay(run, again, Scheme(*IMPLICIT.coefficients()))
    for name, kept in interior.snapshot().items():
        np.testing.assert_allclose(again.snapshot()[name], kept, rtol=1e-9, atol=1e-10, err_msg=name)


def replay(run, interior, scheme):
    """Take an interior along the frames of a trajectory."""
    plan = run.scene.plan
    work, rows = new_work(plan), zip(run.x, run.v, run.a, strict=True)
    motions = [run.scene.interiors.motions(plan, work, *row)[0] for row in rows]
    interior.begin(0.0, motions[0], plan.gravity)
    for k in range(1, len(run.t)):
        interior.trial(run.t[k], run.t[k] - run.t[k - 1], scheme, motions[k])
        interior.commit()


def test_a_fixed_step_that_fails_tells_and_keeps():
    interior = chain(Failing, 1, stiffness=2e3).fail_at([30])
    scene, *_ = pendulum(interior, False)
    with pytest.raises(SimulationError, match=r"body 'lattice' failed in the step from .* inverted") as it:
        scene.simulate(0.2, h=2e-3, integrator=IMPLICIT)
    trajectory = it.value.trajectory
    assert len(trajectory.t) > 8
    assert interior.t == trajectory.t[-1]
    assert isinstance(it.value.__cause__.__cause__, ConvergenceError)
    assert len(trajectory.energies(next(iter(trajectory.scene.interiors.bodies)))["kinetic"]) == len(trajectory.t)


def test_the_energy_account_closes():
    """Machine and interior together, what was spent on slip included, to the method's order."""
    ranges = []
    for h in (2e-3, 1e-3):
        options = {"stiffness": 2e3, "limit": 15.0, "hardening": 200.0}
        scene, _, _, body = pendulum(chain(ImplicitSprings, 2, **options), False)
        run = scene.simulate(0.3, h=h, integrator=fm.GeneralizedAlpha(rho=1.0))
        parts = run.energies(body)
        assert set(parts) == {"kinetic", "elastic", "plastic", "gravitational"}
        assert np.diff(parts["plastic"]).min() >= 0.0
        assert parts["plastic"][-1] > 0.5
        ranges.append(np.ptp(run.energy().total + sum(parts.values())))
    assert ranges[0] < 0.05
    assert ranges[1] < 0.4 * ranges[0], ranges


def test_the_plan_is_constant_but_for_the_wrenches_of_interiors():
    """A run writes to no array of the compiled scene but that one, which holds the last row's wrenches."""
    scene, *_ = pendulum(chain(ImplicitSprings, 2, stiffness=2e3), False)
    plan = scene.start().scene.plan
    before = {name: part.copy() for name, part in plan.fields().items()}
    run = scene.simulate(0.05, h=0.01, integrator=fm.GeneralizedAlpha())
    after = run.scene.plan.fields()
    changed = {name for name, part in before.items() if not np.array_equal(part, after[name])}
    assert changed == {"wrenches"}
    np.testing.assert_array_equal(after["wrenches"], run.interior_rows[-1].wrenches)
    for copied in (plan, plan.replace(data=plan.data.copy()), pickle.loads(pickle.dumps(plan))):
        with pytest.raises(ValueError, match="read-only"):
            copied.data[0] = 1.0
