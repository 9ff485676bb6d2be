"""From the description of a scene to the machine."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexmbd.errors import FlexmbdError, SceneError
from flexmbd.files.python_file import PythonFiles
from flexmbd.force import Force
from flexmbd.machine.system import System
from flexmbd.multibody.bodies.body import FlexibleBody, Frame, Ground, RigidBody
from flexmbd.multibody.bodies.point_mass import PointMass
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.contact.contact_laws import Friction
from flexmbd.multibody.contact.touch import AnyContact
from flexmbd.multibody.force.states import States
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.functions.time_function import Piecewise
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.motion.quantity import Acceleration, Position, Velocity
from flexmbd.record.reduced_body import ReducedBody
from flexmbd.run.event import Event, Moment
from flexmbd.scene_file.entry_kinds import COUPLINGS, FORCES, JOINTS
from flexmbd.scene_file.scene_description import (
    BodyName,
    ControllerEntry,
    Crossing,
    EventEntry,
    FramePlace,
    FunctionPlace,
    JointName,
    Measured,
    PointEntry,
    PortPlace,
    RecordEntry,
    RigidEntry,
    SceneFile,
    ShapedEntry,
    SignalName,
    StatesEntry,
    TouchEntry,
)
from flexmbd.scene_file.shapes import make_shape
from flexmbd.scene_file.touching import LAWS, SHAPES
from flexmbd.scene_file.values import nearest


@dataclass(frozen=True, eq=False)
class Built:
    """A machine made from a scene file.

    Attributes:
        system: the machine.
        bodies: by their names, the ground too.
        joints: by their names.
        forces: by their places in the file.
        events: to look for while it moves, in the file's order.
        signals: by their names.
        states: the state equations, by their names.
        touches: the contacts of each [[touch]], by its name.
    """

    system: System
    bodies: Mapping[str, RigidBody | FlexibleBody | Ground]
    joints: Mapping[str, Connection]
    forces: Mapping[str, Force]
    events: list[Event] = field(default_factory=list, init=False)
    signals: dict[str, Signal] = field(default_factory=dict, init=False)
    states: dict[str, States] = field(default_factory=dict, init=False)
    touches: dict[str, tuple[AnyContact, ...]] = field(default_factory=dict, init=False)
    _files: PythonFiles = field(default_factory=lambda: PythonFiles(SceneError), init=False)

    def frame(self, place: FramePlace) -> Frame:
        """The frame at a place.

        Raises:
            SceneError, InterfaceError: R is not a rotation, or the body has no such interface.
        """
        body = self.bodies[place.body]
        if isinstance(body, FlexibleBody):
            return body.frame(place.interface)
        return body.frame((0.0, 0.0, 0.0) if place.p is None else place.p, R=place.R)

    def port(self, place: PortPlace) -> Port:
        """The port at a place.

        Raises:
            SceneError: the body has no such port.
        """
        body: Any = self.bodies[place.body]
        found: Port = body.port(place.port)
        return found

    def signal(self, place: SignalName) -> Signal:
        """The signal of a name, the same wherever it stands.

        Raises:
            SceneError: its initial value is not finite.
        """
        return self.signals.setdefault(place.name, Signal(place.name, place.initial))

    def function(self, place: FunctionPlace) -> Any:
        """The function at a place; its file is run when the first of its functions is asked for.

        Raises:
            SceneError: the file cannot be read or fails, or has no such function.
        """
        found = self._files.value(place.file, place.name)
        if place.breaks:
            return Piecewise(found, place.breaks)
        if not place.takes_scene:
            return found
        if not callable(found):
            raise SceneError(f"{place.name!r} in {place.file} is no function, but {found!r:.60}")

        @functools.wraps(found)
        def of_scene(*arguments: Any) -> Any:
            return found(*arguments, self)

        return of_scene


def build(scene: SceneFile) -> Built:
    """Make the machine that a scene file describes; records are loaded, and Python files run, now. Not collective.

    Raises:
        SceneError: a record cannot be loaded, a Python file fails, or something does not fit; the message says where
            in the file.
    """
    system = System(gravity=scene.gravity)
    bodies: dict[str, RigidBody | FlexibleBody | Ground] = {system.ground.name: system.ground}
    joints: dict[str, Connection] = {}
    forces: dict[str, Force] = {}
    built = Built(system, bodies, joints, forces)
    with _at(scene, "ground", system.ground.name):
        system.ground.shape = make_shape(scene.floor)
    for body in scene.bodies:
        with _at(scene, body.place, body.name):
            if isinstance(body, RecordEntry):
                record = FlexibleBody(ReducedBody.load(body.path), shape=make_shape(body.shapes))
                bodies[body.name] = system.add(record, name=body.name, p=body.drawn.p, R=body.drawn.R)
            else:
                bodies[body.name] = system.add(_made(body), name=body.name, p=body.drawn.p, R=body.drawn.R)
    for joint in scene.joints:
        with _at(scene, joint.place, joint.name):
            kind = JOINTS[joint.kind].make(**joint.arguments)
            ends: list[Any] = [built.bodies[one.body] for one in (joint.parent, joint.child)]
            if joint.at is None:
                ends = [built.frame(one) for one in (joint.parent, joint.child)]
            connection = system.connect(kind, *ends, at=joint.at, name=joint.name)
            if joint.position is not None:
                connection.position = joint.position
            if joint.velocity is not None:
                connection.velocity = joint.velocity
            if joint.motion is not None:
                connection.prescribe(_resolved_value(built, joint.motion))
            joints[joint.name] = connection
    _give_voltages(scene, built)
    for element in scene.forces:
        with _at(scene, element.place, element.kind):
            force = FORCES[element.kind].make(**_resolved(built, element.arguments))
            forces[element.place] = system.add_force(force)
    for element in scene.couplings:
        with _at(scene, element.place, element.kind):
            system.couple(COUPLINGS[element.kind].make(**_resolved(built, element.arguments)))
    for touch in scene.touches:
        with _at(scene, touch.place, touch.name):
            built.touches[touch.name] = _touch(built, touch)
    for equations in scene.states:
        with _at(scene, equations.place, equations.name):
            built.states[equations.name] = _add_states(built, equations)
    for event in scene.events:
        with _at(scene, event.place, event.name):
            built.events.append(_event(built, event))
    for entry in scene.controllers:
        with _at(scene, entry.place, entry.name):
            _add_controller(built, entry)
    return built


def _give_voltages(scene: SceneFile, built: Built) -> None:
    """To the ports of flexible bodies."""
    for body in scene.bodies:
        if isinstance(body, RecordEntry):
            with _at(scene, f"{body.place}.voltages", body.name):
                for name, value in body.voltages.items():
                    built.port(PortPlace(body.name, name)).effort = _resolved_value(built, value)


def _touch(built: Built, entry: TouchEntry) -> tuple[AnyContact, ...]:
    """Let shapes touch.

    Raises:
        SceneError: a shape, the law or friction is none, or as ``System.touch``; the message has the table.
    """
    one = [_told_from(shape.place, SHAPES[shape.kind].make, built, shape.arguments) for shape in entry.one]
    other = one if entry.other is None else [
        _told_from(shape.place, SHAPES[shape.kind].make, built, shape.arguments) for shape in entry.other
    ]  # fmt: skip
    law = _told_from(entry.law.place, LAWS[entry.law.kind].make, built, entry.law.arguments)
    friction = None if entry.friction is None else Friction(**_resolved(built, entry.friction))
    return built.system.touch(one, other, law, friction=friction)


def _told_from(place: str, make: Callable[..., Any], built: Built, arguments: Mapping[str, object]) -> Any:
    """What a table makes; errors say which."""
    try:
        return make(**_resolved(built, arguments))
    except FlexmbdError as reason:
        raise SceneError(f"{place}: {reason}") from reason


def _event(built: Built, entry: EventEntry) -> Event:
    function: Callable[[Moment], Any] = _resolved_value(built, entry.function)
    action = None if entry.action is None else built.function(entry.action)
    return Event(function, entry.direction, entry.stop, action, entry.name)


def _add_controller(built: Built, entry: ControllerEntry) -> None:
    """Put a controller into the scene.

    Raises:
        SceneError: its law is no function, no load has a signal that it sets, or as ``System.add_controller``.
    """
    _refuse_unknown(built, entry.inputs)
    built.system.add_controller(
        built.function(entry.step),
        period=entry.period,
        measurements=[_resolved_value(built, one) for one in entry.measurements],
        inputs=[built.signal(signal) for signal in entry.inputs],
        offset=entry.offset,
        state=entry.state,
        name=entry.name,
    )


def _add_states(built: Built, entry: StatesEntry) -> States:
    """Put state equations into the scene.

    Raises:
        SceneError: as ``_add_controller``, and ``System.add_states``.
    """
    _refuse_unknown(built, entry.inputs)
    return built.system.add_states(
        built.function(entry.rates),
        scale=entry.scale,
        initial=entry.initial,
        measurements=[_resolved_value(built, one) for one in entry.measurements],
        outputs=None if entry.outputs is None else built.function(entry.outputs),
        inputs=[built.signal(signal) for signal in entry.inputs],
        name=entry.name,
        names=entry.names,
    )


def _refuse_unknown(built: Built, inputs: Iterable[SignalName]) -> None:
    for signal in inputs:
        if signal.name not in built.signals:
            raise SceneError(f"no load has the signal {signal.name!r}; {nearest(signal.name, built.signals)}")


def _crossing(built: Built, crossing: Crossing) -> Callable[[Moment], float]:
    """How far a coordinate lies above its level.

    Raises:
        SceneError: the joint has no such coordinate.
    """
    if isinstance(crossing.of, FramePlace):
        frame = built.frame(crossing.of)
        return lambda moment: float(
            (moment.velocity(frame) if crossing.rate else moment.position(frame))[crossing.index] - crossing.level
        )
    joint = built.joints[crossing.of.name]
    built.system.compile().scene.index.coordinates(joint)
    count = len(joint.joint.velocity_names)
    if len(joint.joint.start) != count:
        raise SceneError(f"joint {joint.name!r} has no coordinate that is one number; watch a frame instead")
    if crossing.index >= count:
        raise SceneError(f"joint {joint.name!r} has coordinates 0 to {count - 1}; there is no {crossing.index}")
    return lambda moment: float(
        np.atleast_1d(moment.beta_rate(joint) if crossing.rate else moment.beta(joint))[crossing.index] - crossing.level
    )


def _made(body: RigidEntry | ShapedEntry | PointEntry) -> RigidBody:
    shape = make_shape(body.shapes)
    if isinstance(body, PointEntry):
        return PointMass(body.mass, shape=shape)
    if isinstance(body, RigidEntry):
        return RigidBody(body.mass, body.inertia, body.com, shape=shape, as_measured=body.as_measured)
    if shape is None:
        raise SceneError("a body by its density needs a shape")
    return RigidBody.from_shape(shape, density=body.density)


def _resolved(built: Built, arguments: Mapping[str, object]) -> dict[str, Any]:
    """Arguments in which the names of frames, joints and bodies have become these."""
    return {name: _resolved_value(built, value) for name, value in arguments.items()}


def _resolved_value(built: Built, value: object) -> Any:
    match value:
        case FramePlace():
            return built.frame(value)
        case JointName(name):
            return built.joints[name]
        case BodyName(name):
            return built.bodies[name]
        case PortPlace():
            return built.port(value)
        case FunctionPlace():
            return built.function(value)
        case SignalName():
            return built.signal(value)
        case Measured(of, order):
            return (Position, Velocity, Acceleration)[order](_resolved_value(built, of))
        case Crossing():
            return _crossing(built, value)
        case tuple():
            return tuple(_resolved_value(built, one) for one in value)
    return value


@contextmanager
def _at(scene: SceneFile, place: str, name: str) -> Iterator[None]:
    """Errors raised within say where in the file the cause stands."""
    try:
        yield
    except FlexmbdError as error:
        raise SceneError(f"{scene.path}: {place} ({name}): {error}") from error
