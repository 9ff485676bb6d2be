"""The files of docs/extending.md, each written to a folder and used as a stranger would."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from machines import pendulum, slider_crank
from particles import particle_body
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

import flexmbd as fm
from flexmbd.cli import main
from flexmbd.errors import ExportError

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
FILES = {
    block.split("\n", 1)[0].removeprefix("# "): block
    for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("outside")
    for name, text in FILES.items():
        (place / name).write_text(text, encoding="utf-8")
    return place


def module(folder, name):
    """One of the files, imported under its own name."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def test_all_files_are_used_and_none_looks_behind_the_doors():
    """Public names alone: rooms of `flexmbd`, and what UFL files may import."""
    assert set(FILES) == {
        "own_spring.py", "stick.py", "explicit_midpoint.py", "pin_in_slot.py", "bulk_and_shear.py", "modal_json.py",
        "sloshing.py", "bouc_wen.py", "bathe.py", "bdf2.py",
        "bogacki_shampine.py",
    }  # fmt: skip
    for name, text in FILES.items():
        assert len(text.splitlines()) <= 100, name
        assert re.findall(r"from flexmbd\.\w+\.", text) == []


def hanging(force, *numbers):
    """A turning body that hangs in a spring."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    body = scene.add(fm.RigidBody(1.3, (0.02, 0.03, 0.04)), name="body")
    joint = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    joint.velocity = (0.0, 0.0, 0.0, 1.0, -2.0, 0.5)
    scene.add_force(force(scene.ground.frame(p=(0.1, 0.5, 0.0)), body.frame(p=(0.2, 0.1, 0.05)), *numbers))
    return scene


def test_a_force(folder):
    """Without its cube it is the spring built in; with it, a step that keeps energy keeps its own."""
    spring = module(folder, "own_spring").HardeningSpring
    how = {"h": 5e-3, "integrator": fm.ExplicitRungeKutta()}
    own, theirs = (hanging(kind, 40.0, 0.3).simulate(0.5, **how) for kind in (spring, fm.force.SpringDamper))
    np.testing.assert_allclose(own.x, theirs.x, rtol=0.0, atol=1e-13)
    run = hanging(spring, 40.0, 0.3, 900.0).simulate(0.5, h=5e-3, integrator=fm.EnergyMomentum())
    assert np.ptp(run.energy().total) < 1e-11 * np.ptp(run.energy().kinetic)


def test_a_force_with_memory(folder, tmp_path):
    """A mass that slips to rest: the way that Coulomb's friction gives it, less what the stick springs back."""
    speed, mass, stiffness, most = 3.0, 2.0, 5e4, 40.0
    ends = []
    for method in (fm.ExplicitRungeKutta(), fm.GeneralizedAlpha(), fm.RadauIIA(), fm.EnergyMomentum()):
        scene = fm.System(gravity=(0.0, 0.0, 0.0))
        body = scene.add(fm.RigidBody(mass, (1.0, 1.0, 1.0)), name="body")
        joint = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame())
        force = scene.add_force(module(folder, "stick").Stick(joint, stiffness, most))
        joint.velocity = speed
        run = scene.simulate(0.2, rtol=1e-5, integrator=method, checkpoints=[0.1])
        again = scene.simulate(0.2, rtol=1e-5, integrator=method, restart=run.checkpoints[0])
        np.testing.assert_array_equal(again.x, run.x[-len(again.t) :])
        kept = run.remembered(force)
        # the work of the sliding force and what is stored in the stretched stick are all there is
        slipped = (0.5 * mass * speed**2 - 0.5 * most**2 / stiffness) / most
        assert kept["slipped"][-1] == pytest.approx(slipped, rel=2e-4)
        assert kept["dissipated"][-1] == pytest.approx(most * slipped, rel=2e-4)
        ends.append(kept["slipped"][-1])
    # where the law bends generalized-alpha keeps 2e-5 to 2e-4 from rtol 1e-4 to 1e-6, as the bend falls into a step
    assert np.ptp(ends) < 3e-4 * max(ends)


def test_a_force_with_states(folder):
    """A body on a mount with hysteresis in six directions, off its centre, against scipy's equations of the same."""
    stiffness, damping = np.array([900.0, 700.0, 1100.0, 30.0, 25.0, 40.0]), np.array([2.0, 1.0, 3.0, 0.02, 0.03, 0.01])
    most, share = np.array([2e-3, 3e-3, 2e-3, 0.01, 0.02, 0.015]), 0.2
    mass, J, com, arm = 1.3, np.array([0.02, 0.03, 0.04]), np.array([0.05, -0.02, 0.03]), np.array([0.1, 0.04, -0.06])
    gravity, foot = np.array([0.0, -9.81, 0.0]), np.array([0.1, 0.02, -0.05])
    R_F = Rotation.from_rotvec([0.4, -0.3, 0.6]).as_matrix()
    scene = fm.System(gravity=gravity)
    body = scene.add(fm.RigidBody(mass, J, com), name="body")
    fly = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    fly.velocity = (0.3, -0.2, 0.4, 0.5, -0.8, 0.6)
    mount = module(folder, "bouc_wen").Mount(
        scene.ground.frame(p=foot, R=R_F), body.frame(p=arm, R=R_F), stiffness, most, share=share, damping=damping
    )
    scene.add_force(mount)

    def rates(t, y):
        p, q, v, w, z = np.split(y, [3, 7, 10, 13])  # of the body frame: place, turn, velocity, spin in body axes
        R = Rotation.from_quat(q, scalar_first=True).as_matrix()
        d, rate = R_F.T @ (p + R @ arm - foot), R_F.T @ (v + R @ np.cross(w, arm))
        turned, spin = R_F.T @ R @ R_F, R_F.T @ R @ w
        way = np.concatenate([d, 0.5 * np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0],
                                                 turned[1, 0] - turned[0, 1]])])  # fmt: skip
        speed = np.concatenate([rate, spin])
        wrench = -stiffness * (share * way + (1.0 - share) * z) - damping * speed
        force, torque = R.T @ R_F @ wrench[:3], R.T @ R_F @ wrench[3:]  # in body axes
        about_com = torque + np.cross(arm - com, force)
        w_rate = (about_com - np.cross(w, J * w)) / J
        a = gravity + R @ force / mass - R @ (np.cross(w_rate, com) + np.cross(w, np.cross(w, com)))
        s, u = q[0], q[1:]
        q_rate = 0.5 * np.concatenate([[-u @ w], s * w + np.cross(u, w)])
        grown = speed * (1.0 - np.where(z * speed > 0.0, (np.abs(z) / most) ** 2, 0.0))
        return np.concatenate([v, q_rate, a, w_rate, grown])

    start = np.zeros(19)
    start[3], start[7:13] = 1.0, fly.velocity
    theirs = solve_ivp(rates, (0.0, 0.4), start, method="DOP853", rtol=1e-11, atol=1e-14).y[:, -1]
    run = scene.simulate(0.4, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    sizes = np.repeat([np.abs(theirs[:3]).max(), np.abs(theirs[3:7]).max()], [3, 4])
    np.testing.assert_allclose((run.x[-1][:7] - theirs[:7]) / sizes, 0.0, atol=1e-7)
    np.testing.assert_allclose((run.states(mount)[-1] - theirs[13:]) / most, 0.0, atol=1e-7)
    assert (np.abs(run.states(mount)).max(axis=0) > 0.5 * most).all()  # all six have yielded
    for method in (fm.RadauIIA(), fm.GeneralizedAlpha()):
        other = scene.simulate(0.4, rtol=1e-6, integrator=method)
        np.testing.assert_allclose((other.states(mount)[-1] - theirs[13:]) / most, 0.0, atol=1e-2)
    assert sum(name.startswith("Mount ") and name.endswith(".about z") for name in run.table().names) == 1


def test_an_integrator(folder, tmp_path):
    """Order 2 on a pendulum's closed form; error control; events; a loop; a restart to the bit."""
    method = module(folder, "explicit_midpoint").ExplicitMidpoint()
    period = 4.0 / np.sqrt(9.81) * ellipk(0.5)
    errors = []
    for steps in (200, 400, 800):
        scene, _, hinge = pendulum()
        run = scene.simulate(period, h=period / steps, integrator=method)
        errors.append(abs(run.beta(hinge)[-1] - run.beta(hinge)[0]))
    assert np.log2(errors[0] / errors[1]) > 1.8
    assert np.log2(errors[1] / errors[2]) > 1.8
    scene, _, hinge = pendulum()
    lowest = fm.Event(lambda moment: moment.beta(hinge) - 1.5 * np.pi, name="lowest")
    run = scene.simulate(period, rtol=1e-3, integrator=method, events=[lowest])
    assert [one.t for one in run.events] == pytest.approx([0.25 * period, 0.75 * period], abs=1e-3)
    crank = slider_crank()[0]
    own = crank.simulate(0.2, rtol=1e-3, integrator=method)
    best = crank.simulate(0.2, rtol=1e-9, integrator=fm.ExplicitRungeKutta())
    assert abs(own.x[-1] - best.x[-1]).max() < 1e-3
    whole = crank.simulate(0.2, rtol=1e-3, integrator=method, checkpoints=[0.1])
    kept = whole.checkpoints[0].save(tmp_path / "kept.npz")
    rest = crank.simulate(0.2, rtol=1e-3, integrator=method, restart=fm.Checkpoint.load(kept))
    np.testing.assert_array_equal(rest.x, whole.x[len(whole.t) - len(rest.t) :])


def test_an_explicit_tableau(folder):
    """Order 3 on a pendulum's closed form, and the error in proportion to rtol."""
    method = module(folder, "bogacki_shampine").METHOD
    period = 4.0 / np.sqrt(9.81) * ellipk(0.5)
    scene, _, hinge = pendulum()

    def error(**how):
        beta = scene.simulate(period, integrator=method, **how).beta(hinge)
        return abs(beta[-1] - beta[0])

    # at the turning point the angle is of one order more
    quarter = [abs(scene.simulate(0.25 * period, h=0.25 * period / n, integrator=method).beta(hinge)[-1] - 1.5 * np.pi)
               for n in (100, 200, 400)]  # fmt: skip
    orders = np.log2(np.array(quarter[:-1]) / np.array(quarter[1:]))
    assert (abs(orders - 3.0) < 0.1).all()
    assert error(rtol=1e-4) < 1e-2
    assert error(rtol=1e-8) < 1e-6


@pytest.mark.parametrize("name", ["bathe", "bdf2"])
def test_an_implicit_method(folder, tmp_path, name):
    """Order 2 on a pendulum, a heavy top and a loop with its reactions; error control; events; restart to the bit."""
    assert len(FILES[f"{name}.py"].splitlines()) <= 60
    method = getattr(module(folder, name), name.upper())
    top = fm.System(gravity=(0.0, 0.0, -9.81))
    body = top.add(fm.RigidBody(15.0, (0.234375, 0.46875, 0.234375), (0.0, 1.0, 0.0)), name="top")
    top.connect(fm.joint.Spherical(), top.ground.frame(), body.frame()).velocity = (0.0, 150.0, -4.61538)
    crank, _, turning = slider_crank()
    turning.position, turning.velocity = 0.3, 10.0
    for scene, t_end in ((pendulum()[0], 1.0), (top, 0.1), (crank, 0.16)):
        best = scene.simulate(t_end, rtol=1e-12, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        errors = []
        for steps in (400, 800, 1600):
            run = scene.simulate(t_end, h=t_end / steps, rtol=1e-10, integrator=method)
            pairs = (run.x, best.x), (run.v, best.v)
            errors.append([abs(a[-1] - b[-1]).max() for a, b in pairs])
        orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
        assert orders.min() > 1.85, (errors, orders)
        errors = []
        for rtol in (1e-4, 1e-6):
            run = scene.simulate(t_end, rtol=rtol, integrator=method)
            errors.append(abs(run.x[-1] - best.x[-1]).max())
        assert errors[0] < 60.0 * 1e-4
        assert 50.0 < errors[0] / errors[1] < 200.0  # in proportion
        if run.multipliers.size:
            size = abs(best.multipliers).max()
            np.testing.assert_allclose(run.multipliers[-1], best.multipliers[-1], atol=1e-4 * size)
    scene, _, hinge = pendulum()
    period = 4.0 / np.sqrt(9.81) * ellipk(0.5)
    lowest = fm.Event(lambda moment: moment.beta(hinge) - 1.5 * np.pi, name="lowest")
    run = scene.simulate(period, rtol=1e-5, integrator=method, events=[lowest])
    assert [one.t for one in run.events] == pytest.approx([0.25 * period, 0.75 * period], abs=1e-3)
    whole = crank.simulate(0.2, rtol=1e-4, integrator=method, checkpoints=[0.1])
    kept = whole.checkpoints[0].save(tmp_path / "kept.npz")
    rest = crank.simulate(0.2, rtol=1e-4, integrator=method, restart=fm.Checkpoint.load(kept))
    np.testing.assert_array_equal(rest.x, whole.x[len(whole.t) - len(rest.t) :])


def test_a_joint(folder):
    """By coordinates and by constraints alike."""
    joint = module(folder, "pin_in_slot").PinInSlot()
    ends = []
    for way in (fm.Way.COORDINATES, fm.Way.CONSTRAINTS):
        scene = fm.System(gravity=(3.0, -9.81, 0.0))
        body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.2, 0.1, 0.0)), name="body")
        scene.connect(joint, scene.ground.frame(), body.frame(), way=way)
        run = scene.simulate(0.7, rtol=1e-8, integrator=fm.ExplicitRungeKutta())
        ends.append(run.position(body.frame(p=(0.2, 0.1, 0.0)))[-1])
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)
    assert ends[0][0] > 0.5


def test_a_form(folder):
    """The same stiffness as the form built in, of the same material."""
    from flexmbd import forms, meshes
    from flexmbd.continuum import ContinuumModel, Interface
    from flexmbd.reduction import guyan

    form = module(folder, "bulk_and_shear")
    E, nu = 2.0e11, 0.3
    materials = {
        form: form.Parameters(K=E / (3.0 - 6.0 * nu), G=E / (2.0 + 2.0 * nu), rho=7850.0),
        forms.solid_linear: forms.solid_linear.Parameters(E=E, nu=nu, rho=7850.0),
    }
    ends = [Interface("x_min"), Interface("x_max")]
    mesh = meshes.block(0.3, 0.04, 0.06, divisions=(3, 1, 1))
    own, theirs = (
        guyan(ContinuumModel(mesh, one, material, degree=2, interfaces=ends), frame="x_min")
        for one, material in materials.items()
    )
    np.testing.assert_allclose(own.stiffness, theirs.stiffness, rtol=1e-9)
    assert own.mass == pytest.approx(theirs.mass, rel=1e-12)


def test_an_export_format(folder, tmp_path, monkeypatch):
    """Found by its path, also by the command."""
    monkeypatch.chdir(tmp_path)
    body = particle_body(3, modes=4).record
    body.save("cloud.h5")
    assert main(["export", "cloud.h5", "--to", str(folder / "modal_json.py"), "-o", "cloud.json"]) == 0
    found = json.loads(Path("cloud.json").read_text())
    assert found["mass"] == body.mass
    np.testing.assert_array_equal(found["frames"]["tip"], body.interface("tip").modes)
    with pytest.raises(ExportError, match=r"sloshing\.py has no FORMAT"):
        fm.export.format_named(str(folder / "sloshing.py"))
    with pytest.raises(ExportError, match=r"nothing\.py cannot be imported"):
        fm.export.format_named("nothing.py")


def test_a_body(folder):
    """A held tank feels k x0 cos(w t)."""
    scene = fm.System()
    tank = scene.add(fm.ContinuumBody(module(folder, "sloshing").Sloshing(2.0, 800.0, 0.01)), name="tank")
    held = scene.connect(fm.joint.Fixed(), scene.ground.frame(), tank.frame("tank"))
    run = scene.simulate(0.5, h=1e-3)
    late = 10.0 * 0.02**2 / 24.0  # phase (rad) at the end: central differences swing faster by (w h)^2 / 24
    np.testing.assert_allclose(run.reaction(held)[:, 0], -8.0 * np.cos(20.0 * run.t), atol=2.0 * 8.0 * late)
