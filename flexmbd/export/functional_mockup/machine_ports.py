"""Inputs and outputs of a machine: forces that are set from outside, and observed quantities."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from flexmbd.errors import ExportError
from flexmbd.export.functional_mockup.machine_parts import Call, FrameCall, Parts
from flexmbd.export.functional_mockup.model_description import Causality, Variable
from flexmbd.given import is_list
from flexmbd.integrate import state as st
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.bodies.port import Port, PortFlow
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.force.distributed_load import DistributedLoad
from flexmbd.multibody.force.frame_force import FrameForce
from flexmbd.multibody.force.joint_force import JointForce
from flexmbd.multibody.force.joint_torque import JointTorque
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.arrays import new_work
from flexmbd.multibody.kernels.reading.force_tables import (
    constant_place,
    force_elements,
    joint_force_times,
    keep_forces,
)
from flexmbd.multibody.kernels.sampling.port_flows import port_flow
from flexmbd.multibody.kernels.sampling.series import frame_series
from flexmbd.multibody.motion.quantity import Acceleration, Output, Position, Rotation, Velocity
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]
T = TypeVar("T")

#: What a machine takes from outside beside efforts of ports: a given force, whose numbers are the start values.
Given = JointTorque | JointForce | FrameForce | DistributedLoad

#: Columns of ``frame_series`` that an output of a frame is.
_COLUMNS: dict[Any, tuple[int, int]] = {Position: (0, 3), Rotation: (3, 12), Velocity: (12, 15), Acceleration: (18, 21)}
_ENDINGS: dict[Any, str] = {Position: "{}", Velocity: "v{}", Acceleration: "a{}", Rotation: "R{}"}


#: Units of a coordinate, its rate and its acceleration.
_STATE_UNITS = {
    kinds.GROUP_ANGLE: ("rad", "rad/s", "rad/s2"),
    kinds.GROUP_LENGTH: ("m", "m/s", "m/s2"),
    kinds.GROUP_MODAL: ("1", "1/s", "1/s2"),
}


@dataclass(frozen=True)
class Drive:
    """An input and the offset of its value in ``Plan.time_data``."""

    variable: Variable
    offset: int


@dataclass(frozen=True)
class ObservedVariable:
    """An output and the array's entry where it comes about."""

    variable: Variable
    array: FloatArray
    index: int


def named(ports: Sequence[T] | Mapping[str, T]) -> list[tuple[str | None, T]]:
    """With the names that the user gave, if any.

    Raises:
        ExportError: neither a list nor a mapping.
    """
    if not isinstance(ports, Mapping) and not is_list(ports):
        raise ExportError(f"inputs and outputs are lists, or mappings of names to them, got {ports!r:.100}")
    return list(ports.items()) if isinstance(ports, Mapping) else [(None, one) for one in ports]


@contextmanager
def driven(ports: Sequence[Port]) -> Iterator[None]:
    """Let ports have efforts that inputs set, within a `with` block.

    Raises:
        ExportError: the effort of one is given by a function or a signal of others.
    """
    for port in ports:
        start = 0.0 if port.is_free else port.effort_now
        (function,) = _constants(f"the {port.effort_name} of port {port.label}", [start])
        port.drive(function)
    try:
        yield
    finally:
        for port in ports:
            port.drive(None)


def replaced(force: Given) -> Given:
    """The force with a function of time, which an input sets, in place of each number."""
    if not isinstance(force, Given):
        raise ExportError(
            f"{force!r} is not an input of a machine; give a JointTorque, JointForce, FrameForce, DistributedLoad or "
            "the port of a body"
        )
    if isinstance(force, FrameForce):
        return replace(force, force=_constants(force.what, force.force), torque=_constants(force.what, force.torque))
    if isinstance(force, DistributedLoad):
        return replace(force, factor=_constants(force.what, [force.factor])[0])
    return replace(force, value=_constants(force.what, [force.value])[0])


def _constants(what: str, values: Sequence[Any]) -> tuple[PPoly, ...]:
    for value in values:
        if not isinstance(value, (int, float)) or not np.isfinite(value):
            raise ExportError(f"{what} is an input, whose values are numbers at the start; it has {value!r}")
    return tuple(PPoly([[float(value)]], [0.0, 1.0]) for value in values)


def drives_of(scene: CompiledScene, force: Given | Port, name: str | None) -> list[Drive]:
    """The inputs that a force of `replaced` or a port has in a scene; ``name`` as the user gave it."""
    if isinstance(force, Port):
        time = scene.index.efforts.get(force)
        if time is None:
            raise ExportError(f"port {force.label} is of no body in the scene")
        offset, unit = constant_place(scene.plan, time), force.body.record.ports.effort_units[force.number]
        called = name or f"{force.label}.{force.effort_name}"
        value = float(scene.plan.time_data[offset])
        return [Drive(Variable(called, Causality.INPUT, unit, scene.time_names[time], start=value), offset)]
    rows = scene.index.forces[force]
    own = keep_forces(scene.plan, rows.forces, rows.elements)
    times = list(dict.fromkeys(int(row) for row in (*joint_force_times(own), *force_elements(own).time)))
    if isinstance(force, FrameForce):
        names = [f"{name or force.frame.label}.{kind}{axis}" for kind in "FM" for axis in "xyz"]
        units = ["N"] * 3 + ["N.m"] * 3
    elif isinstance(force, DistributedLoad):
        names, units = [f"{name or force.body.name}.{force.name}"], ["1"]
    else:
        turns = isinstance(force, JointTorque)
        names = [name or f"{force.connection.name}.{'torque' if turns else 'force'}"]
        units = ["N.m" if turns else "N"]
    found = []
    for time, called, unit in zip(times, names, units, strict=True):
        offset = constant_place(scene.plan, time)
        value = float(scene.plan.time_data[offset])
        found.append(Drive(Variable(called, Causality.INPUT, unit, scene.time_names[time], start=value), offset))
    return found


def observed_by(
    scene: CompiledScene, output: Output | PortFlow, name: str | None, parts: Parts
) -> list[ObservedVariable]:
    """The variables of an output; ``name`` as the user gave it. Frames are added to ``parts``.

    Raises:
        ExportError: it is none, or has no coordinates in the scene.
    """
    if isinstance(output, PortFlow):
        return [_observed_port(scene, output.port, name, parts)]
    if type(output) not in _COLUMNS:
        raise ExportError(
            f"{output!r} is not an output; give fm.output.Position, Velocity, Acceleration or Rotation, or the charge "
            "of a port"
        )
    of = output.of
    if isinstance(of, Frame):
        return _observed_frame(scene, output, name or of.label, parts)
    slots = None
    if isinstance(of, Connection | FlexibleBody | PseudoRigidBody) and not isinstance(output, Rotation):
        slots = (scene.index.joints.get(of) if isinstance(of, Connection) else scene.index.modes.get(of))
    if slots is None:
        raise ExportError(f"an output {type(output).__name__} of {of!r}: it has no coordinates here; give a frame")
    places, names = slots.v, list(scene.velocity_names[slots.v])
    if name is not None:
        names = [name if len(names) == 1 else f"{name}.{k + 1}" for k in range(len(names))]
    array = {Position: parts.state.x, Velocity: parts.state.v, Acceleration: parts.state.a}[type(output)]
    if isinstance(output, Position):
        if slots.x.stop - slots.x.start != len(names):
            raise ExportError(f"the positions of {of.name!r} are a quaternion; give a frame's Position and Rotation")
        places = slots.x
    ending = {Position: "", Velocity: ".rate", Acceleration: ".acceleration"}[type(output)] if name is None else ""
    found = []
    for k, unit in enumerate(_units_of(of, type(output), len(names))):
        text = f"{type(output).__name__} of {scene.velocity_names[slots.v][k]}"
        variable = Variable(names[k] + ending, Causality.OUTPUT, unit, text, direct=isinstance(output, Acceleration))
        found.append(ObservedVariable(variable, array, places.start + k))
    return found


def _observed_port(scene: CompiledScene, port: Port, name: str | None, parts: Parts) -> ObservedVariable:
    """The flow of a port; its call is added to ``parts``."""
    if scene.index.efforts.get(port) is None:
        raise ExportError(f"port {port.label} is of no body in the scene")
    ports, state = port.body.record.ports, parts.state
    rows = np.array([scene.index.efforts[port.body.port(other)] for other in ports.names], np.int64)
    second = np.zeros((0, 0)) if port.second is None else np.ascontiguousarray(port.second)
    place, capacity = scene.index.modal(port.body).x.start, np.ascontiguousarray(ports.capacity[port.number])
    time, load, out = state.numbers[st.TIME : st.TIME + 1], np.ascontiguousarray(port.load), np.zeros(1)
    arguments = (parts.plan, new_work(parts.plan), time, state.x, place, load, second, rows, capacity, out)
    parts.flows.append(Call(port_flow, arguments))
    called = name or f"{port.label}.{port.flow_name}"
    unit, text = ports.flow_units[port.number], f"{port.flow_name} of port {port.label}"
    return ObservedVariable(Variable(called, Causality.OUTPUT, unit, text, direct=True), out, 0)


def states_of(scene: CompiledScene) -> tuple[Variable, ...]:
    """Coordinates, velocities and the derivatives of both, as variables of model exchange."""
    units = [_STATE_UNITS[int(scene.group_kind[group])] for group in scene.group_of]
    sizes = scene.group_floor[scene.group_of]
    names = [f"state.{name}" for name in scene.velocity_names]
    local, states, rates = Causality.LOCAL, [], []
    for order, ending in enumerate(("", ".rate")):
        for name, unit, size in zip(names, units, sizes, strict=True):
            what = f"state {name}{ending}"
            states.append(Variable(name + ending, local, unit[order], what, nominal=float(size)))
            text, of = f"derivative of {what}", name + ending
            rates.append(Variable(f"der({of})", local, unit[order + 1], text, derivative_of=of))
    return (*states, *rates)


def _units_of(of: Connection | FlexibleBody | PseudoRigidBody, kind: Any, count: int) -> list[str]:
    """Units of a joint's coordinates; modes have none that FMI knows."""
    if not isinstance(of, Connection):
        return ["1"] * count
    ending = {Position: "", Velocity: "/s", Acceleration: "/s2"}[kind]
    return [("rad" if angular else "m") + ending for angular in of.joint.angular]


def _observed_frame(scene: CompiledScene, output: Output, name: str, parts: Parts) -> list[ObservedVariable]:
    frame: Any = output.of
    kind: Any = type(output)
    if not isinstance(frame, Frame):
        raise ExportError(f"an output {kind.__name__} of {frame!r}: give a frame")
    call = next((one for one in parts.frames if one.frame is frame), None)
    if call is None:
        plan, s = scene.index.with_probe(parts.plan, frame), parts.state
        probe, motion = len(plan.frames) - 1, (s.x[None], s.v[None], s.a[None])
        arguments = (plan, new_work(plan), probe, *motion, np.zeros((1, 21)))
        call = FrameCall(frame, Call(frame_series, arguments))
        parts.frames.append(call)
    axes = [a + b for a in "xyz" for b in "xyz"] if kind is Rotation else list("xyz")
    unit = {Position: "m", Rotation: "1", Velocity: "m/s", Acceleration: "m/s2"}[kind]
    text = f"{kind.__name__} of {frame.label} in inertial axes"
    found = []
    for column, axis in zip(range(*_COLUMNS[kind]), axes, strict=True):
        called = f"{name}.{_ENDINGS[kind].format(axis)}"
        variable = Variable(called, Causality.OUTPUT, unit, text, direct=kind is Acceleration)
        found.append(ObservedVariable(variable, call.call.arguments[-1], column))
    return found
