"""Elastic surfaces that touch rigid shapes: forces, tangent, momenta; bodies of particles with random patches."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
import scipy.optimize
from element_slopes import analytic, differenced, energy, generalised_force
from particles import particle_body
from patched import patched_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import RangeWarning, SceneError, StartWarning
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.contact.signed_distance import distances
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.kernels.physics.joints import retract

TILTED = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
SHAPES = {
    "half space": lambda f: contact.HalfSpace(f, "y"),
    "sphere": lambda f: contact.Sphere(f, 0.5),
    "hollow sphere": lambda f: contact.HollowSphere(f, 0.55),
    "cylinder": lambda f: contact.Cylinder(f, 0.5),
    "hollow cylinder": lambda f: contact.HollowCylinder(f, 0.55),
    "capsule": lambda f: contact.Capsule(f, 0.5, 0.2),
    "box": lambda f: contact.Box(f, (0.9, 0.8, 1.0)),
    "disc": lambda f: contact.Disc(f, 0.5, 0.4, rounding=0.1),
}
DENT = contact.Hertz(E=1e5, nu=0.3)


def ball_surface(body):
    """Of patches on a ball."""
    return contact.ElasticSurface(body, shape=contact.Sphere(body.frame(), 0.3))


#: The way in which the body comes to each, in the shape's frame.
WAYS = {
    "half space": (0.1, 1.0, 0.2), "hollow sphere": (-0.5, -0.4, 0.2), "hollow cylinder": (-0.5, -0.6, 0.1),
    "box": (0.1, 0.9, 0.05), "disc": (0.7, 0.2, 0.3),
}  # fmt: skip


def meeting(name, *, depth, bent=(0.0, 0.0, 0.0), modes=4, softness=1e-3, seed=3, patches=7, mu=0.0):
    """A patched body on a flying one, by a spherical joint, and a shape on another flying one, in which it is so deep.

    The modes are at (0.05, -0.03, 0.02, 0.04), the last of the configuration that is returned.
    """
    scene = fm.System()
    carrier = scene.add(fm.RigidBody(2.0, (0.1, 0.12, 0.09)), name="carrier")
    body = scene.add(patched_body(seed, modes=modes, softness=softness, patches=patches), name="elastic")
    elastic = name == "elastic"
    other: Any = fm.RigidBody(3.0, (0.2, 0.2, 0.2))
    if elastic:
        other = patched_body(8, modes=3, patches=25, softness=softness)
    scene.add(other, name="other")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), other.frame())
    turn = Rotation.from_rotvec([0.2, 0.4, -0.3])
    free.position = (0.3, -0.2, 0.1, *np.roll(turn.as_quat(), 1))
    offset, at = ((0.0, 0.0, 0.0), np.eye(3)) if elastic else ((0.05, 0.1, -0.1), TILTED)
    kind = "sphere" if name == "ball" else name
    shape: Any = contact.Sphere(other.frame(), 0.3) if elastic else SHAPES[kind](other.frame(p=offset, R=at))
    q = np.array([0.05, -0.03, 0.02, 0.04, *np.zeros(modes)])[:modes]
    group = body.record.contact
    x = group.x + np.einsum("pab,pbn,n->pa", group.axes, group.phi, q)
    R, way = turn.as_matrix() @ at, np.array(WAYS.get(name, (0.5, 0.4, 0.1)))

    def overlap(s):
        out = np.zeros((len(x), 4))
        distances(np.append(shape.numbers(), 0.0), s * way + x @ R, out)
        return out[:, 0].min() + depth

    along = np.linspace(3.0, 0.0, 301)
    k = np.flatnonzero(np.diff(np.sign([overlap(s) for s in along])))[0]
    s = scipy.optimize.brentq(overlap, along[k + 1], along[k])
    place = np.array(free.position[:3]) + turn.as_matrix() @ np.array(offset) + R @ (s * way)
    flying = scene.connect(fm.joint.Free(), scene.ground.frame(), carrier.frame())
    flying.position = (*place, 1.0, 0.0, 0.0, 0.0)
    scene.connect(fm.joint.Spherical(), carrier.frame(), body.frame("root"))
    touched = contact.ElasticSurface(other, shape=shape) if elastic else shape
    law, own = contact.Hard(mu=mu), contact.ElasticSurface(body)
    (pair,) = scene.touch(own, touched, law) if name != "ball" else scene.touch(ball_surface(body), shape, DENT)
    body.q = q
    if elastic:
        other.q = bent
    compiled = scene.compile()
    return scene, compiled.scene, compiled.start().x, pair


@pytest.mark.parametrize("name", [*SHAPES, "elastic", "ball"])
def test_forces_are_the_slopes_of_the_energy(name):
    """On all coordinates, of the body and of what it touches; several patches touch and others do not."""
    patches = 25 if name in ("elastic", "ball") else 7
    _, compiled, x, _ = meeting(name, depth=0.05, bent=(0.04, -0.05, 0.03), patches=patches)
    plan = compiled.plan
    force = generalised_force(plan, x)
    assert np.abs(force).max() > 1.0
    np.testing.assert_allclose(force, -differenced(plan, x, energy, 1e-5), atol=1e-7 * np.abs(force).max())


@pytest.mark.parametrize("name", [*SHAPES, "elastic", "ball"])
def test_tangent(name):
    """Of plane shapes it is exact, of curved ones to the dent over the radius."""
    errors = []
    for depth in (1e-3, 1e-4):
        _, compiled, x, _ = meeting(name, depth=depth, patches=25 if name == "ball" else 7)
        expected = differenced(compiled.plan, x, generalised_force, 1e-6).T
        errors.append(np.abs(analytic(compiled.plan, x) - expected).max() / np.abs(expected).max())
    assert max(errors) < (1e-7 if name in ("half space", "box") else 1e-2)
    assert errors[1] < max(0.8 * errors[0], 1e-7)


def held_there(plan, x, seed=0, size=1e-4):
    """A configuration a little further than one in which the patches came to stick."""
    work, rest = new_work(plan), np.zeros(len(plan.free))
    kept, moved = x.copy(), x.copy()
    remember(plan, work, kept, rest, 0.0)
    moved[:] = kept
    retract(plan, kept, size * np.random.default_rng(seed).standard_normal(len(plan.free)), moved)
    return moved


@pytest.mark.parametrize("name", ["half space", "sphere", "elastic"])
def test_what_sticks_is_elastic(name):
    """Its forces are the slopes of an energy, and the tangent their derivatives."""
    patches = 25 if name == "elastic" else 7
    _, compiled, x, _ = meeting(name, depth=1e-3, mu=5.0, patches=patches)
    x = held_there(compiled.plan, x)
    force = generalised_force(compiled.plan, x)
    np.testing.assert_allclose(force, -differenced(compiled.plan, x, energy, 1e-6), atol=2e-3 * np.abs(force).max())
    expected = differenced(compiled.plan, x, generalised_force, 1e-7).T
    error = np.abs(analytic(compiled.plan, x) - expected).max() / np.abs(expected).max()
    assert error < (1e-7 if name == "half space" else 1e-2)


@pytest.mark.parametrize("name", ["half space", "sphere", "elastic"])
def test_tangent_of_what_slides(name):
    """Of plane shapes it is exact, sliding along and across and towards sticking included."""
    _, compiled, x, _ = meeting(name, depth=1e-3, mu=0.1, patches=25 if name == "elastic" else 7)
    x = held_there(compiled.plan, x, size=1e-3)
    expected = differenced(compiled.plan, x, generalised_force, 1e-7).T
    error = np.abs(analytic(compiled.plan, x) - expected).max() / np.abs(expected).max()
    assert error < (1e-7 if name == "half space" else 1e-2)


@pytest.mark.parametrize("name", ["half space", "sphere"])
def test_forces_of_many_patches_are_the_least_energy(name):
    """f >= 0 that makes f^T C f / 2 + gap^T f least, by nonnegative least squares of C's factor."""
    scene, _, _, pair = meeting(name, depth=0.04, patches=60)
    run = scene.simulate(1e-6, rtol=1e-3, integrator=fm.ExplicitRungeKutta())
    (met,) = run.contacts(pair)
    body, group = pair.surface.body, pair.surface.body.record.contact
    R, R_F = run.rotation(body.frame())[0], run.rotation(pair.frame_F)[0]
    x = group.x + np.einsum("pab,pbn,n->pa", group.axes, group.phi, run.q(body)[0])
    z = (x @ R.T + run.position(body.frame())[0] - run.position(pair.frame_F)[0]) @ R_F
    found = np.zeros((60, 4))
    distances(np.append(pair.shape.numbers(), 0.0), z, found)
    gap, normal = found[:, 0], found[:, 1:] @ R_F.T
    own = np.einsum("pba,pb->pa", group.axes, normal @ R)
    C = np.einsum("pa,paqb,qb->pq", own, group.G.reshape(60, 3, 60, 3), own)
    factor = np.linalg.cholesky(C)
    f, _ = scipy.optimize.nnls(factor.T, -np.linalg.solve(factor, gap))
    turns = 1e-9 if name == "half space" else 0.1  # of the normal, by the dent over the radius
    np.testing.assert_allclose(met.normal[0], normal, atol=turns)
    assert 2 < (f > 0.0).sum() < (gap < 0.0).sum() + 5
    np.testing.assert_allclose(met.normal_force[0], f, atol=max(1e-7, turns**2) * f.max())
    np.testing.assert_allclose(met.gap[0], gap + C @ f, atol=1e-9)
    np.testing.assert_allclose(met.pressure[0], f / group.area, atol=max(1e-7, turns**2) * met.pressure.max())


@pytest.mark.filterwarnings("ignore::flexmbd.errors.RangeWarning")
@pytest.mark.parametrize("kind", ["rigid", "elastic"])
def test_momenta_and_energy_are_kept(kind):
    """A body that meets a flying sphere, or another elastic one, between its patches, by steps that keep energy."""
    scene = fm.System()
    elastic = scene.add(patched_body(5, modes=6, patches=30), name="elastic")
    ball: Any = fm.RigidBody(1.0, (0.05, 0.06, 0.07))
    if kind == "elastic":
        ball = patched_body(6, modes=3, patches=30)
    scene.add(ball, name="ball")
    flying = [scene.connect(fm.joint.Free(), scene.ground.frame(), one) for one in (elastic.frame(), ball.frame())]
    flying[0].position = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    flying[1].position, flying[1].velocity = (1.0, 0.1, 0.05, 1.0, 0.0, 0.0, 0.0), (-3.0, 0.0, 0.0, 1.0, 2.0, -1.0)
    if kind == "rigid":
        touched: Any = contact.Sphere(ball.frame(p=(0.05, 0.0, 0.0)), 0.3)
    else:
        touched = contact.ElasticSurface(ball, shape=contact.Sphere(ball.frame(), 0.3))
    (pair,) = scene.touch(contact.ElasticSurface(elastic), touched, contact.Hard())
    run = scene.simulate(0.5, rtol=1e-4, integrator=fm.EnergyMomentum())
    (met,) = run.contacts(pair)
    assert met.normal_force.max() > 10.0
    assert not met.normal_force[-1].any()
    assert (met.gap > -1e-12).all()
    assert np.abs(run.velocity(ball.frame())[-1] - run.velocity(ball.frame())[0]).max() > 0.5
    momentum = run.momentum()
    for one in (momentum.linear, momentum.angular):
        assert np.abs(one - one[0]).max() < 1e-9 * np.abs(one[0]).max()
    total = run.energy().total
    assert np.abs(total / total[0] - 1.0).max() < 1e-9


@pytest.mark.filterwarnings("ignore::flexmbd.errors.RangeWarning")
def test_a_scene_that_is_turned_moves_alike():
    """By a turn of the world, and of the body's axes against its interface."""
    found = []
    for R in (np.eye(3), TILTED):
        scene = fm.System(gravity=R @ (0.0, 0.0, -9.81))
        elastic = scene.add(patched_body(5, modes=6, patches=30), name="elastic")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(R=R), elastic.frame())
        free.position = (0.0, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0)
        floor = contact.HalfSpace(scene.ground.frame(R=R))
        (pair,) = scene.touch(floor, contact.ElasticSurface(elastic), contact.Hard())
        run = scene.simulate(0.4, rtol=1e-9, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
        t = np.linspace(0.0, 0.4, 30)
        (met,) = run.contacts(pair, t=t)
        assert met.normal_force.max() > 10.0
        found.append((run.position(elastic.frame(), t=t) @ R, run.q(elastic, t=t), met.normal_force))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(other, one, atol=1e-6 * np.abs(one).max())


def on_floor(body, surface=None, law=None, friction=None, height=0.2):
    scene = fm.System()
    elastic = scene.add(body, name="elastic")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), elastic.frame())
    free.position = (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0)
    touching = contact.ElasticSurface(elastic, surface)
    kwargs = {} if friction is None else {"friction": friction}
    pair = scene.touch(touching, contact.HalfSpace(scene.ground.frame()), law or contact.Hard(), **kwargs)
    return scene, elastic, pair


def test_what_is_refused():
    with pytest.raises(SceneError, match=r"no contact patches; reduce .* craig_bampton\(..., contact="):
        on_floor(fm.FlexibleBody(particle_body(1, modes=3).record))
    with pytest.raises(SceneError, match="no surface 'tooth'; its record has 'one', 'other'"):
        on_floor(patched_body(1, modes=3), "tooth")
    with pytest.raises(SceneError, match="leave nothing of the dent of patch 0 of 'one'"):
        on_floor(patched_body(1, modes=3, softness=0.0))
    with pytest.raises(SceneError, match=r"restitution = 0.5 .* leave both out"):
        on_floor(patched_body(1, modes=3), law=contact.Hard(restitution=0.5))
    with pytest.raises(SceneError, match="its law must be"):
        on_floor(patched_body(1, modes=3), law=contact.PowerLaw(k=1e5))
    with pytest.raises(SceneError, match="its friction is the law's"):
        on_floor(patched_body(1, modes=3), friction=contact.Friction(0.3, 1e5, 1.0, 1.0))
    scene, elastic, _ = on_floor(patched_body(1, modes=3), "one")
    with pytest.raises(SceneError, match="touch already"):
        scene.touch(contact.ElasticSurface(elastic), contact.HalfSpace(scene.ground.frame()), contact.Hard())
    with pytest.raises(SceneError, match="on one body"):
        scene.touch(contact.ElasticSurface(elastic), contact.Sphere(elastic.frame(), 0.1), contact.Hard())
    with pytest.raises(SceneError, match="on one body"):
        scene.touch(contact.ElasticSurface(elastic), contact.ElasticSurface(elastic), contact.Hard())
    ball = contact.Sphere(scene.ground.frame(), 0.1)
    with pytest.raises(SceneError, match=r"keeps no nodes: .* keep=Keep\(modes=True\), or give .* shape="):
        scene.touch(contact.ElasticSurface(elastic), ball, contact.PowerLaw(k=1e5))
    with pytest.raises(SceneError, match="what an impact on an elastic body loses"):
        scene.touch(ball_surface(elastic), ball, contact.Hertz(E=1e5, restitution=0.5))
    with pytest.raises(SceneError, match="its shape must be on the body's own frame"):
        contact.ElasticSurface(elastic, shape=ball)
    far = contact.ElasticSurface(elastic, shape=contact.Sphere(elastic.frame(), 0.6))
    with pytest.raises(SceneError, match=r"its shape, a Sphere, lies 0.3 m from the centroid of patch 0"):
        scene.touch(far, contact.Sphere(scene.ground.frame(), 0.1), contact.Hard())
    with pytest.raises(SceneError, match="do not stand in one list"):
        scene.touch([ball_surface(elastic), ball], ball, contact.Hard())
    with pytest.raises(SceneError, match="is not touched by patches"):
        scene.touch(contact.ElasticSurface(elastic), contact.Vertex(scene.ground.frame()), contact.Hard())
    with pytest.raises(SceneError, match="the body of an ElasticSurface"):
        contact.ElasticSurface(scene.ground)
    with pytest.raises(SceneError, match="central differences"):
        scene.simulate(0.1, integrator=fm.CentralDifference())


def test_an_overlap_at_the_start_is_told():
    """Of an undeformed body; not of one whose modes are set, as it is where it rests."""
    scene, elastic, _ = on_floor(patched_body(1, modes=3), height=0.1)
    with pytest.warns(StartWarning, match="overlap by .* where the body is undeformed"):
        scene.simulate(1e-6, rtol=1e-3)
    scene.start()
    elastic.q = (1e-3, 0.0, 0.0)
    scene.simulate(1e-6, rtol=1e-3)


def test_nothing_near_costs_no_force():
    """A surface above a small sphere that its patches pass by beside it: no force, and steps that see it."""
    scene = fm.System()
    elastic = scene.add(patched_body(5, modes=6, patches=30), name="elastic")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), elastic.frame())
    free.position, free.velocity = (-5.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), (100.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    (pair,) = scene.touch(contact.ElasticSurface(elastic), contact.Sphere(scene.ground.frame(), 0.2), contact.Hard())
    run = scene.simulate(0.1, rtol=1e-3)
    (met,) = run.contacts(pair)
    assert met.normal_force.max() > 0.0  # no step is so long that it is passed through unseen


@pytest.mark.parametrize(("thickness", "told"), [(2e-3, True), (2.0, False)])
def test_a_dent_beyond_half_of_a_thin_wall_is_told(thickness, told):
    scene = fm.System()
    ball = scene.add(patched_body(4, modes=3, softness=1e-4), name="ball")
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), ball.frame())
    flight.position, flight.velocity = (-0.5 - 0.5 * thickness, 0, 0, 1, 0, 0, 0), (3.0, 0, 0, 0, 0, 0)
    wall = contact.Box(scene.ground.frame(), (thickness, 4.0, 4.0))
    scene.touch(contact.ElasticSurface(ball), wall, contact.Hard())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene.simulate(0.2, rtol=1e-4)
    found = [str(one.message) for one in caught if issubclass(one.category, RangeWarning)]
    assert any("dents too far" in one for one in found) == told
