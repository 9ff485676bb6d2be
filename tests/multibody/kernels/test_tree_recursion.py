"""The recursion over a tree against the dense matrix, on machines of all joints with forces across them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.physics.time_functions import evaluate_times
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent, tree_tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work
from flexmbd.multibody.kernels.tangent.tree_recursion import (
    TreeRecursion,
    factor_recursion,
    new_tree_recursion,
    solve_recursion,
)

JOINTS = (
    fm.joint.Revolute("z"), fm.joint.Spherical(), fm.joint.Prismatic("x"), fm.joint.Cylindrical("y"),
    fm.joint.Universal(), fm.joint.Fixed(), fm.joint.Planar(),
)  # fmt: skip
LARGE = np.array([10**6])


def random_tree(seed: int, *, bodies: int = 9, forces: bool = True, ground: bool = False) -> fm.System:
    """A tree of random joints, some of one step, with bushings across these and springs on hinges; one is driven."""
    rng = np.random.default_rng(seed)
    scene = fm.System(gravity=(0.5, -9.81, 1.0))
    frames = [scene.ground]
    for k in range(bodies):
        body = scene.add(fm.RigidBody(rng.uniform(0.5, 2.0), (0.3, 0.4, 0.5), rng.normal(size=3) * 0.3), name=f"b{k}")
        carrier = frames[rng.integers(max(0, len(frames) - 2), len(frames))]
        kind = JOINTS[rng.integers(len(JOINTS))] if k else fm.joint.Prismatic("x")
        joint = scene.connect(kind, carrier.frame(p=rng.normal(size=3)), body.frame())
        if k == 0:
            joint.prescribe(fm.Sine(0.2, 3.0))
        elif forces and isinstance(kind, fm.joint.Revolute):
            scene.add_force(fm.force.JointSpring(joint, 7.0, damping=0.3))
            ends = carrier.frame(p=(0.3, 0.1, 0.0)), body.frame(p=(0.5, 1.0, 0.2))
            scene.add_force(fm.force.SpringDamper(*ends, 9.0, 0.1, 0.4))
        frames.append(body)
    if ground:
        pull_from_ground(scene, [frames[4], frames[7], frames[-1]], rng)
    return scene


def pull_from_ground(scene: fm.System, bodies: list[fm.RigidBody], rng: np.random.Generator) -> None:
    """A spring from the ground, a bushing to it, given wrenches in both axes."""
    one, two, three = (body.frame(p=rng.normal(size=3)) for body in bodies)
    scene.add_force(fm.force.SpringDamper(scene.ground.frame(p=(0.2, 0.1, 3.0)), one, 9.0, 0.1, 0.4))
    near = scene.ground.frame(p=(0.1, 2.0, 0.3), R=Rotation.from_rotvec((0.1, 0.3, 0.0)).as_matrix())
    scene.add_force(fm.force.Bushing(two, near, np.arange(1.0, 7.0), damping=0.3 * np.ones(6)))
    scene.add_force(fm.force.FrameForce(three, (1.0, -2.0, 3.0), (0.3, 0.2, 0.1)))
    scene.add_force(fm.force.FrameForce(two, (2.0, 1.0, 3.0), (0.1, 0.2, 0.5), axes=fm.force.Axes.FRAME))


def solved(scene: fm.System, seed: int, weights: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Of random right-hand sides the solutions by the recursion and by the dense matrix."""
    compiled = scene.compile().scene
    plan, rng, nv = compiled.plan, np.random.default_rng(seed), compiled.nv
    work, recursion = new_work(plan), new_tree_recursion(plan, LARGE)
    assert len(recursion.number) == nv
    evaluate_times(plan, 0.3, work.time)
    x = compiled.start + 0.0
    for slots in compiled.index.joints.values():
        if slots.x.stop - slots.x.start == slots.v.stop - slots.v.start:
            x[slots.x] += rng.normal(size=slots.x.stop - slots.x.start)
    state = x, rng.normal(size=nv), rng.normal(size=nv), np.zeros(0)
    tw, matrix = new_tangent_work(plan, nv, sizes=np.ones((2, nv))), np.zeros((nv, nv))
    tangent(plan, work, tw, *state, *weights, matrix)
    sides = rng.normal(size=(3, len(plan.free)))
    dense = np.linalg.solve(matrix[np.ix_(plan.free, plan.free)], sides.T).T
    tree_tangent(plan, work, tw, recursion, *state, *weights)
    assert factor_recursion(plan, recursion)
    solve_recursion(plan, recursion, sides)
    return sides, dense


@pytest.mark.parametrize("weights", [(0.0, 0.0, 1.0), (1e-2, 0.1, 1.0)], ids=["mass", "all"])
@pytest.mark.parametrize("seed", range(12))
def test_solutions_are_those_of_the_dense_matrix(seed, weights):
    found, dense = solved(random_tree(seed), seed, weights)
    np.testing.assert_allclose(found, dense, rtol=0.0, atol=1e-10 * np.abs(dense).max())


@pytest.mark.parametrize("weights", [(0.0, 0.0, 1.0), (1e-2, 0.1, 1.0)], ids=["mass", "all"])
@pytest.mark.parametrize("seed", range(6))
def test_the_ground_is_a_partner_like_any_body(seed, weights):
    found, dense = solved(random_tree(seed, ground=True), seed, weights)
    np.testing.assert_allclose(found, dense, rtol=0.0, atol=1e-10 * np.abs(dense).max())


def test_a_flying_tree():
    scene = fm.System()
    trunk = scene.add(fm.RigidBody(2.0, (0.3, 0.4, 0.5), (0.1, 0.0, 0.0)), name="trunk")
    scene.connect(fm.joint.Free(), scene.ground.frame(), trunk.frame())
    for k in range(3):
        limb = scene.add(fm.RigidBody(1.0, (0.1, 0.2, 0.2), (0.5, 0.0, 0.1)), name=f"limb {k}")
        scene.connect(fm.joint.Spherical(), trunk.frame(p=(1.0, 0.3 * k, 0.0)), limb.frame())
    found, dense = solved(scene, 1, (1e-2, 0.1, 1.0))
    np.testing.assert_allclose(found, dense, rtol=0.0, atol=1e-11 * np.abs(dense).max())


def test_a_vanishing_pivot_is_refused():
    """A hinge without inertia about its axis."""
    scene = fm.System()
    disc = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 0.0)), name="disc")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), disc.frame())
    compiled = scene.compile().scene
    plan, work, recursion = compiled.plan, new_work(compiled.plan), new_tree_recursion(compiled.plan, LARGE)
    tw = new_tangent_work(plan, 1, sizes=np.ones((2, 1)))
    at_rest = compiled.start, np.zeros(1), np.zeros(1), np.zeros(0)
    tree_tangent(plan, work, tw, recursion, *at_rest, 0.0, 0.0, 1.0)
    assert not factor_recursion(plan, recursion)


def _recursion_of(scene: fm.System, size: int) -> TreeRecursion:
    return new_tree_recursion(scene.compile().scene.plan, np.array([size]))


def test_it_serves_long_chains_and_not_short_ones():
    def chain(links: int, *, held: str = "") -> fm.System:
        scene, ends = fm.System(), []
        end = scene.ground.frame()
        for k in range(links):
            link = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.5, 0.0, 0.0)), name=f"{k}")
            scene.connect(fm.joint.Revolute("y"), end, link.frame())
            end = link.frame(p=(1.0, 0.0, 0.0))
            ends.append(end)
        if held:
            start = ends[0] if held == "by a link" else scene.ground.frame()
            scene.add_force(fm.force.SpringDamper(start, end, 1.0, 1.0))
        return scene

    assert len(_recursion_of(chain(10), 10).number) == 0
    assert len(_recursion_of(chain(100), 100).number) == 100
    assert len(_recursion_of(chain(100, held="by the ground"), 100).number) == 100
    assert len(_recursion_of(chain(100, held="by a link"), 100).number) == 0


def test_a_chain_moves_as_by_dense_factors():
    """A force of the whole state, though it is zero, keeps the recursion from serving."""
    runs = []
    for whole in (False, True):
        scene = random_tree(3, bodies=40, ground=True)
        if whole:
            scene.add_force(fm.force.StateForce(_no_force))
        runs.append(scene.simulate(0.05, rtol=1e-6, integrator=fm.GeneralizedAlpha()))
    np.testing.assert_allclose(runs[0].x[-1], runs[1].x[-1], rtol=0.0, atol=1e-9)


def _no_force(t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.zeros(len(v))
