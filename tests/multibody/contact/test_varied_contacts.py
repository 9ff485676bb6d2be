"""Contacts in compiled machines whose laws, frictions and sizes take other values: as scenes built anew with them."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError

LAW = contact.PowerLaw(k=1e5, p=1.5, restitution=0.5, speed=0.1)
ROUGH = contact.Friction(0.3, stiffness=1e5, damping=50.0, load=10.0)


def ball(law=LAW, rough=ROUGH, radius=0.1):
    """One that slides, and begins to roll."""
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(fm.RigidBody(1.0, (0.004, 0.004, 0.004)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (0.0, 0.0, 0.101, 1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    floor = contact.HalfSpace(scene.ground.frame())
    (pair,) = scene.touch(floor, contact.Sphere(body.frame(), radius), law, friction=rough)
    return scene, body, pair


OTHER = [
    ("friction", contact.Friction(0.1, stiffness=1e5, damping=50.0, load=10.0)),
    ("friction", contact.Friction(0.3, stiffness=1e4, damping=10.0, load=40.0)),
    ("law", contact.PowerLaw(k=1e4)),
    ("radius", 0.09),
]


@pytest.mark.parametrize(("argument", "value"), OTHER)
def test_other_values_are_those_of_a_scene_built_anew(argument, value):
    scene, _, pair = ball()
    machine = scene.compile(parameters={"x": fm.parameter.OfForce(pair, argument)})
    run = machine.simulate(0.2, rtol=1e-6, x=value)
    given = {"law": "law", "friction": "rough", "radius": "radius"}[argument]
    anew, _, other = ball(**{given: value})
    expected = anew.simulate(0.2, rtol=1e-6)
    np.testing.assert_array_equal(run.v, expected.v)
    np.testing.assert_array_equal(run.states(pair), expected.states(other))
    np.testing.assert_array_equal(run.contacts(pair)[0].force, expected.contacts(other)[0].force)
    assert np.abs(run.v[-1] - machine.simulate(0.2, rtol=1e-6).v[-1]).max() > 1e-6


def test_an_ensemble_over_the_coefficient_of_friction():
    """A ball that slides is slowed by mu g."""
    scene, _, pair = ball()
    machine = scene.compile(parameters={"rough": fm.parameter.OfForce(pair, "friction")})
    for mu in (0.05, 0.2, 0.3):
        rough = contact.Friction(mu, stiffness=1e5, damping=50.0, load=10.0)
        run = machine.simulate(0.1, rtol=1e-6, rough=rough)
        anew = ball(rough=rough)[0].simulate(0.1, rtol=1e-6)
        np.testing.assert_array_equal(run.v, anew.v)
        force = run.contacts(pair)[0]
        slides = (force.normal_force > 1.0) & (np.linalg.norm(force.slip, axis=1) > 0.1)
        size = np.linalg.norm(force.friction, axis=1)
        assert size[slides] == pytest.approx(mu * force.normal_force[slides], rel=1e-6)


def test_a_copy_of_a_variant_keeps_the_sizes_of_its_states():
    scene, _, pair = ball()
    machine = scene.compile(parameters={"rough": fm.parameter.OfForce(pair, "friction")})
    run = machine.simulate(0.1, rtol=1e-6, rough=contact.Friction(0.1, stiffness=1e4, damping=50.0, load=10.0))
    copied, same = pickle.loads(pickle.dumps((run, pair)))
    np.testing.assert_array_equal(copied.states(same), run.states(pair))


@pytest.mark.parametrize(
    ("argument", "value", "said"),
    [
        ("law", 3.0, "contact of sphere ball with HalfSpace ground: its law must be fm.contact.PowerLaw"),
        ("law", contact.Hard(), "its law must be fm.contact.PowerLaw"),
        ("law", contact.PowerLaw, "got the class PowerLaw itself"),
        ("law", contact.PowerLaw(k=-1.0), "k = -1.0"),
        ("friction", 0.3, "its friction must be fm.contact.Friction"),
        ("friction", contact.Friction(-0.3, 1.0, 1.0, 1.0), "mu = -0.3"),
        ("friction", contact.Friction(0.0, 1e5, 50.0, 10.0), "build the scene anew"),
        ("friction", contact.Friction(0.3, 1e5, 50.0, 10.0, rolling=0.01), "build the scene anew"),
        ("friction", None, "build the scene anew"),
        ("radius", "a", "radius of a sphere that touches must be positive"),
        ("radius", -1.0, "radius of a sphere that touches must be positive"),
        ("centre", (1.0, 2.0), r"centre of a sphere that touches must be \(3,\) m"),
        ("shape", 3.0, "what a sphere touches must be a shape"),
    ],
)
def test_values_that_cannot_be_are_told(argument, value, said):
    scene, _, pair = ball()
    machine = scene.compile(parameters={"x": fm.parameter.OfForce(pair, argument)})
    with pytest.raises(SceneError, match=said):
        machine.simulate(0.1, x=value)


def test_a_shape_varies_in_its_place_alone():
    """On another body or elsewhere it would be a shape of another frame, which frames' own parameters are for."""
    scene, body, pair = ball()
    machine = scene.compile(parameters={"shape": fm.parameter.OfForce(pair, "shape")})
    tilted = contact.HalfSpace(scene.ground.frame(), normal=(0.1, 0.0, 1.0))
    run = machine.simulate(0.1, rtol=1e-6, shape=tilted)
    assert np.abs(run.contacts(pair)[0].normal[-1] - np.array([0.1, 0.0, 1.0]) / np.sqrt(1.01)).max() < 1e-12
    for frame in (scene.ground.frame((0.0, 0.0, 0.1)), body.frame()):
        with pytest.raises(SceneError, match="build the scene anew"):
            machine.simulate(0.1, shape=contact.HalfSpace(frame))


def test_a_hard_contact_varies():
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(fm.RigidBody(1.0, (0.004, 0.004, 0.004)), name="ball")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position = (0.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0)
    (pair,) = scene.touch(
        contact.HalfSpace(scene.ground.frame()), contact.Sphere(body.frame(), 0.1), contact.Hard(restitution=0.5)
    )
    machine = scene.compile(parameters={"law": fm.parameter.OfForce(pair, "law")})
    run = machine.simulate(0.2, h=1e-3, law=contact.Hard(restitution=1.0))
    energy = run.energy().total
    assert np.abs(energy / energy[0] - 1.0).max() < 1e-11
    with pytest.raises(SceneError, match="its law must be"):
        machine.simulate(0.2, h=1e-3, law=LAW)


@pytest.mark.parametrize("method", [fm.ExplicitRungeKutta(), fm.RadauIIA(), fm.EnergyMomentum()])
def test_what_is_asked_of_a_run_leaves_the_next_one_as_it_is(method):
    """The force of a contact just before it touches a thin plate, which bounds the steps there."""
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    body = scene.add(fm.RigidBody(1.0, (0.004, 0.004, 0.004)), name="ball")
    scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame()).position = (0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0)
    plate = contact.Box(scene.ground.frame(), (1.0, 1.0, 1e-6))
    pair = scene.touch(plate, contact.Sphere(body.frame(), 1e-3), contact.PowerLaw(k=1e9))
    machine = scene.compile()
    first = machine.simulate(t_end=0.5, rtol=1e-4, integrator=method)
    t = first.t[np.argmax(first.contacts(pair)[0].gap < 0.0)]
    for _ in range(2):
        first.contacts(pair, t=np.linspace(0.9 * t, 0.9999999 * t, 50))
        again = machine.simulate(t_end=0.5, rtol=1e-4, integrator=method)
        np.testing.assert_array_equal(again.t, first.t)
        np.testing.assert_array_equal(again.v, first.v)
