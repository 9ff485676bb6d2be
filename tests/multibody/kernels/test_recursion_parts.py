"""The parts of a tree's tangent against the dense matrices, for real and complex shifts."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.tangent.recursion_parts import (
    N_PARTS,
    add_product,
    keep_part,
    new_complex_recursion,
    new_recursion_parts,
    set_shift,
)
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent, tree_tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.kernels.tangent.tree_recursion import factor_recursion, new_tree_recursion, solve_recursion

JOINTS = (
    fm.joint.Revolute("z"), fm.joint.Spherical(), fm.joint.Prismatic("x"), fm.joint.Universal(), fm.joint.Planar(),
)  # fmt: skip
SHIFT = 0.03 - 0.05j


@entry_kernel
def _set_complex_shift(parts, real, imaginary, recursion):
    set_shift(parts, complex(real, imaginary), recursion)


def _tree(seed: int, *, ground: bool) -> fm.System:
    """Nine bodies on random joints, springs on and across the hinges; the first joint is prescribed."""
    rng = np.random.default_rng(seed)
    scene = fm.System(gravity=(0.5, -9.81, 1.0))
    carriers = [scene.ground]
    for k in range(9):
        body = scene.add(fm.RigidBody(rng.uniform(0.5, 2.0), (0.3, 0.4, 0.5), rng.normal(size=3) * 0.3), name=f"b{k}")
        carrier = carriers[rng.integers(max(0, len(carriers) - 2), len(carriers))]
        kind = JOINTS[rng.integers(len(JOINTS))] if k else fm.joint.Prismatic("x")
        joint = scene.connect(kind, carrier.frame(p=rng.normal(size=3)), body.frame())
        if k == 0:
            joint.prescribe(fm.Sine(0.2, 3.0))
        elif isinstance(kind, fm.joint.Revolute):
            scene.add_force(fm.force.JointSpring(joint, 70.0, damping=3.0))
            scene.add_force(fm.force.SpringDamper(carrier.frame(p=(0.3, 0.1, 0.0)), body.frame(), 90.0, 1.0, 0.4))
        carriers.append(body)
    if ground:
        spring = fm.force.SpringDamper(scene.ground.frame(p=(0.2, 0.1, 3.0)), carriers[5].frame(), 90.0, 2.0, 0.4)
        place = carriers[-1].frame(p=(0.3, 0.1, 0.0))
        follower = fm.force.FrameForce(place, (1.0, -2.0, 3.0), axes=fm.force.Axes.FRAME)
        for force in (spring, follower, fm.force.FrameForce(place, (1.0, -2.0, 3.0))):
            scene.add_force(force)
    return scene


@pytest.mark.parametrize("ground", [False, True], ids=["", "forces from the ground"])
@pytest.mark.parametrize("seed", range(6))
def test_parts_make_the_dense_matrices(seed, ground):
    compiled = _tree(seed, ground=ground).compile().scene
    plan, nv, rng = compiled.plan, compiled.nv, np.random.default_rng(seed)
    work, tw = new_work(plan), new_tangent_work(compiled.plan, compiled.nv, sizes=np.ones((2, compiled.nv)))
    evaluate_times(plan, 0.3, work.time)
    state = compiled.start, rng.normal(size=nv), rng.normal(size=nv), np.zeros(0)
    recursion = new_tree_recursion(plan, np.array([10**6]))
    shifted, parts = new_complex_recursion(recursion), new_recursion_parts(recursion)
    vector, dense = rng.normal(size=len(plan.free)), []
    for part, (x, v, a) in enumerate(np.eye(N_PARTS)):
        whole, product = np.zeros((nv, nv)), np.zeros(len(plan.free))
        tangent(plan, work, tw, *state, x, v, a, whole)
        dense.append(whole[np.ix_(plan.free, plan.free)])
        tree_tangent(plan, work, tw, recursion, *state, x, v, a)
        assert keep_part(recursion, parts, part)
        add_product(plan, parts, part, recursion, -2.0, vector, product)
        np.testing.assert_allclose(product, -2.0 * dense[part] @ vector, rtol=0.0, atol=1e-11 * np.abs(whole).max())
    stiffness, damping, mass = dense
    set_shift(parts, 0.07, recursion)
    _set_complex_shift(parts, SHIFT.real, SHIFT.imag, shifted)
    for factors, shift in ((recursion, 0.07), (shifted, SHIFT)):
        assert factor_recursion(plan, factors)
        sides = rng.normal(size=(2, len(plan.free))) * (1.0 + 0.0 * shift)
        expected = np.linalg.solve(mass + shift * (damping + shift * stiffness), sides.T).T
        solve_recursion(plan, factors, sides)
        np.testing.assert_allclose(sides, expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())


def test_a_chain_by_radau_moves_as_by_dense_factors():
    """A force of the whole state, though it is zero, keeps the recursion from serving."""
    runs = []
    for whole in (False, True):
        scene = _chain(50)
        if whole:
            scene.add_force(fm.force.StateForce(lambda t, x, v: np.zeros(len(v))))
        runs.append(scene.simulate(0.1, rtol=1e-6, integrator=fm.RadauIIA()))
    assert runs[0].stats.steps == runs[1].stats.steps
    np.testing.assert_allclose(runs[0].x[-1], runs[1].x[-1], rtol=0.0, atol=1e-10)


def _chain(links: int) -> fm.System:
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    end = scene.ground.frame()
    for k in range(links):
        link = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.5, 0.0, 0.0)), name=f"{k}")
        joint = scene.connect(fm.joint.Spherical() if k % 7 == 3 else fm.joint.Revolute("z"), end, link.frame())
        if k % 7 == 1:
            scene.add_force(fm.force.JointSpring(joint, 1e3, damping=1.0))
        end = link.frame(p=(1.0, 0.0, 0.0))
    return scene
