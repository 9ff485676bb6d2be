"""Elastic surfaces of a body that touch several things and give way together: bodies of particles, random patches."""

from __future__ import annotations

import itertools
import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize
from element_slopes import analytic, differenced, energy, generalised_force
from patched import patched_body
from scipy.spatial.transform import Rotation

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import RangeWarning, SceneError

DOWN = np.diag([1.0, -1.0, -1.0])


def flying(scene, body, name, place, turn):
    scene.add(body, name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (*place, *np.roll(Rotation.from_rotvec(turn).as_quat(), 1))
    return body, free


def between_planes(share=1.0):
    """A body between two planes, and a third one at its side, so near, that its patches "one" touch alone."""
    scene = fm.System()
    body, _ = flying(scene, patched_body(3, modes=4, patches=30), "body", (0.02, 0.01, 0.03), (0.1, 0.2, -0.04))
    ground, whole = scene.ground, contact.ElasticSurface(body)
    side = Rotation.from_euler("y", 70.0, degrees=True).as_matrix()
    wall = contact.HalfSpace(ground.frame(p=-0.2 * share * side[:, 2], R=side))
    pairs = [
        *scene.touch(whole, contact.HalfSpace(ground.frame(p=(0.0, 0.0, -0.22))), contact.Hard()),
        *scene.touch(whole, contact.HalfSpace(ground.frame(p=(0.0, 0.0, 0.20), R=DOWN)), contact.Hard()),
        *scene.touch(contact.ElasticSurface(body, "one"), wall, contact.Hard()),
    ]
    body.q = (0.02, -0.03, 0.01, 0.02)
    return scene, pairs


def among_bodies():
    """On the ground, under another elastic body that touches a ceiling, beside a flying ball."""
    scene = fm.System()
    lower, _ = flying(scene, patched_body(3, modes=4, patches=30), "lower", (0.02, 0.01, 0.03), (0.1, 0.2, -0.04))
    upper, _ = flying(scene, patched_body(8, modes=3, patches=25), "upper", (0.05, 0.03, 0.553), (0.2, -0.1, 0.4))
    ball, _ = flying(scene, fm.RigidBody(1.0, (0.1, 0.1, 0.1)), "ball", (0.53, 0.03, 0.05), (0.0, 0.0, 0.0))
    whole, round_one = contact.ElasticSurface(lower), contact.Sphere(upper.frame(), 0.3)
    ceiling = scene.ground.frame(p=(0.0, 0.0, 0.81), R=DOWN)
    pairs = [
        *scene.touch(whole, contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -0.23))), contact.Hard()),
        *scene.touch(whole, contact.ElasticSurface(upper, shape=round_one), contact.Hard()),
        *scene.touch(contact.ElasticSurface(lower, "one"), contact.Sphere(ball.frame(), 0.25), contact.Hard()),
        *scene.touch(contact.ElasticSurface(upper, "other"), contact.HalfSpace(ceiling), contact.Hard()),
    ]
    lower.q, upper.q = (0.02, -0.03, 0.01, 0.02), (0.01, -0.02, 0.01)
    return scene, pairs


def pressed(C, gap):
    factor = np.linalg.cholesky(C)
    return scipy.optimize.nnls(factor.T, -np.linalg.solve(factor, gap))[0]


def bearing(scene, pairs):
    run = scene.simulate(1e-9, rtol=1e-3)
    return [run.contacts(pair)[0] for pair in pairs]


@pytest.mark.filterwarnings("ignore::flexmbd.errors.StartWarning")
@pytest.mark.parametrize("made", [between_planes, among_bodies])
def test_forces_are_the_slopes_of_one_energy(made):
    scene, pairs = made()
    assert sum((met.normal_force > 0.0).any() for met in bearing(scene, pairs)) >= 3
    compiled = scene.compile()
    plan, x = compiled.scene.plan, compiled.start().x
    force = generalised_force(plan, x)
    np.testing.assert_allclose(force, -differenced(plan, x, energy, 1e-5), atol=1e-8 * np.abs(force).max())


@pytest.mark.parametrize("made", [between_planes, among_bodies])
def test_tangent_of_joined_surfaces(made):
    """Of planes it is exact, what a turn against one changes of the couple against another included."""
    scene, _ = made()
    compiled = scene.compile()
    plan, x = compiled.scene.plan, compiled.start().x
    expected = differenced(plan, x, generalised_force, 1e-6).T
    error = np.abs(analytic(plan, x) - expected).max() / np.abs(expected).max()
    assert error < (1e-8 if made is between_planes else 0.05)


def test_forces_of_joined_surfaces_are_the_least_energy():
    """f >= 0 that makes f^T C f / 2 + gap^T f least, C of all contacts, by nonnegative least squares of its factor."""
    scene, pairs = between_planes()
    run = scene.simulate(1e-9, rtol=1e-3)
    met = [run.contacts(pair)[0] for pair in pairs]
    body = pairs[0].surface.body
    group, R = body.record.contact, run.rotation(body.frame())[0]
    x = group.x + np.einsum("pab,pbn,n->pa", group.axes, group.phi, run.q(body)[0])
    z = x @ R.T + run.position(body.frame())[0]
    gap, along, patch = [], [], []
    for pair in pairs:
        normal, rows = pair.frame_F.R_BF[:, 2], pair.surface.patches
        gap.append((z[rows] - pair.frame_F.p_BF_B) @ normal)
        along.append(np.einsum("pba,b->pa", group.axes[rows], normal @ R))
        patch.append(rows)
    gap, along, patch = map(np.concatenate, (gap, along, patch))
    G = group.G.reshape(30, 3, 30, 3)[patch][:, :, patch]
    C = np.einsum("pa,paqb,qb->pq", along, G, along)
    faces, f = along[:, 0] < 0.0, np.zeros(len(gap))  # others are on the far side of the body
    f[faces] = pressed(C[np.ix_(faces, faces)], gap[faces])
    found = np.concatenate([one.normal_force[0] for one in met])
    np.testing.assert_allclose(found, f, atol=1e-7 * f.max())
    np.testing.assert_allclose(np.concatenate([one.gap[0] for one in met]), gap + C @ f, atol=1e-9)
    first = faces & (np.arange(len(gap)) < 30)  # by itself
    assert np.abs(pressed(C[np.ix_(first, first)], gap[first]) - f[first]).max() > 0.02 * f[first].max() > 0.1


@pytest.mark.filterwarnings("ignore::flexmbd.errors.StartWarning")
def test_what_two_shapes_press_alike_is_pressed_once():
    """A plane and a box whose top lies in it: as the plane alone."""
    found = []
    for twice in (False, True):
        scene = fm.System()
        body, _ = flying(scene, patched_body(3, modes=4, patches=30), "body", (0.0, 0.0, 0.22), (0.1, 0.2, -0.04))
        surface, pairs = contact.ElasticSurface(body), []
        floor = [contact.HalfSpace(scene.ground.frame())]
        if twice:
            floor.append(contact.Box(scene.ground.frame(p=(0.0, 0.0, -1.0)), (4.0, 4.0, 2.0)))
        for one in floor:
            pairs += scene.touch(surface, one, contact.Hard())
        found.append(sum(met.force[0].sum(axis=0) for met in bearing(scene, pairs)))
    assert found[0][2] > 1.0
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9, atol=1e-9 * found[0][2])


@pytest.mark.filterwarnings("ignore::flexmbd.errors.RangeWarning", "ignore::flexmbd.errors.StartWarning")
def test_joined_surfaces_keep_momenta_and_energy():
    """A body between two flying balls that meet it at once."""
    scene = fm.System()
    body, _ = flying(scene, patched_body(5, modes=6, patches=30), "body", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    pairs = []
    for side in (-1.0, 1.0):
        ball = fm.RigidBody(1.0, (0.05, 0.06, 0.07))
        _, free = flying(scene, ball, f"ball {side:g}", (side, 0.05, 0.02), (0.0, 0.0, 0.0))
        free.velocity = (-3.0 * side, 0.0, 0.0, 1.0, 2.0, -1.0)
        pairs += scene.touch(contact.ElasticSurface(body), contact.Sphere(ball.frame(), 0.3), contact.Hard())
    run = scene.simulate(0.4, rtol=1e-9, integrator=fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8))
    met = [run.contacts(pair)[0] for pair in pairs]
    assert (np.minimum(*(one.normal_force.sum(axis=1) for one in met)) > 1.0).any()  # both at once
    momentum, total = run.momentum(), run.energy().total
    for one in (momentum.linear, momentum.angular):
        assert np.abs(one - one[0]).max() < 1e-9
    assert np.abs(total / total[0] - 1.0).max() < 1e-7


@pytest.mark.parametrize("count", [3, 40])
def test_too_many_that_touch_each_other_are_told(count):
    """Each with each: they are solved by pairs then."""
    scene = fm.System()
    surfaces = []
    for k in range(count):
        body, _ = flying(scene, patched_body(3, modes=1, patches=8), f"body {k}", (2.0 * k, 0.0, 0.0), (0.0, 0.0, 0.0))
        surfaces.append(contact.ElasticSurface(body, shape=contact.Sphere(body.frame(), 0.3)))
    for one, other in itertools.combinations(surfaces, 2):
        scene.touch(one, other, contact.Hard())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene.simulate(1e-9, rtol=1e-3, integrator=fm.ExplicitRungeKutta())
    told = [str(one.message) for one in caught if issubclass(one.category, RangeWarning)]
    assert any("too many to be solved together" in one for one in told) == (count == 40)


@pytest.mark.filterwarnings("ignore::flexmbd.errors.StartWarning")
def test_surfaces_by_parts_are_as_one():
    """The patches of a body by their two surfaces, each with a plane, and all together."""
    found = []
    for names in ((None,), ("one", "other")):
        scene = fm.System()
        body, _ = flying(scene, patched_body(3, modes=4, patches=30), "body", (0.0, 0.0, 0.2), (0.1, 0.2, -0.04))
        body.q = (0.02, -0.03, 0.01, 0.02)
        surfaces = [contact.ElasticSurface(body, name) for name in names]
        pairs = scene.touch(surfaces, contact.HalfSpace(scene.ground.frame()), contact.Hard())
        force = np.zeros(30)
        for pair, met in zip(pairs, bearing(scene, pairs), strict=True):
            force[pair.surface.patches] = met.normal_force[0]
        found.append(force)
    assert (found[0] > 0.0).sum() > 2
    np.testing.assert_allclose(found[1], found[0], atol=1e-11 * found[0].max())


def friction_told(share, mu):
    """What is told of a body on a rough plane by one surface, on another plane by the other, which are joined by G."""
    scene = fm.System()
    body = patched_body(3, modes=4, patches=30)
    group = body.record.contact
    assert group is not None
    apart = group.surface[:, None] != group.surface
    G = np.where(np.repeat(np.repeat(apart, 3, axis=0), 3, axis=1), share * group.G, group.G)
    body = fm.FlexibleBody(replace(body.record, contact=replace(group, G=G)))
    flying(scene, body, "body", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    below, above = scene.ground.frame(p=(0.0, 0.0, -1.0)), scene.ground.frame(p=(0.0, 0.0, 1.0), R=DOWN)
    scene.touch(contact.ElasticSurface(body, "one"), contact.HalfSpace(below), contact.Hard(mu=mu))
    scene.touch(contact.ElasticSurface(body, "other"), contact.HalfSpace(above), contact.Hard())
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene.simulate(1e-9, rtol=1e-3, integrator=fm.ExplicitRungeKutta())
    return any("has friction, and is solved alone" in str(one.message) for one in caught)


def test_friction_beside_others_is_told_where_they_feel_each_other():
    assert friction_told(1.0, mu=0.2)
    assert not friction_told(1e-3, mu=0.2)
    assert not friction_told(1.0, mu=0.0)


def test_records_with_other_patches_need_a_new_machine():
    """A compiled machine knows the patches of its own record: one with the same ones may take its place."""
    scene, pairs = between_planes()
    body = pairs[0].surface.body
    machine = scene.compile(parameters={"record": fm.parameter.BodyRecord(body)})
    group = body.record.contact
    softer = replace(body.record, contact=replace(group, G=2.0 * group.G))
    with pytest.raises(SceneError, match=r"a record of 'body' with other contact patches .* build the scene anew"):
        machine.simulate(1e-9, rtol=1e-3, record=softer)
    alike = replace(body.record, stiffness=2.0 * body.record.stiffness)
    run = machine.simulate(1e-9, rtol=1e-3, record=alike)
    before = machine.simulate(1e-9, rtol=1e-3)
    np.testing.assert_array_equal(run.contacts(pairs[0])[0].force[0], before.contacts(pairs[0])[0].force[0])


def test_variants_of_joined_surfaces():
    """With a plane at another place a variant has the forces of a scene that is built so.

    Patches that the group does not know are refused.
    """
    scene, pairs = between_planes()
    plane = pairs[2].frame_F
    parameters = {"surface": fm.parameter.OfForce(pairs[2], "surface"), "place": fm.parameter.FrameOrigin(plane)}
    machine = scene.compile(parameters=parameters)
    with pytest.raises(SceneError, match="it cannot vary to other patches"):
        machine.simulate(1e-9, rtol=1e-3, surface=contact.ElasticSurface(pairs[2].surface.body, "other"))
    run = machine.simulate(1e-9, rtol=1e-3, place=0.9 * plane.p_BF_B)
    anew, others = between_planes(0.9)
    forces = [met.normal_force[0] for met in bearing(anew, others)]
    np.testing.assert_array_equal(np.concatenate([run.contacts(pair)[0].normal_force[0] for pair in pairs]),
                                  np.concatenate(forces))  # fmt: skip
    assert forces[2].sum() > 1.1 * bearing(scene, pairs)[2].normal_force[0].sum() > 0.0
