"""Steps by a sparse matrix are those by a dense one; it is taken where it pays, and grows with the machine."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from bicycle import bicycle
from large_machines import HINGE, brick, combs, hammock, ladder, lattice, marbles
from particles import particle_body
from spring_lattice import spring_lattice

import flexmbd as fm
from flexmbd.integrate import matrix_choice
from flexmbd.integrate.alpha.generalized_alpha import relation_of
from flexmbd.integrate.alpha.interiors import newton_iteration
from flexmbd.integrate.alpha.relation import begin_stage, take_weights
from flexmbd.integrate.alpha.workspace import new_workspace
from flexmbd.integrate.matrix_choice import alpha_matrix, radau_matrix
from flexmbd.integrate.predicted_cost import counts
from flexmbd.integrate.radau import matrix as radau_steps
from flexmbd.integrate.radau import workspace as radau_workspace
from flexmbd.integrate.radau.stages import evaluate_stage_times, place_stages, predict_stages
from flexmbd.multibody.kernels.base import plan_layout as at
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.base.compiling import entry_kernel
from flexmbd.multibody.kernels.base.native import complex_lapack_addresses
from flexmbd.multibody.kernels.tangent.sparse_matrix import new_pattern
from flexmbd.multibody.kernels.tangent.unknown_blocks import unknown_blocks
from flexmbd.run.snapshot import new_snapshot

ALPHA, RADAU, EM = fm.GeneralizedAlpha(), fm.RadauIIA(), fm.EnergyMomentum()


def flexible_loop():
    """A soft rod on a crank, its tip on a plane, and a gear from the crank to a further body."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    crank, follower = (scene.add(brick(), name=name) for name in ("crank", "follower"))
    rod = scene.add(fm.FlexibleBody(particle_body(7, modes=4, damping=1.0).record), name="rod")
    drive = scene.connect(HINGE, scene.ground.frame(), crank.frame())
    drive.velocity = 2.0
    scene.connect(HINGE, crank.frame((0.3, 0.0, 0.0)), rod.frame("root"))
    plane = scene.ground.frame((0.0, 0.1, 0.0))
    scene.connect(fm.joint.PointOnPlane("y"), plane, rod.frame("tip"), way=fm.Way.CONSTRAINTS)
    turn = scene.connect(HINGE, scene.ground.frame((0.0, 1.0, 0.0)), follower.frame(), name="follower's hinge")
    scene.couple(fm.joint.Gear(drive, turn, 2.0))
    return scene


def yielding():
    """A ladder some of whose hinges an augmented Lagrangian closes."""
    scene = ladder(4)
    for k, joint in enumerate(scene._connections[3::4]):
        if k % 2:
            joint.enforce = fm.AugmentedLagrangian(stiffness=1e5, damping=10.0, tol=1e-8)
    return scene


def riding():
    """Two discs that roll, of which rows hold velocities alone, and a frame that turns like a ball."""
    scene, _, steer = bicycle(4.0)
    steer.velocity = 0.5
    return scene


MACHINES = {
    "lattice": lambda: lattice(2, 3),
    "ladder": lambda: ladder(4),
    "combs": lambda: combs(4),
    "flexible loop": flexible_loop,
    "hammock": lambda: hammock(5),
    "bicycle": riding,
    "marbles": lambda: marbles(3),
    "yielding": yielding,
}


def forced(way):
    """A choice of a sparse matrix whatever it costs, with some bodies cut: "none", "some" or "all"."""

    def chosen(plan, sizes, *, cuts=True):
        share = {"none": 0.0, "some": 0.5, "all": 1.0}[way] if cuts else 0.0
        drawn = np.random.default_rng(3).random(len(plan.tree)) < share
        blocks = unknown_blocks(plan, drawn & (plan.tree[:, at.PARENT] >= 0))
        return blocks, new_pattern(blocks)

    return chosen


def both(monkeypatch, scene, way, **how):
    """The end and the numbers of steps, by the sparse matrix and by the dense one."""
    found = []
    for choose in (forced(way), lambda *_, **__: None):
        monkeypatch.setattr(matrix_choice, "sparse_blocks", choose)
        run = scene.compile().simulate(0.02, **how)
        found.append((np.concatenate([run.x[-1], run.v[-1]]), run.stats))
    return found


@pytest.mark.parametrize("way", ["none", "some", "all"])
@pytest.mark.parametrize("name", MACHINES)
def test_generalized_alpha(monkeypatch, name, way):
    """To round-off and in as many iterations: the same corrections, those of loops' shifts included."""
    (end, stats), (expected, dense) = both(monkeypatch, MACHINES[name](), way, h=2e-3, integrator=ALPHA)
    np.testing.assert_allclose(end, expected, atol=1e-9)
    assert stats.iterations == dense.iterations


@pytest.mark.parametrize("way", ["none", "some", "all"])
@pytest.mark.parametrize("name", [name for name in MACHINES if name != "lattice"])
def test_radau_iia(monkeypatch, name, way):
    """The same steps, whatever holds the loops; the ends to what Newton's iteration leaves."""
    (end, stats), (expected, dense) = both(monkeypatch, MACHINES[name](), way, rtol=1e-6, integrator=RADAU)
    np.testing.assert_allclose(end, expected, atol=1e-9)
    assert stats.steps == dense.steps


@pytest.mark.parametrize("name", ["lattice", "combs", "marbles"])
def test_energy_momentum(monkeypatch, name):
    """Of trees: the same steps, whether or not they are halved."""
    how = {"h": 2e-3} if name != "marbles" else {"h": 2e-4}
    (end, stats), (expected, dense) = both(monkeypatch, MACHINES[name](), "none", integrator=EM, **how)
    np.testing.assert_allclose(end, expected, atol=1e-9)
    assert stats.iterations == dense.iterations


def test_energy_momentum_keeps_the_energy_of_a_large_lattice():
    """By the sparse matrix, which is chosen there; with error control as well as at equal steps."""
    scene, _ = spring_lattice(30, 5, fm.joint.PlanarPoint("z"), load=(0.0, 0.0, 0.0))
    scene.gravity = (0.0, -9.81, 0.0)
    assert "matrix of a step: sparse" in scene.explain(integrator=EM)
    for how in ({"h": 2e-3}, {"rtol": 1e-4}):
        run = scene.simulate(0.05, integrator=EM, **how)
        energy = run.energy()
        assert np.abs(energy.total - energy.total[0]).max() < 1e-9 * energy.kinetic.max()


def plan_of(scene):
    return scene.start().scene.plan


def test_a_sparse_matrix_grows_with_the_machine():
    """Operations and numbers of the ladder's and a lattice's matrix: some twice as many for twice the length."""
    for build, n in ((ladder, 60), (partial(lattice, 4), 20)):
        few, many = (alpha_matrix(plan_of(build(k))).sparse[1] for k in (n, 2 * n))
        assert many.operations < 2.0**1.25 * few.operations
        assert many.fill < 2.0**1.25 * few.fill


def test_it_is_taken_where_it_pays_and_told():
    for scene in (lattice(6, 40), ladder(80)):
        assert "matrix of a step: sparse" in scene.explain(integrator=ALPHA)
    assert radau_matrix(plan_of(lattice(6, 40))).sparse is not None
    assert "matrix of a step: dense, 18 unknowns" in lattice(3, 3).explain(integrator=RADAU)
    # a multiplier to each row, where the others have two unknowns
    assert "matrix of a step: dense, 400 unknowns" in ladder(80).explain(integrator=fm.EnergyMomentum())
    chain = combs(0)
    end = chain.ground.frame()
    for _ in range(60):
        link = chain.add(brick())
        chain.connect(HINGE, end, link.frame())
        end = link.frame((0.5, 0.0, 0.0))
    assert "by the recursion over the tree" in chain.explain(integrator=ALPHA)
    assert "matrix of a step" not in chain.explain(integrator=fm.ExplicitRungeKutta())


def test_machines_side_by_side_take_no_square_of_their_number():
    """Of 1500 pendulums no array holds a number for each pair."""
    scene = fm.System()
    for k in range(1500):
        scene.connect(HINGE, scene.ground.frame((float(k), 0.0, 0.0)), scene.add(brick()).frame())
    for choice in (alpha_matrix(plan_of(scene)), radau_matrix(plan_of(scene))):
        sparse, work = choice.new_sparse(), choice.new_tangent(1500, np.zeros((2, 1500)))
        arrays = [*sparse.to.fields().values(), *work.fields().values(), sparse.matrix.values]
        assert max(np.size(one) for one in arrays if isinstance(one, np.ndarray)) < 1500 * 40


@entry_kernel
def begin(plan, work, state, scratch, h):
    take_weights(scratch.relation, h, 0.0)
    begin_stage(plan, work, state, scratch, h, 0)


def correction(scene, choice, monkeypatch, *, h):
    """Newton's correction of a step from a start with random speeds: accelerations, reactions, shifts."""
    monkeypatch.setattr(matrix_choice, "sparse_blocks", choice)
    start = scene.start()
    plan, nv, m = start.scene.plan, start.scene.nv, len(start.scene.plan.rows)
    state = new_snapshot(start, ALPHA, t_start=0.0, t_end=1.0, rtol=1e-6, h=h).state
    work = new_work(plan)
    scratch = new_workspace(plan, work, start.scene.nx, nv, relation_of(ALPHA))
    scratch.memory.index[0] = 2
    scratch.scale_x[:] = scratch.scale_v[:] = 1.0
    rng = np.random.default_rng(2)
    state.v[:] = 3.0 * rng.standard_normal(nv)
    begin(plan, work, state, scratch, h)
    scratch.unknown[: len(plan.free) + m] = rng.standard_normal(len(plan.free) + m)
    sizes = newton_iteration(plan, work, state, scratch, h)
    return scratch.correction[0].copy(), sizes


@pytest.mark.parametrize("way", ["none", "some", "all"])
@pytest.mark.parametrize("name", ["ladder", "flexible loop"])
def test_corrections_of_loops(monkeypatch, name, way):
    """By a step of 5 ms, in which rows turn by 15 mrad and stiffness counts: all but products of the two."""
    scene = MACHINES[name]()
    found, size = correction(scene, forced(way), monkeypatch, h=5e-3)
    expected, dense_size = correction(scene, lambda *_, **__: None, monkeypatch, h=5e-3)
    m = len(plan_of(scene).rows)
    for part in (slice(0, -2 * m), slice(-2 * m, -m), slice(-m, None)):
        scale = abs(expected[part]).max()
        np.testing.assert_allclose(found[part], expected[part], atol=1e-4 * scale)
    np.testing.assert_allclose(size, dense_size, rtol=1e-4)


@entry_kernel
def factor(plan, work, state, scratch, h):
    evaluate_stage_times(plan, work, state, scratch, h)
    predict_stages(plan, state, scratch, h, False)
    place_stages(plan, state, scratch, h)
    radau_steps.take_tangent(plan, work, state, scratch, 1)
    radau_steps.factor_step(plan, state, scratch, h)


@entry_kernel
def correct(plan, scratch, h):
    radau_steps.correct_stages(plan, scratch, h)


@entry_kernel
def put_imbalance(plan, scratch, step):
    radau_steps.put_imbalance(plan, scratch, step)


def radau_parts(monkeypatch, scene, choice, *, h):
    """Corrections of the three stages for random residuals, their shifts of positions, and an imbalance."""
    monkeypatch.setattr(matrix_choice, "sparse_blocks", choice)
    start = scene.start()
    plan, nv = start.scene.plan, start.scene.nv
    state = new_snapshot(start, RADAU, t_start=0.0, t_end=1.0, rtol=1e-6, h=h).state
    work = new_work(plan)
    scratch = radau_workspace.new_workspace(
        plan, work, start.scene.nx, nv, lapack_complex=complex_lapack_addresses()
    )
    scratch.scale_x[:] = scratch.scale_v[:] = 1.0
    factor(plan, work, state, scratch, h)
    rng = np.random.default_rng(2)
    scratch.a[:], scratch.multipliers[:] = 0.0, 0.0
    scratch.equation[:] = rng.standard_normal(scratch.equation.shape)
    correct(plan, scratch, h)
    scratch.error_x[:], scratch.error_v[:] = rng.standard_normal((2, len(plan.free)))
    put_imbalance(plan, scratch, h)
    return scratch.a[:, plan.free], scratch.multipliers, scratch.pushed, scratch.rhs_real


def radau_differences(monkeypatch, scene, choice, *, h):
    """By how much the parts differ from the dense way's, over the largest of each."""
    found, expected = (radau_parts(monkeypatch, scene, one, h=h) for one in (choice, lambda *_, **__: None))
    return [abs(a - b).max(initial=0.0) / abs(b).max(initial=1e-300) for a, b in zip(found, expected, strict=True)]


@pytest.mark.parametrize("way", ["none", "some", "all"])
@pytest.mark.parametrize("name", ["lattice", "combs", "ladder"])
def test_corrections_of_radau_stages(monkeypatch, name, way):
    """To round-off in trees and at rest, of shifts that are a thousand times the accelerations."""
    assert max(radau_differences(monkeypatch, MACHINES[name](), forced(way), h=5e-3)) < 1e-9


@pytest.mark.parametrize("way", ["none", "some", "all"])
def test_corrections_of_radau_stages_of_loops_that_turn(monkeypatch, way):
    """What is left out of the accelerations, turns of rows times those of forces, over the shifts: as h squared."""
    scene, left = hammock(5), []
    for h in (1e-3, 5e-4):
        found, expected = (
            radau_parts(monkeypatch, scene, one, h=h) for one in (forced(way), lambda *_, **__: None)
        )
        left.append(abs(found[0] - expected[0]).max() / abs(expected[2]).max())
    assert left[0] < 1e-6
    assert left[0] / left[1] == pytest.approx(4.0, rel=0.1)


def test_loops_of_radau_iia_grow_with_the_machine():
    few, many = (radau_matrix(plan_of(ladder(k))).sparse[1] for k in (60, 120))
    assert many.operations < 2.0**1.25 * few.operations
    assert "sparse" in radau_matrix(plan_of(marbles(40))).text()


def cluster(count):
    """Stars that attract each other."""
    scene = fm.System()
    stars = [scene.add(fm.PointMass(1.0)) for _ in range(count)]
    for k, star in enumerate(stars):
        scene.connect(fm.joint.Translation(), scene.ground.frame((float(k), 0.1 * k**2, 0.0)), star.frame())
    scene.add_force(fm.force.Gravitation(stars, G=1.0))
    return scene


def test_groups_whose_pairs_attract_each_other_are_told():
    told = "dense, 90 unknowns: a force may join any two of its coordinates"
    for method in (ALPHA, RADAU):
        assert told in cluster(30).explain(integrator=method)


def test_the_cost_of_a_factorisation_is_that_of_the_matrix_it_has():
    """Of loops and trees it grows with the machine, of dense matrices of some hundred unknowns with the cube."""
    small, large = (counts(plan_of(ladder(k))).factor for k in (80, 160))
    assert small < large < 2.0**1.25 * small
    few, many = (counts(plan_of(cluster(k))).factor for k in (80, 160))
    assert many == pytest.approx(8.0 * few)
