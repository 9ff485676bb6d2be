"""Hard contacts beside what machines have: loops, drives, springs, controllers, elastic bodies, units, frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from exported_bodies import soft_bar
from hard_scenes import G, bouncing_ball, four_bar

import flexmbd as fm
from flexmbd import contact
from flexmbd.errors import SceneError
from flexmbd.forms import beam_timoshenko
from flexmbd.run.stopped import SimulationError


@pytest.mark.parametrize(("backwards", "scale"), [(False, 1.0), (True, 1.0), (False, 1000.0)])
def test_a_coupler_of_a_four_bar_meets_a_plane(backwards, scale):
    """One inertia: the blow leaves the share e of its speed, whichever body and joint comes first."""
    scene, pair = four_bar(contact.Hard(restitution=0.4), backwards=backwards, scale=scale)
    run = scene.simulate(1.0, h=1e-3)
    velocity = run.velocity(pair.frame_G)
    assert np.linalg.norm(velocity[[0, -1]], axis=1) == pytest.approx([0.5 * scale, 0.2 * scale], rel=1e-6)
    assert velocity[-1, 1] > 0.0 > velocity[0, 1]
    met = run.contacts(pair)[0]
    hit = run.t[np.argmax(met.normal_force > 0.0)]
    assert hit == pytest.approx(np.deg2rad(40.0), abs=2e-3)
    assert run.stats.constraint_residual < 1e-9 * scale
    # of the machine's inertia J: the normal impulse's moment L cos(30 deg) P = J (1 + e)
    J = (2.0 * (1.0 / 12.0 + 1.0 / 4.0) * 0.25 + 2.0 * 0.25) * scale**2
    impulse = met.impulse[:, 1].sum()
    assert impulse * 0.5 * scale * np.cos(np.deg2rad(30.0)) == pytest.approx(1.4 * J, rel=3e-3)


def test_a_four_bar_that_rests_on_a_plane_is_borne():
    """Under its weight, from virtual work: N dy = (m/2 + M + m/2) g dy; N = 3 m g of bars of 1, 2, 1 kg."""
    scene, pair = four_bar(contact.Hard())
    scene.gravity = (0.0, -G, 0.0)
    run = scene.simulate(1.5, h=1e-3)
    met = run.contacts(pair)[0]
    assert met.normal_force[-1] == pytest.approx(3.0 * G, rel=1e-7)
    assert np.abs(run.v[-1]).max() < 1e-9
    assert abs(met.gap[-1]) < 1e-9


def driven_table(motion, law, height):
    scene = fm.System(gravity=(0.0, 0.0, -G))
    table = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="table")
    lift = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), table.frame())
    lift.prescribe(motion)
    ball = scene.add(fm.RigidBody(2.0, (0.01, 0.01, 0.01)), name="ball")
    drop = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame())
    drop.position = height
    (pair,) = scene.touch(contact.HalfSpace(table.frame()), contact.Sphere(ball.frame(), 0.1), law)
    return scene, lift, drop, pair


def test_a_ball_rides_on_a_table_that_shakes():
    """Below g its acceleration is the table's: N = m (g + z''), its way the table's within h^2."""
    amplitude, omega = 0.05, 10.0
    errors, speeds, forces = [], [], []
    for h in (2e-3, 1e-3):
        scene, lift, drop, pair = driven_table(fm.Sine(amplitude, omega, phase=np.pi / 2), contact.Hard(), 0.15)
        run = scene.simulate(2.0, h=h)
        met = run.contacts(pair)[0]
        force = 2.0 * (G - amplitude * omega**2 * np.cos(omega * (run.t - 0.5 * h)))
        forces.append(np.abs(met.normal_force - force)[3:].max())
        errors.append(np.abs(run.beta(drop) - run.beta(lift) - 0.1).max())
        speeds.append(np.abs(run.beta_rate(drop) - run.beta_rate(lift))[2:].max())
    assert errors[0] < 5e-6
    assert errors[1] < 0.3 * errors[0]
    assert speeds[0] < 0.1 * (2e-3 * omega) ** 2 * amplitude * omega
    assert speeds[1] < 0.3 * speeds[0]
    assert forces[0] < 1e-4 * 2.0 * G
    assert forces[1] < 0.3 * forces[0]


def test_a_ball_bounces_on_a_table_that_rises_as_on_one_at_rest():
    """The table's axes are inertial ones: of a fall from the same height, the same flights."""
    law = contact.Hard(restitution=0.5)
    speed = 0.7
    rises = fm.Motion(
        fm.compiled(lambda t: 0.7 * t), fm.compiled(lambda t: 0.7 + 0.0 * t), fm.compiled(lambda t: 0.0 * t)
    )
    ways = []
    for motion, start in ((rises, speed), (None, 0.0)):
        scene, lift, drop, _ = driven_table(motion or fm.Sine(0.0, 1.0), law, 0.4)
        drop.velocity = start
        run = scene.simulate(2.0, h=1e-3)
        ways.append(run.beta(drop) - run.beta(lift))
    assert ways[0] == pytest.approx(ways[1], abs=1e-9)


@pytest.mark.parametrize("settings", [{"h": 1e-3}, {"rtol": 1e-6, "integrator": fm.ExplicitRungeKutta()}])
@pytest.mark.parametrize("loop", [False, True])
def test_what_prescribed_motions_alone_close_is_refused_by_name(loop, settings):
    """A ball, or a four-bar, that is driven into a plane at a known time: no impulse is large enough."""
    if loop:
        scene, _ = four_bar(contact.Hard(restitution=0.4), driven=True)
        time = np.deg2rad(40.0)
    else:
        scene = fm.System(gravity=(0.0, 0.0, -G))
        ball = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="ball")
        scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), ball.frame()).prescribe(
            fm.Sine(0.1, 10.0, offset=0.15)
        )
        scene.touch(contact.HalfSpace(scene.ground.frame()), contact.Sphere(ball.frame(), 0.1), contact.Hard())
        time = 7.0 * np.pi / 60.0
    with pytest.raises(SimulationError, match=r"closed.* by prescribed motions, and nothing gives way") as caught:
        scene.simulate(1.0, **settings)
    assert caught.value.trajectory.t[-1] == pytest.approx(time, abs=2e-3)


def test_driven_bodies_may_touch_and_slide_and_held_ones_overlap():
    """One that comes down to the floor and leaves it, one that is led along it, one that a joint holds half in it."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    dips, slides, held = (scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name=f"body {k}") for k in range(3))
    scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), dips.frame()).prescribe(fm.Sine(0.1, 10.0, offset=0.2))
    along = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=(0.0, 5.0, 0.1)), slides.frame())
    along.prescribe(fm.Sine(1.0, 3.0))
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), held.frame())
    floor = contact.HalfSpace(scene.ground.frame())
    for body in (dips, slides, held):
        scene.touch(floor, contact.Sphere(body.frame(), 0.1), contact.Hard(mu=0.3))
    assert scene.simulate(2.0, h=1e-3).t[-1] == 2.0


@pytest.mark.parametrize("damping", [2.0, 500.0, 2000.0])
def test_a_sprung_block_is_pressed_on_its_stop(damping):
    """It comes to the stop, loses all at e = 0, and rests: N = k x0 - m g, whatever a damper takes of its speed."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    block = scene.add(fm.RigidBody(2.0, (0.1, 0.1, 0.1)), name="block")
    slide = scene.connect(fm.joint.Prismatic("z"), scene.ground.frame(), block.frame())
    slide.position = -0.1
    scene.add_force(fm.force.JointSpring(slide, 500.0, rest=0.2, damping=damping))
    stop = contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, 0.1)), normal=(0.0, 0.0, -1.0))
    (pair,) = scene.touch(stop, contact.Sphere(block.frame(), 0.05), contact.Hard())
    run = scene.simulate(20.0 if damping > 100.0 else 1.0, h=1e-3)
    met = run.contacts(pair)[0]
    assert met.normal_force[-1] == pytest.approx(500.0 * (0.2 - 0.05) - 2.0 * G, rel=1e-8)
    assert met.gap.min() > -1e-2


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_controllers_and_state_equations_work_beside_contacts(e):
    """A controller presses a ball that rests; an actuator with a lag follows: N goes to m g + F."""
    scene, drop, pair = bouncing_ball(contact.Hard(restitution=e, mu=0.3), height=0.01)
    push = fm.Signal("push")
    scene.add_force(fm.force.FrameForce(drop.child, (0.0, 0.0, push)))
    scene.add_controller(
        lambda t, y, z: (-5.0 - z[0], z + 0.5 * (1.0 - z)), period=0.01, measurements=[], inputs=[push], state=[0.0]
    )
    run = scene.simulate(1.0, h=1e-3, checkpoints=[0.505])
    met = run.contacts(pair)[0]
    assert met.normal_force[-1] == pytest.approx(G + 6.0, rel=1e-6)
    rest = scene.simulate(1.0, h=1e-3, restart=run.checkpoints[0])
    assert np.array_equal(run.x[-1], rest.x[-1])


def test_links_of_one_tree_touch_each_other():
    """Two links on a hinge fold onto each other: within one part, so that the spin about the ground's hinge is kept."""
    scene = fm.System()
    links = [scene.add(fm.RigidBody(1.0, (1e-3, 1.0 / 12.0, 1.0 / 12.0)), name=f"link {k}") for k in range(2)]
    left, right = (-0.5, 0.0, 0.0), (0.5, 0.0, 0.0)
    first = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), links[0].frame(p=left))
    second = scene.connect(fm.joint.Revolute("z"), links[0].frame(p=right), links[1].frame(p=left))
    second.position, second.velocity, first.velocity = 2.5, 3.0, 0.4
    capsule = contact.Capsule(links[0].frame(R=[[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]), 0.05, 1.0)
    tip = links[1].frame(p=right)
    (pair,) = scene.touch(capsule, contact.Sphere(tip, 0.05), contact.Hard(restitution=0.5, mu=0.2))
    run = scene.simulate(0.4, h=2e-4)
    met = run.contacts(pair)[0]
    hit = int(np.argmax(met.normal_force > 0.0))
    spin = run.momentum().angular[:, 2]
    assert hit > 0
    assert spin == pytest.approx(np.full(len(spin), spin[0]), rel=1e-3)
    assert spin[:hit] == pytest.approx(np.full(hit, spin[0]), rel=1e-5)
    before, after = run.beta_rate(second)[[hit - 1, hit]]
    assert before > 0.0 > after
    energy = run.energy().total
    assert energy[-1] - energy[0] == pytest.approx(met.normal_work[-1] + met.friction_work[-1], rel=2e-2)


def test_a_point_mass_bounces_and_what_would_turn_it_is_refused():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    point = scene.add(fm.PointMass(0.3), name="point")
    flight = scene.connect(fm.joint.Translation(), scene.ground.frame(), point.frame())
    flight.position, flight.velocity = (0.0, 0.0, 0.5), (1.0, 0.0, 0.0)
    floor = contact.HalfSpace(scene.ground.frame())
    for shape in (contact.Box(point.frame(), (0.1, 0.1, 0.1)), contact.Capsule(point.frame(), 0.1, 0.1)):
        with pytest.raises(SceneError, match="point mass 'point' has no orientation"):
            scene.touch(floor, shape, contact.Hard())
    (pair,) = scene.touch(floor, contact.Vertex(point.frame()), contact.Hard(restitution=0.6, mu=0.1))
    run = scene.simulate(3.0, h=1e-3)
    met = run.contacts(pair)[0]
    first = int(np.argmax(met.normal_force > 0.0))
    assert run.beta_rate(flight)[first + 1, 2] > 0.0
    assert met.impulse[first, 2] == pytest.approx(0.3 * 1.6 * np.sqrt(G), rel=5e-3)
    assert met.impulse[first, 0] == pytest.approx(-0.1 * met.impulse[first, 2], rel=1e-9)
    assert met.normal_force[-1] == pytest.approx(0.3 * G, rel=1e-9)
    assert np.abs(run.v[-1]).max() < 1e-9


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_units_and_axes_do_not_matter(e):
    """In mm and t, and with up along x: the same numbers, in those units and along that axis."""
    law = contact.Hard(restitution=e, mu=0.3)
    ways, forces = [], []
    for settings in ({}, {"size": 1000.0, "mass": 1e-3}, {"up": "x"}):
        scene, drop, pair = bouncing_ball(law, **settings)
        size, axis = settings.get("size", 1.0), "xyz".index(settings.get("up", "z"))
        slide = np.zeros(6)
        slide[(axis + 1) % 3] = 0.5 * size
        drop.velocity = slide
        run = scene.simulate(2.0, h=1e-3, rtol=1e-10)
        ways.append(np.roll(run.x[:, :3], -axis, axis=1) / size)
        forces.append(run.contacts(pair)[0].normal_force)
    for way, force in zip(ways[1:], forces[1:], strict=True):
        assert way == pytest.approx(ways[0], abs=1e-9)
        assert force == pytest.approx(forces[0], abs=1e-7 * forces[0].max())


def two_rods(root, *, h):
    """(nt, 6) the places of two rods on a hinge that fly onto a floor, the first or the second on the free joint."""
    scene = fm.System(gravity=(0.0, 0.0, -G))
    rods = [scene.add(fm.RigidBody(1.0 + k, (1e-2, 0.1, 0.1)), name=f"rod {k}") for k in range(2)]
    middle = ((0.5, 0.0, 0.0), (-0.5, 0.0, 0.0))
    hinge = [rods[k].frame(p=middle[k]) for k in range(2)]
    free = scene.connect(fm.joint.Free(), scene.ground.frame(), rods[root].frame())
    free.position = (0.5 * (2 * root - 1.0), 0.0, 0.4, 1.0, 0.0, 0.0, 0.0)
    scene.connect(fm.joint.Revolute("y"), hinge[root], hinge[1 - root]).position = 0.0
    floor, law = contact.HalfSpace(scene.ground.frame()), contact.Hard(restitution=0.3, mu=0.4)
    for k, far in enumerate(((-0.5, 0.0, 0.0), (0.5, 0.0, 0.0))):
        scene.touch(floor, contact.Sphere(rods[k].frame(p=far), 0.05), law)
    scene.touch(floor, contact.Sphere(rods[0].frame(p=middle[0]), 0.1), law)
    run = scene.simulate(0.6, h=h, rtol=1e-10)
    return np.concatenate([run.position(rod.frame()) for rod in rods], axis=1)


def test_another_body_at_the_root_gives_the_same_motion():
    """Within the error of a step's impacts."""
    apart = [np.abs(two_rods(0, h=h) - two_rods(1, h=h)).max() for h in (1e-3, 2.5e-4)]
    assert apart[0] < 1e-3
    assert apart[1] < 0.3 * apart[0]


def test_variants_give_what_scenes_built_with_their_values_give():
    """To the bit, also from the second run on, and in an ensemble."""

    def scene_of(place, mass):
        scene, drop, pair = bouncing_ball(contact.Hard(restitution=0.5, mu=0.3), mass=mass)
        drop.position, drop.velocity = (0.0, 0.0, place, 1.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0, 5.0, 0.0)
        return scene, drop, pair

    scene, drop, _ = scene_of(0.5, 1.0)
    ball = drop.child.body
    machine = scene.compile(
        parameters={"place": fm.parameter.InitialPosition(drop), "mass": fm.parameter.Mass(ball)}
    )
    places, masses = (0.3, 0.5, 0.7, 0.4), (1.0, 2.0, 1.5, 1.0)
    for height, mass in zip(places, masses, strict=True):
        place = (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0)
        ran = machine.simulate(0.8, h=1e-3, place=place, mass=mass)
        alone, other, _ = scene_of(height, 1.0)
        other.child.body.mass = mass
        built = alone.simulate(0.8, h=1e-3)
        assert np.array_equal(ran.x, built.x)
    samples = {"place": [(0.0, 0.0, z, 1.0, 0.0, 0.0, 0.0) for z in places], "mass": np.array(masses)}
    outputs = {"end": lambda run: run.x[-1]}
    with machine.ensemble(samples, outputs, t_end=0.8, h=1e-3) as study:
        assert np.array_equal(study.output("end")[-1], built.x[-1])


def test_an_elastic_bar_rests_on_a_stop_as_on_a_stiff_spring():
    """Its damped tip, let go above a stop, ends with the force of the equilibrium on a stiff smooth contact."""
    damped = replace(soft_bar(), damping=np.diag(0.3 * np.sqrt(soft_bar().stiffness)))
    ends = []
    for law in (contact.Hard(), contact.PowerLaw(k=1e6)):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        bar = scene.add(fm.FlexibleBody(damped), name="bar")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), bar.frame("x_min"))
        tip = bar.frame("x_max")
        (pair,) = scene.touch(
            contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -0.02))), contact.Vertex(tip), law
        )
        if isinstance(law, contact.Hard):
            run = scene.simulate(1.5, h=6e-5)
            met = run.contacts(pair)[0]
            assert abs(met.gap[-1]) < 1e-9
            ends.append(met.normal_force[-1])
        else:
            point = scene.equilibrium()
            ends.append(1e6 * -(point.position(tip)[2] + 0.02))
    assert ends[0] == pytest.approx(ends[1], rel=1e-3)
    assert ends[0] > 1.0


def test_an_elastic_bar_strikes_by_newtons_law_and_keeps_the_balance_of_energy():
    scene = fm.System(gravity=(0.0, 0.0, -G))
    bar = scene.add(fm.FlexibleBody(soft_bar()), name="bar")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), bar.frame("x_min"))
    tip = bar.frame("x_max")
    (pair,) = scene.touch(
        contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -0.02))), contact.Vertex(tip), contact.Hard(restitution=0.5)
    )
    run = scene.simulate(0.3, h=5e-5)
    met = run.contacts(pair)[0]
    hit = int(np.argmax(met.normal_force > 0.0))
    speed = run.velocity(tip)[:, 2]
    assert speed[hit] == pytest.approx(-0.5 * speed[hit - 1], rel=5e-3)
    energy = run.energy().total
    assert energy - energy[0] == pytest.approx(met.normal_work, abs=2e-2 * np.abs(met.normal_work[-1]))


def test_the_tip_of_an_exact_beam_rests_on_a_stop():
    """The mean of its swings about it: against the equilibrium of the beam on a stiff smooth contact."""
    rubber = beam_timoshenko.Parameters.rectangle(
        2e7, 0.3, 1100.0, width=0.04, height=0.06, orientation=(0.0, 1.0, 0.0)
    )
    ends = []
    for law in (contact.Hard(), contact.PowerLaw(k=1e6)):
        scene = fm.System(gravity=(0.0, 0.0, -G))
        points = {"clamp": (0.0, 0.0, 0.0), "middle": (0.5, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
        pieces = {"rod": [("clamp", "middle"), ("middle", "tip")]}
        beam = scene.add(fm.ExactBeam(points, pieces, {"rod": rubber}, 2), name="beam")
        scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
        tip, above = beam.frame("tip"), scene.ground.frame(p=(0.5, 0.0, 2.0))
        scene.add_force(fm.force.SpringDamper(above, beam.frame("middle"), 0.0, 1.0, damping=20.0))
        (pair,) = scene.touch(
            contact.HalfSpace(scene.ground.frame(p=(0.0, 0.0, -0.02))), contact.Vertex(tip), law
        )
        if isinstance(law, contact.Hard):
            run = scene.simulate(2.0, h=1e-4)
            ends.append(run.contacts(pair)[0].normal_force[len(run.t) // 2 :].mean())
        else:
            ends.append(1e6 * -(scene.equilibrium().position(tip)[2] + 0.02))
    assert ends[0] == pytest.approx(ends[1], rel=5e-3)
    assert ends[0] > 1.0
