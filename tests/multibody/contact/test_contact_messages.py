"""Wrong contacts, starts and questions: each is told by name, with what to do."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import ExportError, RangeWarning, SceneError, StartWarning
from flexmbd.multibody.contact import touch
from flexmbd.run.stopped import SimulationError

LAW = contact.PowerLaw(k=1e5)


def ball(scene, name, place, velocity=(0.0, 0.0, 0.0), mass=1.0):
    body = scene.add(fm.RigidBody(mass, (0.004 * mass,) * 3), name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (*place, 1.0, 0.0, 0.0, 0.0), (*velocity, 0.0, 0.0, 0.0)
    return body


def two(apart, law, velocity=(0.0, 0.0, 0.0)):
    scene = fm.System()
    a, b = ball(scene, "a", (0.0, 0.0, 0.0), velocity), ball(scene, "b", (apart, 0.0, 0.0))
    pair = scene.touch(contact.Sphere(a.frame(), 0.1), contact.Sphere(b.frame(), 0.1), law)
    return scene, pair


def test_centres_that_coincide_are_told_at_the_start():
    scene, _ = two(0.0, LAW)
    said = "contact of sphere b with Sphere a at t = 0 s: the centre of what touches is in the middle of the shape"
    with pytest.raises(SceneError, match=said):
        scene.simulate(0.1)
    with pytest.raises(SceneError, match=said):
        scene.start()


def test_hard_centres_that_coincide_are_told():
    scene, _ = two(0.0, contact.Hard())
    said = r"hard contact of sphere b with Sphere a at t = 0\.001 s: the centre of what touches is in the middle"
    with pytest.raises(SimulationError, match=said):
        scene.simulate(0.1, h=1e-3)


def test_a_body_inside_another_is_told_where_the_run_begins():
    scene, _ = two(0.05, LAW)
    with pytest.warns(RangeWarning, match="the shapes overlap where the run begins: begin with them apart"):
        scene.simulate(1e-4)
    soft, _ = two(0.5, contact.PowerLaw(k=1.0), velocity=(3.0, 0.0, 0.0))
    with pytest.warns(RangeWarning, match="the law is too soft for what meets there"):
        soft.simulate(0.2)


@pytest.mark.parametrize("apart", [0.19, 0.199])
def test_hard_shapes_that_overlap_at_the_start_are_told_with_the_depth(apart):
    scene, _ = two(apart, contact.Hard())
    with pytest.warns(StartWarning, match=rf"sphere b with Sphere a overlap by {0.2 - apart:.3g} m at the start"):
        run = scene.simulate(0.01, h=1e-3, checkpoints=[5e-3])
    assert run.position(scene._bodies[1].frame())[-1, 0] > 0.2 - 1e-9 + run.position(scene._bodies[0].frame())[-1, 0]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.simulate(0.01, h=1e-3, restart=run.checkpoints[0])


def test_shapes_of_a_list_that_overlap_are_told_by_their_pair():
    scene = fm.System(gravity=(0.0, 0.0, -10.0))
    boxes = [ball(scene, f"box {k}", (0.0, 0.0, 0.5 + 0.95 * k)) for k in range(3)]
    shapes = [contact.Box(one.frame(), (1.0, 1.0, 1.0)) for one in boxes]
    scene.touch([*shapes, contact.HalfSpace(scene.ground.frame())], shapes, contact.Hard())
    with pytest.warns(StartWarning, match=r"Box box [01] and Box box [12] overlap by 0\.05 m"):
        scene.simulate(0.01, h=1e-3)


@pytest.mark.parametrize("gap", [0.0, 1e-9, -1e-9, 0.01])
def test_hard_shapes_that_touch_or_are_apart_are_not_told(gap):
    scene, _ = two(0.2 + gap, contact.Hard(), velocity=(1.0, 0.0, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.simulate(0.05, h=1e-3)


def test_an_equilibrium_that_friction_would_have_to_bear_is_told():
    scene = fm.System(gravity=(2.0, 0.0, -9.81))
    body = ball(scene, "ball", (0.0, 0.0, 0.1 - 1e-5))
    rough = contact.Friction(0.5, stiffness=1e5, damping=1e2, load=10.0)
    floor = contact.HalfSpace(scene.ground.frame())
    scene.touch(floor, contact.Sphere(body.frame(), 0.1), LAW, friction=rough)
    with pytest.raises(SceneError, match=r"Friction \(contact of sphere ball with HalfSpace ground\) does not bear it"):
        scene.equilibrium()


def test_what_a_smooth_contact_has_no_states_of_is_told():
    scene, (pair,) = two(0.3, LAW)
    run = scene.simulate(1e-3)
    with pytest.raises(SceneError, match="contact of sphere b with Sphere a has no states: a contact has them with"):
        run.states(pair)


@pytest.mark.parametrize("asked", [3.0, "ab", None, contact.PowerLaw])
def test_what_is_no_contact_is_told(asked):
    scene, _ = two(0.3, LAW)
    run = scene.simulate(1e-3)
    for ask in (run.contacts, run.contact_forces):
        with pytest.raises(SceneError, match=r"what run\.contacts is asked for must be a contact, or all, as scene"):
            ask(asked)


def test_a_contact_of_another_scene_is_told():
    (_, (pair,)), (other, _) = two(0.3, LAW), two(0.3, LAW)
    with pytest.raises(SceneError, match="is not in this trajectory's scene"):
        other.simulate(1e-3).contacts(pair)


@pytest.mark.parametrize(
    ("points", "said"),
    [
        ([(0.0, 0.0), (1.0, np.nan), (1.0, 1.0)], r"1 of 3 are not, the first of them number 1, \(1, nan\) m"),
        ([(0.0, 0.0), (1.0, np.inf), (np.inf, 1.0)], r"2 of 3 are not, the first of them number 1, \(1, inf\) m"),
        ("circle", r"finite numbers of shape \(n, 2\) \(m\), got 'circle'"),
        ([(0.0, 0.0, 0.0)], r"got shape \(1, 3\)"),
    ],
)
def test_points_of_a_profile_that_are_none_are_told(points, said):
    with pytest.raises(SceneError, match=f"Profile on ground: .*{said}"):
        contact.Profile(fm.System().ground.frame(), points)


CUBE = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]


@pytest.mark.parametrize("faces", [3.0, np.array(3.0), [0.5, 1.5], [[0.5, 1, 2]], "abc", {0: 1}, np.ones((3, 2, 2))])
def test_faces_that_are_no_lists_of_whole_numbers_are_told(faces):
    with pytest.raises(SceneError, match=r"ConvexPolytope on ground: face.* must be .*list.* of whole numbers"):
        contact.ConvexPolytope(fm.System().ground.frame(), CUBE, faces)


def test_a_fixed_step_that_a_contact_cannot_bear_is_refused_with_the_largest():
    """A ball that rests on a stiff law: an explicit step of 1 ms is beyond 2 over its rate."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    body = ball(scene, "ball", (0.0, 0.0, 0.1 - 1e-8))
    scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Sphere(body.frame(), 0.1), contact.PowerLaw(k=1e9))
    with pytest.raises(SceneError, match=r"Take h = [0-9.e-]+ s at most") as told:
        scene.simulate(0.1, h=1e-3, integrator=fm.ExplicitRungeKutta())
    largest = float(str(told.value).split("Take h = ")[1].split(" ")[0])
    scene.simulate(10.0 * largest, h=largest, integrator=fm.ExplicitRungeKutta())
    assert 0.3 < largest * np.sqrt(1e9) < 5.0


def test_lists_beyond_memory_are_refused_before(monkeypatch):
    scene = fm.System()
    shapes = [contact.Sphere(ball(scene, f"ball {k}", (k, 0.0, 0.0)).frame(), 0.1) for k in range(20)]
    monkeypatch.setattr(touch, "available_memory", lambda: 100_000)
    with pytest.raises(SceneError, match=r"lists of 20 and 20 shapes make 400 contacts.*take fm.contact.Hard"):
        scene.touch(shapes, shapes, LAW)
    scene.touch(shapes, shapes, contact.Hard())


@pytest.mark.parametrize("law", [LAW, contact.PowerLaw(k=1e5, restitution=0.5, speed=None), contact.Hard()])
def test_an_fmu_with_contacts_is_refused(tmp_path, law):
    scene, _ = two(0.3, law)
    with pytest.raises(ExportError, match=r"bodies that touch cannot be exported in an FMU .*sphere b with Sphere a"):
        fm.export.fmu_machine(scene, tmp_path / "two.fmu", h=1e-4)
    assert not list(tmp_path.iterdir())
