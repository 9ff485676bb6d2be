"""The contents of a scene file, as data: nothing is loaded or computed yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.run.event import Direction

Vector = tuple[float, ...]
Matrix = tuple[Vector, ...]

GROUND = "ground"


@dataclass(frozen=True)
class BodyName:
    """A body of the scene."""

    name: str


@dataclass(frozen=True)
class JointName:
    """A joint of the scene."""

    name: str


@dataclass(frozen=True)
class FunctionPlace:
    """A function in a Python file, which is run when the machine is built.

    Attributes:
        file: the Python file.
        name: of the function in it.
        place: where it is asked for.
        takes_scene: whether its last argument is the machine, a ``Built``, by which it finds bodies and joints.
        breaks: s, of a function of time: where its value or slope jumps.
    """

    file: Path
    name: str
    place: str
    takes_scene: bool = False
    breaks: Vector = ()


@dataclass(frozen=True)
class SignalName:
    """A signal of the scene, and its value before it is set; one of the same name is the same signal."""

    name: str
    initial: float = 0.0


@dataclass(frozen=True)
class FramePlace:
    """A frame on a body.

    Attributes:
        body: its name, or "ground".
        interface: of a flexible body; None: the body frame.
        p: (3,) m, on a rigid body or the ground; None: its origin.
        R: (3, 3) from the frame's axes to the body's; None: the body's axes.
        label: how results call it.
    """

    body: str
    interface: str | None
    p: Vector | None
    R: Matrix | None
    label: str


@dataclass(frozen=True)
class ShapeEntry:
    """A shape: its kind and its arguments; of a file the path is whole."""

    place: str
    kind: str
    arguments: Mapping[str, object]


@dataclass(frozen=True)
class DrawnPose:
    """Where the drawing has a body frame: p (3,) m, R (3, 3) from its axes to the ground's; None: the default."""

    p: Vector | None = None
    R: Matrix | None = None


@dataclass(frozen=True)
class PointEntry:
    """A point mass: kg."""

    name: str
    place: str
    mass: float
    shapes: tuple[ShapeEntry, ...] = ()
    drawn: DrawnPose = DrawnPose()


@dataclass(frozen=True)
class RigidEntry:
    """A rigid body: kg; kg m^2 about the centre of mass, its diagonal or whole; m; whether any inertia will do."""

    name: str
    place: str
    mass: float
    inertia: Vector | Matrix
    com: Vector
    shapes: tuple[ShapeEntry, ...] = ()
    as_measured: bool = False
    drawn: DrawnPose = DrawnPose()


@dataclass(frozen=True)
class ShapedEntry:
    """A homogeneous rigid body: its shapes and its density (kg/m^3)."""

    name: str
    place: str
    shapes: tuple[ShapeEntry, ...]
    density: float
    drawn: DrawnPose = DrawnPose()


@dataclass(frozen=True)
class RecordEntry:
    """A flexible body, by the file of its record; ``voltages``: of its ports, or what else their efforts are."""

    name: str
    place: str
    path: Path
    shapes: tuple[ShapeEntry, ...] = ()
    drawn: DrawnPose = DrawnPose()
    voltages: Mapping[str, TimeFunction | FunctionPlace | SignalName] = field(default_factory=dict)


@dataclass(frozen=True)
class PortPlace:
    """A port of a flexible body, by the names of both."""

    body: str
    port: str


@dataclass(frozen=True)
class JointEntry:
    """A joint: its kind's arguments, its frames, and what is known of its motion (rad, m).

    ``at``: (3,) m, its place in the drawing; then ``parent`` and ``child`` are bodies.
    """

    name: str
    place: str
    kind: str
    arguments: Mapping[str, object]
    parent: FramePlace
    child: FramePlace
    position: Vector | None
    velocity: Vector | None
    motion: TimeFunction | FunctionPlace | SignalName | None
    at: Vector | None = None


@dataclass(frozen=True)
class Crossing:
    """Where a coordinate of a joint, or of a frame's position (m, inertial axes), or its rate passes a level.

    Attributes:
        of: the joint or the frame.
        index: which of its coordinates, or 0, 1, 2 for x, y, z.
        rate: whether it is the rate.
        level: rad, m, rad/s or m/s.
    """

    of: JointName | FramePlace
    index: int
    rate: bool
    level: float


@dataclass(frozen=True)
class EventEntry:
    """An event: where a function of a moment passes zero, or a coordinate a level."""

    name: str
    place: str
    function: FunctionPlace | Crossing
    direction: Direction
    stop: bool
    action: FunctionPlace | None


@dataclass(frozen=True)
class Measured:
    """The place (0), velocity (1) or acceleration (2) of a joint, a frame or a flexible body's modes."""

    of: JointName | FramePlace | BodyName
    order: int


@dataclass(frozen=True)
class ControllerEntry:
    """A sampled controller: its law, s between samples, what it measures, what it sets."""

    name: str
    place: str
    step: FunctionPlace
    period: float
    measurements: tuple[Measured | SignalName | FunctionPlace, ...]
    inputs: tuple[SignalName, ...]
    offset: float
    state: Vector | None


#: What state equations follow; functions of time are data.
FollowedEntry: TypeAlias = Measured | SignalName | FunctionPlace | TimeFunction


@dataclass(frozen=True)
class StatesEntry:
    """State equations z' = rates(t, z, u), y = outputs(t, z, u): what they follow (u), the signals that y sets."""

    name: str
    place: str
    rates: FunctionPlace
    outputs: FunctionPlace | None
    initial: Vector | None
    scale: float | Vector
    measurements: tuple[FollowedEntry, ...]
    inputs: tuple[SignalName, ...]
    names: tuple[str, ...]


@dataclass(frozen=True)
class Element:
    """A force element, a coupling, a shape that touches or a law: its kind's arguments by the names of their class."""

    place: str
    kind: str
    arguments: Mapping[str, object]


@dataclass(frozen=True)
class TouchEntry:
    """Shapes that touch: one, or each of a list, another one or each of another list.

    Attributes:
        name: by which results call its contacts.
        place: in the file.
        one, other: shapes; without ``other`` the list touches within itself.
        law: of the contact.
        friction: its arguments; None: smooth.
    """

    name: str
    place: str
    one: tuple[Element, ...]
    other: tuple[Element, ...] | None
    law: Element
    friction: Mapping[str, object] | None


@dataclass(frozen=True)
class RunEntry:
    """The simulation: s; without h by rtol; without an integrator the scene's own choice.

    It is broken off after ``max_steps``, or ``max_seconds`` of the wall's clock where these are given.
    """

    t_end: float
    rtol: float
    h: float | None
    integrator: str | None
    max_step: float | None
    max_steps: int
    max_seconds: float | None


@dataclass(frozen=True)
class OutputEntry:
    """What the tables hold; ``every`` s, or at the steps' ends. ``joints``: None for all that have coordinates."""

    every: float | None
    joints: tuple[JointName, ...] | None
    frames: Mapping[str, tuple[FramePlace, ...]]
    modal: tuple[BodyName, ...]
    reactions: tuple[JointName, ...]
    energies: bool
    formats: tuple[str, ...]
    film: str | None
    contacts: tuple[str, ...] = ()
    ports: tuple[PortPlace, ...] = ()


@dataclass(frozen=True)
class SceneFile:
    """A whole scene file."""

    path: Path
    gravity: Vector
    bodies: tuple[RigidEntry | ShapedEntry | RecordEntry | PointEntry, ...]
    joints: tuple[JointEntry, ...]
    forces: tuple[Element, ...]
    couplings: tuple[Element, ...]
    events: tuple[EventEntry, ...]
    run: RunEntry
    output: OutputEntry
    floor: tuple[ShapeEntry, ...] = ()
    controllers: tuple[ControllerEntry, ...] = ()
    states: tuple[StatesEntry, ...] = ()
    touches: tuple[TouchEntry, ...] = ()
