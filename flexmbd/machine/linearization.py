"""Linearises a compiled scene: about which state, and by which inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.machine.linearized_machine import LinearizedMachine
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.interiors.steady import InteriorModes
from flexmbd.multibody.kernels.base.arrays import Work, new_work
from flexmbd.multibody.kernels.base.compiling import compiling
from flexmbd.multibody.linear.derivatives import DERIVING
from flexmbd.multibody.linear.linearize import LinearEquations, linearize
from flexmbd.multibody.linear.ports import Input, InputEffects, find_ports
from flexmbd.multibody.linear.steadiness import AHEAD, SAME
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.motion.quantity import LinearOutput
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.plan.scene_matrices import coordinate_sizes
from flexmbd.multibody.start.consistent_start import Start, match_motion
from flexmbd.multibody.team import Team
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.trajectory import Trajectory


def working_point(start: Start, about: WorkingPoint | Trajectory | None, t: float) -> WorkingPoint:
    """Where to linearise, with the rows of ``start.scene``; ``about`` as ``System.linearize`` has it.

    Raises:
        SceneError: it is of another scene.
    """
    scene = start.scene
    if about is None:
        return WorkingPoint(scene, t, start.x, start.v, start.multipliers)
    about.scene.refuse_other(scene)
    if isinstance(about, WorkingPoint):
        if scene.interiors is not None:
            scene.interiors.restore(scene.plan, about.interiors)
        return replace(about, scene=scene)
    if scene.interiors is not None:
        names = ", ".join(f"body {body.name!r}" for body in scene.interiors.bodies)
        raise SceneError(
            f"{names}: a trajectory does not hold what is between the frames of a body with history; linearise about "
            "scene.equilibrium()"
        )
    x, v = about.x[-1].copy(), about.v[-1].copy()
    work = new_work(scene.plan)
    evaluate_inputs(scene, work, t)
    v, _, multipliers = match_motion(scene, work, x, v, held=np.zeros(scene.nv, bool))
    return WorkingPoint(scene, t, x, v, multipliers)


def linear_machine(
    whole: CompiledScene,
    point: WorkingPoint,
    *,
    inputs: Sequence[Input],
    disturbances: Sequence[Input],
    outputs: Sequence[LinearOutput],
    modes: InteriorModes,
    bodies: Mapping[str, Body],
    team: Team,
) -> LinearizedMachine:
    """Linearise about ``point``; ``whole`` is its scene with the forces that are there as inputs alone.

    Raises:
        SceneError: as ``System.linearize``.
    """
    scene = point.scene
    work = new_work(scene.plan)
    evaluate_inputs(scene, work, point.t)
    whole = replace(whole, plan=whole.plan.replace(rows=scene.plan.rows), row_names=scene.row_names)
    ports = find_ports(whole, point, work.time, [*inputs, *disturbances])
    controls = sum(ports.count[: len(inputs)])
    with compiling(DERIVING, aloud=team.is_root):
        equations = linearize(point, work, ports, outputs, modes)
    _refuse_changing_inputs(whole, point, equations, work, ports, [*inputs, *disturbances])
    return LinearizedMachine(
        equations=equations,
        point=point,
        controls=ports.names[:controls],
        disturbances=ports.names[controls:],
        motions=ports.motions,
        bodies=bodies,
        team=team,
    )


def _refuse_changing_inputs(
    whole: CompiledScene,
    point: WorkingPoint,
    equations: LinearEquations,
    work: Work,
    ports: InputEffects,
    inputs: Sequence[Input],
) -> None:
    """Raise SceneError where what an input does, seen from the turning axes, changes along the steady motion."""
    if equations.rate == 0.0 or not inputs:
        return
    scene, by, motion = point.scene, equations.by, equations.motion
    Vz, sizes = by.Vz[: scene.nv], np.append(coordinate_sizes(scene), np.ones(len(by.Vz) - scene.nv))[by.z, None]
    before = Vz.T @ ports.force
    for distance in AHEAD:
        t = distance / equations.rate
        T = motion.transport(work, point.x, t)
        there = replace(point, x=motion.later(work, point.x, point.v, t), v=T @ point.v)
        later = Vz.T @ T.T @ find_ports(whole, there, work.time, inputs).force
        change, whole_size = (np.abs(part * sizes).max(axis=0, initial=0.0) for part in (later - before, before))
        if (change > SAME * whole_size).any():
            name = ports.names[int(np.argmax(change > SAME * whole_size))]
            raise SceneError(
                f"the input {name!r} changes along the steady motion, so that no constant matrix gives what it does; "
                "give a force on a joint, or one in the axes of a frame that turns along"
            )
