"""Explicit runs: damping against closed forms, contact when the step changes, hardening curves, degree 2."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.optimize import brentq

from flexmbd import meshes
from flexmbd.continuum import ExplicitRun, NonlinearModel, RigidPlane, Support
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.errors import SceneError
from flexmbd.forms import hencky_plasticity, j2_plasticity
from flexmbd.forms.j2_plasticity import LinearHardening, TabulatedHardening, VoceHardening


def block(form, hardening, *, divisions=(1, 1, 1), cell="hexahedron", degree=1, E=1e6, yield_stress=1e6, size=1.0):
    mesh = meshes.block(
        size, size, size, divisions=divisions, cell=cell, degree=degree, comm=MPI.COMM_SELF
    )  # fmt: skip
    material = form.Parameters(E, 0.3, 1000.0, yield_stress, hardening=hardening)
    return NonlinearModel(mesh, form, material, degree=degree)


def rod(n, **options):
    """Length 1 and wave speed 1, waves along x alone."""
    mesh = meshes.block(1.0, 10.0 / n, 10.0 / n, divisions=(n, 1, 1), comm=MPI.COMM_SELF)
    material = j2_plasticity.Parameters(E=1.0, nu=0.0, rho=1.0, yield_stress=1e6)
    return ExplicitRun(NonlinearModel(mesh, j2_plasticity, material, degree=1), **options)


def test_damping_of_one_mode():
    """The chain's first mode, 2 n sin(pi / 2 n): q' ' + c q' + w^2 q = 0, and the energy that it has lost."""
    n, c, t_end, size = 16, 1.5, 1.0, 1e-5
    w = 2 * n * np.sin(np.pi / (2 * n))
    wd, d = np.sqrt(w**2 - c**2 / 4), c / 2
    q = size / wd * np.exp(-d * t_end) * np.sin(wd * t_end)
    v = size * np.exp(-d * t_end) * (np.cos(wd * t_end) - d / wd * np.sin(wd * t_end))
    modal = (10.0 / n) ** 2 / 2  # kg, of the mode
    off = []
    for steps in (40, 80):
        run = rod(n, velocity=lambda x: size * np.cos(np.pi * x) * [1.0, 0.0, 0.0], damping=c)
        account = run.simulate(t_end, h=t_end / steps, outputs=1)
        X = run.motion.mesh.X
        found = run.motion.masses @ ((run.motion.x - X)[:, 0] * np.cos(np.pi * X[:, 0])) / modal
        lost = modal / 2 * (size**2 - v**2 - w**2 * q**2)
        off.append([abs(found - q) * wd / size, abs(account["damping"][-1] / lost - 1.0)])
        # of the formulas the balance is exact
        kept = account["kinetic"] + account.internal + account["damping"]
        assert abs(kept - kept[0]).max() < 1e-12 * kept[0]
        assert account["damping"][-1] > 0.5 * kept[0]
    assert np.all(np.array(off[1]) < 0.3 * np.array(off[0]))
    assert max(off[1]) < 1e-3


def test_damping_of_a_falling_body():
    """v = g / c (1 - exp(-c t)), and no shorter stable step."""
    g, c = np.array([0.0, 0.0, -9.81]), 3.0
    run = ExplicitRun(block(hencky_plasticity, LinearHardening(1e5)), gravity=g, damping=c)
    assert run.stable_step == ExplicitRun(block(hencky_plasticity, LinearHardening(1e5))).stable_step
    account = run.simulate(2.0, outputs=4)
    v = run.motion.momentum(np.zeros(3))[:3] / run.motion.mass
    assert v == pytest.approx(g / c * (1.0 - np.exp(-2.0 * c)), rel=1e-4, abs=1e-12)
    lost = 1000.0 * 9.81**2 / c * (2.0 - 2 / c * (1 - np.exp(-2 * c)) + (1 - np.exp(-4 * c)) / (2 * c))
    assert account["damping"][-1] == pytest.approx(lost, rel=1e-3)
    assert account.error < 1e-10


def test_damping_and_contact_end_a_step_on_the_plane():
    run = ExplicitRun(
        block(hencky_plasticity, LinearHardening(1e5)),
        velocity=(0.0, 0.0, -1.0), gravity=(0.0, 0.0, -9.81), damping=20.0,
        planes=[RigidPlane((0.0, 0.0, -0.51), (0.0, 0.0, 1.0), penalty=None)],
    )  # fmt: skip
    account = run.simulate(0.3, h=0.5 * run.stable_step, outputs=2)
    assert abs(run.motion.x[:, 2] + 0.51)[run.motion.mesh.X[:, 2] < 0.0].max() < 1e-12
    assert account.error < 1e-2


@pytest.mark.parametrize("shares", [(0.9, 0.45), (0.45, 0.9)])
def test_contact_gives_back_what_it_took_when_the_step_changes(shares):
    """A rod against a wall: what the penalty holds is the same function of the depth at any step."""
    run = rod(20, velocity=(-1e-3, 0.0, 0.0), planes=[RigidPlane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))])
    h = run.stable_step
    for k in range(13):
        account = run.simulate(0.2 * (k + 1), h=shares[k % 2] * h, outputs=1)
    begun = account["kinetic"][0]
    assert account["contact"].max() > 0.15 * begun
    assert abs(account["contact"][-1]) < 2e-3 * begun
    assert account.error < 2e-3
    # nothing comes of nothing
    assert run.motion.momentum(np.zeros(3))[0] / run.motion.mass == pytest.approx(1e-3, rel=0.02)


CURVES = {
    "Voce": (VoceHardening(2e4, 30.0, 1e4), lambda a: 2e4 * (1.0 - np.exp(-30.0 * a)) + 1e4 * a),
    "Table": (
        TabulatedHardening((0.0, 0.02, 0.05, 0.2), (2e4, 3e4, 3.5e4, 4e4)),
        lambda a: np.interp(a, (0.0, 0.02, 0.05, 0.2), (0.0, 1e4, 1.5e4, 2e4)),
    ),
}


@pytest.mark.parametrize("name", CURVES)
@pytest.mark.parametrize("form", [hencky_plasticity, j2_plasticity])
def test_a_slow_pull_follows_the_hardening_curve(name, form):
    """One brick pulled at its end: the stress is that of the curve, solved for by itself along one axis."""
    hardening, growth = CURVES[name]
    body = block(form, hardening, yield_stress=2e4)
    far = np.flatnonzero(body.layout.node_x[:, 0] > 1.0 - 1e-9).astype(np.int32)
    near = [np.flatnonzero(abs(body.layout.node_x - x - [-1.0, 0.0, 0.0]).max(axis=1) < 1e-9)[0]
            for x in body.layout.node_x[far]]  # fmt: skip
    motion = NodalMotion(body, supports=[Support(f"{axis}_min", **{axis: True}) for axis in "xyz"],
                         damping=20.0, bonded=far)  # fmt: skip
    motion.begin(np.zeros(3), np.eye(3), np.zeros(3))
    h, steps, strains = 0.5 * motion.limit, 2000, []
    for k in range(1, steps + 1):
        # gently off, and the end as wide as the other one
        pulled = 0.06 * (k / steps) ** 2 if form is j2_plasticity else np.expm1(0.06 * (k / steps) ** 2)
        ends = motion.x[near] + [1.0, 0.0, 0.0]
        ends[:, 0] = 1.0 + pulled
        motion.advance(h, ends)
        if k % 400 == 0:
            force = -motion.force[far, 0].sum()
            strain = pulled if form is j2_plasticity else np.log1p(pulled)
            stress = force if form is j2_plasticity else force * (1.0 + pulled)
            expected = brentq(lambda s, e=strain: s - min(1e6 * e, 2e4 + growth(max(e - s / 1e6, 0.0))), 0.0, 1e6)
            strains.append((stress, expected))
    for stress, expected in strains:
        assert stress == pytest.approx(expected, rel=3e-3)
    assert strains[-1][1] > 3e4


def bent(form, cell, yield_stress):
    """A block of degree 2 whose edges and faces are curved."""
    mesh = meshes.block(1.0, 0.4, 0.5, divisions=(2, 1, 1), cell=cell, degree=2, comm=MPI.COMM_SELF)
    x = mesh.mesh.geometry.x
    x[:, 2] += 0.15 * x[:, 0] ** 2 + 0.1 * x[:, 1] * x[:, 0]
    material = form.Parameters(1e6, 0.3, 1000.0, yield_stress, hardening=LinearHardening(1e5))
    return NonlinearModel(mesh, form, material, degree=2)


SECOND = [(hencky_plasticity, "tetrahedron"), (j2_plasticity, "tetrahedron"), (hencky_plasticity, "hexahedron")]


@pytest.mark.parametrize(("form", "cell"), SECOND)
def test_curved_cells_of_degree_two_fly_and_yield(form, cell):
    """Lumped by Hinton's rule: momenta to round-off, and the account closes."""
    run = ExplicitRun(
        bent(form, cell, 2e4),
        velocity=lambda x: np.array([0.3, -0.2, 0.1]) + np.cross([1.0, -2.0, 3.0], x) + 3.0 * x * [1.0, -1.0, 0.5],
    )
    assert run.motion.masses.min() > 0.0
    begun = run.motion.momentum(np.zeros(3))
    account = run.simulate(0.1, h=0.5 * run.stable_step, outputs=4)
    assert account["plastic"][-1] > 0.05 * account["kinetic"][0]
    assert abs(run.motion.momentum(np.zeros(3)) - begun).max() < 1e-12 * abs(begun).max()
    kept = account["kinetic"] + account.internal
    assert abs(kept - kept[0]).max() < 1e-12 * kept[0]
    assert account.error < 1e-2


@pytest.mark.parametrize(("form", "cell"), SECOND)
def test_the_limit_of_degree_two(form, cell):
    """That of the dense eigenproblem; stable below it, and not above."""
    run = ExplicitRun(bent(form, cell, 1e9))
    body, motion = run.motion.body, run.motion
    units = 1e-7 * np.eye(body.n_owned)
    K = np.array([(body.force(unit) - body.force(-unit)) / 2e-7 for unit in units])
    body.revert()
    root = np.sqrt(np.repeat(motion.masses, 3))
    limit = 2.0 / np.sqrt(np.linalg.eigvalsh((K + K.T) / 2 / np.outer(root, root))[-1])
    assert run.stable_step == pytest.approx(limit, rel=1e-3)
    speed = 1e-9 * np.random.default_rng(1).standard_normal(motion.v.shape)
    for share, grows in ((0.99, False), (1.01, True)):
        motion.begin(np.zeros(3), np.eye(3), np.zeros(3))
        motion.v[:] = speed
        for _ in range(60):
            motion.advance(share * limit)
        assert (abs(motion.v).max() > 1e-6) == grows, share


def test_bad_damping():
    with pytest.raises(SceneError, match="damping must be finite and at least 0"):
        ExplicitRun(block(hencky_plasticity, LinearHardening(1e5)), damping=-1.0)
