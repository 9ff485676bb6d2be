"""Statics of reduced bodies that touch: press fits against Lame's rings, bolted joints against their diagram."""

from __future__ import annotations

import functools
import warnings

from mpi4py import MPI

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact, meshes
from flexmbd.continuum import ContinuumModel, Interface
from flexmbd.errors import SceneError
from flexmbd.forms import solid_linear
from flexmbd.reduction import Keep, ModalDamping, Patch, craig_bampton

E, NU, RHO = 2.1e11, 0.3, 7850.0
INSIDE, BORE, OUTSIDE, HEIGHT, OVERLAP = 0.03, 0.05, 0.08, 0.01, 5e-5  # m


@functools.cache
def ring(around, size, *, inner=BORE, outer=OUTSIDE, touches="inner"):
    """A full ring of straight-sided cells, which nothing holds, one of its cylinders in patches."""
    radii, angles = np.linspace(inner, outer, 4), 2.0 * np.pi * np.arange(around) / around
    planes = (-0.5 * HEIGHT, 0.5 * HEIGHT)
    x = np.array([(r * np.cos(a), r * np.sin(a), z) for z in planes for r in radii for a in angles])
    number = np.arange(len(x)).reshape(2, len(radii), around)
    corners = [(k, j, i) for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    cells = [
        [number[k, i + p, (j + q) % around] for k, q, p in corners]
        for i in range(len(radii) - 1)
        for j in range(around)
    ]
    groups = {
        "inner": lambda x: np.hypot(x[0], x[1]) < inner * (1.0 + 1e-9),
        "outer": lambda x: np.hypot(x[0], x[1]) > outer * (1.0 - 1e-9),
    }
    mesh = meshes.from_arrays(
        MPI.COMM_SELF, x, np.array(cells), cell="hexahedron", degree=1, facet_groups=groups
    )
    model = ContinuumModel(mesh, solid_linear, solid_linear.Parameters(E=E, nu=NU, rho=RHO), degree=2)
    return craig_bampton(model, modes=4, contact=[Patch(touches, size=size)], keep=Keep(modes=True))


def pressures(scene, pair):
    """(p,) Pa at the equilibrium, with which a run begins."""
    run = scene.simulate(1e-9, about=scene.equilibrium(), rtol=1e-3)
    return run.contacts(pair)[0].pressure[0]


def on_a_shaft(record, *, apart=0.0, speed=0.0, shape=True):
    """A ring, on a rigid shaft that is larger by the overlap, which turns at a speed (rad/s)."""
    scene = fm.System()
    shaft = scene.add(fm.RigidBody(1.0, (1, 1, 1)), name="shaft")
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), shaft.frame()).velocity = speed
    hub = scene.add(fm.FlexibleBody(record), name="hub")
    scene.connect(fm.joint.Fixed(), shaft.frame(), hub.frame())
    bore = contact.HollowCylinder(hub.frame(), BORE) if shape else None
    own = contact.ElasticSurface(hub, "inner", shape=bore)
    (pair,) = scene.touch(own, contact.Cylinder(shaft.frame(), BORE + OVERLAP - apart), contact.Hard())
    return scene, pair


def widening(inner, outer, nu):
    """Of a ring of plane stress by a unit of pressure at its bore, or with -nu outside: 1/m of its radius, times E."""
    return (outer**2 + inner**2) / (outer**2 - inner**2) + nu


SHAPES = contact.Cylinder, contact.HollowCylinder
LAME = E * OVERLAP / (BORE * widening(BORE, OUTSIDE, NU))


@pytest.mark.parametrize(("around", "size", "patches"), [(32, 0.02, 8), (32, 0.0142, 16), (64, 0.0099, 32)])
def test_a_ring_on_a_shaft_is_pressed_as_lame_says(around, size, patches):
    """But for the patches: of 2 phi of the bore one feels sin phi / phi of what widens it, and presses alike."""
    found = pressures(*on_a_shaft(ring(around, size)))
    assert len(found) == patches
    assert np.ptp(found) < 1e-6 * LAME
    assert found.mean() / LAME - 1.0 == pytest.approx((np.pi / patches) ** 2 / 3.0, abs=3e-3)


def test_a_ring_that_turns_is_pressed_less():
    """By what the bore widens: rho w^2 a ((3 + nu) b^2 + (1 - nu) a^2) / (4 E); and not at all where that is more."""
    record, still = ring(32, 0.0142), None
    for speed in (0.0, 1000.0, 1500.0):
        found = pressures(*on_a_shaft(record, speed=speed)).mean()
        still = found if still is None else still
        wider = RHO * speed**2 * BORE / (4.0 * E) * ((3.0 + NU) * OUTSIDE**2 + (1.0 - NU) * BORE**2)
        assert (still - found) / LAME == pytest.approx(wider / OVERLAP, rel=0.01, abs=1e-9)
    scene, pair = on_a_shaft(record, speed=2500.0)
    assert not pressures(scene, pair).any()


def test_two_rings_share_their_overlap():
    """By their widths; the patches of either are the points, of as many on both and of fewer."""
    both = widening(BORE, OUTSIDE, NU) + widening(INSIDE, BORE, -NU)
    exact = E * OVERLAP / (BORE * both)
    for around, size, tolerance in ((32, 0.0142, 0.025), (24, 0.02, 0.06)):
        scene = fm.System()
        hub = scene.add(fm.FlexibleBody(ring(32, 0.0142)), name="hub")
        inner = ring(around, size, inner=INSIDE, outer=BORE, touches="outer")
        sleeve = scene.add(fm.FlexibleBody(inner), name="sleeve")
        for body in (hub, sleeve):
            scene.connect(fm.joint.Fixed(), scene.ground.frame(), body.frame())
        bore = contact.ElasticSurface(hub, "inner", shape=contact.HollowCylinder(hub.frame(), BORE))
        outside = contact.Cylinder(sleeve.frame(), BORE + OVERLAP)
        (pair,) = scene.touch(bore, contact.ElasticSurface(sleeve, "outer", shape=outside), contact.Hard())
        assert pressures(scene, pair).mean() == pytest.approx(exact, rel=tolerance)


def test_shapes_that_face_the_other_way_are_refused():
    """A bore is a HollowCylinder; as a Cylinder, or a shaft as a HollowCylinder, it would be touched by nothing."""
    hub = fm.FlexibleBody(ring(32, 0.0142))
    sleeve = fm.FlexibleBody(ring(32, 0.0142, inner=INSIDE, outer=BORE, touches="outer"))
    bore = {kind: contact.ElasticSurface(hub, "inner", shape=kind(hub.frame(), BORE)) for kind in SHAPES}
    shaft = {kind: contact.ElasticSurface(sleeve, "outer", shape=kind(sleeve.frame(), BORE)) for kind in SHAPES}
    for inner, outer in ((SHAPES[0], SHAPES[0]), (SHAPES[1], SHAPES[1])):
        for swapped in (False, True):
            scene = fm.System()
            scene.add(hub, name="hub")
            scene.add(sleeve, name="sleeve")
            pair = bore[inner], shaft[outer]
            with pytest.raises(SceneError, match=rf"its shape, a {inner.__name__}, faces the other way"):
                scene.touch(*(pair[::-1] if swapped else pair), contact.Hard())


def test_triangles_that_face_into_a_body_or_are_in_millimetres_are_refused():
    hub = fm.FlexibleBody(ring(32, 0.0142))
    angle = 2.0 * np.pi * np.arange(64) / 64
    circle = np.column_stack([BORE * np.cos(angle), BORE * np.sin(angle)])
    x = np.concatenate([np.insert(circle, 2, z, axis=1) for z in (-0.5 * HEIGHT, 0.5 * HEIGHT)])
    one, next_one = np.arange(64), np.roll(np.arange(64), -1)
    first, second = (one, one + 64, next_one), (next_one, one + 64, next_one + 64)
    inwards = np.concatenate([np.column_stack(first), np.column_stack(second)])
    cases = (1.0, inwards, None), (1.0, inwards[:, ::-1], "faces the other"), (1e3, inwards, "lies 50 m")
    for scale, triangles, said in cases:
        bore = contact.TriangleSurface(hub.frame(), scale * x, triangles, open=True)
        scene = fm.System()
        scene.add(hub, name="hub")
        pair = contact.Sphere(scene.ground.frame(), 0.01), contact.ElasticSurface(hub, "inner", shape=bore)
        law = contact.PowerLaw(k=1e6)
        if said is None:
            scene.touch(*pair, law)
        else:
            with pytest.raises(SceneError, match=said):
                scene.touch(*pair, law)


def test_a_fit_of_centroids_is_told():
    """Which lie behind the bore by six overlaps; with the bore's shape, and apart from a shaft, nothing is told."""
    record = ring(32, 0.0142)
    with pytest.warns(fm.RangeWarning, match=r"it is a fit, of patches whose centroids lie up to 0\.\d+ m behind"):
        on_a_shaft(record, shape=False)[0].equilibrium()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        on_a_shaft(record)[0].equilibrium()
        on_a_shaft(record, shape=False, apart=2e-3)[0].equilibrium()


LENGTH, SIDE, PRELOAD = 0.05, 0.02, 2e4  # m, m, N
OF_PARTS = E * SIDE**2 / (2.0 * LENGTH)  # N/m, of two bars in series
OF_BOLT = 0.25 * OF_PARTS
FACTOR = OF_BOLT / (OF_BOLT + OF_PARTS)


@functools.cache
def part(held, touches):
    """A bar without lateral strain, one end a frame, the other four patches."""
    mesh = meshes.block(SIDE, SIDE, LENGTH, divisions=(4, 4, 3))
    steel = solid_linear.Parameters(E=E, nu=0.0, rho=RHO)
    model = ContinuumModel(mesh, solid_linear, steel, degree=2, interfaces=[Interface(held)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fm.ModesWarning)
        return craig_bampton(
            model, modes=4, frame=held, contact=[Patch("face", size=0.01, facets=touches)], keep=Keep(modes=True),
            damping=ModalDamping(0.3),
        )  # fmt: skip


def bolted(*, load=0.0, mu=0.0, apart=0.0, rest=None, preload=None):
    """Two parts, the lower on the ground; a bolt from the ground to the upper's head, or the preload in its place."""
    scene = fm.System()
    lower = scene.add(fm.FlexibleBody(part("z_min", "z_max")), name="lower")
    upper = scene.add(fm.FlexibleBody(part("z_max", "z_min")), name="upper")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), lower.frame())
    joint = fm.joint.Free() if mu else fm.joint.Prismatic("z")
    head = scene.connect(joint, scene.ground.frame(), upper.frame(), name="head")
    head.position = (0, 0, 2.0 * LENGTH + apart, 1, 0, 0, 0) if mu else 2.0 * LENGTH + apart
    ends = contact.ElasticSurface(lower, "face"), contact.ElasticSurface(upper, "face")
    (pair,) = scene.touch(*ends, contact.Hard(mu=mu))
    if preload is None:
        rest = 2.0 * LENGTH - PRELOAD / OF_BOLT - PRELOAD / OF_PARTS if rest is None else rest
        scene.add_force(fm.force.SpringDamper(scene.ground.frame(), upper.frame(), OF_BOLT, rest))
    else:
        scene.add_force(fm.force.FrameForce(upper.frame(), (0.0, 0.0, -preload)))
    scene.add_force(fm.force.FrameForce(upper.frame(), (0.0, 0.0, load)))
    return scene, upper.frame(), pair, 0.0 if rest is None else rest


@pytest.mark.parametrize("apart", [0.0, 1e-4, -1e-5])
def test_a_bolted_joint_has_its_diagram(apart):
    """The bolt takes k_S / (k_S + k_P) of a load, up to what opens the joint; all of it from there on (VDI 2230)."""
    opens = PRELOAD / (1.0 - FACTOR)
    for share in (0.0, 0.5, 0.99, 1.01, 2.0):
        scene, head, pair, rest = bolted(load=share * opens, apart=apart)
        rest_at = scene.equilibrium()
        of_bolt = OF_BOLT * (rest_at.position(head)[2] - rest)
        run = scene.simulate(1e-9, about=rest_at, rtol=1e-3)
        clamp = run.contacts(pair)[0].normal_force[0].sum()
        exact = PRELOAD + FACTOR * share * opens if share < 1.0 else share * opens
        assert of_bolt == pytest.approx(exact, rel=1e-4)
        assert clamp == pytest.approx(PRELOAD * max(0.0, 1.0 - share), rel=1e-4, abs=1e-6 * PRELOAD)


def test_a_path_opens_a_bolted_joint():
    opens = PRELOAD / (1.0 - FACTOR)
    scene, head, _, rest = bolted(load=lambda t: t)
    path = scene.equilibrium(path=fm.Continuation(to=2.0 * opens))
    load = path.factors
    exact = np.where(load < opens, PRELOAD + FACTOR * load, load)
    np.testing.assert_allclose(OF_BOLT * (path.position(head)[:, 2] - rest), exact, rtol=1e-4)
    assert load[-1] == 2.0 * opens


def test_a_bolt_is_tightened_by_a_force():
    """The force presses the parts; the bolt that is then put in, so much shorter as it bears that, changes nothing."""
    pressed = bolted(preload=PRELOAD)
    at = pressed[0].equilibrium().position(pressed[1])
    scene, head, _, _ = bolted(rest=at[2] - PRELOAD / OF_BOLT)
    np.testing.assert_allclose(scene.equilibrium().position(head), at, atol=1e-14)


@pytest.mark.parametrize("apart", [0.0, 1e-4])
def test_a_run_begins_with_the_preload_and_does_not_creep(apart):
    """It stays; pushed aside by a tenth of its friction it comes back, and by little more than all of it slips."""
    scene, head, pair, _ = bolted(mu=0.2, apart=apart)
    run = scene.simulate(0.02, about=scene.equilibrium(), rtol=1e-5)
    assert np.ptp(run.position(head), axis=0).max() < 1e-12
    assert run.contacts(pair)[0].normal_force[-1].sum() == pytest.approx(PRELOAD, rel=1e-3)
    for part_of, returns in ((0.1, True), (1.02, False)):
        scene, head, pair, _ = bolted(mu=0.2, apart=apart)
        force = part_of * 0.2 * PRELOAD

        def pulse(t, size):
            return size * np.sin(np.pi * t / 0.01) ** 2 if t < 0.01 else 0.0

        sideways = (lambda t, size=force: pulse(t, size)), 0.0, 0.0
        upright = 0.0, (lambda t, size=-force * LENGTH: pulse(t, size)), 0.0  # as if it pulled where they touch
        scene.add_force(fm.force.FrameForce(head, sideways, upright))
        run = scene.simulate(0.04, about=scene.equilibrium(), rtol=1e-5)
        aside = run.position(head, t=np.linspace(0.0, 0.04, 81))[:, 0]
        assert run.contacts(pair)[0].normal_force[-1].sum() == pytest.approx(PRELOAD, rel=1e-2)
        assert (abs(aside[-1]) < 1e-3 * abs(aside).max()) == returns
