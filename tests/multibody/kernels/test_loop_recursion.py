"""Loops eliminated with the bodies, against dense matrices and against rows by their paths."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.integrate.explicit.loop_dynamics import new_loop_memory, new_loops
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.forward_dynamics import loop_layout
from flexmbd.multibody.kernels.forward_dynamics.loop_layout import new_loop_recursion
from flexmbd.multibody.kernels.forward_dynamics.loop_recursion import factor_loops
from flexmbd.multibody.kernels.forward_dynamics.loop_solution import rows_times, solve_loops
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work


@pytest.fixture
def always(monkeypatch):
    monkeypatch.setattr(loop_layout, "_most_operations", lambda plan: np.inf)


def ladder(windows: int) -> fm.System:
    """Windows of three bars each, one hanging from the other."""
    return tilted_ladder(windows, 0.3, 0.0)[0]


def tilted_ladder(windows: int, angle: float, rate: float) -> tuple[fm.System, Connection]:
    """A ladder and its first hinge, which stands at an angle (rad) and turns at a rate (rad/s)."""
    scene, hinge = fm.System(gravity=(0.0, -9.81, 0.0)), fm.joint.Revolute("z")
    left, right = scene.ground.frame(), scene.ground.frame(p=(1.0, 0.0, 0.0))
    inertia, hinges = (0.1, 0.1, 0.1), []
    for k in range(windows):
        rail = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"rail {k}")
        rung = scene.add(fm.RigidBody(1.0, inertia, (0.5, 0.0, 0.0)), name=f"rung {k}")
        other = scene.add(fm.RigidBody(1.0, inertia, (0.0, -0.5, 0.0)), name=f"other rail {k}")
        hinges.append(scene.connect(hinge, left, rail.frame()))
        scene.connect(hinge, rail.frame(p=(0.0, -1.0, 0.0)), rung.frame())
        scene.connect(hinge, rung.frame(p=(1.0, 0.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0)))
        scene.connect(hinge, right, other.frame())
        left, right = rail.frame(p=(0.0, -1.0, 0.0)), other.frame(p=(0.0, -1.0, 0.0))
    hinges[0].position, hinges[0].velocity = angle, rate
    return scene, hinges[0]


JOINTS = (fm.joint.Revolute("z"), fm.joint.Spherical(), fm.joint.Universal(), fm.joint.Cylindrical("y"))


def tree_with_loops(seed: int) -> fm.System:
    """Twelve bodies on random joints, the first prescribed, and five distances held between random places of them."""
    rng = np.random.default_rng(seed)
    scene = fm.System(gravity=(0.5, -9.81, 1.0))
    bodies = []
    for k in range(12):
        carrier = bodies[rng.integers(max(0, k - 3), k)] if k else scene.ground
        body = scene.add(fm.RigidBody(rng.uniform(0.5, 2.0), (0.3, 0.4, 0.5), rng.normal(size=3) * 0.3), name=f"b{k}")
        kind = JOINTS[rng.integers(len(JOINTS))] if k else fm.joint.Prismatic("x")
        joint = scene.connect(kind, carrier.frame(p=rng.normal(size=3)), body.frame(p=rng.normal(size=3) * 0.2))
        if k == 0:
            joint.prescribe(fm.Sine(0.2, 3.0))
        bodies.append(body)
    for _ in range(5):
        one, other = rng.choice(12, 2, replace=False)
        ends = bodies[one].frame(p=rng.normal(size=3)), bodies[other].frame(p=rng.normal(size=3))
        scene.connect(fm.joint.Distance(1.5), *ends)
    scene.connect(fm.joint.Distance(1.5), scene.ground.frame(p=(3.0, 2.0, 1.0)), bodies[11].frame(p=(0.3, 0.0, 0.0)))
    return scene


@pytest.mark.parametrize("build", [lambda: ladder(5), *(lambda seed=seed: tree_with_loops(seed) for seed in range(8))])
def test_it_solves_the_dense_equations(build, always):
    compiled = build().compile().scene
    plan, nv, m = compiled.plan, compiled.nv, len(compiled.plan.rows)
    work, rng = new_work(plan), np.random.default_rng(1)
    evaluate_times(plan, 0.3, work.time)
    rest, matrix = np.zeros(nv), np.zeros((nv, nv))
    tw = new_tangent_work(plan, nv, sizes=np.ones((2, nv)))
    tangent(plan, work, tw, compiled.start, rest, rest, np.zeros(m), 0.0, 0.0, 1.0, matrix)
    forward_kinematics(plan, work, compiled.start, rest, rest)
    mass, slopes = matrix[np.ix_(plan.free, plan.free)], tw.jacobian[:, plan.free]
    rows, motion, nu, product = slopes @ rng.normal(size=len(plan.free)), np.zeros(nv), np.zeros(m), np.zeros(m)
    response = np.linalg.solve(mass, slopes.T)
    expected = response @ np.linalg.pinv(slopes @ response, rcond=1e-11) @ rows
    recursion = new_loop_recursion(plan)
    groups = len(np.unique(recursion.ending)) - 1
    rank = np.zeros(groups, np.int64)
    factor_loops(plan, work, recursion, np.zeros(m), np.zeros(groups), np.zeros(m), rank)
    assert rank.sum() == np.linalg.matrix_rank(slopes, tol=1e-9)
    solve_loops(plan, recursion, rank, rows, motion, nu)
    np.testing.assert_allclose(motion[plan.free], expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_allclose(response @ nu, expected, rtol=0.0, atol=1e-8 * np.abs(expected).max())
    np.testing.assert_array_equal(motion[plan.driven[:, 0]], 0.0)
    vector = rng.normal(size=nv)
    rows_times(plan, recursion, vector, product)
    np.testing.assert_allclose(product, tw.jacobian @ vector, rtol=0.0, atol=1e-12 * np.abs(vector).sum())


def test_a_ladder_moves_as_by_the_paths_of_its_rows(monkeypatch):
    runs = []
    for operations in (0.0, np.inf):
        monkeypatch.setattr(loop_layout, "_most_operations", lambda plan, found=operations: found)
        runs.append(ladder(6).simulate(0.5, h=2e-3, integrator=fm.ExplicitRungeKutta()))
    np.testing.assert_allclose(runs[1].x, runs[0].x, rtol=0.0, atol=1e-12)


def test_a_window_passes_positions_where_it_lies_flat(always):
    """A window of equal bars swings through: the energy stays, though the rows lose rank at the flat position."""
    scene, hinge = tilted_ladder(1, 0.1, 9.0)
    run = scene.simulate(2.0, rtol=1e-8)
    total = run.energy().total
    assert np.ptp(run.beta(hinge)) > 2.0 * np.pi
    np.testing.assert_allclose(total, total[0], rtol=0.0, atol=1e-5 * abs(run.energy().kinetic).max())


def test_it_serves_long_ladders_and_not_short_ones():
    def serves(windows: int) -> bool:
        plan = ladder(windows).compile().scene.plan
        return len(new_loops(plan, new_loop_memory(plan), len(plan.free)).recursion.order) > 0

    assert serves(40)
    assert not serves(8)
