"""Energy and angular momentum over a thousand periods.

By the energy-momentum method in fixed steps: a pendulum let go from the horizontal, Simo's and Wong's top, a free body
that turns about an axis that is none of its own, and a pendulum that bends. Told is the slope of what should stay,
times the time, over the largest kinetic energy or the momentum: nothing drifts. By the classical method of order 4 what
is lost grows with time.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import flexmbd as fm
from flexmbd.beams import DiscreteFrame, discrete_body
from verification.machines._rods import rod
from verification.reference import Computed, Reference, Source, Sureness, numbers

SOURCE = Source("Conservation of energy and angular momentum; the top of Simo & Wong 1991", "10.1002/nme.1620310103")
REFERENCES = (
    Reference("pendulum: energy, 1000 periods", "", (0.0,), 1e-9, Sureness.PRIMARY, size=1.0),
    Reference("top: energy, 1000 nutations", "", (0.0,), 1e-9, Sureness.PRIMARY, size=1.0),
    Reference("free body: energy and angular momentum, 1000 turns", "", (0.0, 0.0), 1e-9, Sureness.PRIMARY, size=1.0),
    Reference("pendulum that bends: energy, 1000 swings", "", (0.0,), 1e-9, Sureness.PRIMARY, size=1.0),
    Reference("pendulum by order 4: loss in 1000 periods over that in 500", "", (2.0,), 1e-2, Sureness.PRIMARY),
)
PERIOD, NUTATION, SPIN = 1.9332, 0.68545849728962, (1.0, 2.0, 0.5)
METHOD = fm.EnergyMomentum()


def drift(t: np.ndarray, kept: np.ndarray, size: float) -> float:
    """Slope times the time, over a size."""
    return float(np.polyfit(t - t.mean(), kept - kept[0], 1)[0] * (t[-1] - t[0]) / size)


def of_energy(run: fm.Trajectory) -> float:
    """Drift over the largest kinetic energy."""
    energy = run.energy()
    return drift(run.t, energy.total, energy.kinetic.max())


def pendulum(method: fm.EnergyMomentum | fm.ExplicitRungeKutta) -> fm.Trajectory:
    """A rod of 1 m for a thousand periods."""
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), scene.add(rod(1.0, 1.0), name="rod").frame())
    return scene.simulate(1000.0 * PERIOD, h=PERIOD / 40.0, integrator=method)


def top() -> fm.Trajectory:
    """As in `machines.fast_top`."""
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    mass = 20.0 / 9.81
    body = scene.add(fm.RigidBody(mass, (5.0 - mass, 5.0 - mass, 1.0), (0.0, 0.0, 1.0)), name="top")
    point = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
    point.position = (np.cos(0.15), np.sin(0.15), 0.0, 0.0)
    point.velocity = (0.0, 0.0, 50.0)
    return scene.simulate(1000.0 * NUTATION, h=NUTATION / 200.0, integrator=METHOD)


def free_body() -> fm.Trajectory:
    """Inertia 1, 2, 3."""
    scene = fm.System()
    body = scene.add(fm.RigidBody(1.0, (1.0, 2.0, 3.0)), name="body")
    flight = scene.connect(fm.joint.Spherical(), scene.ground.frame(), body.frame())
    flight.velocity = SPIN
    turn = 2.0 * np.pi / float(np.linalg.norm(SPIN))
    return scene.simulate(1000.0 * turn, h=turn / 40.0, integrator=METHOD)


def bending() -> fm.Trajectory:
    """A beam of four elements, whose first vibration is some twenty times as fast as it swings."""
    section = SimpleNamespace(
        E=1e5, nu=0.0, rho=1.0, A=1.0, Iy=5e-3, Iz=5e-3, Iyz=0.0, J=5e-3, ky=np.inf, kz=np.inf,
        orientation=(0.0, 1.0, 0.0),
    )  # fmt: skip
    ends = {"root": (0.0, 0.0, 0.0), "tip": (1.0, 0.0, 0.0)}
    frame = DiscreteFrame(
        ends, {"beam": [("root", "tip")]}, {"beam": section}, divisions=4, coordinates=("x", "y", "rz")
    )  # fmt: skip
    record = discrete_body(frame, interfaces=["root"], frame="root")
    scene = fm.System(gravity=(0.0, -9.81, 0.0))
    beam = scene.add(fm.FlexibleBody(record), name="beam")
    hinge = scene.connect(fm.joint.Revolute("z"), scene.ground.frame(), beam.frame("root"))
    hinge.position = -0.5
    return scene.simulate(1000.0 * 1.7, h=1.7 / 100.0, integrator=METHOD)


def compute() -> Computed:
    """Each once."""
    turning = free_body()
    momentum = turning.momentum().angular
    kept = drift(turning.t, np.linalg.norm(momentum, axis=1), float(np.linalg.norm(momentum[0])))
    classical = pendulum(fm.ExplicitRungeKutta(fm.Pair.CLASSICAL_4))
    lost = classical.energy().total - classical.energy().total[0]
    half = int(np.argmin(abs(classical.t - 0.5 * classical.t[-1])))
    return Computed(
        (
            numbers(of_energy(pendulum(METHOD))), numbers(of_energy(top())), numbers(of_energy(turning), kept),
            numbers(of_energy(bending())), numbers(lost[-1] / lost[half]),
        ),
        accuracy="energy-momentum, 40 to 200 steps a period; Newton to 1e-12",
    )  # fmt: skip
