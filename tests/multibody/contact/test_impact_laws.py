"""Newton's and Poisson's laws of impact against closed forms: where they are one, and where they are not."""

from __future__ import annotations

import numpy as np
import pytest
from hard_scenes import G, bouncing_ball

import flexmbd as fm
from flexmbd import contact
from flexmbd.contact import ImpactLaw
from flexmbd.errors import SceneError

NEWTON, POISSON = ImpactLaw.NEWTON, ImpactLaw.POISSON


def ball(scene, name, place, velocity=(0.0,) * 6):
    body = scene.add(fm.RigidBody(1.0, (4e-3,) * 3), name=name)
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
    free.position, free.velocity = (*place, 1.0, 0.0, 0.0, 0.0), velocity
    return contact.Sphere(body.frame(), 0.1)


@pytest.mark.parametrize("lists", [False, True])
@pytest.mark.parametrize(
    ("impact", "after"), [(NEWTON, (1 / 3, 1 / 3, 1 / 3)), (POISSON, (1 / 6, 1 / 6, 2 / 3))]
)
def test_a_blow_goes_through_a_contact_at_rest_by_poissons_law_alone(impact, after, lists):
    """A ball strikes two that touch, plastically, and these are elastic to each other.

    Compression brings all three to one speed, by impulses 2/3 and 1/3; Poisson's law gives the second once more, which
    pushes the middle ball back against the first.  By Newton's law what does not approach does not part.
    """
    scene = fm.System()
    first, second, third = (
        ball(scene, f"ball {k}", (0.2 * k, 0.0, 0.0), (float(k == 0), 0, 0, 0, 0, 0)) for k in range(3)
    )
    plastic, elastic = contact.Hard(impact=impact), contact.Hard(restitution=1.0, impact=impact)
    for pair, law in (((first, second), plastic), ((second, third), elastic)):
        scene.touch(*([one] for one in pair), law) if lists else scene.touch(*pair, law)
    run = scene.simulate(0.05, h=1e-3, rtol=1e-9)
    speeds = [run.velocity(one.frame)[-1, 0] for one in (first, second, third)]
    assert speeds == pytest.approx(after, abs=1e-7)


STEPPED, LOCATED = {"h": 1e-3, "rtol": 1e-10}, {"rtol": 1e-10, "integrator": fm.ExplicitRungeKutta()}


def falling_rod(impact, *, e, mu, speed, settings):
    """A thin rod of 1 kg and 2 m, at 60 degrees to a floor, that falls on one end without turning.

    The velocity of its tip along normal and floor after the impact, u_0 + W P, and W: W_nn = 1 + 3 c^2, W_nt = 3 s c,
    W_tt = 1 + 3 s^2 (1/kg).  It touches in the middle of a step, where impulses act.
    """
    angle = np.deg2rad(60.0)
    c, s = np.cos(angle), np.sin(angle)
    scene = fm.System()
    rod = scene.add(fm.RigidBody(1.0, (1e-6, 1.0 / 3.0, 1.0 / 3.0)), name="rod")
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), rod.frame())
    free.position = (0.0, 0.0, s + 0.0105, np.cos(0.5 * angle), 0.0, np.sin(0.5 * angle), 0.0)
    free.velocity = (speed, 0.0, -1.0, 0.0, 0.0, 0.0)
    tip = rod.frame(p=(1.0, 0.0, 0.0))
    law = contact.Hard(restitution=e, mu=mu, impact=impact)
    pair = scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Vertex(tip), law)
    run = scene.simulate(0.02, **settings)
    impulse = run.contacts(pair)[0].impulse
    assert (np.abs(impulse).max(axis=1) > 0.0).sum() == 1
    mobility = np.array([[1.0 + 3.0 * c * c, 3.0 * s * c], [3.0 * s * c, 1.0 + 3.0 * s * s]])
    return np.array([-1.0, speed]) + mobility @ impulse.sum(axis=0)[[2, 0]], mobility


@pytest.mark.parametrize("settings", [STEPPED, LOCATED], ids=["stepped", "located"])
@pytest.mark.parametrize("impact", [NEWTON, POISSON])
def test_a_rod_that_slides_on_its_end_is_left_by_both_laws_alike(impact, settings):
    """Without friction, and where it slides throughout: u = u_0 + W (1, -+mu) P, linear in P."""
    e, speed = 0.6, 4.0
    for mu in (0.0, 0.2):
        found, W = falling_rod(impact, e=e, mu=mu, speed=speed, settings=settings)
        along = W @ np.array([1.0, -mu])
        normal = (1.0 + e) / along[0]
        assert found == pytest.approx(np.array([-1.0, speed]) + along * normal, rel=1e-6)
        assert found[0] == pytest.approx(e, rel=1e-6)


@pytest.mark.parametrize("settings", [STEPPED, LOCATED], ids=["stepped", "located"])
@pytest.mark.parametrize(("impact", "share"), [(NEWTON, 0.0), (POISSON, 1.0)])
def test_a_rod_that_comes_to_stick_rebounds_by_the_impulse_by_poissons_law(impact, share, settings):
    """Routh's way of the impulse: along the line of sticking compression ends at u = 0, and goes on by e times as far.

    So Poisson's rebound is e (1 + v W_nt / W_tt) for an approach of 1 and a slip v before; Newton's is e.
    """
    e, speed = 0.6, 0.3
    found, W = falling_rod(impact, e=e, mu=1.0, speed=speed, settings=settings)
    assert found[1] == pytest.approx(0.0, abs=1e-9)
    assert found[0] == pytest.approx(e * (1.0 + share * speed * W[0, 1] / W[1, 1]), rel=1e-6)


@pytest.mark.parametrize("e", [0.0, 0.6, 1.0])
def test_a_ball_bounces_and_comes_to_rest_as_by_newtons_law(e):
    """One contact without friction: both laws are one; what rests rests."""
    ends = []
    for impact in (NEWTON, POISSON):
        scene, _, pair = bouncing_ball(contact.Hard(restitution=e, impact=impact))
        run = scene.simulate(2.5, h=1e-3)
        met = run.contacts(pair)[0]
        energy = run.energy().total
        if e == 1.0:
            assert np.abs(energy / energy[0] - 1.0).max() < 1e-10
        else:
            assert met.normal_force[-1] == pytest.approx(G, rel=1e-9)
            assert np.abs(run.v[-100:]).max() < 1e-12
            assert np.diff(energy).max() < 1e-9 * energy[0]
        ends.append(run.x[:, 2])
    assert np.abs(ends[0] - ends[1])[:600].max() < 2e-2


@pytest.mark.parametrize("e", [0.0, 0.9])
def test_stacks_rest_and_slide_by_poissons_law(e):
    """Two boxes on each other on an incline, with friction: at rest without creep, on redundant corners."""
    a = np.deg2rad(20.0)
    scene = fm.System(gravity=(G * np.sin(a), 0.0, -G * np.cos(a)))
    shapes = []
    for k in range(2):
        body = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name=f"box {k}")
        free = scene.connect(fm.joint.Free(), scene.ground.frame(), body.frame())
        free.position = (0.0, 0.0, 0.1 + 0.2 * k, 1.0, 0.0, 0.0, 0.0)
        shapes.append(contact.Box(body.frame(), (0.3, 0.3, 0.2)))
    law = contact.Hard(restitution=e, mu=0.5, impact=POISSON)
    floor = contact.HalfSpace(scene.ground.frame())
    scene.touch([*shapes, floor], [*shapes, floor], law)
    run = scene.simulate(0.3, h=2e-3, rtol=1e-8)
    assert np.abs(run.x[-1] - run.x[0]).max() < 1e-7
    assert np.abs(run.v[-1]).max() < 1e-6


def test_balls_in_a_bowl_come_to_rest_by_poissons_law_without_gain():
    """Many contacts at once, with friction: energy falls by what contacts take, and ends at rest under the weights."""
    random = np.random.default_rng(5)
    scene = fm.System(gravity=(0.0, 0.0, -G))
    places = [(0.25 * (k % 3 - 1), 0.25 * (k // 3 - 1), -0.2 + 0.05 * random.normal()) for k in range(9)]
    shapes = [ball(scene, f"ball {k}", place) for k, place in enumerate(places)]
    bowl, law = contact.HollowSphere(scene.ground.frame(), 0.8), contact.Hard(restitution=0.5, mu=0.4, impact=POISSON)
    pairs = (*scene.touch(shapes, bowl, law), *scene.touch(shapes, shapes, law))
    run = scene.simulate(4.0, h=2e-3, rtol=1e-5)
    energy = run.energy()
    works = sum(one.normal_work[-1] + one.friction_work[-1] for one in run.contacts(pairs))
    assert np.diff(energy.total).max() < 1e-5 * np.ptp(energy.total)
    assert energy.total[-1] - energy.total[0] == pytest.approx(works, rel=2e-2)
    assert energy.kinetic[-1] < 1e-3 * energy.kinetic.max()


def test_what_is_no_law_is_refused_by_name():
    scene, *_ = bouncing_ball(contact.Hard())
    body = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)))
    with pytest.raises(SceneError, match=r"ImpactLaw\.POISSON"):
        scene.touch(
            contact.HalfSpace(scene.ground.frame()), contact.Sphere(body.frame(), 0.1), contact.Hard(impact="poisson")
        )
