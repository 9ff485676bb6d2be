"""Heaps of hard boxes: that impulses are found to rtol, by whichever way, and that what rests takes few sweeps."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.multibody.kernels.impulses import parts as parts_of_machines

G = 9.81
SIDES = np.array([1.0, 0.8, 0.6])


def box(scene, name, place, *, turn=(1.0, 0.0, 0.0, 0.0), velocity=(0.0,) * 6, size=1.0, density=1000.0):
    sides = size * SIDES
    mass, squares = density * np.prod(sides), np.square(sides)
    inertia = tuple(mass / 12.0 * (squares.sum() - squares))
    body = scene.add(fm.RigidBody(mass, inertia), name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (*place, *turn), velocity
    return contact.Box(body.frame(), sides)


def askew(random):
    turn = np.array([1.0, 0.0, 0.0, 0.0]) + 0.3 * random.normal(size=4)
    return tuple(turn / np.linalg.norm(turn))


def falling_heap(hinged, size=1.0):
    """Boxes askew, without overlaps, above a floor; two of them on a hinge between both, if asked."""
    random = np.random.default_rng(5)
    scene = fm.System(gravity=(0.0, 0.0, -G))
    places = size * np.array([(1.5 * (k % 3), 0.02 * k, 0.9 + 1.4 * (k // 3)) for k in range(9)])
    shapes = [box(scene, f"box {k}", place, turn=askew(random), size=size) for k, place in enumerate(places)]
    if hinged:
        one = scene.add(fm.RigidBody(300.0, (20.0, 30.0, 40.0)), name="one")
        other = scene.add(fm.RigidBody(200.0, (10.0, 20.0, 30.0)), name="other")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), one.frame())
        free.position = (1.0, 0.1, 4.5, *askew(random))
        scene.connect(fm.joint.Revolute("y"), one.frame(p=(0.6, 0.0, 0.0)), other.frame(p=(-0.6, 0.0, 0.0)))
        shapes += [contact.Box(body.frame(), SIDES) for body in (one, other)]
    law = contact.Hard(mu=0.5)
    pairs = (*scene.touch(shapes, contact.HalfSpace(scene.ground.frame()), law), *scene.touch(shapes, shapes, law))
    return scene, shapes, pairs


@pytest.mark.parametrize("hinged", [False, True])
def test_lone_bodies_do_what_the_rows_of_their_parts_do(hinged, monkeypatch):
    """By their twists or by unit forces along their joints: the same sweeps, but for round-off."""
    scene, _, _ = falling_heap(hinged)
    ours = scene.simulate(0.6, h=5e-3, rtol=1e-6)
    monkeypatch.setattr(parts_of_machines, "lone_rows", lambda plan, reached: np.full(len(reached), -1))
    rows = scene.simulate(0.6, h=5e-3, rtol=1e-6)
    assert ours.stats.iterations > 2 * ours.stats.steps
    assert ours.stats.iterations == pytest.approx(rows.stats.iterations, rel=0.1)
    assert np.abs(ours.v - rows.v).max() < 1e-6 * np.abs(rows.v).max()


def test_velocities_after_a_step_are_right_to_rtol_of_what_impulses_change():
    """Against a step whose impulses are found to ten digits, from states within impacts and rest."""
    scene, _, _ = falling_heap(False)
    run = scene.simulate(0.8, h=5e-3, rtol=1e-6)
    for k in (100, 120, 140, 160):
        ends = []
        for rtol in (1e-10, 1e-1, 1e-3, 1e-5):
            again = fm.System(gravity=(0.0, 0.0, -G))
            rows = zip(run.x[k].reshape(-1, 7), run.v[k].reshape(-1, 6), strict=True)
            shapes = [box(again, f"box {i}", x[:3], turn=x[3:], velocity=v) for i, (x, v) in enumerate(rows)]
            law = contact.Hard(mu=0.5)
            again.touch(shapes, contact.HalfSpace(again.ground.frame()), law)
            again.touch(shapes, shapes, law)
            ends.append(again.simulate(5e-3, h=5e-3, rtol=rtol).v[-1])
        exact = ends[0]
        changed = np.linalg.norm(exact - run.v[k] - np.tile([0.0, 0.0, -G * 5e-3, 0.0, 0.0, 0.0], 9))
        assert changed > G * 5e-3
        for found, rtol in zip(ends[1:], (1e-1, 1e-3, 1e-5), strict=True):
            assert np.linalg.norm(found - exact) < rtol * changed


@pytest.mark.parametrize("size", [4.0**-5, 4.0**5])
def test_a_heap_of_another_size_does_the_same_in_its_own_time(size):
    """Times grow with the root of the size, here a power of two, so that digits stay: no bound has a unit."""
    scenes = [(falling_heap(False, size=s)[0], s**0.5) for s in (1.0, size)]
    one, other = (scene.simulate(0.6 * unit, h=5e-3 * unit, rtol=1e-3) for scene, unit in scenes)
    scale = np.tile([size] * 3 + [1.0] * 4, 9)
    assert other.stats.iterations == one.stats.iterations
    assert np.abs(other.x[-1] / scale - one.x[-1]).max() < 1e-9


def test_what_rests_takes_the_impulses_of_the_step_before():
    """A pyramid of bricks: a few sweeps tell that nothing is to change, once the first steps have found what bears."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    shapes = [box(scene, f"brick {row} {k}", (1.1 * k + 0.55 * row, 0.0, 0.3 + 0.6 * row))
              for row in range(5) for k in range(5 - row)]  # fmt: skip
    law = contact.Hard(mu=0.5)
    scene.touch(shapes, contact.HalfSpace(scene.ground.frame()), law)
    scene.touch(shapes, shapes, law)
    one, first, run = (scene.simulate(end, h=5e-3, rtol=1e-4) for end in (5e-3, 0.1, 0.3))
    assert np.abs(run.v).max() < 1e-4 * G * 5e-3 * 15.0
    assert run.stats.iterations - first.stats.iterations < 0.1 * one.stats.iterations * 40


def test_a_tower_of_grams_stands_beside_blocks_of_tonnes_that_fall():
    """Each contact counts alike, whatever the masses: the tower's impulses are not lost in those of the crash."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    light = [box(scene, f"light {k}", (0.0, 0.0, (0.3 + 0.6 * k) * 0.01), size=0.01) for k in range(6)]
    heavy = [box(scene, f"heavy {k}", (5.0 + 2.5 * k, 0.0, 2.0), size=2.0, turn=askew(np.random.default_rng(k)))
             for k in range(3)]  # fmt: skip
    law, floor = contact.Hard(mu=0.5), contact.HalfSpace(scene.ground.frame())
    scene.touch(light + heavy, floor, law)
    scene.touch(light, light, law)
    run = scene.simulate(0.4, h=2e-3, rtol=1e-4)
    top = run.position(light[-1].frame)
    assert np.abs(run.velocity(heavy[0].frame)).max() > 1.0
    assert np.abs(top - top[0]).max() < 1e-5
