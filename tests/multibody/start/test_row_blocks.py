"""Loops that do not feel each other are solved for block by block: as each by itself, and as the dense way has it."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_machine import mixed_scene

import flexmbd as fm
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.base.row_blocks import row_blocks
from flexmbd.multibody.kernels.forward_dynamics.articulated import articulate
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.forward_dynamics.row_paths import new_row_paths, solve_rows
from flexmbd.multibody.kernels.inverse_dynamics.recursion import forward_kinematics
from flexmbd.multibody.plan.mass_solver import dense_solver, recursive_solver
from flexmbd.multibody.plan.scene_matrices import constraint_jacobian, constraint_values, mass_matrix

HINGE = fm.joint.Revolute("z")


class FourBar:
    """A four-bar on a body, put together bar by bar so that the loops of several can be closed in any order."""

    def __init__(self, scene, base, place, size, name):
        self.scene, self.size, self.name = scene, size, name
        self.base = base.frame(p=(*place, 0.0)), base.frame(p=(place[0] + size, place[1], 0.0))
        self.bars = [
            scene.add(fm.RigidBody(1.0 + k, (0.1, 0.2, 0.25), centre), name=f"{name} {k}")
            for k, centre in enumerate(((0.1, -0.5 * size, 0.0), (0.5 * size, 0.0, 0.0), (0.0, -0.4 * size, 0.0)))
        ]
        self.crank = scene.connect(HINGE, self.base[0], self.bars[0].frame())
        scene.connect(HINGE, self.bars[0].frame(p=(0.0, -size, 0.0)), self.bars[1].frame())
        self.crank.position, self.crank.velocity = 0.3 * size, 0.7 * size

    def hang_rocker(self):
        self.rocker = self.scene.connect(HINGE, self.base[1], self.bars[2].frame())

    def close(self):
        ends = self.bars[1].frame(p=(self.size, 0.0, 0.0)), self.bars[2].frame(p=(0.0, -self.size, 0.0))
        self.loop = self.scene.connect(HINGE, *ends, way=fm.Way.CONSTRAINTS)


def side_by_side(sizes, base=None):
    """Four-bars whose parts were added in turns, on the ground or on a body of their scene."""
    scene = fm.System(gravity=(0.3, -9.81, 0.0))
    stand = scene.ground if base is None else base(scene)
    machines = [FourBar(scene, stand, (3.0 * k, 0.1 * k), size, f"bar {size}") for k, size in enumerate(sizes)]
    for step in (FourBar.hang_rocker, FourBar.close):
        for machine in machines:
            step(machine)
    return scene, machines


def turntable(scene):
    table = scene.add(fm.RigidBody(5.0, (1.0, 1.0, 1.0)), name="table")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), table.frame()).prescribe(fm.Sine(0.4, 3.0))
    return table


def platform(scene):
    body = scene.add(fm.RigidBody(5.0, (1.0, 1.0, 1.0)), name="platform")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    return body


@pytest.mark.parametrize(("base", "count"), [(None, 3), (turntable, 3), (platform, 1)])
def test_what_couples_rows(base, count):
    """Separate machines do not, nor a stand whose motion is prescribed; a stand that is free does."""
    scene, machines = side_by_side((1.0, 1.3, 0.8), base)
    compiled = scene.compile().scene
    blocks = row_blocks(compiled.plan)
    assert len(blocks) == count
    owners = [{compiled.row_owners[r].name for r in block.rows} for block in blocks]
    names = [machine.loop.name for machine in machines]
    assert owners == ([{name} for name in names] if count == 3 else [set(names)])
    free = np.concatenate([block.free for block in blocks])
    assert sorted(free) == list(range(compiled.nv)) if base is not turntable else len(set(free)) == compiled.nv - 1


def test_a_gear_couples_rows():
    scene, machines = side_by_side((1.0, 1.3, 0.8))
    scene.couple(fm.joint.Gear(machines[0].crank, machines[2].rocker, 2.0))
    assert [len(block.rows) for block in row_blocks(scene.compile().scene.plan)] == [11, 5]


def two_springs(scene):
    """A stand that is held by springs and moves."""
    body = platform(scene)
    scene.add_force(fm.force.SpringDamper(scene.ground.frame(p=(0, 3, 0)), body.frame(), 300.0, 2.0, 1.0))
    return body


@pytest.mark.parametrize("geared", [False, True])
@pytest.mark.parametrize("base", [None, turntable, two_springs])
def test_rows_of_blocks_by_the_dense_mass_matrix(base, geared):
    """C M^-1 C^T as ``solve_rows`` fills it, each block in its place, is all there is of it."""
    scene, machines = side_by_side((1.0, 1.3, 0.8), base)
    if geared:
        scene.couple(fm.joint.Gear(machines[0].crank, machines[2].rocker, 2.0))
    compiled = scene.compile().scene
    plan, free = compiled.plan, compiled.plan.free
    work, rng = new_work(plan), np.random.default_rng(3)
    x = compiled.start + 0.0
    hinges = [compiled.index.joints[c] for c in compiled.index.joints if len(c.joint.angular) == 1]
    for slots in hinges:
        x[slots.x] = rng.uniform(-0.5, 0.5)
    paths, aw, m = new_row_paths(plan), new_articulated_work(plan), len(plan.rows)
    articulate(plan, work, aw, x)
    forward_kinematics(plan, work, x, np.zeros(compiled.nv), np.zeros(compiled.nv))
    small = np.zeros((m, m))
    solve_rows(plan, work, aw, paths, small)
    rows = constraint_jacobian(compiled, work, x)[:, free]
    expected = rows @ np.linalg.solve(mass_matrix(compiled, work, x)[np.ix_(free, free)], rows.T)
    np.testing.assert_allclose(small, np.tril(expected), atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(
    "method", [fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4), fm.CentralDifference(), fm.EnergyMomentum()], ids=str
)
def test_machines_in_one_scene_move_as_each_by_itself(method):
    sizes = (1.0, 1.3, 0.8)
    scene, machines = side_by_side(sizes)
    run = scene.simulate(0.4, h=2e-3, integrator=method)
    for size, machine in zip(sizes, machines, strict=True):
        alone, (single,) = side_by_side((size,))
        other = alone.simulate(0.4, h=2e-3, integrator=method)
        together, apart = (r.beta(m.crank) for r, m in ((run, machine), (other, single)))
        np.testing.assert_allclose(together, apart, atol=1e-10)
        held, wanted = run.reaction(machine.loop), other.reaction(single.loop)
        np.testing.assert_allclose(held, wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("make", [lambda: mixed_scene()[0], lambda: side_by_side((1.0, 0.7), turntable)[0]])
def test_recursion_and_dense_factors_solve_alike(make):
    """M^-1 f at a start with joints of every kind, modes and a prescribed motion: two programs, one answer."""
    compiled = make().compile().scene
    work, rng = new_work(compiled.plan), np.random.default_rng(5)
    forces = rng.standard_normal((3, compiled.nv))
    dense, recursive = (kind(compiled, work, compiled.start)(forces) for kind in (dense_solver, recursive_solver))
    np.testing.assert_allclose(recursive, dense, atol=1e-11 * np.abs(dense).max())


def test_slopes_of_blocks_are_those_of_all_rows():
    """Sweeps that move all blocks at once, by the rates of each unit velocity alone."""
    compiled = side_by_side((1.0, 1.3, 0.8), turntable)[0].compile().scene
    work, rng = new_work(compiled.plan), np.random.default_rng(7)
    x = compiled.start + 0.1 * rng.standard_normal(compiled.nx)
    zero = np.zeros(compiled.nv)
    rates = [constraint_values(compiled, work, x, unit)[1] for unit in np.eye(compiled.nv)]
    expected = np.array(rates).T - constraint_values(compiled, work, x, zero)[1][:, None]
    np.testing.assert_allclose(constraint_jacobian(compiled, work, x), expected, atol=1e-14)


def test_a_joint_without_inertia_is_named_in_a_large_machine():
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    end = scene.ground.frame()
    for k in range(120):
        body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.1, 0.0, 0.0)))
        scene.connect(HINGE, end, body.frame(), name=f"hinge {k}")
        end = body.frame(p=(0.2, 0.0, 0.0))
    point = scene.add(fm.RigidBody(1.0, (0.0, 0.0, 0.0)), name="point")
    scene.connect(HINGE, end, point.frame(), name="idle")
    with pytest.raises(fm.AssemblyError, match="moving 'idle"):
        scene.start()
