"""Walls that further mass slows through their thickness: against eigenvalues, accounts, and bare ones."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.linalg import eigh

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import ExplicitContinuum, ExplicitRun, Interface, NonlinearModel, RigidPlane, Support
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.continuum.interior.thickness_mass import ThicknessMass
from flexmbd.errors import FormulationError, LockingWarning, SceneError
from flexmbd.forms import neo_hookean, solid_shell

ALUMINIUM = solid_shell.Parameters(E=7e10, nu=0.3, rho=2700.0)
LENGTH, WIDTH = 0.2, 0.04


def strip(divisions=(10, 2), *, thickness=1e-3, interfaces=(), comm=MPI.COMM_SELF):
    mesh = meshes.wall(meshes.sheet(LENGTH, WIDTH, divisions=divisions, comm=comm), thickness)
    return NonlinearModel(mesh, solid_shell, ALUMINIUM, degree=1, interfaces=[Interface(name) for name in interfaces])


def matrices(body, thickness):
    """Stiffness, lumped mass, and the mass with what is added, dense."""
    tangent = body.tangent(np.zeros(body.layout.n_local), dt=0.0)
    rows = np.arange(body.n_owned, dtype=np.int32)
    stiffness = np.array(tangent.getValues(rows, rows))
    bare = np.diag(np.repeat(NodalMotion(body).masses, 3))
    unit = np.eye(body.n_owned)
    added = np.column_stack([thickness.times(column.reshape(-1, 3)).reshape(-1) for column in unit])
    return (stiffness + stiffness.T) / 2, bare, bare + added


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_the_step_grows_to_that_of_the_wall_and_bending_stays(scale):
    """By eigenvalues of dense matrices: the stable step; what bending loses falls by the square of the cells' size."""
    losses = []
    for n in (1, 2):
        body = strip((10 * n, 2 * n))
        thickness = ThicknessMass(body, scale)
        K, bare, M = matrices(body, thickness)
        np.testing.assert_allclose(M, M.T, atol=0)
        np.testing.assert_allclose(M.sum(axis=1), bare.sum(axis=1), rtol=1e-9)  # translations feel nothing of it
        limit = NodalMotion(body, thickness=thickness).limit
        assert limit == pytest.approx(2.0 / np.sqrt(eigh(K, M, eigvals_only=True)[-1]), rel=1e-3)
        assert thickness.ratio == pytest.approx(scale * WIDTH / 2 / n / 1e-3)
        assert limit > 0.85 * thickness.ratio * NodalMotion(body).limit
        free = np.repeat(body.layout.node_x[:, 0] > body.layout.node_x[:, 0].min() + 1e-6, 3)
        held = np.ix_(free, free)
        slow, fast = (np.sqrt(eigh(K[held], mass[held], eigvals_only=True)[0]) for mass in (M, bare))
        losses.append(1.0 - slow / fast)
    # Rayleigh's quotient of a cantilever of the length l, whose nodes are as if L apart through it: half of the rotary
    # inertia (L / 2)^2 of a mass times the integral of the mode's slopes squared, 4.648 / l of the mode's own
    assert losses[0] == pytest.approx(4.648 / 8.0 * (scale * WIDTH / 2.0 / LENGTH) ** 2, rel=0.1)
    assert losses[0] / losses[1] == pytest.approx(4.0, rel=0.05)


def test_the_step_follows_what_is_crushed_along_the_wall():
    """The edges through it, the shortest, stay as long. Of one modulus, and denser: by the root of the length."""
    run = ExplicitRun(strip(), scaled_thickness=1.0)
    motion, rest = run.motion, run.stable_step
    for share in np.linspace(1.0, 0.6, 9)[1:]:
        motion.mesh.pull(motion.mesh.X * [share, 1.0, 1.0], dt=0.0)
        motion.renew_limit()
    assert run.stable_step == pytest.approx(np.sqrt(0.6) * rest, rel=0.03)


def test_a_tumbling_plate_keeps_its_momenta_and_energy():
    body = strip((8, 2), thickness=4e-3)

    def thrown(x):
        bends = np.column_stack([0 * x[:, 0], 3 + 0 * x[:, 0], 20 * np.sin(30 * x[:, 0])])
        return np.cross([40.0, 90.0, 60.0], x) + bends

    run = ExplicitRun(body, velocity=thrown, scaled_thickness=1.0)
    about = np.zeros(3)
    before = run.motion.momentum(about)
    run.simulate(0.004, outputs=40)
    size = np.linalg.norm(before.reshape(2, 3), axis=1)
    drift = np.linalg.norm((run.motion.momentum(about) - before).reshape(2, 3), axis=1)
    assert (drift < 1e-12 * size).all()
    total = run.account.total
    assert abs(total / total[0] - 1.0).max() < 1e-3
    assert run.account["elastic"].max() > 0.01 * total[0]


def test_a_wall_falls_with_gravity_held_and_damped_by_all_its_mass():
    """Gravity feels nothing of what is added; of edges of which one end is held along an axis the other moves."""
    body = strip((4, 2), thickness=2e-3)
    run = ExplicitRun(body, gravity=(0.0, 0.0, -9.81), damping=3.0, scaled_thickness=1.0)
    run.simulate(1e-3, outputs=1)
    falls = np.tile([0.0, 0.0, -9.81 * np.exp(-3e-3)], (len(run.motion.a), 1))
    np.testing.assert_allclose(run.motion.a, falls, rtol=1e-6, atol=1e-3)
    held = ExplicitRun(
        body, gravity=(0.0, 0.0, -9.81), supports=[Support("bottom", z=True)], scaled_thickness=1.0, damping=200.0,
        velocity=lambda x: np.column_stack([1.0 + 500.0 * x[:, 2], 0 * x[:, 0], 0 * x[:, 0]]),
    )  # fmt: skip
    held.simulate(1e-3, outputs=20)
    total = held.account.total
    assert abs(total / total[0] - 1.0).max() < 1e-4


def swung(scale):
    """Energies of a machine's body and where the tip is, of a strip that swings from a hinge by its edge."""
    body = strip((5, 1), thickness=8e-3, interfaces=("x_min", "x_max"))
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    interior = ExplicitContinuum(body, scaled_thickness=scale)
    wall = scene.add(fm.ContinuumBody(interior), name="wall")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), wall.frame("x_min"))
    hinge.velocity = (60.0,)
    run = scene.simulate(1.5e-3, integrator=fm.CentralDifference())
    return run, run.energy().total + sum(run.energies(wall).values()), run.position(wall.frame("x_max"))


def test_a_strip_on_a_hinge_swings_as_the_bare_one():
    """Its frames have the further rotary inertia of their edges, and the account of the machine knows of it."""
    (bare, at_rest, there), (run, total, tip) = (swung(scale) for scale in (0.0, 1.0))
    assert len(run.t) < len(bare.t) / 3
    assert abs(total - total[0]).max() < 2e-3 * abs(total[0])
    assert abs(at_rest - at_rest[0]).max() < 2e-3 * abs(at_rest[0])
    assert np.linalg.norm(tip[-1] - there[-1]) < 0.01 * np.linalg.norm(there[-1] - there[0])


def test_a_plate_that_hits_a_plane_keeps_its_account():
    body = strip((6, 2), thickness=4e-3)
    plane = RigidPlane(point=(0.0, 0.0, -2.001e-3), normal=(0.0, 0.0, 1.0), name="floor", friction=0.3)
    run = ExplicitRun(body, velocity=(2.0, 0.0, -3.0), planes=[plane], scaled_thickness=1.0)
    run.simulate(1e-3, outputs=20)
    total = run.account.total
    assert abs(total / total[0] - 1.0).max() < 1e-2
    assert run.motion.v[:, 2].mean() > 0.0


@pytest.mark.mpi
def test_ranks_share_edges():
    ends = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        run = ExplicitRun(
            strip(comm=comm),
            velocity=lambda x: np.column_stack([30 * x[:, 1], 1 + 0 * x[:, 0], 9 * np.sin(40 * x[:, 0])]),
            scaled_thickness=1.0,
        )
        run.simulate(3e-4, outputs=2)
        ends.append((run.motion.limit, run.motion.energies()["kinetic"], run.motion.memory.gather_nodes(run.motion.x)))
    (limit, kinetic, x), (of_all, their_energy, their_x) = ends
    assert of_all == pytest.approx(limit, rel=1e-9)
    assert their_energy == pytest.approx(kinetic, rel=1e-9)
    np.testing.assert_allclose(their_x, x, atol=1e-12)


def test_what_is_no_wall_is_told():
    with pytest.raises(SceneError, match="scaled_thickness must be from 0"):
        ExplicitRun(strip(), scaled_thickness=1.5)
    with pytest.raises(SceneError, match="scaled_thickness"):
        ExplicitRun(strip(), scaled_thickness="all")
    rubber = neo_hookean.Parameters(1e6, 0.4, 1000.0)
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    block = NonlinearModel(mesh, neo_hookean, rubber, degree=1)
    with pytest.raises(FormulationError, match="layered cells"):
        ExplicitRun(block, scaled_thickness=1.0)


def test_several_layers_are_refused():
    mesh = meshes.block(0.2, 0.04, 0.01, divisions=(4, 2, 2), comm=MPI.COMM_SELF)
    with pytest.warns(LockingWarning, match="third edges"):
        body = NonlinearModel(mesh, solid_shell, ALUMINIUM, degree=1)
    with pytest.raises(FormulationError, match="one cell through the thickness"):
        ExplicitRun(body, scaled_thickness=1.0)
