"""Errors fall with rtol down to round-off, and no looser rtol takes more steps: of all methods, on unlike machines."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.forms.beam_timoshenko import Parameters

EIGHT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
METHODS = {
    "5(4)": (fm.ExplicitRungeKutta(), range(3, 10)),
    "8(5,3)": (EIGHT, range(3, 10)),
    "Radau": (fm.RadauIIA(), range(3, 10)),
    "generalized-alpha": (fm.GeneralizedAlpha(), range(3, 7)),
    "energy-momentum": (fm.EnergyMomentum(), range(3, 6)),
    "central differences": (fm.CentralDifference(), range(3, 7)),
}


def oscillator(*, far=800.0):
    """A mass on a spring, whose rail has its frame far away."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="body")
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=(far, 0.0, 0.0)), body.frame(), name="slide")
    scene.add_force(fm.force.JointSpring(slide, 400.0))
    slide.position = 0.1
    return scene, [slide], 1.0


def four_bar():
    """A planar loop under gravity."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    before, joints = scene.ground.frame(), []
    for mass, length, angle in ((0.5, 0.2, 1.2), (1.0, 0.6, -0.9), (0.8, 0.4, 0.0)):
        spin = mass * length**2 / 12.0
        bar = scene.add(fm.RigidBody(mass, (spin, spin, spin), (length / 2.0, 0.0, 0.0)))
        joints.append(scene.connect(fm.joint.Revolute("z"), before, bar.frame()))
        joints[-1].position = angle
        before = bar.frame(p=(length, 0.0, 0.0))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(p=(0.5, 0.0, 0.0)), before)
    return scene, joints[:1], 1.0


def beam():
    """A very flexible beam on a hinge, of two exact elements."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    rubber = Parameters.rectangle(5e6, 0.3, 1200.0, width=0.1, height=0.1, orientation=(0.0, 0.0, 1.0))
    ends = {"a": (0.0, 0.0, 0.0), "b": (1.0, 0.0, 0.0)}
    rod = scene.add(fm.ExactBeam(ends, {"rod": [("a", "b")]}, {"rod": rubber}, 2, viscosity=1e-3), name="rod")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), rod.frame("a"))
    return scene, [hinge], 0.3


def lattice():
    """Masses on rails in a plane, each with its frame of the ground, held by springs to their neighbours."""
    scene, slides, masses = fm.System(), [], {}
    for i in range(1, 7):
        for j in range(2):
            mass = scene.add(fm.RigidBody(10.0, (1.0, 1.0, 1.0)), name=f"{i} {j}")
            slides.append(scene.connect(fm.joint.Planar("z"), scene.ground.frame((i, j, 0.0)), mass.frame()))
            scene.add_force(fm.force.FrameForce(mass.frame(), (0.0, -0.5, 0.0)))
            masses[i, j] = mass.frame()
    masses |= {(0, j): scene.ground.frame((0.0, j, 0.0)) for j in range(2)}
    for (i, j), end in masses.items():
        for di, dj in ((1, 0), (0, 1), (1, 1)):
            if (i + di, j + dj) in masses and i + di > 0:
                other = masses[i + di, j + dj]
                scene.add_force(fm.force.SpringDamper(end, other, 4000.0, float(np.hypot(di, dj)), damping=10.0))
    return scene, slides, 1.0


def kicked():
    """A slider-crank that a motor with a time constant of 0.3 ms brings to speed from its dead centre."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    crank = scene.add(fm.RigidBody(0.44, (0.0034, 0.0067, 0.0036)), name="crank")
    rod = scene.add(fm.RigidBody(0.15, (1e-4, 0.01, 0.01), (0.45, 0.0, 0.0)), name="rod")
    slider = scene.add(fm.RigidBody(1.0, (5e-3, 3e-3, 5e-3)), name="slider")
    drive = scene.connect(fm.joint.Revolute("y"), scene.ground.frame(), crank.frame())
    scene.connect(fm.joint.Revolute("y"), crank.frame(p=(0.18, 0.0, 0.0)), rod.frame())
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(p=(1.08, 0.0, 0.0)), slider.frame())
    scene.connect(fm.joint.Revolute("y"), slider.frame(), rod.frame(p=(0.9, 0.0, 0.0)))
    scene.add_force(fm.force.JointTorque(drive, 40.0))
    scene.add_force(fm.force.JointDamper(drive, 20.0))
    scene.add_force(fm.force.JointDamper(slide, 30.0))
    return scene, [drive], 1.0


SCENES = {one.__name__: one for one in (oscillator, four_bar, beam, lattice, kicked)}


@cache
def reference(name):
    scene, joints, t_end = SCENES[name]()
    return scene.simulate(t_end, rtol=1e-13, integrator=EIGHT), joints


def ladder(name, method):
    """Of each rtol: the largest error at any step, and the steps."""
    integrator, digits = METHODS[method]
    exact, known = reference(name)
    found = []
    for k in digits:
        scene, joints, t_end = SCENES[name]()
        run = scene.simulate(t_end, rtol=10.0**-k, integrator=integrator)
        off = [np.abs(run.beta(a) - exact.beta(b, t=run.t)).max() for a, b in zip(joints, known, strict=True)]
        found.append((max(off), run.stats.steps))
    return np.array(found).T


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("method", METHODS)
def test_errors_fall_with_rtol(method, name):
    """Each decade, and in two to a fifth at least, where they are not below rtol; at most a hundred rtol."""
    errors, steps = ladder(name, method)
    rtol = 10.0 ** -np.array(METHODS[method][1], float)
    assert (errors < 100.0 * rtol).all(), errors / rtol
    assert (errors[1:] < np.maximum(errors[:-1], rtol[1:])).all(), errors
    assert (errors[2:] < np.maximum(errors[:-2] / 5.0, rtol[2:])).all(), errors
    # a rejection more or less is chance
    assert (steps[:-1] <= 1.1 * steps[1:] + 10.0).all(), steps


@pytest.mark.parametrize("method", ["Radau", "generalized-alpha", "8(5,3)"])
def test_frames_of_the_ground_say_nothing_of_sizes(method):
    """Neither its rail's frame nor its own origin far away makes an oscillator of 0.1 m less exact."""
    ends = []
    for far in (0.0, 8.0, 800.0):
        scene, (slide,), t_end = oscillator(far=far)
        ends.append(scene.simulate(t_end, rtol=1e-5, integrator=METHODS[method][0]).beta(slide)[-1].item())
    place = (800.0, 0.0, 0.0)
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01), place))
    slide = scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), body.frame(p=place))
    scene.add_force(fm.force.JointSpring(slide, 400.0))
    slide.position = 0.1
    ends.append(scene.simulate(1.0, rtol=1e-5, integrator=METHODS[method][0]).beta(slide)[-1].item())
    np.testing.assert_allclose(ends, ends[0], rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("method", ["Radau", "generalized-alpha"])
@pytest.mark.parametrize("rtol", [1e-1, 1e-3])
def test_a_start_of_a_motor_is_forgotten(method, rtol):
    """Behind the start the steps are as many as in a run that begins there, but for a few."""
    integrator = METHODS[method][0]
    scene, (drive,), _ = kicked()
    run = scene.simulate(3.0, rtol=rtol, integrator=integrator)
    exact, (known,) = reference("kicked")
    later, (other,), _ = kicked()
    other.position, other.velocity = exact.beta(known, t=0.1).item(), exact.beta_rate(known, t=0.1).item()
    again = later.simulate(2.9, rtol=rtol, integrator=integrator)
    assert np.count_nonzero(run.t > 0.1) <= 2 * again.stats.steps + 20
    assert run.beta(drive)[-1] == pytest.approx(again.beta(other)[-1], abs=6.0 * rtol)


@pytest.mark.parametrize("method", ["Radau", "generalized-alpha"])
@pytest.mark.parametrize("h", [5e-3, 1e-2, 2e-2])
def test_fixed_steps_get_over_a_start_that_they_do_not_resolve(method, h):
    """The motor's start, of 0.3 ms, is taken in parts of a step, behind which steps are h long."""
    scene, (drive,), t_end = kicked()
    run = scene.simulate(t_end, h=h, integrator=METHODS[method][0])
    exact, (known,) = reference("kicked")
    assert np.diff(run.t)[20:] == pytest.approx(h, rel=1e-9)
    assert run.beta(drive)[-1] == pytest.approx(exact.beta(known)[-1], abs=0.05)
