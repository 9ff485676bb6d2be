"""What error control means by rtol, on machines whose equations of motion are written here once more.

A step may add rtol times its radians of the machine's motion, relative to 1 rad and the largest speed met.  That is
asked of each step, against the exact motion from where the step began, so that neither the machine's own growth of
errors nor luck of signs enters; at the end the errors are then in proportion to rtol.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

import flexmbd as fm

GRAVITY, TORQUE, STIFFNESS = 9.81, 2.0, 40.0
EIGHT = fm.ExplicitRungeKutta(fm.Pair.DORMAND_PRINCE_8)
METHODS = {
    "8(5,3)": (EIGHT, range(3, 10)),
    "5(4)": (fm.ExplicitRungeKutta(), range(3, 10)),
    "Radau": (fm.RadauIIA(), range(3, 10)),
    "generalized-alpha": (fm.GeneralizedAlpha(), range(3, 8)),
    "energy-momentum": (fm.EnergyMomentum(), range(3, 8)),
}


@dataclass(frozen=True, eq=False)
class Machine:
    """A scene, and the equation of motion of its first n angles, the only ones that are free.

    build: (length, mass) -> scene and joints, for lengths in units of 1 / length m, masses in units of 1 / mass kg.
    energies: (angles, rates) -> kinetic and potential energy (J), by sympy.
    torque: on the first angle (N m).  own: rate of a vibration that lasts (1/s).  start: angles, then rates.
    """

    build: Callable[[float, float], tuple[fm.System, list[Any]]]
    energies: Callable[[Any, Any], tuple[Any, Any]]
    torque: float
    own: float
    start: tuple[float, ...]
    t_end: float


def _links(scene, before, rods, unit, heavy):
    """Bodies (mass, spin inertia, centre, length) on hinges, one behind the other; the hinges, the last body's end."""
    joints = []
    for mass, inertia, centre, length in rods:
        spin = inertia * heavy * unit**2
        rod = scene.add(fm.RigidBody(mass * heavy, (spin, spin, spin), (centre * unit, 0.0, 0.0)))
        joints.append(scene.connect(fm.joint.Revolute("z"), before, rod.frame()))
        before = rod.frame(p=(length * unit, 0.0, 0.0))
    return joints, before


CRANK, ROD, PISTON = (0.9, 8e-4, 0.02, 0.08), (0.5, 6e-3, 0.15, 0.3), 0.5
BARS = (1.0, 2e-3, 0.1, 0.2), (1.0, 8e-3, 0.25, 0.5), (1.0, 5e-3, 0.2, 0.4)
BASE = 0.5
PENDULUM = 0.5, 4e-3, 0.1, 0.2


def _moving(rod, joint, angle):
    """Centre (2,) of a rod and its end, from its joint (2,) and its direction."""
    along = sp.Matrix([sp.cos(angle), sp.sin(angle)])
    return joint + rod[2] * along, joint + rod[3] * along


def _energies(bodies, angles, rates):
    """Of bodies (mass, inertia, centre, angle)."""
    kinetic = potential = sp.Integer(0)
    for mass, inertia, centre, angle in bodies:
        speed = [sum(sp.diff(one, q) * w for q, w in zip(angles, rates, strict=True)) for one in (*centre, angle)]
        kinetic += (mass * (speed[0] ** 2 + speed[1] ** 2) + inertia * speed[2] ** 2) / 2
        potential += mass * GRAVITY * centre[1]
    return kinetic, potential


def _slider_crank(unit, heavy):
    scene = fm.System(gravity=(0.0, -GRAVITY * unit, 0.0))
    joints, end = _links(scene, scene.ground.frame(), (CRANK, ROD), unit, heavy)
    spin = 1e-4 * heavy * unit**2
    piston = scene.add(fm.RigidBody(PISTON * heavy, (spin, spin, spin)), name="piston")
    scene.connect(fm.joint.Revolute("z"), end, piston.frame())
    scene.connect(fm.joint.Prismatic("x"), scene.ground.frame(), piston.frame())
    scene.add_force(fm.force.JointTorque(joints[0], TORQUE * heavy * unit**2))
    return scene, joints[:1]


def _slider_crank_energies(angles, rates):
    lean = -sp.asin(sp.sin(angles[0]) * CRANK[3] / ROD[3])
    crank, pin = _moving(CRANK, sp.Matrix([0, 0]), angles[0])
    rod, end = _moving(ROD, pin, lean)
    bodies = (*CRANK[:2], crank, angles[0]), (*ROD[:2], rod, lean), (PISTON, 0.0, sp.Matrix([end[0], 0]), sp.Integer(0))
    return _energies(bodies, angles, rates)


def _four_bar(unit, heavy):
    scene = fm.System(gravity=(0.0, -GRAVITY * unit, 0.0))
    joints, end = _links(scene, scene.ground.frame(), BARS[:2], unit, heavy)
    (rocker,), tip = _links(scene, scene.ground.frame(p=(BASE * unit, 0.0, 0.0)), BARS[2:], unit, heavy)
    scene.connect(fm.joint.Revolute("z"), end, tip)
    scene.add_force(fm.force.JointTorque(joints[0], TORQUE * heavy * unit**2))
    x, y = 0.2 * np.cos(0.5) - BASE, 0.2 * np.sin(0.5)
    gap = np.hypot(x, y)
    coupler = np.arctan2(-y, -x) + np.arccos((gap**2 + 0.5**2 - 0.4**2) / (2.0 * gap * 0.5))
    joints[1].position = coupler - 0.5
    rocker.position = np.arctan2(y + 0.5 * np.sin(coupler), x + 0.5 * np.cos(coupler))
    return scene, joints[:1]


def _four_bar_energies(angles, rates):
    crank, pin = _moving(BARS[0], sp.Matrix([0, 0]), angles[0])
    x, y = pin[0] - BASE, pin[1]
    gap = sp.sqrt(x**2 + y**2)
    coupler = sp.atan2(-y, -x) + sp.acos((gap**2 + BARS[1][3] ** 2 - BARS[2][3] ** 2) / (2 * gap * BARS[1][3]))
    rod, end = _moving(BARS[1], pin, coupler)
    rocker = sp.atan2(end[1], end[0] - BASE)
    swing, _ = _moving(BARS[2], sp.Matrix([BASE, 0]), rocker)
    bodies = (*BARS[0][:2], crank, angles[0]), (*BARS[1][:2], rod, coupler), (*BARS[2][:2], swing, rocker)
    return _energies(bodies, angles, rates)


def _pendula(number, *, stiffness, start, t_end):
    """Pendula one behind the other, the first on a spring of its hinge."""

    def build(unit, heavy):
        scene = fm.System(gravity=(0.0, -GRAVITY * unit, 0.0))
        joints, _ = _links(scene, scene.ground.frame(), (PENDULUM,) * number, unit, heavy)
        if stiffness > 0.0:
            scene.add_force(fm.force.JointSpring(joints[0], stiffness * heavy * unit**2))
        return scene, joints

    def energies(angles, rates):
        end, bodies, direction = sp.Matrix([0, 0]), [], sp.Integer(0)
        for angle in angles:
            direction += angle
            centre, end = _moving(PENDULUM, end, direction)
            bodies.append((*PENDULUM[:2], centre, direction))
        kinetic, potential = _energies(bodies, angles, rates)
        return kinetic, potential + stiffness * angles[0] ** 2 / 2

    own = float(np.sqrt(stiffness / (PENDULUM[1] + PENDULUM[0] * PENDULUM[2] ** 2)))
    return Machine(build, energies, 0.0, own, start, t_end)


MACHINES = {
    "slider-crank": Machine(_slider_crank, _slider_crank_energies, TORQUE, 0.0, (0.5, 10.0), 0.5),
    "four-bar": Machine(_four_bar, _four_bar_energies, TORQUE, 0.0, (0.5, 3.0), 0.5),
    "double pendulum": _pendula(2, stiffness=0.0, start=(0.5, 0.5, 3.0, 0.0), t_end=1.0),
    "pendulum with spring": _pendula(1, stiffness=STIFFNESS, start=(0.3, 1.0), t_end=0.5),
}


@cache
def equation(name):
    """(y) -> dy/dt of angles and rates (2 n, k), by Lagrange's equations."""
    machine = MACHINES[name]
    n = len(machine.start) // 2
    angles, rates = sp.symbols(f"q:{n}"), sp.symbols(f"w:{n}")
    kinetic, potential = machine.energies(angles, rates)
    momenta = sp.Matrix([sp.diff(kinetic, w) for w in rates])
    forces = sp.Matrix([sp.diff(kinetic - potential, q) for q in angles]) - momenta.jacobian(angles) * sp.Matrix(rates)
    forces[0] += machine.torque
    parts = sp.lambdify((*angles, *rates), [*momenta.jacobian(rates), *forces], modules="numpy", cse=True)

    def rate(y):
        columns = y.shape[1]
        found = np.array([np.broadcast_to(one, columns) for one in parts(*y)])
        mass = np.moveaxis(found[: n * n].reshape(n, n, columns), -1, 0)
        return np.concatenate([y[n:], np.linalg.solve(mass, found[n * n :].T[..., None])[..., 0].T])

    return rate


def exact_flow(name, y, h):
    """Angles and rates (2 n, k) after times h (k,) from y (2 n, k), all at once."""
    rate = equation(name)

    def scaled(_, flat):
        return (h * rate(flat.reshape(y.shape))).ravel()

    end = solve_ivp(scaled, (0.0, 1.0), y.ravel(), method="DOP853", rtol=3e-14, atol=1e-14).y[:, -1]
    return end.reshape(y.shape)


def simulate(name, method, rtol, *, length=1.0, mass=1.0):
    machine = MACHINES[name]
    scene, joints = machine.build(length, mass)
    n = len(joints)
    for joint, angle, speed in zip(joints, machine.start[:n], machine.start[n:], strict=True):
        joint.position, joint.velocity = angle, speed
    run = scene.simulate(machine.t_end, rtol=rtol, integrator=method)
    return run, np.array([*(run.beta(j).ravel() for j in joints), *(run.beta_rate(j).ravel() for j in joints)])


def local_errors(name, run, y, rtol):
    """Errors of up to 400 of the steps over what rtol means, each the larger of angle and rate.

    Round-off of a step counts for no error: it is a dozen units in the last place of angles and rates.
    """
    n = len(y) // 2
    chosen = np.unique(np.linspace(0, len(run.t) - 2, 400).astype(int))
    speed = np.maximum.accumulate(np.abs(run.v).max(axis=1))[chosen]
    rate = np.maximum(speed, np.sqrt(np.maximum.accumulate(np.abs(run.a).max(axis=1))[chosen]))
    h = np.diff(run.t)[chosen]
    gap = np.abs(y[:, chosen + 1] - exact_flow(name, y[:, chosen], h))
    gap = np.maximum(0.0, gap - 12.0 * np.spacing(np.abs(y[:, chosen + 1])))
    share = np.minimum(1.0, h * np.maximum(rate, MACHINES[name].own))
    fast = np.maximum(rate, MACHINES[name].own)
    return np.maximum(gap[:n].max(axis=0), gap[n:].max(axis=0) / fast) / (rtol * share)


@pytest.mark.parametrize("units", [(1.0, 1.0), (1e3, 1e-3)], ids=["m, kg", "mm, t"])
@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("method", METHODS)
def test_no_step_adds_more_than_rtol_says(method, name, units):
    """Whatever is asked; at 1e-3 steps are so long, up to half a radian, that estimates are no more than rough."""
    integrator, digits = METHODS[method]
    worst = []
    for k in digits:
        run, y = simulate(name, integrator, 10.0**-k, length=units[0], mass=units[1])
        worst.append(local_errors(name, run, y, 10.0**-k).max())
    assert worst[0] < 5.0, worst
    assert max(worst[1:]) < 1.4, worst
