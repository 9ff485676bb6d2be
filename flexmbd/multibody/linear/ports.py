"""Inputs of a linearised machine: given forces and prescribed motions, and what they do to the equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.force.bearing_friction import BearingFriction
from flexmbd.multibody.force.kane_body import KaneBody
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import Plan, new_work
from flexmbd.multibody.kernels.inverse_dynamics.residual import residual
from flexmbd.multibody.kernels.reading.constraint_tables import constraint_rows, driven_coordinates, penalty_rows
from flexmbd.multibody.kernels.reading.force_tables import force_elements, joint_force_times, keep_forces, without_loads
from flexmbd.multibody.linear.elimination import Prescribed
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

#: A force element, whether in the scene or not, or a joint whose motion is prescribed.
Input: TypeAlias = Force | Connection

_ORDERS = ("", "rate of ", "acceleration of ")


@dataclass(frozen=True, eq=False)
class InputEffects:
    """Effects of the nu inputs.

    Attributes:
        names: (nu,).
        count: how many of them each input has: one, more for a force of several functions; three for a motion.
        force: (nv, nu) generalised forces per unit.
        motions: first columns of displacements, whose rates and accelerations follow.
        given: what they prescribe.
    """

    names: tuple[str, ...]
    count: tuple[int, ...]
    motions: tuple[int, ...]
    force: FloatArray
    given: Prescribed

    def extended(self, added: int) -> InputEffects:
        """The same of a machine with further coordinates, on which they do nothing."""
        motion = np.pad(self.given.motion, ((0, 0), (0, added), (0, 0)))
        force = np.pad(self.force, ((0, added), (0, 0)))
        return replace(self, force=force, given=replace(self.given, motion=motion))


def refuse_followers(forces: Sequence[Force], inputs: Sequence[Input]) -> None:
    """Raise SceneError where the scene's ``forces`` follow accelerations, and so what inputs do at that instant."""
    for force in forces:
        if isinstance(force, KaneBody | BearingFriction) and inputs:
            raise SceneError(
                f"{getattr(force, 'what', type(force).__name__)} follows the machine's accelerations, and so the "
                "inputs, which V and W cannot express; linearise without inputs and disturbances, or give a RigidBody "
                "or a JointFriction in its place"
            )


def find_ports(scene: CompiledScene, point: WorkingPoint, times: FloatArray, inputs: Sequence[Input]) -> InputEffects:
    """Find what each input does at the working point.

    Args:
        scene: compiled with all force elements among the inputs; with its redundant rows left out.
        point: where.
        times: ``Work.time`` at that instant.
        inputs: force elements and joints.

    Raises:
        SceneError: a force that depends on the state, or does nothing; a joint whose motion is not prescribed.
    """
    columns: list[tuple[str, FloatArray]] = []
    motions: list[tuple[int, int]] = []  # first column, row of Plan.times
    count = []
    for one in inputs:
        if isinstance(one, Connection):
            row = _motion_row(scene, one)
            motions.append((len(columns), row))
            found = [
                (f"{order}motion of {one.name}", _penalised(scene, point, times, row, k))
                for k, order in enumerate(_ORDERS)
            ]
        else:
            found = _columns(scene, point, one)
        columns += found
        count.append(len(found))
    nu = len(columns)
    force = np.array([column for _, column in columns]).reshape(nu, scene.nv).T
    firsts = tuple(first for first, _ in motions)
    given = _prescribed(scene, motions, nu)
    return InputEffects(tuple(name for name, _ in columns), tuple(count), firsts, force, given)


def _columns(scene: CompiledScene, point: WorkingPoint, force: Force) -> list[tuple[str, FloatArray]]:
    """One for each function of time that scales the force, and one for what acts without."""
    rows = scene.index.forces[force]
    what = getattr(force, "what", type(force).__name__)
    plan = keep_forces(scene.plan, rows.forces, rows.elements)
    elements, on_joints = force_elements(plan), joint_force_times(plan)
    if not all(one.given for one in elements.behaviour):
        raise SceneError(
            f"{what} follows the machine's state and is not an input; give a JointTorque, JointForce, FrameForce or "
            "DistributedLoad, or a joint with a prescribed motion"
        )
    scales = sorted({int(k) for k in (*on_joints, *elements.time) if k >= 0})
    found = []
    constant = bool((elements.time < 0).any())
    several = len(scales) + constant > 1
    for scale in ([-1] if constant else []) + scales:
        acting = keep_forces(plan, on_joints == scale, elements.time == scale)
        unit = np.ones((len(scene.plan.times) + 1, 3))
        column = _required_forces(without_loads(plan), point, unit) - _required_forces(acting, point, unit)
        found.append((scene.time_names[scale] if several and scale >= 0 else what, column))
    if not any(column.any() for _, column in found):
        raise SceneError(f"{what} as an input does nothing: its size is zero, or it acts where nothing can move")
    return found


def _required_forces(plan: Plan, point: WorkingPoint, times: FloatArray) -> FloatArray:
    """(nv,) the residual at the working point without reactions."""
    work = new_work(plan)
    work.time[:] = times
    out = np.zeros(len(point.v))
    residual(plan, work, point.x, point.v, np.zeros(len(point.v)), np.zeros(len(plan.rows)), out)
    return out


def _motion_row(scene: CompiledScene, connection: Connection) -> int:
    """The row of ``Plan.times`` that prescribes a joint."""
    slots, frames = scene.index.joints.get(connection), scene.index.closures.get(connection)
    if connection.motion is not None and slots is not None:
        driven = driven_coordinates(scene.plan)
        return int(driven.time[driven.v == slots.v.start][0])
    if connection.motion is not None and frames is not None:
        for rows in (constraint_rows(scene.plan), penalty_rows(scene.plan)):
            for time in rows.time[rows.between(*frames) & (rows.time >= 0)]:
                return int(time)
    raise SceneError(
        f"joint {connection.name!r} is not an input: its motion is not prescribed in this scene; call "
        "joint.prescribe(0.0) to move it as an input, or give a JointTorque or JointForce on it"
    )


def _penalised(scene: CompiledScene, point: WorkingPoint, times: FloatArray, row: int, order: int) -> FloatArray:
    """(nv,) what the motion does through a penalty, in which it is linear."""
    if not (penalty_rows(scene.plan).time == row).any():
        return np.zeros(scene.nv)
    step = 1e-3
    moved = times.copy()
    moved[row, order] += step
    change = _required_forces(scene.plan, point, times) - _required_forces(scene.plan, point, moved)
    return np.asarray(change / step, dtype=np.float64)


def _prescribed(scene: CompiledScene, motions: Sequence[tuple[int, int]], nu: int) -> Prescribed:
    """Motions of coordinates and of rows."""
    plan, driven = scene.plan, driven_coordinates(scene.plan)
    motion, row, rate = np.zeros((3, scene.nv, nu)), np.zeros((2, len(plan.rows), nu)), np.zeros((nu, nu))
    for first, time in motions:
        for k in driven.v[driven.time == time]:
            motion[np.arange(3), k, first + np.arange(3)] = 1.0
        for k in np.flatnonzero(constraint_rows(plan).time == time):
            row[np.arange(2), k, first + np.arange(2)] = 1.0
        rate[[first, first + 1], [first + 1, first + 2]] = 1.0
    return Prescribed(motion, row, rate)


def without_inputs(scene: CompiledScene, forces: Sequence[Force]) -> CompiledScene:
    """The scene without force elements that are there as inputs alone."""
    rows = [scene.index.forces[force] for force in forces]
    kept = [k for k in range(len(scene.plan.forces)) if not any(k in row.forces for row in rows)]
    elements = [k for k in range(len(scene.plan.elements)) if not any(k in row.elements for row in rows)]
    plan = keep_forces(scene.plan, kept, elements)
    return replace(scene, plan=plan)
