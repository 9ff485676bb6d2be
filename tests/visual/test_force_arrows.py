"""Arrows of contact forces: where they stand, how long they are, and that pictures and films have them."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import PictureError, SceneError
from flexmbd.visual import show as show_machine
from flexmbd.visual.drawn_scene import drawn_scene
from flexmbd.visual.part import placed, reach

SMALL = (320, 240)


def resting(law, places=((0.0, 0.0, 0.1), (1.0, 0.0, 0.1))):
    """Balls of 1 and 2 kg on a floor, and one that never touches it."""
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    floor, pairs = contact.HalfSpace(scene.ground.frame()), []
    for k, place in enumerate((*places, (0.5, 0.0, 1.5))):
        mass = k + 1.0
        shape = fm.Shape.sphere(0.1)
        body = scene.add(fm.RigidBody(mass, (0.004 * mass,) * 3, shape=shape), name=f"ball {k}")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position = (*place, 1.0, 0.0, 0.0, 0.0)
        pairs += scene.touch(floor, contact.Sphere(body.frame(), 0.1), law)
    return scene, pairs


def arrows_of(run, pairs, times):
    drawn = drawn_scene(run, times, notes=[""] * len(times), forces=run._forces_of(pairs))
    return drawn, [part for part in drawn.parts if part.quantity == ("contact force", "N")]


@pytest.mark.parametrize("law", [contact.Hard(), contact.PowerLaw(k=1e5, restitution=0.3, speed=0.01)])
def test_arrows_go_from_where_they_act_along_the_force_and_with_its_size(law):
    scene, pairs = resting(law)
    run = scene.simulate(0.3, **({"h": 1e-3} if isinstance(law, contact.Hard) else {"rtol": 1e-8}))
    times = np.array([0.0, 0.3])
    places, forces = run.contact_forces(pairs, t=times)
    assert places.shape == forces.shape == (2, 3, 3)
    assert forces[1] == pytest.approx(np.outer([10.0, 20.0, 0.0], [0.0, 0.0, 1.0]), rel=1e-2, abs=1e-2)
    drawn, (arrows,) = arrows_of(run, pairs, times)
    assert arrows.largest == np.linalg.norm(forces, axis=2).max()
    outlines, values = (part.reshape(3, -1, *part.shape[1:]) for part in placed(arrows, 1))
    for k in range(3):
        force, size = forces[1, k], np.linalg.norm(forces[1, k])
        assert values[k] == pytest.approx(size)
        along = (outlines[k] - places[1, k]) @ (force / size if size else force)
        assert along.min() == pytest.approx(0.0, abs=1e-12)
        assert along.max() == pytest.approx(arrows.longest * size / arrows.largest)
    extent = np.linalg.norm(np.ptp(drawn.places, axis=0))
    assert 0.1 * extent < arrows.longest < 0.5 * extent
    lows, highs = reach(arrows).min(axis=0), reach(arrows).max(axis=0)
    assert (lows <= outlines[:2].min(axis=(0, 1))).all()
    assert (outlines[:2].max(axis=(0, 1)) <= highs).all()
    volume = np.einsum("ti,ti->", *(_moments(outlines[0], arrows.triangle[: len(arrows.triangle) // 3])))
    assert volume > 0.0  # its triangles face outwards


def _moments(x, triangles):
    a, b, c = np.moveaxis(x[triangles] - x.mean(axis=0), 1, 0)
    return a, np.cross(b, c)


def test_points_of_a_group_come_and_go():
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    bodies = [scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=f"box {k}") for k in range(2)]
    for k, body in enumerate(bodies):
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position = (2.0 * k, 0.0, 0.25 + 0.2 * k, 1.0, 0.0, 0.0, 0.0)
    shapes = [contact.Box(body.frame(), (0.5, 0.5, 0.5)) for body in bodies]
    (group,) = scene.touch(shapes, contact.HalfSpace(scene.ground.frame()), contact.Hard())
    run = scene.simulate(0.4, h=1e-2)
    _, forces = run.contact_forces(group, t=[0.1, 0.4])
    assert forces.shape == (2, 8, 3)
    assert forces.sum(axis=1)[:, 2] == pytest.approx([10.0, 20.0], rel=1e-4)
    assert (np.linalg.norm(forces, axis=2) > 0.0).sum(axis=1).tolist() == [4, 8]
    _, (arrows,) = arrows_of(run, [group], np.array([0.1, 0.4]))
    assert arrows.forces.shape == (2, 8, 3)


def test_without_contacts_or_forces_nothing_is_drawn():
    scene, pairs = resting(contact.PowerLaw(k=1e5), places=((0.0, 0.0, 1.0), (1.0, 0.0, 1.0)))
    run = scene.simulate(0.01)
    assert arrows_of(run, pairs, np.array([0.0, 0.01]))[1] == []
    assert arrows_of(run, [], np.array([0.0, 0.01]))[1] == []


def test_pictures_and_films_have_them(tmp_path):
    scene, pairs = resting(contact.PowerLaw(k=1e5, restitution=0.3, speed=0.01))
    run = scene.simulate(0.1)
    for name, given in (("bare.png", ()), ("arrows.png", pairs)):
        run.show(path=tmp_path / name, t=0.1, size=SMALL, contacts=given)
    assert (tmp_path / "bare.png").read_bytes() != (tmp_path / "arrows.png").read_bytes()
    run.animate(tmp_path / "arrows.gif", fps=2, slow_motion=10.0, size=SMALL, contacts=pairs)
    assert (tmp_path / "arrows.gif").stat().st_size > 0
    for given in (3.0, lambda t: 3.0, lambda t: (np.zeros((1, 3)), np.zeros((1, 3))), lambda t: [np.zeros((1, 2, 3))]):
        with pytest.raises(PictureError, match="forces must"):
            show_machine(run, path=tmp_path / "no.png", forces=given)
    for given in ([3.0], 3.0, "ab"):
        with pytest.raises(SceneError, match="contacts must be a list"):
            run.show(path=tmp_path / "no.png", contacts=given)
        with pytest.raises(PictureError, match="contacts must be a list"):
            run.animate(tmp_path / "no.gif", contacts=given)
