"""Trees of parallel hinges, which have a recursion of their own, and rows by their paths through a tree."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_machine import mixed_scene
from random_trees import NOTHING, random_tree, somewhere
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.integrate.explicit import loop_dynamics
from flexmbd.multibody.kernels.algebra import rank_revealing
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.forward_dynamics.articulated import articulate, forward_dynamics, solve_mass
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.forward_dynamics.row_paths import new_row_paths, solve_rows
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.plan.scene_matrices import constraint_values, mass_matrix


@entry_kernel
def factor_semidefinite(matrix, order, scale):
    return rank_revealing.factor_semidefinite(matrix, order, scale)


@entry_kernel
def solve_semidefinite(matrix, rank, order, scale, rhs, scratch, out):
    rank_revealing.solve_semidefinite(matrix, rank, order, scale, rhs, scratch, out)


@entry_kernel
def respond(plan, work, aw, loops, rows, out):
    loop_dynamics.minimum_norm_motion(plan, work, aw, loops, loops.rank, rows, out)


def parallel_tree(seed, *, twisted=False):
    """Nine bodies on hinges about one direction, two of them on the ground; mass anywhere, two children somewhere."""
    rng = np.random.default_rng(seed)
    scene = fm.System(gravity=rng.standard_normal(3) * 9.0)
    bodies, hinges = [], []
    axis = rng.standard_normal(3)
    for k in range(9):
        lever = Rotation.random(random_state=seed + k).as_matrix()
        inertia = lever @ np.diag(rng.uniform(0.02, 0.03, 3)) @ lever.T
        body = scene.add(fm.RigidBody(rng.uniform(0.5, 2.0), inertia, tuple(rng.standard_normal(3) * 0.2)))
        parent = scene.ground if k in (0, 5) else bodies[{3: 1, 4: 1, 7: 6, 8: 6}.get(k, k - 1)]
        other = rng.standard_normal(3) if twisted and k == 3 else axis
        inner, outer = parent.frame(p=rng.standard_normal(3) * 0.3), body.frame(p=rng.standard_normal(3) * 0.3)
        hinges.append(scene.connect(fm.joint.Revolute(other), inner, outer))
        bodies.append(body)
    return scene, bodies, hinges


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("seed", [1, 2])
def test_parallel_hinges_solve_the_residual(seed, loaded):
    """Gravity out of the plane, products of inertia, mass beside the plane, torques, springs across the branches."""
    scene, bodies, hinges = parallel_tree(seed)
    if loaded:
        scene.add_force(fm.force.JointTorque(hinges[2], 1.7))
        scene.add_force(fm.force.JointSpring(hinges[4], 30.0, 0.2, 1.5))
        ends = bodies[3].frame(p=(0.1, 0.2, 0.3)), bodies[8].frame(p=(0.3, -0.1, 0.2))
        scene.add_force(fm.force.SpringDamper(*ends, stiffness=40.0, length=0.3, damping=2.0))
        scene.add_force(fm.force.SpringDamper(scene.ground.frame(), bodies[6].frame(p=(1, 0, 0)), 20.0, 0.2))
    compiled = scene.compile().scene
    plan = compiled.plan
    x, v, work = somewhere(compiled, seed)
    aw = new_articulated_work(plan)
    assert aw.planar[0] == 1
    a, out, ask = np.zeros((3, compiled.nv))
    forward_dynamics(plan, work, aw, x, v, a, NOTHING)
    residual(plan, work, x, v, a, NOTHING, out)
    residual(plan, work, x, v, 0 * a, NOTHING, ask)
    np.testing.assert_allclose(out, 0.0, atol=1e-12 * np.abs(ask).max())
    rhs, columns = np.eye(compiled.nv), np.full((compiled.nv, compiled.nv), np.nan)
    solve_mass(plan, work, aw, rhs, columns)
    np.testing.assert_allclose(columns @ mass_matrix(compiled, work, x), rhs, atol=1e-11)


def test_other_trees_are_not_taken_for_parallel():
    scene, _, hinges = parallel_tree(3, twisted=True)
    assert new_articulated_work(scene.compile().scene.plan).planar[0] == 0
    scene, _, hinges = parallel_tree(3)
    hinges[4].prescribe(fm.Sine(0.3, 1.7))
    assert new_articulated_work(scene.compile().scene.plan).planar[0] == 0


def coupled_tree(seed):
    """Rigid and flexible bodies on random joints, rods between two of them and the ground, a gear."""
    scene, bodies, clouds = random_tree(seed, driven=seed == 1)
    hinges = [c for c in scene._connections if isinstance(c.joint, fm.joint.Revolute)]
    scene.couple(fm.joint.Gear(hinges[0], hinges[-1], 0.4))
    tips = [b.frame("tip") for b in bodies if id(b) in clouds][:2]
    scene.connect(fm.joint.Distance(2.0), *tips)
    scene.connect(fm.joint.Distance(1.5), scene.ground.frame(), bodies[-1].frame())
    scene.connect(fm.joint.Spherical(), bodies[-1].frame(), bodies[2].frame("tip"))
    return scene


def grid():
    """Windows of hinged rods in a row and one above: loops that share rods."""
    scene, bodies, _ = parallel_tree(4)
    for pair in ((4, 7), (3, 8), (2, 6)):
        scene.connect(fm.joint.Revolute("z"), *(bodies[k].frame(p=(0.1 * k, 0.2, 0.0)) for k in pair))
    return scene


@pytest.mark.parametrize(
    "make",
    [lambda: mixed_scene()[0], lambda: coupled_tree(1), lambda: coupled_tree(2), grid],
    ids=["every joint", "coupled and driven", "coupled", "grid"],
)
def test_rows_by_their_paths(make):
    """C by the rates of the rows, C M^-1 C^T by the dense mass matrix, at a place where loops are open."""
    compiled = make().compile().scene
    plan, free = compiled.plan, compiled.plan.free
    x, v, work = somewhere(compiled, 7)
    m = len(plan.rows)
    assert m > 4
    aw, paths = new_articulated_work(plan), new_row_paths(plan)
    a = np.zeros(compiled.nv)
    for part in (paths.jacobian, paths.joint_force, paths.joint_acceleration):
        assert not part.any()
    matrix = mass_matrix(compiled, work, x)[np.ix_(free, free)]
    for factor in (
        lambda: articulate(plan, work, aw, x),
        lambda: forward_dynamics(plan, work, aw, x, v, a, NOTHING),
    ):
        factor()
        forward_kinematics(plan, work, x, v, a)
        small = np.full((m, m), np.nan)
        solve_rows(plan, work, aw, paths, small)
        for w in (v, np.cos(np.arange(compiled.nv))):
            rates = constraint_values(compiled, work, x, w)[1] - constraint_values(compiled, work, x, 0 * w)[1]
            np.testing.assert_allclose(paths.jacobian @ w, rates, atol=1e-12)
        rows = paths.jacobian[:, free]
        expected = rows @ np.linalg.solve(matrix, rows.T)
        np.testing.assert_allclose(np.tril(small), np.tril(expected), atol=1e-11 * np.abs(expected).max())


def test_respond_solves_the_loops():
    """What rows do to the machine, with the dense mass matrix."""
    compiled = grid().compile().scene
    plan = compiled.plan
    kept = plan.replace(rows=np.ascontiguousarray(plan.rows[[0, 1, 5, 6]]))  # those in the plane, of two hinges
    x, v, work = somewhere(compiled, 7)
    n, m = compiled.nv, len(kept.rows)
    memory = loop_dynamics.LoopMemory(np.ones(m), np.ones(1))
    loops, aw = loop_dynamics.new_loops(kept, memory, n), new_articulated_work(kept)
    articulate(kept, work, aw, x)
    forward_kinematics(kept, work, x, v, v)
    solve_rows(kept, work, aw, loops.paths, loops.row_factors)
    rank = factor_semidefinite(loops.row_factors, loops.row_order, loops.row_scale)
    rates = np.arange(1.0, m + 1.0)
    moved = np.zeros(n)
    loops.rank[0] = rank
    respond(kept, work, aw, loops, rates, moved)
    assert rank == m
    np.testing.assert_allclose(loops.paths.jacobian @ moved, rates, atol=1e-11)
    force = np.linalg.lstsq(loops.paths.jacobian.T, mass_matrix(compiled, work, x) @ moved, rcond=None)[0]
    np.testing.assert_allclose(loops.paths.jacobian.T @ force, mass_matrix(compiled, work, x) @ moved, atol=1e-10)


def test_sparse_factors_with_exchanges():
    """A matrix of blocks in a row whose pivots come in any order, one of them short of rank."""
    rng = np.random.default_rng(2)
    rows = np.zeros((9, 14))
    for k in range(9):
        rows[k, k : k + 3] = rng.standard_normal(3) * 10.0 ** rng.uniform(-1, 1)
    rows[5] = rows[4] - 2.0 * rows[3]
    matrix = rows @ rows.T
    factors, order = np.tril(matrix), np.zeros(9, np.int64)
    rank = factor_semidefinite(factors, order, np.ones(9))
    assert rank == 8
    lower = np.tril(factors)[:, :rank]
    np.testing.assert_allclose(lower @ lower.T, matrix[np.ix_(order, order)], atol=1e-11)
    rhs = matrix @ rng.standard_normal(9)
    out = np.zeros(9)
    solve_semidefinite(factors, rank, order, np.ones(9), rhs, np.zeros(9), out)
    np.testing.assert_allclose(matrix @ out, rhs, atol=1e-9)
