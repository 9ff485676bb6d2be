"""Reduced bodies that touch by their contact patches: against waves, statics and other sizes of patches."""

from __future__ import annotations

import functools

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.forms import solid_linear
from flexmbd.reduction import Patch, craig_bampton


@pytest.fixture(scope="module")
def bar():
    """Of Doyen, Ern & Piperno 2011: 10 m long, E = 900 Pa, 1 kg/m^3, with three modes along it."""
    material = solid_linear.Parameters(E=900.0, nu=0.0, rho=1.0)
    model = ContinuumModel(meshes.block(1.0, 1.0, 10.0, divisions=(1, 1, 40)), solid_linear, material, degree=2)
    foot = Patch("foot", size=2.0, facets="z_min")
    with pytest.warns(fm.ModesWarning):
        return craig_bampton(model, modes=20, geometric_stiffness=False, contact=[foot])


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
    return craig_bampton(model, modes=6, frame="z_min", contact=[pad])


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

