"""Free bodies with history by central differences: waves, limits, momentum, energy, contact, bad input."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, RigidPlane, Support
from flexmbd.errors import ExplicitRunError, MeshError, SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity, neo_hookean, updated_lagrangian

WALL = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)


def rod(n, comm=MPI.COMM_WORLD):
    """Length 1 and wave speed 1, waves along x alone: nu = 0, and cells ten times as wide as long."""
    mesh = meshes.block(1.0, 10.0 / n, 10.0 / n, divisions=(n, 1, 1), comm=comm)
    material = j2_plasticity.Parameters(E=1.0, nu=0.0, rho=1.0, yield_stress=1e6)
    return NonlinearModel(mesh, j2_plasticity, material, degree=1)


def soft_block(form=hencky_plasticity, *, yield_stress=2e4, comm=MPI.COMM_WORLD, **options):
    mesh = meshes.block(1.0, 0.3, 0.4, divisions=(4, 2, 2), comm=comm)
    hardening = j2_plasticity.LinearHardening(1e5)
    material = form.Parameters(E=1e6, nu=0.3, rho=1000.0, yield_stress=yield_stress, hardening=hardening)
    return NonlinearModel(mesh, form, material, degree=1, **options)


def tumbling(x):
    return np.array([0.3, -0.2, 0.1]) + np.cross([1.0, -2.0, 3.0], x) + 2.0 * x * [1.0, -1.0, 0.5]


def rebound(n, penalty, share):
    """Duration of contact over 2 L / c, and speed of the centre of mass after it over that before."""
    run = ExplicitRun(rod(n), velocity=(-1e-3, 0.0, 0.0), planes=[RigidPlane(*WALL, penalty=penalty)])
    h, pushed = share * run.stable_step, []
    while run.t < 2.4:
        run.simulate(run.t + h, h=h, outputs=1)
        if abs(run.motion.a[run.motion.x[:, 0] < 0.5 / n, 0]).max() > 0.0 and run.motion.contacts.met.any():
            pushed.append(run.t)
    return pushed[-1], run.motion.momentum(np.zeros(3))[0] / run.motion.mass / 1e-3


def test_a_rod_stays_at_the_wall_while_the_wave_runs_there_and_back():
    errors = []
    for n in (20, 40):
        duration, speed = rebound(n, None, 1.0)
        errors.append(1.0 - speed)
        assert abs(duration - 2.0) < 1.5 / n
    # the first cell's layer arrives with half a cell's mass and stops there
    assert 0.0 < errors[1] < 0.6 * errors[0] < 0.03
    # a penalty gives way, and lets go a few steps later; it keeps the energy
    for n in (20, 40):
        duration, speed = rebound(n, 0.5, 0.95)
        assert 0.0 < duration - 2.0 < 6.0 / n
        assert abs(speed - 1.0) < 0.2 / n


def test_the_wave_is_the_exact_one_at_the_longest_step():
    """At h = dx / c central differences on the chain have no dispersion: d'Alembert's jump stays one cell wide."""
    run = ExplicitRun(rod(40), velocity=(-1e-3, 0.0, 0.0), planes=[RigidPlane(*WALL, penalty=None)])
    for _ in range(20):
        run.motion.advance(1.0 / 40)
    x, v = run.motion.mesh.X, run.motion.v[:, 0]
    middle = abs(x[:, 0] - 0.5) < 0.01 / 40
    assert abs(v[(x[:, 0] < 0.5) & ~middle]).max() < 1e-9
    assert abs(v[(x[:, 0] > 0.5) & ~middle] + 1e-3).max() < 1e-9
    assert abs(v[middle] + 0.5e-3).max() < 1e-9


def test_stable_below_the_critical_step_and_not_above():
    """The chain's largest frequency is 2 c / dx."""
    run = ExplicitRun(rod(20))
    assert run.stable_step == pytest.approx(1.0 / 20, rel=1e-3)
    for share, grows in ((0.99, False), (1.01, True)):
        motion = ExplicitRun(rod(20)).motion
        rng = np.random.default_rng(1)
        motion.v[:, 0] = 1e-12 * rng.choice([-1.0, 1.0], 21)[np.rint(20 * motion.x[:, 0]).astype(int)]
        for _ in range(400):
            motion.advance(share / 20)
        assert (abs(motion.v).max() > 1e-8) == grows, share
    with pytest.raises(SceneError, match=r"not above the stable step, 0\.0499"):
        run.simulate(1.0, h=1.01 / 20)


@pytest.mark.parametrize("form", [hencky_plasticity, j2_plasticity])
def test_a_free_body_keeps_its_momentum_and_energy(form):
    run = ExplicitRun(soft_block(form), velocity=tumbling)
    begun = run.motion.momentum(np.zeros(3))
    account = run.simulate(150 * run.stable_step, h=0.5 * run.stable_step, outputs=5)
    assert account["plastic"][-1] > 0.03 * account["kinetic"][0]
    assert abs(run.motion.momentum(np.zeros(3)) - begun).max() < 1e-12 * abs(begun).max()
    # of the formulas the balance is exact, and of the material it is one of the second order
    kept = account["kinetic"] + account.internal
    assert abs(kept - kept[0]).max() < 1e-12 * kept[0]
    assert account.error < 1e-2
    assert "closes within" in str(account)


@pytest.mark.parametrize("form", [hencky_plasticity, j2_plasticity])
def test_rigid_rotation_strains_nothing(form):
    """Nodes driven through a thousand turns, sixty degrees a step."""
    mesh = meshes.block(1.0, 1.0, 1.0, divisions=(1, 1, 1), comm=MPI.COMM_SELF)
    body = NonlinearModel(mesh, form, form.Parameters(1.0, 0.3, 1.0, 1e-3), degree=1)
    motion = ExplicitRun(body).motion
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    for k in range(1, 6001):
        motion.mesh.pull(motion.mesh.X @ Rotation.from_rotvec(np.pi / 3 * (k % 6) * axis).as_matrix().T, dt=0.0)
    assert max(abs(stress).max() for stress in body.stress()) < 1e-10
    assert max(abs(history).max() for history in body.history()) < 1e-10
    turned = motion.mesh.pull(motion.mesh.X @ Rotation.from_rotvec(1.0 * axis).as_matrix().T, dt=0.0)
    assert abs(turned).max() < 1e-10


def test_friction_slows_a_sliding_block_and_the_account_closes():
    """v = v0 - mu g t, its energy turned into that of friction."""
    body = soft_block(yield_stress=1e9)
    floor = RigidPlane((0.0, 0.0, -0.2), (0.0, 0.0, 2.0), friction=0.3, name="floor")
    run = ExplicitRun(body, velocity=(2.0, 0.0, 0.0), planes=[floor], gravity=(0.0, 0.0, -9.81))
    account = run.simulate(0.4, outputs=8)
    momentum = run.motion.momentum(np.zeros(3))[0] / run.motion.mass
    assert momentum == pytest.approx(2.0 - 0.3 * 9.81 * 0.4, abs=0.05)
    assert account["friction"][-1] == pytest.approx((2.0**2 - momentum**2) / 2 * 120.0, rel=0.05)
    assert account.error < 5e-3
    last = run.simulate(1.2, outputs=1)
    assert abs(run.motion.momentum(np.zeros(3))[0] / run.motion.mass) < 0.05
    assert last.t[-1] == 1.2


def test_held_components_stay():
    supports = [Support("x_min", x=True), Support("y_min", y=True, z=True)]
    run = ExplicitRun(soft_block(), velocity=tumbling, supports=supports)
    X = run.motion.x.copy()
    run.simulate(20 * run.stable_step, outputs=1)
    move = abs(run.motion.x - X)
    assert move[X[:, 0] < 1e-9, 0].max() == 0.0
    assert move[X[:, 1] < -0.15 + 1e-9][:, 1:].max() == 0.0
    assert move.max() > 1e-3


def test_a_snapshot_goes_on_to_the_bit():
    planes = [RigidPlane((-0.01, 0.0, 0.0), (1.0, 0.0, 0.0))]
    run = ExplicitRun(soft_block(), velocity=tumbling, planes=planes)
    h = 0.5 * run.stable_step
    for _ in range(20):
        run.motion.advance(h)
    kept = run.motion.snapshot()
    for _ in range(20):
        run.motion.advance(h)
    places, energies = run.motion.x.copy(), run.motion.energies()
    other = ExplicitRun(soft_block(), planes=planes).motion
    fresh = other.limit
    for motion in (run.motion, other):
        motion.restore(kept)
        for _ in range(20):
            motion.advance(h)
        assert np.array_equal(motion.x, places)
        assert motion.energies() == energies
    assert other.renew_limit() == run.motion.renew_limit() != fresh


def test_bad_input():
    with pytest.raises(SceneError, match=r"wall: the body begins 0\.01 m behind it"):
        ExplicitRun(soft_block(), planes=[RigidPlane((0.01, 0.0, 0.0), (1.0, 0.0, 0.0), name="wall")])
    with pytest.raises(SceneError, match="normal is zero"):
        RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    with pytest.raises(SceneError, match="penalty"):
        RigidPlane(*WALL, penalty=4.0)
    with pytest.raises(SceneError, match="friction"):
        RigidPlane(*WALL, friction=-0.1)
    with pytest.raises(SceneError, match="holds no component"):
        Support("x_min")
    with pytest.raises(MeshError, match="no facet group 'left'"):
        ExplicitRun(soft_block(), supports=[Support("left", x=True)])
    with pytest.raises(SceneError, match="velocity"):
        ExplicitRun(soft_block(), velocity=(1.0, 2.0))
    run = ExplicitRun(soft_block())
    with pytest.raises(SceneError, match=r"t_end = 1e\+15 s is so large that steps of .* s vanish in its round-off"):
        run.simulate(1e15)
    with pytest.raises(SceneError, match=r"outputs = 1e\+30 are more than memory holds"):
        run.simulate(1e-3, outputs=10**30)


def test_a_crushed_cell_is_named_and_what_was_noted_is_kept():
    run = ExplicitRun(soft_block(), velocity=(-300.0, 0.0, 0.0), planes=[RigidPlane(*WALL)])
    with pytest.raises(ExplicitRunError, match=r"at t = .* cell \d+, at .* is turned inside out|has fallen to"):
        run.simulate(0.01, h=0.9 * run.stable_step, outputs=100)
    assert len(run.account.t) == len(run.places) >= 1
    assert run.account.t[-1] <= run.t


@pytest.mark.parametrize("stretch", [(0.5, 1.0, 1.0), (0.4, 1.6, 1.6), (1.5, 1.0, 0.8)])
def test_the_stable_step_follows_the_shape(stretch):
    """Against that of a new body of that shape, of the same mass."""
    run = ExplicitRun(soft_block(yield_stress=1.0))
    motion = run.motion
    for share in np.linspace(0.0, 1.0, 11)[1:]:
        motion.mesh.pull(motion.mesh.X * (1.0 + share * (np.array(stretch) - 1.0)), dt=0.0)
        motion.renew_limit()
    mesh = meshes.block(*np.array(stretch) * [1.0, 0.3, 0.4], divisions=(4, 2, 2))
    material = hencky_plasticity.Parameters(1e6, 0.3, 1000.0 / np.prod(stretch), 1e9)
    fresh = ExplicitRun(NonlinearModel(mesh, hencky_plasticity, material, degree=1))
    assert 0.85 < run.stable_step / fresh.stable_step < 1.08


@pytest.mark.parametrize("stretch", [(0.5, 1.0, 1.0), (0.7, 0.8, 1.2), (1.2, 1.1, 1.0)])
def test_the_stable_step_of_the_initial_configuration_follows_the_shape(stretch):
    """Against the fastest vibration of the tangent there; crushed to a half, the step at rest is twice too long."""
    mesh = meshes.block(1.0, 0.3, 0.4, divisions=(4, 2, 2))
    body = NonlinearModel(mesh, neo_hookean, neo_hookean.Parameters(1e6, 0.3, 1000.0), degree=1)
    run = ExplicitRun(body)
    motion, rest = run.motion, run.stable_step
    for share in np.linspace(0.0, 1.0, 11)[1:]:
        motion.mesh.pull(motion.mesh.X * (1.0 + share * (np.array(stretch) - 1.0)), dt=0.0)
        motion.renew_limit()
    stiffness = body.tangent(np.zeros(body.layout.n_local)).convert("dense").getDenseArray()
    root = np.repeat(np.sqrt(motion.masses), 3)
    exact = 2.0 / np.sqrt(np.linalg.eigvalsh(stiffness / root / root[:, None])[-1])
    assert 0.75 < run.stable_step / min(exact, rest) < 1.08


def test_pressures_within_a_cell_stay_together_in_a_large_plastic_flow():
    """A copper rod on a wall: shapes of both updated formulations; strains of 1.5 with increments of 3 % a step."""
    ends = []
    for form in (hencky_plasticity, updated_lagrangian):
        mesh = meshes.round_bar(3.2e-3, 32.4e-3, divisions=(2, 2, 24))
        copper = form.Parameters(
            E=117e9, nu=0.35, rho=8930.0, yield_stress=0.4e9, hardening=j2_plasticity.LinearHardening(0.1e9)
        )
        body = NonlinearModel(mesh, form, copper, degree=1)
        run = ExplicitRun(
            body,
            velocity=(0.0, 0.0, -227.0),
            planes=[RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))],
            supports=[Support("x_min", x=True), Support("y_min", y=True)],
        )
        account = run.simulate(14e-6)
        x = run.motion.x
        ends.append([x[:, 2].max(), np.hypot(x[:, 0], x[:, 1]).max()])
        assert account.error < 0.05
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.02)
    stress = body.history()[0][:, :3].reshape(-1, 8, 3)
    pressure = stress.sum(axis=2) / 3
    # what Truesdell's rate makes of an elastic strain, |dev tau|^2 / (6 mu), and the flow stress
    flow = copper.yield_stress + copper.hardening.growth(body.history()[0][:, 6].max())
    assert np.ptp(pressure, axis=1).max() < flow**2 / (9 * copper.E / (2 * (1 + copper.nu)))
    assert abs(pressure).max() < 10 * copper.yield_stress  # 86 GPa and more where flow makes pressure


def test_an_inverted_cell_is_named():
    run = ExplicitRun(soft_block(), velocity=lambda x: np.where(x > 0.9, [-300.0, 0.0, 0.0], 0.0))
    with pytest.raises(ExplicitRunError, match=r"at t = .* s, step 1: cell \d+, at .* is turned inside out"):
        run.simulate(0.01, outputs=3)
    assert run.account.t == [0.0]


@pytest.mark.mpi
@pytest.mark.parametrize("form", [hencky_plasticity, j2_plasticity])
def test_all_ranks_together_do_what_one_does(form):
    if MPI.COMM_WORLD.size == 1 and form is j2_plasticity:
        return  # the same twice
    told = []
    for comm in (MPI.COMM_WORLD, MPI.COMM_SELF):
        floor = RigidPlane((0.0, 0.0, -0.2), (0.0, 0.0, 1.0), friction=0.2)
        run = ExplicitRun(soft_block(form, comm=comm), velocity=tumbling, planes=[floor], gravity=(0.0, 0.0, -9.81))
        account = run.simulate(0.05, h=1.2e-3, outputs=2)
        middle = run.motion.mesh.sum(run.motion.masses @ run.motion.x**2)
        told.append((np.array([*account.rows[-1].values()]), middle, run.stable_step))
    (first, places, limit), (second, others, single) = told
    assert abs(first - second).max() < 1e-9 * abs(second).max()
    assert places == pytest.approx(others, rel=1e-12)
    assert limit == pytest.approx(single, rel=1e-3)
