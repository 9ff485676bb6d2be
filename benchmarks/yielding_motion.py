"""Bodies that yield as they move, in yielding.py: Taylor's bar, a hinge pendulum, a tube to its first fold."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np

import flexmbd as fm
from flexmbd import meshes
from flexmbd.continuum import (
    ExplicitContinuum,
    ExplicitRun,
    ImplicitContinuum,
    Interface,
    NonlinearModel,
    RigidPlane,
    Support,
    wall_form,
)
from flexmbd.continuum.interior.nodal_motion import NodalMotion
from flexmbd.forms import hencky_plasticity, updated_lagrangian
from flexmbd.forms.j2_plasticity import LinearHardening

# m: of an axisymmetric program that is converged, docs/explicit.md
TAYLOR_LENGTH = 21.471e-3
# s; at the tube's its first fold's walls are about to meet, which nothing sees
PENDULUM_END, TUBE_END = 0.034, 1.05e-3
# m, crushes at which the tube's mean force is told
CRUSHES = (5e-3, 10e-3, 20e-3, 30e-3)
# points through the thickness of a tube of solid-shells
TUBE_LAYERS = 4


def taylor(divisions: tuple[int, int, int], *, end: float = 80e-6) -> dict[str, float]:
    """The copper rod of demos/taylor_bar.py: its length at the end, m."""
    copper = hencky_plasticity.Parameters(
        E=117e9, nu=0.35, rho=8930.0, yield_stress=0.4e9, hardening=LinearHardening(0.1e9)
    )
    mesh = meshes.round_bar(3.2e-3, 32.4e-3, divisions=divisions)
    body = NonlinearModel(mesh, hencky_plasticity, copper, degree=1)
    run = ExplicitRun(
        body, velocity=(0.0, 0.0, -227.0), planes=[RigidPlane((0, 0, 0), (0, 0, 1), penalty=None)],
        supports=[Support("x_min", x=True), Support("y_min", y=True)],
    )
    begin = time.process_time()
    run.simulate(end, outputs=1)
    return {
        "seconds": time.process_time() - begin,
        "cells": float(len(body.groups[0].cells)),
        "steps": float(run.steps),
        "length": float(run.motion.x[:, 2].max()),
    }


def pendulum(
    divisions: tuple[int, int, int],
    *,
    explicit: bool,
    rtol: float | None = None,
    h: float | None = None,
    end: float = PENDULUM_END,
) -> dict[str, float]:
    """The rod of demos/plastic_hinge_pendulum.py: its bend, rad, and its plastic work, J, at the end."""
    steel = hencky_plasticity.Parameters(
        E=210e9, nu=0.3, rho=7850.0, yield_stress=250e6, hardening=LinearHardening(50e6)
    )
    mesh = meshes.block(0.2, 0.02, 0.02, divisions=divisions)
    ends = [Interface("x_min"), Interface("x_max")]
    solid = NonlinearModel(mesh, hencky_plasticity, steel, degree=1, interfaces=ends)
    ball = {"x_max": fm.RigidBody(8.0, 0.4 * 8.0 * 0.04**2 * np.ones(3))}
    interior = ExplicitContinuum(solid, rigid_parts=ball) if explicit else ImplicitContinuum(solid, rigid_parts=ball)
    rod = fm.ContinuumBody(interior)
    scene = fm.System(gravity=(0.0, 0.0, -9.81))
    scene.add(rod, name="rod")
    hinge = scene.connect(fm.joint.Revolute(axis="y"), scene.ground.frame(), rod.frame("x_min"), name="hinge")
    stop = fm.force.JointStop(hinge, lower=-10.0, upper=np.radians(2.0), stiffness=2e5, transition=1e-3)
    scene.add_force(stop)
    hinge.velocity = 40.0
    method = fm.CentralDifference() if explicit else fm.GeneralizedAlpha(rho=0.9)
    simulate: Callable[[float], fm.Trajectory] = partial(
        scene.simulate, integrator=method, **{name: value for name, value in (("rtol", rtol), ("h", h)) if value}
    )
    simulate(1e-5 if explicit else 1e-4)  # compiles
    begin = time.process_time()
    run = simulate(end)
    seconds = time.process_time() - begin
    turns = [run.rotation(rod.frame(name))[-1] for name in ("x_min", "x_max")]
    seen = turns[1].T @ turns[0]
    return {
        "seconds": seconds,
        "cells": float(np.prod(divisions)),
        "steps": float(run.stats.steps),
        "bend": float(np.arctan2(-seen[2, 0], seen[0, 0])),
        "work": float(run.energies(rod)["plastic"][-1]),
    }


def tube(divisions: tuple[int, int, int], *, shells: bool = False, end: float = TUBE_END) -> dict[str, float]:
    """The tube of demos/frontal_impact.py, as it is crushed, by bricks or by one layer of solid-shells.

    Returns:
        Of the whole tube the mean force, N, up to the end and to those of `CRUSHES` that it reaches, and the elastic
        and plastic energy, J; the crush, m; how far the walls have moved sideways, and where along the undeformed
        tube most, m.
    """
    vehicle, speed = 10.0, 35.0
    steel = updated_lagrangian.Parameters(
        E=2.1e11, nu=0.3, rho=7850.0, yield_stress=2.5e8, hardening=LinearHardening(8e8)
    )
    form = wall_form(updated_lagrangian, layers=TUBE_LAYERS) if shells else updated_lagrangian
    mesh = meshes.crash_tube(0.06, 0.003, 0.12, divisions=divisions, fold=0.022, dent=5e-4, mitred=shells)
    solid = NonlinearModel(mesh, form, steel, degree=1, interfaces=[Interface("z_max")])
    interior = ExplicitContinuum(
        solid,
        rigid_parts={"z_max": fm.RigidBody(vehicle, (0.1, 0.1, 0.1))},
        planes=[RigidPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), friction=0.2, name="wall")],
        supports=[Support("x_min", x=True), Support("y_min", y=True)],
        scaled_thickness=1.0 if shells else 0.0,
    )
    scene = fm.System()
    body = scene.add(fm.ContinuumBody(interior), name="tube")
    frame = body.frame("z_max")
    guide = scene.connect(fm.joint.Prismatic(axis="z"), scene.ground.frame(p=interior.frames[0].p_BI_B), frame)
    guide.velocity = -speed
    scene.simulate(1e-6, integrator=fm.CentralDifference())  # compiles
    whole = interior.motion.x.copy()
    begin = time.process_time()
    run = scene.simulate(end, integrator=fm.CentralDifference())
    seconds = time.process_time() - begin
    parts = run.energies(body)
    kinetic = parts["kinetic"] + run.energy().kinetic
    ways = run.position(frame)[0, 2] - run.position(frame)[:, 2]
    way, lost = ways[-1], kinetic[0] - kinetic
    up_to = {f"force {1e3 * c:.0f} mm": float(4.0 * np.interp(c, ways, lost) / c) for c in CRUSHES if c <= way}
    sideways = np.linalg.norm((interior.motion.x - whole)[:, :2], axis=1)
    return {
        "seconds": seconds,
        "cells": float(len(solid.groups[0].cells)),
        "steps": float(run.stats.steps),
        "force": float(4.0 * lost[-1] / way),
        **up_to,
        "elastic": float(4.0 * parts["elastic"][-1]),
        "plastic": float(4.0 * parts["plastic"][-1]),
        "crush": float(way),
        "sideways": float(sideways.max()),
        "fold": float(whole[sideways.argmax(), 2]),
    }


def explicit_step(body: NonlinearModel, *, strain: float) -> Callable[[], None]:
    """A step of central differences of a body that has been stretched by about that strain."""
    motion = NodalMotion(body)
    motion.begin(np.zeros(3), np.eye(3), np.zeros(3))
    motion.v[:] = 100.0 * motion.x * [1.0, -0.5, -0.3]
    h = 0.5 * motion.limit
    for _ in range(int(strain / (100.0 * h)) + 1):
        motion.advance(h)
    return partial(motion.advance, h)
