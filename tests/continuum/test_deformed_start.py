"""Bodies that are deformed and stressed when their motion begins: by themselves and between frames."""

from mpi4py import MPI

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    Support,
    follow,
    prescribed_dofs,
)
from flexmbd.errors import InterfaceError
from flexmbd.forms import hencky_plasticity, j2_plasticity

N, STRAIN = 10, 1e-3


def rod(names=(), *, form=j2_plasticity):
    """Length, wave speed, stiffness EA and density 1: nu = 0, and cells as wide as long but for the area of 0.01."""
    mesh = meshes.block(1.0, 1.0 / N, 1.0 / N, divisions=(N, 1, 1), comm=MPI.COMM_SELF)
    material = form.Parameters(E=100.0, nu=0.0, rho=100.0, yield_stress=1e6)
    return NonlinearModel(mesh, form, material, degree=1, interfaces=[Interface(name) for name in names])


def stretched(names=(), *, form=j2_plasticity, strain=STRAIN):
    body = rod(names, form=form)
    held = prescribed_dofs(body, {"x_min": "xyz", "x_max": "xyz"})
    x = body.layout.node_x.copy()
    left = x[:, 0].min()
    pull = body.layout.at_dofs((x - [left, 0.0, 0.0]) * [strain, 0.0, 0.0], owned=True)
    follow(body, [1.0], prescribed=held, displacement=lambda t: t * pull[held])
    return body


def bent(*, names=(), angle=0.2, released=False, comm=MPI.COMM_SELF):
    """A bar of 1 x 0.2 x 0.2 m whose end was turned until it yielded."""
    mesh = meshes.block(1.0, 0.2, 0.2, divisions=(6, 2, 2), comm=comm)
    hardening = j2_plasticity.LinearHardening(1e5)
    material = hencky_plasticity.Parameters(E=1e6, nu=0.3, rho=1000.0, yield_stress=1e4, hardening=hardening)
    body = NonlinearModel(mesh, hencky_plasticity, material, degree=1, interfaces=[Interface(name) for name in names])
    held = prescribed_dofs(body, {"x_min": "xyz", "x_max": "xyz"})
    x = body.layout.node_x
    end, face = x[:, 0] > 1.0 - 1e-9, np.array([1.0, 0.0, 0.0])

    def turn(t):
        R, u = Rotation.from_rotvec([0.0, t * angle, 0.0]).as_matrix(), np.zeros_like(x)
        u[end] = (x[end] - face) @ (R - np.eye(3)).T + t * angle * np.array([-0.1, 0.0, -0.3])
        return body.layout.at_dofs(u, owned=True)[held]

    path = follow(body, [0.25, 0.5, 0.75, 1.0], prescribed=held, displacement=turn)
    if released:
        path = follow(body, [2.0, 3.0], prescribed=prescribed_dofs(body, {"x_min": "xyz"}), reached=1.0)
    return body, path, held


def fixed(interior, *, comm=MPI.COMM_SELF):
    """A machine that holds the frames where they are, in axes that are turned."""
    R = Rotation.from_rotvec([0.3, 0.5, -0.2]).as_matrix()
    scene = fm.System(team=MpiTeam(comm))
    body = scene.add(fm.ContinuumBody(interior), name="part")
    for own in interior.frames:
        at = scene.ground.frame(p=R @ own.p_BI_B, R=R @ own.R_BI)
        scene.connect(fm.joint.Fixed(), at, body.frame(own.name))
    return scene, body, R


def test_residual_stress_in_balance_moves_nothing():
    """Bent until it yields and let go slowly, one end held: alone and on a frame it stays as it is, in its stress."""
    body, _, _ = bent(names=("x_min",), released=True)
    before, energy = body.node_x.copy(), body.energies()
    assert energy["plastic"] > energy["elastic"] > 0.0
    run = ExplicitRun(body, supports=[Support("x_min", x=True, y=True, z=True)])
    assert np.array_equal(run.motion.x, before)
    account = run.simulate(200 * run.stable_step, outputs=2)
    assert abs(run.motion.x - before).max() < 1e-9
    assert account["elastic"] == pytest.approx(energy["elastic"], rel=1e-9)
    for kind in (ExplicitContinuum, ImplicitContinuum):
        body, _, _ = bent(names=("x_min",), released=True)
        scene, part, _ = fixed(kind(body))
        h = 2e-3
        told = {"integrator": fm.CentralDifference()} if kind is ExplicitContinuum else {}
        run = scene.simulate(100 * h, h=h, **told)
        assert abs(run.interior_wrench(part, "x_min")).max() < 1e-6
        assert run.energies(part)["elastic"] == pytest.approx(energy["elastic"], rel=1e-9)
        assert abs(run.energies(part)["kinetic"]).max() < 1e-12 * energy["elastic"]


def test_a_stretched_rod_that_is_let_go_swings_by_its_wave(tmp_path):
    """Its end goes from + to - in the time 2 L / c, exactly at the longest step; free, alone and on a frame."""
    run = ExplicitRun(stretched(), supports=[Support("x_min", x=True, y=True, z=True)])
    end = run.motion.mesh.X[:, 0] > 0.5 / N + run.motion.mesh.X[:, 0].max() - 1.0 / N
    length = run.motion.mesh.X[end, 0].mean()
    steps = int(np.ceil(2.0 / run.stable_step))
    run.simulate(2.0, h=2.0 / steps, outputs=2)
    assert run.places[1][end, 0] == pytest.approx(length, abs=0.05 * STRAIN)
    assert run.places[2][end, 0] == pytest.approx(length - STRAIN, abs=0.05 * STRAIN)
    assert run.account.error < 1e-6
    for kind, h in ((ExplicitContinuum, 2.0 / steps), (ImplicitContinuum, 0.02)):
        interior = kind(stretched(("x_min",)))
        scene, body, R = fixed(interior)
        told = {"integrator": fm.CentralDifference()} if kind is ExplicitContinuum else {}
        kept = fm.Recording(tmp_path / "rod.h5", every=0.5)
        fields = scene.simulate(2.0, h=h, recording=kept, **told).recorded(body)
        point = fields.series("position", point=(length, 0.0, 0.0)) - R @ [length, 0.0, 0.0]
        assert point[0] @ R[:, 0] == pytest.approx(STRAIN, rel=1e-9), kind
        assert point[-1] @ R[:, 0] == pytest.approx(-STRAIN, abs=0.1 * STRAIN), kind


@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_frames_hold_a_bent_body_with_the_forces_that_it_was_bent_with(kind):
    """Both ends held where they were brought to, one of them turned: at rest, with the forces of slow loading."""
    body, path, held = bent(names=("x_min", "x_max"))
    interior = kind(body)
    scene, part, R = fixed(interior)
    energy, x = body.energies(), body.node_x.copy()
    h = 0.9 * interior.stable_step() if kind is ExplicitContinuum else 1e-2
    told = {"integrator": fm.CentralDifference()} if kind is ExplicitContinuum else {}
    run = scene.simulate(50 * h, h=h, **told)
    found = run.energies(part)
    for name in ("elastic", "plastic"):
        assert found[name] == pytest.approx(energy[name], rel=1e-3)
    force = np.zeros((body.layout.n_owned_nodes, 3))
    force.reshape(-1)[held] = path.steps[-1].reactions
    nodes = body.layout.node_x[:, 0]
    for k, end in enumerate((nodes < nodes.min() + 1e-9, nodes > nodes.max() - 1e-9)):
        own = interior.frames[k]
        expected = force[end].sum(axis=0), np.cross(x[end] - own.p_BI_B, force[end]).sum(axis=0)
        for row in (0, -1):
            wrench = -run.interior_wrench(part, own.name)[row]
            assert R.T @ wrench[:3] == pytest.approx(expected[0], abs=2e-3 * abs(expected[0]).max())
            assert R.T @ wrench[3:] == pytest.approx(expected[1], abs=2e-3 * abs(expected[1]).max())


@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_a_frame_on_an_interface_that_is_deformed_is_refused(kind):
    body = rod(("x_min", "x_max"))
    held = prescribed_dofs(body, {"x_min": "xyz", "x_max": "x"})
    wide = body.layout.at_dofs(body.layout.node_x * [0.0, 1e-3, 0.0], owned=True)
    held = np.union1d(held, prescribed_dofs(body, {"x_max": "xyz"})).astype(np.int32)
    left = prescribed_dofs(body, {"x_min": "xyz"})
    wide[left] = 0.0
    follow(body, [1.0], prescribed=held, displacement=lambda t: t * wide[held])
    with pytest.raises(InterfaceError, match="interface 'x_max': the body is deformed already, there not"):
        kind(body)


@pytest.mark.mpi
@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_all_ranks_together_do_what_one_does(kind):
    found = []
    for comm in (MPI.COMM_SELF, MPI.COMM_WORLD):
        scene, part, _ = fixed(kind(bent(names=("x_min", "x_max"), comm=comm)[0]), comm=comm)
        told = {"integrator": fm.CentralDifference()} if kind is ExplicitContinuum else {}
        run = scene.simulate(0.02, h=1e-3, **told)
        found.append(np.array([run.interior_wrench(part, end) for end in ("x_min", "x_max")]))
    assert abs(found[0] - found[1]).max() < 1e-6 * abs(found[0]).max()
