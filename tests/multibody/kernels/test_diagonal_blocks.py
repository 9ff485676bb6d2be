"""Machines side by side in one scene: what couples them, and that they move as by the whole matrix."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.tangent.diagonal_blocks import diagonal_blocks, unknown_bounds
from flexmbd.multibody.kernels.tangent.residual_tangent import tangent
from flexmbd.multibody.kernels.tangent.tangent_layout import new_tangent_work

HINGE, BALL = fm.joint.Revolute("z"), fm.joint.Spherical()


def _body(scene: fm.System, name: str) -> fm.RigidBody:
    return scene.add(fm.RigidBody(1.3, (0.1, 0.2, 0.3), (0.5, 0.1, 0.0)), name=name)


def four_bar(scene: fm.System, name: str, angle: float, *, stand: fm.RigidBody | None = None) -> None:
    """A loop of three bars, on the ground or on a body."""
    base = scene.ground if stand is None else stand
    crank, coupler, rocker = (_body(scene, f"{name} {part}") for part in ("crank", "coupler", "rocker"))
    scene.connect(HINGE, base.frame(), crank.frame()).position = angle
    scene.connect(HINGE, crank.frame(p=(0.0, 1.0, 0.0)), coupler.frame())
    scene.connect(HINGE, coupler.frame(p=(1.2, 0.0, 0.0)), rocker.frame(p=(0.0, 1.1, 0.0)))
    scene.connect(HINGE, base.frame(p=(1.1, 0.0, 0.0)), rocker.frame())


def chain(scene: fm.System, name: str, angle: float) -> list[fm.RigidBody]:
    """A ball and two hinges, with a bushing about the last of them."""
    links = [_body(scene, f"{name} {k}") for k in range(3)]
    end = scene.ground.frame()
    for k, link in enumerate(links):
        joint = scene.connect(HINGE if k else BALL, end, link.frame())
        if k:
            joint.velocity = 3.0 * angle
        end = link.frame(p=(1.0, 0.0, 0.0))
    return links


def slider_crank(scene: fm.System, name: str, angle: float) -> None:
    crank, rod, piston = (_body(scene, f"{name} {part}") for part in ("crank", "rod", "piston"))
    scene.connect(HINGE, scene.ground.frame(), crank.frame()).position = angle
    scene.connect(HINGE, crank.frame(p=(0.3, 0.0, 0.0)), rod.frame())
    scene.connect(HINGE, rod.frame(p=(1.0, 0.0, 0.0)), piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame())


MACHINES: dict[str, Callable[[fm.System, str, float], object]] = {
    "four-bar": four_bar, "chain": chain, "slider-crank": slider_crank,
}  # fmt: skip


def scene_of(*names: str) -> fm.System:
    """The machines of these names in one scene, each at its own angle whatever else is there."""
    scene = fm.System(gravity=(0.3, -9.81, 0.2))
    for name in names:
        MACHINES[name](scene, name, 0.2 + 0.1 * list(MACHINES).index(name))
    return scene


def test_blocks_are_the_machines_that_nothing_couples():
    scene = scene_of("four-bar", "chain", "slider-crank")
    blocks = diagonal_blocks(scene.compile().scene.plan)
    sizes = sorted(zip(np.diff(blocks.free), np.diff(blocks.rows), strict=True))
    assert sizes == [(3, 5), (3, 5), (5, 0)]  # rows that are redundant included
    assert sorted(np.diff(unknown_bounds(blocks, 2))) == [5, 13, 13]


def test_machines_whose_joints_are_made_in_turns_lie_side_by_side():
    scene, ends = fm.System(), {}
    for k in range(3):
        for limb in range(4):
            link = _body(scene, f"{limb}, {k}")
            scene.connect(HINGE, ends.get(limb, scene.ground.frame()), link.frame())
            ends[limb] = link.frame(p=(1.0, 0.0, 0.0))
    np.testing.assert_array_equal(diagonal_blocks(scene.compile().scene.plan).free, [0, 3, 6, 9, 12])


def test_a_spring_a_coupling_and_a_users_force_join_machines():
    def bodies(act: Callable[[fm.System, list[list[fm.RigidBody]]], object]) -> int:
        scene = fm.System()
        act(scene, [chain(scene, f"chain {k}", 0.1) for k in range(3)])
        return len(diagonal_blocks(scene.compile().scene.plan).velocity)

    def spring(one: fm.RigidBody, other: fm.RigidBody) -> fm.force.SpringDamper:
        return fm.force.SpringDamper(one.frame(), other.frame(), 5.0, 1.0)

    assert bodies(lambda scene, chains: None) == 3
    assert bodies(lambda scene, c: scene.add_force(spring(c[0][2], c[1][0]))) == 2
    # what lies between the two joined is joined too, for blocks are stretches of v
    assert bodies(lambda scene, c: scene.add_force(spring(c[0][2], c[2][0]))) == 1
    assert bodies(lambda scene, c: scene.connect(BALL, c[1][2].frame(), c[2][2].frame())) == 2


def test_machines_on_a_driven_stand_are_apart():
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    stand = _body(scene, "stand")
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), stand.frame()).prescribe(fm.Sine(0.1, 3.0))
    for k in range(3):
        four_bar(scene, f"machine {k}", 0.2 + 0.1 * k, stand=stand)
    np.testing.assert_array_equal(diagonal_blocks(scene.compile().scene.plan).free, [0, 3, 6, 9])


def test_the_tangent_is_zero_outside_the_blocks():
    scene = scene_of("chain", "four-bar", "slider-crank")
    compiled = scene.compile().scene
    plan, rng = compiled.plan, np.random.default_rng(3)
    nv, m = compiled.nv, len(plan.rows)
    tw = new_tangent_work(plan, nv, sizes=np.ones((2, nv)))
    matrix = np.zeros((nv, nv))
    state = (compiled.start, rng.normal(size=nv), rng.normal(size=nv), rng.normal(size=m))
    tangent(plan, new_work(plan), tw, *state, 1.0, 0.7, 0.4, matrix)
    outside, apart = np.ones((nv, nv), bool), np.ones((m, nv), bool)
    for (first, last), (above, below) in zip(tw.blocks.velocity, pairwise(tw.blocks.rows), strict=True):
        outside[first:last, first:last] = False
        apart[above:below, first:last] = False
    assert outside.any()
    assert not matrix[outside].any()
    assert apart.any()
    assert not tw.jacobian[apart].any()
    assert not tw.rate_jacobian[apart].any()


METHODS = [fm.GeneralizedAlpha(), fm.GeneralizedAlpha(index=3), fm.RadauIIA(), fm.EnergyMomentum()]


def _no_force(t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    return np.zeros(len(v))


@pytest.mark.parametrize("method", METHODS, ids=str)
def test_blocks_give_what_the_whole_matrix_gives(method):
    """A force of the whole state, though it is zero, makes one block of all machines."""
    runs = []
    for whole in (False, True):
        scene = scene_of("slider-crank", "chain", "four-bar")
        if whole:
            scene.add_force(fm.force.StateForce(_no_force))
        assert len(diagonal_blocks(scene.compile().scene.plan).velocity) == (1 if whole else 3)
        runs.append(scene.simulate(0.1, h=2e-3, integrator=method))
    np.testing.assert_allclose(runs[0].x, runs[1].x, rtol=0.0, atol=1e-11)
