"""The integrator that a scene gets when none is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from machines import pendulum, slider_crank
from particles import particle_body
from spring_lattice import linked_pendulums, spring_lattice

import flexmbd as fm
from flexmbd.errors import SceneError
from flexmbd.forms.beam_timoshenko import Parameters
from flexmbd.integrate.automatic import choose
from flexmbd.integrate.machine_rates import machine_rates, rates_of_many


def integrator_line(told):
    """Of what explain() tells, the line that names the method."""
    (line,) = (one for one in told.splitlines() if one.startswith("integrator: "))
    return line


def with_spring(stiffness):
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointSpring(hinge, stiffness, rest=np.pi))
    return scene


def with_friction(coulomb=0.1):
    """Sliding under a load of 9.81 N m, or holding it."""
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointFriction(hinge, coulomb, 1e-3))
    return scene


def with_stop(*, stiffness=1e4, damping=1.0):
    scene, _, hinge = pendulum()
    scene.add_force(fm.force.JointStop(hinge, -0.5, 4.0, stiffness, damping=damping))
    return scene


def with_penalty():
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    bob = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1)), name="bob")
    scene.connect(fm.joint.Free(), scene.ground.frame(), bob.frame())
    scene.connect(fm.joint.Spherical(), scene.ground.frame(), bob.frame(), enforce=fm.Penalty(1e5))
    return scene


def flexible(*, stiffer=1.0):
    """Four modes of 10 to 12 rad/s, or stiffer ones, which the start lets go of by so much less."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    record = particle_body(3, modes=4).record
    body = scene.add(fm.FlexibleBody(replace(record, stiffness=stiffer * record.stiffness)), name="flexible")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame())
    return scene


def flexible_at_a_stop():
    """Modes of 1000 to 1200 rad/s, damped, which nothing but Radau IIA steps over."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    record = particle_body(3, modes=4, damping=0.1).record
    body = scene.add(fm.FlexibleBody(replace(record, stiffness=1e5 * record.stiffness)), name="flexible")
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), body.frame("root"))
    scene.add_force(fm.force.JointStop(hinge, 0.0, 0.6, 2e4))
    hinge.position = 0.3
    return scene


def with_beam(*, looped, softer=1.0):
    """A beam on a hinge, whose other end is free or slides."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    section = Parameters.rectangle(2.1e11 / softer, 0.3, 7850.0, width=0.02, height=0.01, orientation=(0.0, 1.0, 0.0))
    ends = {"hub": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(ends, {"rod": [("hub", "tip")]}, {"rod": section}, 2), name="beam")
    scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), beam.frame("hub"))
    if looped:
        scene.connect(fm.joint.PointOnLine("z"), scene.ground.frame(p=(1.0, 0.0, 0.0)), beam.frame("tip"))
    return scene


@pytest.mark.parametrize(
    ("scene", "arguments", "chosen", "why"),
    [
        (lambda: pendulum()[0], {}, "8(5,3)", "nothing stiff"),
        (lambda: pendulum()[0], {"rtol": 1e-3}, "5(4)", "nothing stiff"),
        (lambda: slider_crank()[0], {}, "8(5,3)", "nothing stiff"),
        (lambda: pendulum()[0], {"h": 1e-3}, "generalized-alpha", "fixed steps"),
        (lambda: with_spring(5.0), {}, "8(5,3)", "vibrations up to 2.24 1/s in a motion of 3.13 1/s"),
        (lambda: with_spring(1e12), {}, "Radau", "vibrations up to 1e+06 1/s in a motion of 3.13 1/s"),
        (with_friction, {}, "8(5,3)", "under the motion's load on friction"),
        (lambda: with_friction(100.0), {}, "Radau", "under the motion's load on friction"),
        (with_stop, {"rtol": 1e-3}, "8(5,3)", "under the motion's load on stops"),
        (lambda: with_stop(stiffness=1e8), {}, "8(5,3)", "under the motion's load on stops"),
        (lambda: with_stop(damping=1e5), {}, "Radau", "under the motion's load on stops"),
        (lambda: flexible_at_a_stop(), {"rtol": 1e-6}, "Radau", "under the motion's load on stops"),
        (with_penalty, {}, "Radau", "penalties"),
        (lambda: with_beam(looped=False), {"rtol": 1e-4}, "Radau", "vibrations up to"),
        (lambda: with_beam(looped=True), {"rtol": 1e-4}, "Radau", "vibrations up to"),
        (lambda: with_beam(looped=False, softer=1e5), {"rtol": 1e-6}, "8(5,3)", "vibrations up to"),
        (lambda: flexible(stiffer=1e4), {"rtol": 1e-3}, "central differences", "vibrations up to 1.26e+03 1/s"),
        (flexible, {"rtol": 1e-9}, "8(5,3)", "limited by accuracy"),
        (lambda: flexible(stiffer=1e6), {"rtol": 1e-4}, "Radau", "vibrations up to 1.26e+04 1/s"),
    ],
)
def test_the_method_suits_the_scene(scene, arguments, chosen, why):
    machine = scene()
    said = integrator_line(machine.explain(**arguments))
    assert chosen in said
    assert why in said
    run = machine.simulate(0.01, **arguments)
    assert chosen in run.stats.integrator
    named = machine.simulate(0.01, integrator="auto", **arguments)
    np.testing.assert_array_equal(run.x, named.x)


def test_a_method_by_a_name_that_there_is_none_of():
    with pytest.raises(SceneError, match=r"integrator must be a method, as fm.RadauIIA\(\), or \"auto\", got 'euler'"):
        pendulum()[0].simulate(1.0, integrator="euler")


def test_a_method_that_was_named_is_told():
    scene = pendulum()[0]
    told = scene.explain(integrator=fm.GeneralizedAlpha())
    assert integrator_line(told) == "integrator: generalized-alpha, rho = 0.8, order 2 (as asked)"
    with pytest.raises(SceneError, match=r"integrator must be a method, as fm\.RadauIIA"):
        scene.explain(integrator="euler")


def machine_in(length, mass, stiffness):
    """A flexible beam of three particles and a spring on its hinge, in metres and kilograms or in other units."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81 * length))
    hub = scene.add(fm.RigidBody(mass, [mass * length**2 * 0.1] * 3))
    hinge = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), hub.frame())
    arm = scene.add(fm.RigidBody(mass, [mass * length**2 * 0.01] * 3, (0.3 * length, 0.0, 0.0)))
    slide = scene.connect(fm.joint.Prismatic("x"), hub.frame(p=(0.2 * length, 0.0, 0.0)), arm.frame())
    scene.add_force(fm.force.JointSpring(slide, stiffness * mass, 0.01 * length))
    hinge.velocity = 2.0
    return scene


@pytest.mark.parametrize("stiffness", [30.0, 1e9])
def test_the_choice_is_the_same_in_any_units(stiffness):
    """In metres and kilograms as in millimetres and tonnes, rates and predicted times included."""
    said = [integrator_line(machine_in(*units, stiffness).explain()) for units in ((1.0, 1.0), (1e3, 1e-3))]
    assert said[0] == said[1]
    assert "predicted" in said[0]


@pytest.mark.parametrize("geared", [False, True])
def test_rates_are_those_of_the_linear_machine(geared):
    """Vibrations along the loops, and how far they are let go: two discs on springs, geared or not, in closed form."""
    scene = fm.System()
    hinges = []
    for stiffness, rest in ((100.0, 0.0), (900.0, 1e-3)):
        body = scene.add(fm.RigidBody(1.0, (1.0, 1.0, 1.0)))
        hinges.append(scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), body.frame()))
        scene.add_force(fm.force.JointSpring(hinges[-1], stiffness, rest))
    if geared:
        scene.couple(fm.joint.Gear(*hinges, ratio=1.0))
    rates = machine_rates(scene.start(), 0.0)
    np.testing.assert_allclose(rates.vibrations, [np.sqrt(500.0)] if geared else [10.0, 30.0], rtol=1e-9)
    np.testing.assert_allclose(rates.amplitudes, [0.9e-3] if geared else [0.0, 1e-3], rtol=1e-9, atol=1e-15)


def test_stops_and_friction_count_as_they_bear_the_load_of_the_motion():
    """A disc that turns at w: a load J w^2; depth and creeping speed under it by hand, and the laws' slopes there."""
    inertia, w = 2.0, 3.0
    load = inertia * w**2
    stiffness, damping, transition = 1e6, 5.0, 1e-3
    scene = fm.System()
    disc = scene.add(fm.RigidBody(1.0, (1.0, 1.0, inertia)))
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), disc.frame())
    hinge.velocity = w
    scene.add_force(fm.force.JointStop(hinge, -1.0, 1.0, stiffness, damping=damping, transition=transition))
    rates = machine_rates(scene.start(), 0.0)
    depth = np.sqrt(2.0 * transition * load / stiffness)  # in the quadratic part
    assert depth < transition
    assert rates.motion == pytest.approx(w)
    assert rates.contact == pytest.approx(np.sqrt(stiffness * depth / transition / inertia))
    assert rates.fastest == pytest.approx(max(rates.contact, load * damping / inertia))
    assert rates.gripped == 1

    static, speed = 40.0, 1e-2
    scene.add_force(fm.force.JointFriction(hinge, 12.0, speed, static=static, stribeck=1.0, viscous=0.1))
    creep = speed * np.arctanh(load / static)
    slope = static / speed / np.cosh(creep / speed) ** 2 + 0.1
    assert machine_rates(scene.start(), 0.0).fastest == pytest.approx((slope + load * damping) / inertia)
    hinge.velocity = 2.0 * w  # the load is four times as large, and more than the friction can bear
    decay = (4.0 * load * damping + 0.1) / inertia
    rates = machine_rates(scene.start(), 0.0)
    assert rates.fastest == pytest.approx(max(decay, rates.contact))


def test_vibrations_that_are_excited_on_the_way_are_told():
    """A mass on a spring of 1e4 rad/s, which is at rest until a force is let go: who chose Radau IIA for it says so."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    rod = scene.add(fm.RigidBody(1.0, (0.01, 0.1, 0.1), (0.5, 0.0, 0.0)))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rod.frame())
    mass = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)))
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), mass.frame())
    scene.add_force(fm.force.JointSpring(slide, 1e8))
    scene.add_force(fm.force.JointForce(slide, fm.Piecewise(lambda t: 1e6 * (t > 0.01), [0.01])))
    with pytest.raises(fm.SimulationError, match="max_steps"), pytest.warns(fm.StepsWarning, match="DORMAND_PRINCE_8"):
        scene.simulate(5.0, rtol=1e-8, max_steps=2500)


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e8])
def test_stops_cost_no_more_steps_than_a_named_method(stiffness):
    """A double pendulum between stops: a tenth of the steps of generalized-alpha, and what rtol allows."""
    def run(**given):
        scene = fm.System(gravity=(0.0, -9.81, 0.0))
        before = scene.ground.frame()
        for _ in range(2):
            rod = scene.add(fm.RigidBody(1.0, (0.01, 0.1, 0.1), (0.5, 0.0, 0.0)))
            hinge = scene.connect(fm.joint.Revolute("z"), before, rod.frame())
            scene.add_force(fm.force.JointStop(hinge, -0.5, 0.5, stiffness, damping=1.0))
            before = rod.frame(p=(1.0, 0.0, 0.0))
        found = scene.simulate(0.6, **given)
        return found.stats.steps, found.beta(hinge)[-1].item()

    steps, angle = run(rtol=1e-6)
    exact = run(rtol=1e-11, integrator=fm.RadauIIA())[1]
    assert abs(angle - exact) < 20e-6
    assert steps < 0.2 * run(rtol=1e-6, integrator=fm.GeneralizedAlpha())[0]


@pytest.mark.mpi
def test_every_rank_chooses_the_same():
    mpi = pytest.importorskip("mpi4py.MPI")
    said = mpi.COMM_WORLD.allgather(flexible(stiffer=1e4).explain(rtol=1e-3))
    assert set(said) == {said[0]}


@pytest.mark.parametrize("kind", ["lattice", "damped lattice", "loops"])
def test_rates_of_many_bodies_as_by_dense_matrices(kind):
    """The fastest rate, and the vibrations that count most with what the start excites of each."""
    if kind == "loops":
        scene = linked_pendulums(60)
    else:
        damping = 30.0 if kind == "damped lattice" else 0.0
        scene = spring_lattice(20, 5, fm.joint.Generic("xy"), damping=damping)[0]
    start = scene.start()
    every, found = machine_rates(start, 0.0), rates_of_many(start, 0.0)
    assert found.motion == pytest.approx(every.motion, rel=1e-6)
    assert found.fastest == pytest.approx(every.fastest, rel=1e-2)
    assert found.fastest <= every.fastest * (1.0 + 1e-9)  # as of any space of motions that the loops allow
    for order in (4.0, 7.0):
        wanted, told = (one.vibrations * one.amplitudes ** (1.0 / order) for one in (every, found))
        assert told.max(initial=0.0) == pytest.approx(wanted.max(initial=0.0), rel=0.1)


def test_a_large_lattice_is_stepped_as_its_rates_say():
    """Soft springs: nothing stiff in how many there are."""
    scene, _ = spring_lattice(40, 5, fm.joint.Generic("xy"), damping=1.0)
    start = scene.start()
    assert start.scene.nv > 300
    chosen = choose(start, t=0.0, rtol=1e-7, h=None)
    assert isinstance(chosen.method, fm.ExplicitRungeKutta)
    assert "vibrations up to" in chosen.why
