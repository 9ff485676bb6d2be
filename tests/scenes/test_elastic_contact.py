"""Reduced bodies that touch by their contact patches: against waves, statics and other sizes of patches."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import SceneError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, ModalDamping, Patch, craig_bampton


@pytest.fixture(scope="module")
def bar():
    """Of Doyen, Ern & Piperno 2011: 10 m long, E = 900 Pa, 1 kg/m^3, with three modes along it."""
    material = solid_linear.Parameters(E=900.0, nu=0.0, rho=1.0)
    model = ContinuumModel(meshes.block(1.0, 1.0, 10.0, divisions=(1, 1, 40)), solid_linear, material, degree=2)
    foot = Patch("foot", size=2.0, facets="z_min")
    with pytest.warns(fm.ModesWarning):
        return craig_bampton(model, modes=20, geometric_stiffness=False, contact=[foot], keep=Keep(modes=True))


@pytest.mark.parametrize("name", ["radau", "generalized-alpha", "explicit", "energy-momentum"])
def test_the_bouncing_bar(bar, name):
    """Falls 5 m, meets at 1 s with 10 m/s, and leaves after two passages of its wave at 30 m/s: impulse 800/3 N s."""
    methods = {
        "radau": (fm.RadauIIA(), 1e-5), "generalized-alpha": (fm.GeneralizedAlpha(), 1e-4),
        "explicit": (fm.ExplicitRungeKutta(), 1e-6), "energy-momentum": (fm.EnergyMomentum(), 1e-3),
    }  # fmt: skip
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(fm.FlexibleBody(bar), name="bar")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 0.0)
    floor = contact.HalfSpace(scene.ground.frame())
    (pair,) = scene.touch(contact.ElasticSurface(body, "foot"), floor, contact.Hard())
    integrator, rtol = methods[name]
    run = scene.simulate(2.0, rtol=rtol, integrator=integrator)
    t = np.linspace(0.95, 2.0, 4001)
    (met,) = run.contacts(pair, t=t)
    force = met.normal_force[:, 0]
    assert np.trapezoid(force, t) == pytest.approx(800.0 / 3.0, rel=0.02)
    touching = t[force > 0.0]
    assert touching[0] == pytest.approx(1.0, abs=2e-3)
    assert touching[-1] == pytest.approx(5.0 / 3.0, abs=0.06)  # of three modes
    assert (met.gap >= -1e-12).all()
    energy = run.energy().total
    assert np.abs(energy / energy[0] - 1.0).max() < {"generalized-alpha": 0.01, "energy-momentum": 1e-8}.get(name, 1e-3)


@functools.cache
def block(size):
    """4 cm wide and 2 cm high, held below, the middle of its top in patches of ``size``."""
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    mesh = meshes.block(0.04, 0.04, 0.02, divisions=(8, 8, 3))
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=[Interface("z_min")])
    pad = Patch("pad", size=size, facets=lambda x: (x[2] > 0.0099) & (abs(x[0] - 0.02) < 0.0101) & (abs(x[1]) < 0.0101))
    return craig_bampton(model, modes=6, frame="z_min", contact=[pad], keep=Keep(modes=True))


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
def test_an_equilibrium_is_the_pressed_body():
    """A large ball pressed in by 10 um: forces of patches by the statics of the record, which are the full model's."""
    record = block(5e-3)
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(record), name="block")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("z_min"))
    x = record.contact.x
    n, radius, depth = record.contact.axes[0, :, 0], 2.0, 1e-5
    centre = x.mean(axis=0) + (radius - depth) * n
    ball = contact.Sphere(scene.ground.frame(p=centre), radius)
    (pair,) = scene.touch(contact.ElasticSurface(body), ball, contact.Hard())
    rest = scene.equilibrium()
    run = scene.simulate(1e-6, about=rest, rtol=1e-3)
    (met,) = run.contacts(pair)
    away = x - centre
    gap = np.linalg.norm(away, axis=1) - radius
    pressed = contact.press(record, gap=gap, normal=away)
    assert (pressed.force > 0.0).sum() > 3
    np.testing.assert_allclose(met.normal_force[0], pressed.force, atol=1e-5 * pressed.force.max())



def test_two_bars_exchange_their_speeds(bar):
    """The one that flies stops, after two passages of the wave, 2 L / c = 2/3 s (Timoshenko & Goodier)."""
    scene = fm.System()
    bodies = [scene.add(fm.FlexibleBody(bar), name=name) for name in ("upper", "lower")]
    joints = [scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame()) for body in bodies]
    joints[0].position, joints[0].velocity = (0.0, 0.0, 5.1, 1.0, 0.0, 0.0, 0.0), (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    joints[1].position = (0.0, 0.0, -5.0, 0.0, 1.0, 0.0, 0.0)  # its foot is above
    (pair,) = scene.touch(*map(contact.ElasticSurface, bodies), contact.Hard())
    run = scene.simulate(1.0, rtol=1e-5, integrator=fm.EnergyMomentum())
    t = np.linspace(0.0, 1.0, 4001)
    force = run.contacts(pair, t=t)[0].normal_force[:, 0]
    assert t[force > 0.0][[0, -1]] == pytest.approx([0.1, 0.1 + 2.0 / 3.0], abs=0.06)  # of three modes
    assert np.trapezoid(force, t) == pytest.approx(10.0, rel=0.04)  # of three modes, which go on to swing
    speeds = [run.velocity(body.frame())[-1, 2] for body in bodies]
    assert speeds == pytest.approx([0.0, -1.0], abs=0.04)
    assert np.ptp(run.energy().total) < 1e-6


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
def test_two_blocks_are_as_one_pressed_half_as_far_on_a_plane():
    """By symmetry, with patches on patches and between them; the shape of the lower one's facets."""
    record = block(5e-3)
    found = []
    for shift in (None, 0.0, 2.5e-3):
        scene = fm.System()
        body = scene.add(fm.FlexibleBody(record), name="block")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("z_min"))
        x, n = record.contact.x, record.contact.axes[0, :, 0]
        middle, depth = x.mean(axis=0), 1e-6
        if shift is None:
            floor = contact.HalfSpace(scene.ground.frame(p=middle - 0.5 * depth * n), -n)
            (pair,) = scene.touch(contact.ElasticSurface(body), floor, contact.Hard())
        else:
            other = scene.add(fm.FlexibleBody(record), name="other")
            t = record.contact.axes[0, :, 1]
            turn = 2.0 * np.outer(t, t) - np.eye(3)  # half a turn about a line in the plane
            place = middle + (shift * t - depth * n) - turn @ middle
            scene.connect(fm.joint.Fixed(), scene.ground.frame(p=place, R=turn), other.frame("z_min"))
            surfaces = contact.ElasticSurface(body), contact.ElasticSurface(other)
            (pair,) = scene.touch(*surfaces, contact.Hard())
        run = scene.simulate(1e-9, about=scene.equilibrium(), rtol=1e-3)
        (met,) = run.contacts(pair)
        found.append(met.normal_force[0].sum())
    assert found[1] == pytest.approx(found[0], rel=0.01)
    assert found[2] == pytest.approx(found[0], rel=0.03)  # which overlaps by a half patch less


@functools.cache
def brick(size):
    """Of rubber, that nothing holds, its foot in nine patches."""
    rubber = solid_linear.Parameters(E=5e6 * size, nu=0.3, rho=1000.0)  # as stiff against its weight at all sizes
    model = ContinuumModel(meshes.block(size, size, 0.5 * size, divisions=(3, 3, 2)), solid_linear, rubber, degree=2)
    foot = Patch("foot", size=0.34 * size, facets="z_min")
    return craig_bampton(model, modes=8, contact=[foot], damping=ModalDamping(0.3))


def on_incline(size, mu, *, sine=0.6, above=0.0):
    """On an incline, laid down where it bears without friction, or ``above`` (m) it."""
    scene = fm.System(gravity=9.81 * np.array([sine, 0.0, -np.sqrt(1.0 - sine**2)]))
    body = scene.add(fm.FlexibleBody(brick(size)), name="brick")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (0.0, 0.0, above - brick(size).contact.x[:, 2].mean(), 1.0, 0.0, 0.0, 0.0)
    floor = contact.HalfSpace(scene.ground.frame())
    (pair,) = scene.touch(contact.ElasticSurface(body), floor, contact.Hard(mu=mu))
    return scene, body, pair


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
@pytest.mark.parametrize("size", [0.1, 1.0])
def test_a_block_slides_down_an_incline(size):
    """By g (0.6 - 0.3 x 0.8) at any size, after it has swung in; no patch bears more than mu times its force."""
    scene, body, pair = on_incline(size, 0.3)
    run = scene.simulate(1.0, rtol=1e-4)
    t = np.linspace(0.0, 1.0, 201)
    (met,) = run.contacts(pair, t=t)
    friction = np.linalg.norm(met.friction, axis=2)
    assert (friction <= 0.3 * met.normal_force * (1.0 + 1e-6) + 1e-9).all()
    speed = run.velocity(body.frame(), t=t)[:, 0]
    assert np.polyfit(t[100:], speed[100:], 1)[0] == pytest.approx(9.81 * (0.6 - 0.3 * 0.8), rel=2e-3)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
@pytest.mark.parametrize("name", ["radau", "generalized-alpha", "explicit"])
def test_a_block_stays_on_an_incline(name):
    """It bears its weight, about which it still swings where the method does not damp that, and does not creep."""
    scene, body, pair = on_incline(0.1, 0.5, sine=0.3)
    methods = {"radau": fm.RadauIIA(), "generalized-alpha": fm.GeneralizedAlpha(), "explicit": fm.ExplicitRungeKutta()}
    run = scene.simulate(1.0, rtol=1e-4, integrator=methods[name])
    t = np.array([0.8, 0.9, 1.0])
    (met,) = run.contacts(pair, t=t)
    weight, swings = body.mass * 9.81, 1.0 if name == "radau" else 50.0
    held = met.friction.sum(axis=1)[-1]
    np.testing.assert_allclose(held, (-0.3 * weight, 0.0, 0.0), atol=1e-3 * swings * weight)
    assert met.normal_force[-1].sum() == pytest.approx(weight * np.sqrt(0.91), rel=1e-3 * swings)
    x = run.position(body.frame(), t=t)[:, 0]
    assert np.ptp(x) < 1e-7 * swings
    assert 1e-5 < x[-1] < 1e-4  # what the foot gives way


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
@pytest.mark.parametrize("above", [1e-3, 0.1])
def test_a_block_is_laid_down_on_an_incline(above):
    """Its equilibrium is the one that begins in touch: patches stick where they meet, if friction holds."""
    found = []
    for height in (0.0, above):
        scene, body, pair = on_incline(0.1, 0.5, sine=0.3, above=height)
        rest = scene.equilibrium()
        (met,) = scene.simulate(1e-3, about=rest, rtol=1e-5).contacts(pair)
        weight = body.mass * 9.81
        np.testing.assert_allclose(met.friction.sum(axis=1)[[0, -1]] / weight, [(-0.3, 0.0, 0.0)] * 2, atol=1e-9)
        found.append(np.append(rest.q(body), rest.position(body.frame())[2]))
    np.testing.assert_allclose(found[1], found[0], atol=1e-9 * abs(found[0]).max())
    scene, _, _ = on_incline(0.1, 0.1, sine=0.3, above=above)
    with pytest.raises(SceneError, match=r"falls onto what it meets: .*; friction bears mu N at most"):
        scene.equilibrium()


@functools.cache
def slab(size):
    """A third of it is patches of ``size``, which a ball touches at one point."""
    steel = solid_linear.Parameters(E=2.1e11, nu=0.3, rho=7850.0)
    mesh = meshes.block(0.048, 0.048, 0.02, divisions=(16, 16, 5))
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=[Interface("z_min")])
    far = 0.0121
    pad = Patch("pad", size=size, facets=lambda x: (x[2] > 0.0099) & (abs(x[0] - 0.024) < far) & (abs(x[1]) < far))
    return craig_bampton(model, modes=6, frame="z_min", contact=[pad], keep=Keep(modes=True))


def pressed_by_ball(size, approach, aside=0.0):
    """The force (N) of a ball of 1 cm that is so near (m) to a slab's undeformed surface."""
    scene = fm.System()
    body = scene.add(fm.FlexibleBody(slab(size)), name="slab")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame("z_min"))
    group = body.record.contact
    n, t = group.axes[0, :, 0], group.axes[0, :, 1]
    ball = contact.Sphere(scene.ground.frame(p=group.x.mean(axis=0) + (0.01 - approach) * n + aside * t), 0.01)
    (pair,) = scene.touch(contact.ElasticSurface(body), ball, contact.Hertz(E=2.1e11, nu=0.3))
    run = scene.simulate(1e-9, about=scene.equilibrium(), rtol=1e-3)
    return run.contacts(pair)[0].normal_force[0, 0]


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
def test_a_ball_dents_a_slab_as_hertz_says_whatever_its_patches_are():
    """On patches and between them; the slab is no half space, which is a hundredth of the dent."""
    star, approach = 2.1e11 / (2.0 * (1.0 - 0.09)), 2e-5
    hertz = 4.0 / 3.0 * star * np.sqrt(0.01) * approach**1.5
    found = [pressed_by_ball(size, approach, aside) for size in (6e-3, 3e-3) for aside in (0.0, 1e-3, 1.5e-3)]
    np.testing.assert_allclose(found, hertz, rtol=0.02)
    np.testing.assert_allclose(found, found[0], rtol=2e-3)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.ModesWarning")
def test_a_dent_wider_than_a_patch_is_told():
    with pytest.warns(fm.RangeWarning, match="Hertz's dent is .* wide in radius, and the patches are 0.0017 m"):
        pressed_by_ball(3e-3, 4e-4)
