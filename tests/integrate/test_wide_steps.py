"""Fixed steps that a machine's rates make wide: what they ask for is solved wherever it can be."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm

LINKS, LENGTH, MASS, INERTIA, GRAVITY = 10, 0.2, 0.8, 3e-3, 9.81
H, STEPS = 2e-3, 12


def whipping_chain(seed):
    """Links on hinges, each at an angle and a rate at random, of some 12 rad/s from link to link."""
    random = np.random.default_rng(seed)
    scene = fm.System(gravity=(0.0, -GRAVITY, 0.0))
    end = scene.ground.frame()
    for k in range(LINKS):
        body = fm.RigidBody(MASS, (INERTIA, INERTIA, INERTIA), (0.5 * LENGTH, 0.0, 0.0))
        link = scene.add(body, name=f"link {k}")
        hinge = scene.connect(fm.joint.Revolute("z"), end, link.frame())
        hinge.position, hinge.velocity = random.normal(), 12.0 * random.normal()
        end = link.frame(p=(LENGTH, 0.0, 0.0))
    return scene


class OwnChain:
    """The same chain by the links' angles from the x axis: its equations, and a step with Newton's full iteration."""

    def __init__(self, rho):
        k = np.arange(1, LINKS + 1)
        beyond = LINKS - np.maximum.outer(k, k) + 0.5  # masses that both links carry, over that of a link
        self.mass = MASS * LENGTH**2 * beyond
        self.mass[np.diag_indices(LINKS)] += INERTIA - 0.25 * MASS * LENGTH**2
        self.weight = MASS * LENGTH * GRAVITY * (LINKS - k + 0.5)
        self.alpha_m, self.alpha_f = (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0)
        self.gamma = 0.5 + self.alpha_f - self.alpha_m
        self.beta = 0.25 * (self.gamma + 0.5) ** 2

    def required(self, angle, rate, acceleration):
        """Moments (LINKS,) that are lacking."""
        apart = angle[:, None] - angle[None, :]
        forces = (self.mass * np.cos(apart)) @ acceleration + (self.mass * np.sin(apart)) @ rate**2
        return forces + self.weight * np.cos(angle)

    def tangent(self, angle, rate, acceleration, per_x, per_v):
        apart = angle[:, None] - angle[None, :]
        c, s = self.mass * np.cos(apart), self.mass * np.sin(apart)
        own = np.diag(c @ rate**2 - s @ acceleration - self.weight * np.sin(angle))
        return c + per_v * 2.0 * s * rate + per_x * (s * acceleration - c * rate**2 + own)

    def step(self, angle, rate, acceleration, auxiliary):
        """One of H from the last accelerations."""
        share = (1.0 - self.alpha_f) / (1.0 - self.alpha_m)
        new = acceleration.copy()
        for _ in range(10):
            known = self.alpha_f * acceleration - self.alpha_m * auxiliary
            ahead = share * new + known / (1.0 - self.alpha_m)
            at = angle + H * rate + H * H * ((0.5 - self.beta) * auxiliary + self.beta * ahead)
            then = rate + H * ((1.0 - self.gamma) * auxiliary + self.gamma * ahead)
            tangent = self.tangent(at, then, new, share * self.beta * H * H, share * self.gamma * H)
            new = new - np.linalg.solve(tangent, self.required(at, then, new))
        return at, then, new, ahead


@pytest.mark.parametrize("seed", [15, 30, 38])
def test_a_fixed_step_is_solved_where_old_factors_lead_nowhere(seed):
    """Newton with the factors of the predictor went astray there; with new ones at each iteration it converges."""
    run = whipping_chain(seed).simulate(STEPS * H, h=H, integrator=fm.GeneralizedAlpha(), checkpoints=[H])
    snapshot = run.checkpoints[0].snapshot
    chain = OwnChain(rho=0.8)
    now = [np.cumsum(part) for part in (run.x[1], run.v[1], run.a[1], snapshot.memory["remembered"][0])]
    assert np.abs(chain.required(*now[:3])).max() < 1e-6 * chain.weight.max()
    for row in range(2, STEPS + 1):
        now = chain.step(*now)
        np.testing.assert_allclose(run.x[row], np.diff(now[0], prepend=0.0), atol=1e-6)
        scale = np.abs(now[1]).max()
        np.testing.assert_allclose(run.v[row], np.diff(now[1], prepend=0.0), atol=1e-6 * scale)
