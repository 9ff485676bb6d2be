"""The tangent in blocks of a sparse matrix against the dense one."""

from __future__ import annotations

import numpy as np
import pytest
from large_machines import brick, lattice, marbles
from mixed_machine import mixed_scene
from particles import particle_body
from patched import patched_body
from random_trees import random_tree

import flexmbd as fm
from flexmbd import contact
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.sparse_assembly import assemble_sparse, put_rows
from flexmbd.multibody.kernels.tangent.sparse_places import new_sparse_places
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.kernels.tangent.unknown_blocks import unknown_blocks

WEIGHTS = (0.7, 0.4, 1.3)
SLOPES = (0.3, 0.6, -0.2)
NONE = np.zeros(0)


def state_of(compiled, seed, spread=0.3):
    rng = np.random.default_rng(seed)
    x = np.empty(compiled.nx)
    retract(compiled.plan, compiled.start, spread * rng.standard_normal(compiled.nv), x)
    return x, *rng.standard_normal((2, compiled.nv))


def dense(plan, state, multipliers=NONE):
    """The same of free velocities and multipliers by the dense tangent."""
    x, v, a = state
    matrix = np.zeros((len(v), len(v)))
    work, tw = new_work(plan), new_tangent_work(plan, len(v), sizes=np.ones((2, len(v))))
    tangent(plan, work, tw, x, v, a, multipliers, *WEIGHTS, matrix)
    across = tw.jacobian[:, plan.free]
    held = SLOPES[0] * across + SLOPES[1] * tw.rate_jacobian[:, plan.free]
    return np.block([[matrix[np.ix_(plan.free, plan.free)], across.T], [held, SLOPES[2] * np.eye(len(plan.rows))]])


def sparse(plan, state, cut=None, multipliers=NONE):
    """The matrix of all unknowns but prescribed velocities, and how many numbers its blocks have."""
    x, v, a = state
    blocks = unknown_blocks(plan, cut)
    pairs = blocks.pairs
    sizes = blocks.size[pairs[:, 0]] * blocks.size[pairs[:, 1]]
    places = np.cumsum(sizes) - sizes
    to = new_sparse_places(plan, blocks, pairs, places, blocks.size[pairs[:, 1]])
    work, tw = new_work(plan), new_tangent_work(plan, len(v), sizes=np.ones((2, len(v))), blocks=blocks)
    values = np.full(int(sizes.sum()), np.nan)
    for _ in range(2):  # nothing is left over
        residual(plan, work, x, v, a, multipliers, np.zeros(len(v)))
        assemble_sparse(plan, work, tw, to, x, v, a, multipliers, *WEIGHTS, values)
        put_rows(plan, tw, to, tw.jacobian, np.tile(SLOPES, (len(plan.rows), 1)), 1.0, values)
    matrix = np.zeros((blocks.unknowns, blocks.unknowns))
    for (i, j), place, size in zip(pairs, places, sizes, strict=True):
        rows, columns = (slice(blocks.first[k], blocks.first[k] + blocks.size[k]) for k in (i, j))
        matrix[rows, columns] = values[place : place + size].reshape(blocks.size[i], blocks.size[j])
    kept = np.flatnonzero(blocks.of >= 0)
    np.testing.assert_array_equal(to.number[kept], np.arange(len(kept)))
    assert (np.diff(blocks.first) > 0).all()
    return matrix[np.ix_(kept, kept)], len(values)


def without_cuts(matrix, count):
    """Eliminate all but the first unknowns, which are those of cut bodies."""
    cut = matrix[count:, count:]
    return matrix[:count, :count] - matrix[:count, count:] @ np.linalg.solve(cut, matrix[count:, :count])


def compare(compiled, seed, cut=None, spread=0.3):
    plan = compiled.plan
    state = state_of(compiled, seed, spread)
    multipliers = np.random.default_rng(seed + 1).standard_normal(len(plan.rows))
    expected = dense(plan, state, multipliers)
    found, count = sparse(plan, state, cut, multipliers)
    found = without_cuts(found, len(expected))
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())
    return count


@pytest.mark.parametrize("seed", range(6))
def test_random_trees(seed):
    """Driven hinges, reduced bodies with children on frames that deform, laws on coordinates; none cut, some or all."""
    compiled = random_tree(seed)[0].compile().scene
    compare(compiled, seed)
    compare(compiled, seed, np.ones(len(compiled.plan.tree), bool))
    compare(compiled, seed, np.random.default_rng(seed).random(len(compiled.plan.tree)) < 0.4)


@pytest.mark.parametrize("kind", [{}, {"rotors": True}, {"nonlinear": True}])
def test_every_joint_and_body(kind):
    compiled = mixed_scene(**kind)[0].compile().scene
    assert len(compiled.plan.rows) > 0
    compare(compiled, 3)
    compare(compiled, 3, np.ones(len(compiled.plan.tree), bool))
    compare(compiled, 3, np.random.default_rng(3).random(len(compiled.plan.tree)) < 0.4)


def test_elastic_surfaces():
    """That touch what another body carries, and the ground, on a chain of which bodies are cut or not."""
    scene = fm.System()
    before = scene.ground.frame()
    bodies = []
    for k in range(3):
        body = scene.add(patched_body(k, modes=4, patches=30, softness=0.1), name=f"limb {k}")
        scene.connect(fm.joint.Spherical(), before, body.frame("root"))
        before = body.frame("tip")
        bodies.append(body)
    scene.touch(contact.ElasticSurface(bodies[2]), contact.Sphere(bodies[0].frame("tip"), 0.5), contact.Hard())
    scene.touch(contact.ElasticSurface(bodies[0]), contact.Sphere(bodies[2].frame("tip"), 0.5), contact.Hard())
    scene.touch(contact.ElasticSurface(bodies[1]), contact.HalfSpace(scene.ground.frame(), "x"), contact.Hard())
    round_one = contact.ElasticSurface(bodies[2], shape=contact.Sphere(bodies[2].frame(), 0.35))
    scene.touch(contact.ElasticSurface(bodies[1]), round_one, contact.Hard())
    compiled = scene.compile().scene
    compare(compiled, 3)
    compare(compiled, 3, np.ones(len(compiled.plan.tree), bool))
    compare(compiled, 3, np.array([False, True, False]))


def limbs():
    """Two flexible limbs side by side with a child each, and springs between all that deforms and does not."""
    scene = fm.System(gravity=(0.0, -9.81, 1.0))
    ends, last = [], []
    for k, joint in enumerate((fm.joint.Screw(0.3, "x"), fm.joint.Spherical())):
        body = scene.add(fm.FlexibleBody(particle_body(20 + k, modes=3, damping=1.0).record), name=f"limb {k}")
        scene.connect(joint, scene.ground.frame(p=(0.3 * k, 0.1, 0.2)), body.frame("root"))
        child = scene.add(brick(), name=f"child {k}")
        hinge = scene.connect(fm.joint.Revolute("y"), body.frame("tip"), child.frame())
        scene.add_force(fm.force.JointSpring(hinge, 3.0, 0.2))
        ends.append(body.frame("tip"))
        last.append(child)
    driven = scene.add(brick(), name="driven")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), driven.frame()).prescribe(fm.Sine(0.2, 3.0))
    stiffness = np.diag([50.0, 60.0, 70.0, 5.0, 6.0, 7.0]) + 0.5
    scene.add_force(fm.force.Bushing(ends[0], ends[1], stiffness, 0.1 * stiffness))
    scene.add_force(fm.force.SpringDamper(last[0].frame((0.1, 0.2, 0.0)), last[1].frame(), 40.0, 3.0, 0.1))
    scene.add_force(fm.force.SpringDamper(driven.frame((0.3, 0.2, 0.0)), ends[0], 40.0, 3.0, 0.1))
    scene.add_force(fm.force.SpringDamper(scene.ground.frame((0.3, 0.2, 0.0)), last[0].frame(), 40.0, 3.0, 0.1))
    return scene


def test_a_joint_that_is_turned_round():
    """Its links, and so their velocities, stand in the tree the other way."""
    scene = fm.System()
    inner, outer = (scene.add(brick()) for _ in range(2))
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), inner.frame())
    scene.connect(fm.joint.Universal(), outer.frame((0.1, 0.0, 0.2)), inner.frame((0.4, 0.1, 0.0)))
    compiled = scene.compile().scene
    assert (np.diff(compiled.plan.tree[:, at.JOINT_V]) < 0).any()
    compare(compiled, 4)
    compare(compiled, 4, np.ones(len(compiled.plan.tree), bool))


def test_springs_between_branches():
    compiled = limbs().compile().scene
    compare(compiled, 5)
    compare(compiled, 5, np.ones(len(compiled.plan.tree), bool))


def test_contacts_with_friction():
    """Their states, and the rates of these by all that moves the two frames."""
    compiled = marbles(3).compile().scene
    assert (compiled.plan.elements[:, at.EL_V] >= 0).all()
    compare(compiled, 6, spread=1e-4)
    compare(compiled, 6, np.ones(len(compiled.plan.tree), bool), spread=1e-4)


def test_a_lattice_has_as_many_entries_as_neighbours():
    counts = []
    for columns in (4, 8, 12):
        compiled = lattice(3, columns).compile().scene
        counts.append(compare(compiled, 2))
        assert compiled.nv == 2 * 3 * columns
    assert counts[2] - counts[1] == counts[1] - counts[0]  # linear in the length
