"""Forward dynamics in O(bodies) against the residual, and its factors against masses of particles."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_machine import along, mixed_scene, particle_positions, rigid_cloud
from particles import particle_body
from random_trees import NOTHING, random_tree, somewhere
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.forward_dynamics.articulated import articulate, forward_dynamics, solve_mass
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual


def dense_mass(compiled, bodies, clouds, x):
    """M by differences of the particles' places: it knows nothing of any recursion but poses."""
    mass = np.concatenate([clouds[id(b)].mass if id(b) in clouds else rigid_cloud(b)[0] for b in bodies])
    arms = np.zeros((compiled.nv, len(mass), 3))
    for j, unit in enumerate(np.eye(compiled.nv)):
        for k, w in ((1, 0.75), (2, -0.15), (3, 1.0 / 60.0)):
            for sign in (-1.0, 1.0):
                place = along(compiled, x, unit, 0 * unit, sign * k * 2e-3)
                arms[j] += sign * w / 2e-3 * particle_positions(compiled, bodies, clouds, place)
    return np.einsum("jka,k,lka->jl", arms, mass, arms)


@pytest.mark.parametrize("seed", range(6))
def test_forward_dynamics_solve_the_residual(seed):
    """Random trees, driven joints among them: at its accelerations nothing is left of the residual."""
    scene, *_ = random_tree(seed)
    compiled = scene.compile().scene
    plan, free = compiled.plan, compiled.plan.free
    x, v, work = somewhere(compiled, seed)
    a, out, ask = np.zeros((3, compiled.nv))
    forward_dynamics(plan, work, new_articulated_work(plan), x, v, a, NOTHING)
    residual(plan, work, x, v, a, NOTHING, out)
    residual(plan, work, x, v, 0 * a, NOTHING, ask)
    np.testing.assert_allclose(out[free], 0.0, atol=1e-12 * np.abs(ask).max())
    times = plan.driven[:, 2]
    np.testing.assert_array_equal(a[plan.driven[:, 0]], work.time[times, 2])


@pytest.mark.parametrize("kind", [{}, {"rotors": True}, {"nonlinear": True}])
def test_reactions_of_loops_are_loads(kind):
    """Every joint kind, three loops with multipliers, flexible frames on both sides of some, rotors inside bodies."""
    scene, *_ = mixed_scene(**kind)
    compiled = scene.compile().scene
    plan = compiled.plan
    x, v, work = somewhere(compiled, 5)
    multipliers = np.random.default_rng(5).standard_normal(len(plan.rows)) * 3.0
    a, out = np.zeros((2, compiled.nv))
    forward_dynamics(plan, work, new_articulated_work(plan), x, v, a, multipliers)
    residual(plan, work, x, v, a, multipliers, out)
    np.testing.assert_allclose(out, 0.0, atol=2e-12)


@pytest.mark.parametrize("seed", [1, 2])
def test_factors_solve_the_mass_of_particles(seed):
    scene, bodies, clouds = random_tree(seed)
    compiled = scene.compile().scene
    plan, free = compiled.plan, compiled.plan.free
    assert len(plan.driven) == 1
    x, v, work = somewhere(compiled, seed)
    matrix = dense_mass(compiled, bodies, clouds, x)
    rng = np.random.default_rng(seed)
    rhs = rng.standard_normal((4, compiled.nv))
    aw = new_articulated_work(plan)
    a = np.zeros(compiled.nv)
    expected = np.zeros_like(rhs)
    expected[:, free] = np.linalg.solve(matrix[np.ix_(free, free)], rhs[:, free].T).T
    for factor in (
        lambda: articulate(plan, work, aw, x),
        lambda: forward_dynamics(plan, work, aw, x, v, a, NOTHING),
    ):
        factor()
        out = np.full_like(rhs, np.nan)
        solve_mass(plan, work, aw, rhs, out)
        # the differences hold about 10 digits, of which the condition of M takes some
        tolerance = 1e-12 * np.linalg.cond(matrix) * np.abs(expected).max()
        assert tolerance < 1e-7
        np.testing.assert_allclose(out, expected, atol=tolerance)


@pytest.mark.parametrize("spread", [0.0, 1e-9, 1e-6, 1e-3, 0.4])
@pytest.mark.parametrize("kind", [fm.joint.Revolute, fm.joint.Prismatic, None], ids=["hinges", "slides", "balls"])
def test_what_a_joint_frees_is_told_from_round_off(kind, spread):
    """On a deforming frame a hinge's axis is a little off the body's: its share of the inertia is small, not zero."""
    scene = fm.System(gravity=(1.0, 0.0, -9.81))
    frame = scene.ground.frame()
    for k in range(4):
        body = scene.add(fm.FlexibleBody(particle_body(k, modes=5).record))
        scene.connect(kind("y") if kind else fm.joint.Spherical(), frame, body.frame("root"))
        frame = body.frame("tip")
    rod = scene.add(fm.RigidBody(1.0, (1e-9, 0.02, 0.02), (0.0, 0.0, 0.0)))
    scene.connect(kind("y") if kind else fm.joint.Fixed(), frame, rod.frame())
    compiled = scene.compile().scene
    plan = compiled.plan
    for seed in range(5):
        x, v, work = somewhere(compiled, seed, spread=spread)
        a, out, ask = np.zeros((3, compiled.nv))
        forward_dynamics(plan, work, new_articulated_work(plan), x, v, a, NOTHING)
        residual(plan, work, x, v, a, NOTHING, out)
        residual(plan, work, x, v, 0 * a, NOTHING, ask)
        np.testing.assert_allclose(out, 0.0, atol=1e-12 * np.abs(ask).max())


def test_massless_links_pass_everything_on():
    """A universal joint, a cylindrical and a planar one as chains of links that have no mass."""
    joint = fm.joint
    scene = fm.System(gravity=(1.0, -2.0, 9.0))
    turn = Rotation.from_rotvec([0.4, 0.2, -0.3]).as_matrix()
    chains = [
        [joint.Revolute("x"), joint.Revolute("y")],
        [joint.Prismatic("z"), joint.Revolute("z")],
        [joint.Prismatic("x"), joint.Prismatic("y"), joint.Revolute("z")],
    ]
    body, light = scene.ground, []
    for chain in chains:
        for number, kind in enumerate(chain):
            last = number == len(chain) - 1
            new = scene.add(fm.RigidBody(1.5, np.diag([0.02, 0.03, 0.04]), (0.1, 0.2, 0.0)))
            place = [0.3, 0.1, -0.2] if number == 0 else [0.0, 0.0, 0.0]
            scene.connect(kind, body.frame(p=place, R=turn if number == 0 else None), new.frame())
            light += [] if last else [new]
            body = new
    compiled = scene.compile().scene
    compiled.plan.rigid[[compiled.index.bodies[b] for b in light]] = 0.0
    plan = compiled.plan
    x, v, work = somewhere(compiled, 3)
    a, out = np.zeros((2, compiled.nv))
    aw = new_articulated_work(plan)
    forward_dynamics(plan, work, aw, x, v, a, NOTHING)
    residual(plan, work, x, v, a, NOTHING, out)
    np.testing.assert_allclose(out, 0.0, atol=1e-12)
    rhs, columns = np.eye(compiled.nv), np.zeros((compiled.nv, compiled.nv))
    solve_mass(plan, work, aw, rhs, columns)
    heavy = [b for b in scene._bodies if b not in light]
    np.testing.assert_allclose(columns @ dense_mass(compiled, heavy, {}, x), rhs, atol=1e-8)


def test_two_factorisations_of_one_scene_do_not_mix():
    """The scratch carries nothing over from another configuration."""
    scene, *_ = random_tree(3)
    compiled = scene.compile().scene
    aw = new_articulated_work(compiled.plan)
    x, v, work = somewhere(compiled, 1)
    a, again = np.zeros((2, compiled.nv))
    forward_dynamics(compiled.plan, work, aw, x, v, a, NOTHING)
    other = somewhere(compiled, 2)
    forward_dynamics(compiled.plan, other[2], aw, other[0], other[1], again, NOTHING)
    forward_dynamics(compiled.plan, work, aw, x, v, again, NOTHING)
    np.testing.assert_array_equal(again, a)
