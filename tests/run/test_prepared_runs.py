"""Runs of variants in the arrays of runs before: to the bit those in new arrays, whatever ran before them."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from particles import particle_body

import flexmbd as fm
from flexmbd import parameter as vary
from flexmbd.errors import AssemblyError, SceneError
from flexmbd.run.prepared import PreparedRuns

Values = list[dict[str, Any]]
Case = tuple[fm.CompiledMachine, Values]
TILT = np.array([[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]])


def chain() -> Case:
    """Parallel hinges with springs and a stop; sizes that change the machine's extent."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    end, joints, pins, links = scene.ground.frame(), [], [], []
    for k in range(4):
        links.append(scene.add(fm.RigidBody(0.5, (1e-4, 2e-3, 2e-3), (0.1, 0.0, 0.0)), name=f"link {k}"))
        joints.append(scene.connect(fm.joint.Revolute("z"), end, links[-1].frame()))
        pins.append(end := links[-1].frame((0.2, 0.0, 0.0)))
    joints[0].position, joints[0].velocity = 0.3, 0.0
    spring = scene.add_force(fm.force.JointSpring(joints[1], 2.0, 0.1, 0.01))
    stop = scene.add_force(fm.force.JointStop(joints[0], -1.0, 1.0, 50.0))
    named = {
        "mass": vary.Mass(links[1]), "inertia": vary.Inertia(links[2]), "com": vary.CentreOfMass(links[3]),
        "pin": vary.FrameOrigin(pins[1]), "k": vary.OfForce(spring, "stiffness"), "upper": vary.OfForce(stop, "upper"),
        "angle": vary.InitialPosition(joints[0]), "rate": vary.InitialVelocity(joints[0]),
    }  # fmt: skip
    values: Values = [
        {"mass": 0.7, "pin": (0.25, 0.0, 0.0), "rate": 2.0}, {"inertia": np.diag([2e-3, 1e-3, 2e-3]), "k": 9.0},
        {"com": (0.3, 0.1, 0.0), "angle": -0.4, "upper": 0.5}, {"pin": (0.02, 0.1, 0.05)}, {"mass": 0.7, "rate": 2.0},
    ]  # fmt: skip
    return scene.compile(parameters=named), values


def branched() -> Case:
    """A modal body behind a universal joint, a driven slide, a bushing, a compiled law, torques in time."""

    @fm.compiled
    def law(t: float, beta: float, rate: float) -> float:
        return -0.5 * beta**3 - 0.02 * rate

    scene = fm.System(gravity=(0.0, -9.81, 0.5))
    arm = scene.add(fm.RigidBody(1.2, (0.02, 0.05, 0.05), (0.25, 0.0, 0.0)), name="arm")
    tail = scene.add(fm.FlexibleBody(particle_body(1, modes=3, damping=2.0).record), name="tail")
    flap = scene.add(fm.RigidBody(0.2, (0.01, 0.01, 0.01), (0.1, 0.0, 0.0)), name="flap")
    place, tip = arm.frame((0.5, 0.0, 0.0)), tail.frame("tip")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), arm.frame())
    scene.connect(fm.joint.Universal(), place, tail.frame("root"))
    slide = scene.connect(fm.joint.Prismatic("x"), tip, flap.frame())
    slide.prescribe(fm.Sine(0.02, 5.0))
    hinge.position, hinge.velocity, tail.q, tail.q_rate = 0.2, 1.0, (0.0, 0.01, 0.0), (0.0, 0.0, 0.1)
    scene.add_force(fm.force.JointLaw(hinge, law))
    bush = scene.add_force(fm.force.Bushing(flap.frame(), place, (50.0,) * 3 + (5.0,) * 3))
    push = scene.add_force(fm.force.FrameForce(tip, (0.0, -1.0, 0.0)))
    torque = scene.add_force(fm.force.JointTorque(hinge, fm.Sine(0.5, 20.0)))
    named = {
        "axes": vary.FrameAxes(place), "bush": vary.OfForce(bush, "stiffness"), "push": vary.OfForce(push, "force"),
        "torque": vary.OfForce(torque, "value"), "q": vary.ModalPosition(tail), "q_rate": vary.ModalVelocity(tail),
        "drive": vary.PrescribedMotion(slide), "mass": vary.Mass(arm),
    }  # fmt: skip
    values: Values = [
        {"bush": (9.0, 8.0, 7.0, 3.0, 2.0, 1.0), "mass": 2.0}, {"push": (1.0, 2.0, 3.0), "q": (0.02, 0.0, 0.0)},
        {"torque": fm.Sine(0.1, 7.0, 0.3, 0.2), "q_rate": (0.1, 0.2, 0.0)}, {"drive": fm.Sine(0.1, 9.0, 0.4)},
        {"mass": 2.0, "axes": TILT},
    ]  # fmt: skip
    return scene.compile(parameters=named), values


def spinning() -> Case:
    """Free and ball-jointed bodies, round ones that become others."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    top = scene.add(fm.RigidBody(1.0, (0.02, 0.02, 0.01), (0.0, 0.0, 0.3)), name="top")
    stone = scene.add(fm.RigidBody(2.0, (0.1, 0.2, 0.25)), name="stone")
    ball = scene.connect(fm.joint.Spherical(), scene.ground.frame(), top.frame())
    flight = scene.connect(fm.joint.Free(), scene.ground.frame(), stone.frame())
    ball.velocity, flight.velocity = (1.0, 0.5, 40.0), (1.0, 2.0, 3.0, 4.0, 0.1, 0.1)
    named = {
        "top": vary.Inertia(top), "com": vary.CentreOfMass(top), "stone": vary.Inertia(stone),
        "spin": vary.InitialVelocity(ball), "off": vary.CentreOfMass(stone),
    }  # fmt: skip
    values: Values = [
        {"top": (0.03, 0.03, 0.01)}, {"top": (0.03, 0.02, 0.012)}, {"com": (0.9, 0.0, 0.3)}, {"stone": (0.2, 0.2, 0.1)},
        {"off": (3.0, 0.0, 0.0)}, {"spin": (0.0, 0.0, 10.0)},
    ]  # fmt: skip
    return scene.compile(parameters=named), values


def sliding() -> Case:
    """A slide on a spring: a length alone, whose tolerated error goes with the machine's extent."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    cart = scene.add(fm.RigidBody(1.0, (0.01, 0.01, 0.01)), name="cart")
    slide = scene.connect(fm.joint.Prismatic("y"), scene.ground.frame(), cart.frame())
    slide.position = 0.0
    spring = scene.add_force(fm.force.JointSpring(slide, 900.0))
    named = {"com": vary.CentreOfMass(cart), "k": vary.OfForce(spring, "stiffness"), "y": vary.InitialPosition(slide)}
    values: Values = [{"com": (x, 0.0, 0.0)} for x in (0.1, 7.0, 0.5)] + [{"k": 100.0}, {"y": 0.2}]
    return scene.compile(parameters=named), values


def looped() -> Case:
    """A plane four-bar whose closing hinge is redundant, one of whose sides varies."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    links = [scene.add(fm.RigidBody(n, (1e-3, 2e-2, 2e-2), (0.5 * n, 0.0, 0.0))) for n in (0.2, 0.6, 0.5)]
    crank, coupler, rocker = links
    hinge, ground = fm.joint.Revolute("z"), scene.ground
    drive = scene.connect(hinge, ground.frame(), crank.frame())
    scene.connect(hinge, crank.frame((0.2, 0.0, 0.0)), coupler.frame())
    pivot = scene.connect(hinge, ground.frame((0.6, 0.0, 0.0)), rocker.frame())
    end = coupler.frame((0.6, 0.0, 0.0))
    scene.connect(hinge, end, rocker.frame((0.5, 0.0, 0.0)))
    drive.position, drive.velocity = 1.2, 3.0
    spring = scene.add_force(fm.force.JointSpring(pivot, 2.0, 1.0, 0.1))
    named = {
        "mass": vary.Mass(coupler), "inertia": vary.Inertia(rocker), "com": vary.CentreOfMass(crank),
        "end": vary.FrameOrigin(end), "k": vary.OfForce(spring, "stiffness"), "angle": vary.InitialPosition(drive),
        "rate": vary.InitialVelocity(drive),
    }  # fmt: skip
    values: Values = [
        {"mass": 0.7, "rate": 2.0}, {"end": (0.62, 0.0, 0.0)}, {"angle": 1.4}, {"k": 9.0, "end": (0.55, 0.01, 0.0)},
        {"inertia": np.diag([2e-3, 1e-2, 1e-2]), "com": (0.3, 0.1, 0.0)}, {"rate": -4.0}, {},
    ]  # fmt: skip
    return scene.compile(parameters=named), values


METHODS: dict[str, dict[str, Any]] = {
    "8(5,3)": {"integrator": fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)},
    "5(4), max_step": {"integrator": fm.ExplicitRungeKutta(), "max_step": 0.004},
    "fixed, from 0.1 s": {"integrator": fm.ExplicitRungeKutta(), "h": 1e-3, "t_start": 0.1},
    "auto": {},
}


@pytest.mark.parametrize("how", METHODS)
@pytest.mark.parametrize("case", [chain, branched, spinning, sliding, looped])
def test_the_same_to_the_bit(case: Callable[[], Case], how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    machine, values = case()
    prepared = []
    step = PreparedRuns.step
    monkeypatch.setattr(PreparedRuns, "step", lambda self: prepared.append(self) or step(self))
    for given in (*values, *reversed(values)):
        run = machine.simulate(0.3, **METHODS[how], **given)
        alone = machine.simulate(0.3, max_rows=10**6, **METHODS[how], **given)
        for name in ("t", "x", "v", "a", "multipliers"):
            np.testing.assert_array_equal(getattr(run, name), getattr(alone, name), err_msg=f"{name}, {given}")
        assert run.scene.digest() == alone.scene.digest()
        assert (run.stats.steps, run.stats.rejected) == (alone.stats.steps, alone.stats.rejected)
        assert run.stats.constraint_residual == alone.stats.constraint_residual
        assert run.kept_rows == alone.kept_rows
    # stops and modes: methods that are not prepared
    assert len(prepared) >= (0 if how == "auto" and case is not spinning else 5)


def test_more_rows_than_a_workspace_holds() -> None:
    machine, values = chain()
    runs = [machine.simulate(2.5, h=1e-3, integrator=fm.ExplicitRungeKutta(), **values[0]) for _ in range(2)]
    np.testing.assert_array_equal(runs[0].x, runs[1].x)
    assert len(runs[1].t) == 2501


def test_failures_are_told_as_ever() -> None:
    """Whatever a workspace cannot do is run anew in the way that has the words for it; the next run is whole."""
    machine, values = chain()
    good = machine.simulate(0.3, **values[0])
    for wrong, error, text in (
        ({"mass": -1.0}, SceneError, "mass must be positive"),
        ({"angle": 1.5}, SceneError, "lies beyond the limits"),
        ({"k": np.nan}, SceneError, "stiffness"),
        ({"rate": 1e150}, fm.SimulationError, "stopped at"),
        ({"rate": 1e200}, AssemblyError, "the start cannot be computed"),
    ):
        with pytest.raises(error, match=text):
            machine.simulate(0.3, **wrong)
        np.testing.assert_array_equal(machine.simulate(0.3, **values[0]).x, good.x)


def test_threads_that_run_in_different_ways_share_a_machine() -> None:
    """Each run has a workspace of its own kind, whatever other threads run on the same machine meanwhile."""
    machine, values = chain()
    ways = [{"integrator": fm.ExplicitRungeKutta(), "rtol": rtol} for rtol in (1e-4, 1e-7)]
    alone = [machine.simulate(0.3, max_rows=10**6, **way, **values[0]) for way in ways]

    def run(k: int) -> bool:
        found = machine.simulate(0.3, **ways[k // 3 % 2], **values[0])
        return np.array_equal(found.x, alone[k // 3 % 2].x)

    with ThreadPoolExecutor(4) as pool:
        assert all(pool.map(run, range(200)))
