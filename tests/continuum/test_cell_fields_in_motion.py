"""Bodies with fields of one cell in machines, implicit and explicit; they yield, restart, are watched."""

from pathlib import Path

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    BodyAcceleration,
    ContinuumModel,
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    MpiTeam,
    NonlinearModel,
    Support,
    load_form,
    node_numbers,
)
from flexmbd.continuum.history.cell_fields_solved import CellFieldsSolved
from flexmbd.forms import j2_plasticity, solid_enhanced, solid_shell_plasticity
from flexmbd.forms.j2_plasticity import LinearHardening
from flexmbd.reduction import craig_bampton

DATA = Path(__file__).parents[1] / "data"
SOFT = solid_enhanced.Parameters(E=2e7, nu=0.3, rho=1000.0)
SELF, WORLD = MPI.COMM_SELF, MPI.COMM_WORLD
G = (0.0, 0.0, -9.81)


def yielding():
    form = load_form(DATA / "enhanced_plasticity.py")
    return form, form.Parameters(E=2e7, nu=0.3, rho=1000.0, yield_stress=1e5, hardening=LinearHardening(1e6))


def arm_mesh(comm=SELF, divisions=(6, 1, 1)):
    return meshes.block(1.0, 0.1, 0.1, divisions=divisions, comm=comm)


def arm(form=solid_enhanced, p=SOFT, *, comm=SELF, divisions=(6, 1, 1)):
    return NonlinearModel(arm_mesh(comm, divisions), form, p, degree=1, interfaces=[Interface("x_min")])


def pendulum(part, *, comm=SELF, gravity=G):
    """On a hinge about y, level at the start; returns the scene, the part and its frame."""
    scene = fm.System(gravity=gravity, team=MpiTeam(comm))
    body = scene.add(part, name="arm")
    frame = body.frame("x_min")
    scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), frame)
    return scene, body, frame


def turned(run, frame):
    """Of the hinge, (nt,) rad."""
    R = run.rotation(frame)
    return np.arctan2(R[:, 0, 2], R[:, 0, 0])


def test_a_pendulum_of_bricks_swings_as_its_reduced_body():
    """One brick through the thickness: so soft that it bends by a twentieth of its length."""
    cells = (12, 1, 1)  # lumped, the arm has 1 / (2 n^2) = 0.35 % more inertia about its end
    model = ContinuumModel(arm_mesh(divisions=cells), solid_enhanced, SOFT, degree=1, interfaces=[Interface("x_min")])
    angles = []
    parts = (
        fm.FlexibleBody(craig_bampton(model, modes=6, frame="x_min")),
        fm.ContinuumBody(ImplicitContinuum(arm(divisions=cells))),
        fm.ContinuumBody(ExplicitContinuum(arm(divisions=cells))),
    )
    methods = fm.GeneralizedAlpha(), fm.GeneralizedAlpha(), fm.CentralDifference()
    for part, method in zip(parts, methods, strict=True):
        scene, body, frame = pendulum(part)
        steps = {"rtol": 1e-5} if isinstance(method, fm.GeneralizedAlpha) else {}
        run = scene.simulate(0.2, integrator=method, **steps)
        angles.append(turned(run, frame)[-1])
        if part is parts[0]:
            continue
        own = sum(run.energies(body).values())
        total = own + run.energy().total
        size = np.ptp(run.energies(body)["gravitational"])
        assert abs(total - total[0]).max() < 2e-3 * size
    assert abs(angles[0]) > 0.2
    assert angles[1] == pytest.approx(angles[0], rel=5e-3)
    assert angles[2] == pytest.approx(angles[0], rel=8e-3)


@pytest.mark.parametrize("kind", [ExplicitContinuum, ImplicitContinuum])
def test_a_restart_goes_on_to_the_bit(kind):
    form, p = yielding()
    method = fm.CentralDifference() if kind is ExplicitContinuum else fm.GeneralizedAlpha()
    ends, kept = [], None
    for restart in (False, True):
        scene, body, frame = pendulum(fm.ContinuumBody(kind(arm(form, p))), gravity=(0.0, 0.0, -300.0))
        steps = {"h": 5e-4} if kind is ImplicitContinuum else {}
        given = {"restart": kept} if restart else {"checkpoints": [0.015]}
        run = scene.simulate(0.025, integrator=method, **steps, **given)
        kept = run.checkpoints[0] if not restart else None
        ends.append((run.position(frame)[-1], run.rotation(frame)[-1], run.energies(body)["plastic"][-1]))
    assert ends[0][2] > 0.0
    for one, other in zip(*ends, strict=True):
        assert np.array_equal(one, other)


def test_explicit_steps_keep_the_account_of_a_bar_that_yields():
    """A bar hits a wall, in twenty steps: its account closes as that of plain bricks, and as with exact fields."""
    bricks, material = yielding()
    plain = j2_plasticity.Parameters(
        material.E, material.nu, material.rho, material.yield_stress, material.hardening
    )
    found, errors = [], []
    for form, p, exact in ((j2_plasticity, plain, False), (bricks, material, False), (bricks, material, True)):
        mesh = meshes.block(0.3, 0.1, 0.1, divisions=(6, 2, 2), comm=SELF)
        body = NonlinearModel(mesh, form, p, degree=1)
        if exact:
            body.step = _exact(body)
        run = ExplicitRun(body, velocity=(-1.0, 0.0, 0.0), supports=[Support("x_min", x=True)])
        account = run.simulate(4e-3)
        errors.append(account.error)
        assert account["plastic"][-1] > 0.5 * account["kinetic"][0]
        found.append([account[name][-1] for name in ("plastic", "elastic", "kinetic")])
    assert max(errors[1:]) < 1.1 * errors[0] < 0.01
    assert found[1] == pytest.approx(found[2], rel=0, abs=5e-4 * max(found[2]))


def test_tangents_of_cells_are_few(monkeypatch):
    """One of each cell at rest tells the stable step; then the kept ones learn how the wall flows, all over."""
    renewed = []
    renew = CellFieldsSolved.renew
    monkeypatch.setattr(CellFieldsSolved, "renew", lambda self, cells: renewed.append(len(cells)) or renew(self, cells))
    wall = meshes.wall(meshes.sheet(0.06, 0.04, divisions=(6, 4), comm=SELF), 0.004)
    steel = solid_shell_plasticity.Parameters(
        E=2.1e11, nu=0.3, rho=7850.0, yield_stress=2.5e8, hardening=LinearHardening(8e8)
    )
    body = NonlinearModel(wall, solid_shell_plasticity, steel, degree=1)
    renewed.clear()
    run = ExplicitRun(body, velocity=lambda x: x * [100.0, -50.0, -30.0] + np.sin(200 * x[:, :1]) * [0.0, 0.0, 20.0])
    assert sum(renewed) <= 24
    renewed.clear()
    h = 0.9 * run.motion.limit
    account = run.simulate(60 * h, h=h)
    assert account["plastic"][-1] > 0.2 * account["kinetic"][0]
    assert sum(renewed) <= 24 + 0.05 * 24 * 60


def test_the_columns_of_fields_are_those_of_the_whole_tangent():
    """Of bricks that yield: inverse and coupling, as explicit steps keep them, and those of the condensed tangent."""
    form, p = yielding()
    body = NonlinearModel(meshes.block(0.3, 0.1, 0.1, divisions=(3, 2, 2), comm=SELF), form, p, degree=1)
    x, u = body.layout.node_x, np.zeros(body.layout.n_local)
    u[body.displacement_dofs] = 0.02 * np.column_stack([x[:, 0] * x[:, 2], x[:, 1] ** 2, x[:, 0] + x[:, 1]])
    body.tangent(u)
    (history,), cells = body._histories, body.groups[0].cells
    assert history._pass.trial.max() > 0.0
    kept, found = history.solved.unknowns, []
    for take in (history.solved.condensed, history.solved.renew):
        kept.inverse[:], kept.coupling[:] = 0.0, 0.0
        take(cells)
        found.append((kept.inverse.copy(), kept.coupling.copy()))
    for whole, columns in zip(*found, strict=True):
        assert abs(whole).max() > 0.0
        assert np.allclose(columns, whole, rtol=0, atol=1e-12 * abs(whole).max())


def _exact(body):
    """`NonlinearModel.step` that solves for the fields of one cell as implicit steps do."""

    def step(increment, *, dt=None):
        force = body.force(increment, dt=dt)
        body.commit(increment, dt=dt)
        return force

    return step


def test_stresses_and_series_have_the_fields(tmp_path):
    """Uniform tension of a bar of distorted bricks: the stress is that of the load everywhere, also over time."""
    mesh, ends = arm_mesh(divisions=(3, 2, 2)), [Interface("x_min"), Interface("x_max")]
    body = NonlinearModel(mesh, solid_enhanced, SOFT, degree=1, interfaces=ends)
    u = np.zeros((body.layout.n_owned_nodes, 3))
    u[:, 0], u[:, 1:] = 1e-4 * body.layout.node_x[:, 0], -0.3e-4 * body.layout.node_x[:, 1:]
    u[:, 2] += 1e-3 * body.layout.node_x[:, 0] * body.layout.node_x[:, 2]  # bends nothing that bricks cannot
    values = np.zeros(body.layout.n_local)
    values[body.displacement_dofs] = u
    body.force(values)
    body.commit(values)
    coupled = NonlinearModel(arm_mesh(divisions=(3, 2, 2)), solid_enhanced, SOFT, degree=1, condense=False)
    d = coupled.displacement_dofs.reshape(-1)
    whole = np.zeros(coupled.layout.n_local)
    whole[coupled.displacement_dofs[np.argsort(node_numbers(coupled))]] = u[np.argsort(node_numbers(body))]
    a = np.setdiff1d(np.arange(len(whole)), d)
    for _ in range(6):
        tangent = coupled.tangent(whole)
        rows = np.arange(len(whole), dtype=np.int32)
        dense = tangent.getValues(rows, rows)[np.ix_(a, a)]
        whole[a] -= np.linalg.solve(dense, coupled.force(whole)[a])
    coupled.commit(whole)
    stress, same = body.stress()[0], coupled.stress()[0]
    assert np.allclose(stress, same, rtol=0, atol=1e-9 * abs(same).max())
    assert body.energies()["elastic"] == pytest.approx(coupled.energies()["elastic"], rel=1e-10)

    scene = fm.System(team=MpiTeam(SELF))
    part = scene.add(fm.ContinuumBody(ImplicitContinuum(arm(), loads=[BodyAcceleration((0.0, 0.0, -1.0))])), name="arm")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), part.frame("x_min"))
    run = scene.simulate(0.02, h=2e-3, recording=fm.Recording(tmp_path / "arm.h5", every=4e-3))
    above, below = (run.recorded(part).series("stress", point=(0.25, 0.0, z))[-1, 0] for z in (0.05, -0.05))
    # it bends: tension above, as much compression below
    assert above > 0.0
    assert above == pytest.approx(-below, rel=0.05)


@pytest.mark.mpi
def test_the_same_motion_on_any_number_of_ranks():
    form, p = yielding()
    found = []
    for comm in (SELF, WORLD):
        for kind, method in ((ImplicitContinuum, fm.GeneralizedAlpha()), (ExplicitContinuum, fm.CentralDifference())):
            part = fm.ContinuumBody(kind(arm(form, p, comm=comm, divisions=(4, 2, 1))))
            scene, body, frame = pendulum(part, comm=comm, gravity=(0.0, 0.0, -300.0))
            steps = {"h": 1e-3} if kind is ImplicitContinuum else {}
            run = scene.simulate(0.02, integrator=method, **steps)
            energies = (run.energies(body)[name][-1] for name in ("elastic", "plastic"))
            found.append([*run.rotation(frame)[-1].ravel(), *energies])
    n = len(found) // 2
    assert found[0][-1] > 0.0
    for alone, together in zip(found[:n], found[n:], strict=True):
        assert together == pytest.approx(alone, rel=1e-6, abs=1e-8 * max(map(abs, alone)))
