"""A description run: what is seen at the start and at the end, and how well its constraints are conditioned."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import functions_of_time as of_time
import numpy as np
import scipy.linalg
from hypothesis import reject
from observation import Moment, moment
from random_machine import Built, Pose, Pseudo, build

from flexmbd.errors import SceneError
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import drive
from flexmbd.multibody.kernels.physics.joints import retract
from flexmbd.multibody.plan.scene_matrices import (
    constraint_jacobian,
    constraint_values,
    mass_factor,
    scaled_jacobian,
)
from flexmbd.multibody.start.given_start import given_start
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.stopped import SimulationError

#: Of rigid machines, and of those with bodies that deform.
RTOL, RTOL_OF_MODES = 1e-7, 1e-6

#: A start whose constraints, each of unit length per unit of kinetic energy, are worse conditioned counts as singular.
SINGULAR = 1e3


@dataclass(frozen=True, eq=False)
class Seen:
    """A machine at both ends of its motion.

    Attributes:
        start, end: what is seen.
        condition: of the constraints on the machine's velocities, each of unit length per unit of kinetic energy.
        inertia: condition of the mass matrix, its diagonal scaled to one.
        redundant: whether some constraints say nothing new.
        run, built: the trajectory and its scene.
    """

    start: Moment
    end: Moment
    condition: float
    inertia: float
    redundant: bool
    run: Any
    built: Built


def condition(start, *, usual=None):
    """Largest over smallest singular value of the independent constraints.

    ``usual``: another state of the machine, in which they are of unit length: at a dead point one may have none left.
    """
    if len(start.scene.plan.rows) == 0:
        return 1.0
    lengths = np.linalg.norm(_slopes(start if usual is None else usual), axis=1)
    sizes = np.linalg.svd(_slopes(start) / lengths[:, None], compute_uv=False)
    return float(max(sizes[0], 1.0) / max(sizes[-1], 1e-300))


def _slopes(start):
    """Of the constraints, per unit of kinetic energy."""
    return scaled_jacobian(start.scene, new_work(start.scene.plan), start.x)


#: Uniaxially pressed below this stretch St Venant-Kirchhoff's stress falls again: the body collapses.
COLLAPSE = 1.0 / np.sqrt(3.0)


def _ends(machine, built, start, run):
    """Whether a machine has no further motion where a run stopped: a dead point, or a pseudo-rigid body collapsed."""
    if run is None:
        return False
    if condition(replace(start, x=run.x[-1]), usual=start) > SINGULAR:
        return True
    soft = [built.bodies[part.name] for part in machine.parts if isinstance(part.body, Pseudo)]
    return any(np.linalg.svd(run.deformation_gradient(body)[-1], compute_uv=False)[-1] < COLLAPSE for body in soft)


#: Of a radian, or in m: how far from its start a machine is taken that tells how long its rows are elsewhere.
BESIDE = 0.1


def _leads_out(machine):
    """Whether a machine starts in a singular position, in which its speeds may lead out of the loops at once."""
    parts = [replace(part, pose=Pose(part.pose.p, part.pose.R)) for part in machine.parts]
    links = [
        link if link.motion is None else replace(link, motion=float(of_time.value(link.motion, machine.start)))
        for link in machine.links
    ]
    built = build(replace(machine, parts=tuple(parts), links=tuple(links)))
    if _locks(built, machine.start):
        return True
    start = built.scene.start(t=machine.start)
    x = np.empty_like(start.x)
    retract(start.scene.plan, start.x, BESIDE * np.random.default_rng(0).standard_normal(len(start.v)), x)
    return condition(start, usual=replace(start, x=x)) > SINGULAR


#: How far a machine is moved that is to tell whether it locks, of a radian or in m; and the share of that way that it
#: is pulled back by where it does: one of all its ways is, or all are by their squares.
ALONG, PULLED_BACK = 1e-3, 0.05


def _locks(built, t):
    """Whether some motion that the loops of a machine at rest allow leads nowhere: closing them again pulls it back."""
    machine = built.scene.compile()
    scene, work = machine.scene, new_work(machine.scene.plan)
    free = scene.plan.free
    if len(scene.plan.rows) == 0:
        return False
    evaluate_inputs(scene, work, t)
    x, v = given_start(scene, machine.connections, machine.bodies)[:2]
    drive(scene.plan, work, x, v, np.zeros(scene.nv))
    ways = scipy.linalg.null_space(constraint_jacobian(scene, work, x)[:, free], rcond=1e-6)
    moved = np.zeros(scene.nv)
    moved[free] = ALONG * ways @ np.random.default_rng(0).standard_normal(ways.shape[1])
    first = moved.copy()
    for _ in range(50):
        near = np.empty_like(x)
        retract(scene.plan, x, moved, near)
        gaps = constraint_values(scene, work, near, np.zeros(scene.nv))[0]
        slopes = constraint_jacobian(scene, work, near)[:, free]
        moved[free] -= np.linalg.lstsq(slopes, gaps, rcond=1e-9)[0]
    return np.linalg.norm(moved - first) > PULLED_BACK * np.linalg.norm(first)


def rtol_of(machine):
    """At which motions are compared."""
    return RTOL_OF_MODES if machine.deforms else RTOL


def inertia(start):
    """The condition of the tree's mass matrix with its diagonal scaled to one."""
    lower = mass_factor(start.scene, new_work(start.scene.plan), start.x)
    return float(np.linalg.cond(lower / np.linalg.norm(lower, axis=1)[:, None]) ** 2) if lower.size else 1.0


def see(machine, *, rtol=None, integrator=None, **options):
    """Run a machine; hypothesis draws another one where its start is singular, or its motion leads to such a place."""
    built = build(machine)
    try:
        start = built.scene.start(t=machine.start)
    except SceneError:
        if _leads_out(machine):
            reject()
        raise
    worst = condition(start)
    if worst > SINGULAR:
        reject()
    try:
        run = built.scene.simulate(
            machine.start + machine.duration,
            t_start=machine.start,
            rtol=rtol_of(machine) if rtol is None else rtol,
            integrator=machine.integrator if integrator is None else integrator,
            **options,
        )
    except SimulationError as stop:
        if _ends(machine, built, start, stop.trajectory):
            reject()
        raise
    ends = [moment(machine, built, run, row) for row in (0, -1)]
    return Seen(*ends, worst, inertia(start), bool(start.scene.redundant), run, built)  # type: ignore[call-arg]
