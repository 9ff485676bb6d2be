"""Explicit steps of stiff machines: rounding of places makes noise of accelerations, which no step is to follow."""

from __future__ import annotations

import numpy as np
import pytest

import flexmbd as fm
from flexmbd.forms import beam_timoshenko

WIRE = beam_timoshenko.Parameters.rectangle(2.1e11, 0.3, 7850.0, width=0.002, height=0.002, orientation=(0.0, 1.0, 0.0))
FORCE = 10.0  # N
STEPS = 2100
STIFF, LEVER, INERTIA = 1e7, 0.1, 1e-2  # N/m, m, kg m^2


def wire() -> tuple[fm.System, fm.Frame, float]:
    """A steel wire of four elements, which a small force bends slowly; its tip and its fastest vibration (1/s)."""
    scene = fm.System()
    ends = {"clamp": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    beam = scene.add(fm.ExactBeam(ends, {"wire": [("clamp", "tip")]}, {"wire": WIRE}, 4), name="wire")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    scene.add_force(fm.force.FrameForce(beam.frame("tip"), (0.0, 0.0, fm.Sine(FORCE, 1.0))))
    return scene, beam.frame("tip"), float(np.abs(scene.linearize().eigenvalues()).max())


def coupled() -> tuple[fm.System, fm.Frame, float]:
    """Two bodies on a stiff bushing turn about each other, a kilometre off; one, and the fastest vibration (1/s).

    Shear of the bushing against both bodies' translation and the turn of the one that it holds on a lever.
    """
    scene = fm.System()
    bodies = [scene.add(fm.RigidBody(1.0, (INERTIA,) * 3), name=name) for name in ("one", "two")]
    for body, place, speed in zip(bodies, (1000.0, 1000.1), (0.0, 0.01), strict=True):
        flight = scene.connect(fm.joint.Free(), scene.ground.frame(p=(place, 0.0, 0.0)), body.frame())
        flight.velocity = (0.0, speed, 0.0, 0.0, 0.0, 0.1)
    one, two = bodies
    scene.add_force(fm.force.Bushing(one.frame(p=(LEVER, 0.0, 0.0)), two.frame(), (STIFF,) * 3 + (1e3,) * 3))
    return scene, two.frame(), float(np.sqrt(STIFF * (2.0 + LEVER**2 / INERTIA)))


@pytest.mark.parametrize("pair", [fm.Pair.DORMAND_PRINCE_5, fm.Pair.DORMAND_PRINCE_8], ids=["5(4)", "8(5,3)"])
@pytest.mark.parametrize("machine", [wire, coupled])
def test_steps_are_those_of_stability(machine, pair):
    """Not shorter than a tenth of the radian of the fastest vibration, however tight the tolerance."""
    scene, _, fastest = machine()
    with pytest.raises(fm.SimulationError) as stopped, pytest.warns(fm.StepsWarning, match="RadauIIA"):
        scene.simulate(1e3, rtol=1e-8, integrator=fm.ExplicitRungeKutta(pair), max_steps=STEPS)
    steps = np.diff(stopped.value.trajectory.t)
    assert np.median(steps[STEPS // 2 :]) > 0.1 / fastest


def test_what_the_noise_hides_is_not_lost():
    scene, tip, _ = wire()
    places = [
        scene.simulate(0.01, rtol=1e-9, integrator=one).position(tip)[-1]
        for one in (fm.RadauIIA(), fm.ExplicitRungeKutta())
    ]
    travel = abs(places[0][2])
    assert travel > 1e-8
    assert places[1] == pytest.approx(places[0], abs=1e-3 * travel)


def test_a_restart_far_off_goes_on_to_the_bit():
    """The noise is that of places a kilometre off, which a restart has evaluated nothing of before."""
    scene, _, fastest = coupled()
    end = 400.0 / fastest
    how = {"rtol": 1e-8, "integrator": fm.ExplicitRungeKutta()}
    whole = scene.simulate(end, checkpoints=[0.5 * end], **how)
    rest = scene.simulate(end, restart=whole.checkpoints[0], **how)
    assert len(rest.t) > 100
    np.testing.assert_array_equal(rest.x, whole.x[-len(rest.x) :])


def test_long_runs_of_soft_machines_do_not_warn(recwarn):
    """Many steps that the motion asks for are none too many."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    bob = scene.add(fm.RigidBody(1.0, (0.1, 0.1, 0.1), (0.5, 0.0, 0.0)), name="bob")
    joint = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), bob.frame())
    scene.add_force(fm.force.JointSpring(joint, 50.0))
    with pytest.raises(fm.SimulationError):
        scene.simulate(1e4, rtol=1e-9, integrator=fm.ExplicitRungeKutta(), max_steps=3000)
    assert not recwarn.list
