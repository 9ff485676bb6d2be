"""What a scene file says, as data: nothing is loaded or computed yet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flexmbd.multibody.functions.time_function import TimeFunction

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
class RigidEntry:
    """A rigid body: kg; kg m^2 about the centre of mass, its diagonal or whole; m."""

    name: str
    place: str
    mass: float
    inertia: Vector | Matrix
    com: Vector


@dataclass(frozen=True)
class RecordEntry:
    """A flexible body, by the file of its record."""

    name: str
    place: str
    path: Path


@dataclass(frozen=True)
class JointEntry:
    """A joint: its kind's arguments, its frames, and what is known of its motion (rad, m)."""

    name: str
    place: str
    kind: str
    arguments: Mapping[str, object]
    parent: FramePlace
    child: FramePlace
    position: Vector | None
    velocity: Vector | None
    motion: TimeFunction | None


@dataclass(frozen=True)
class Element:
    """A force element or a coupling of joints: its kind's arguments, by the names that their class has."""

    place: str
    kind: str
    arguments: Mapping[str, object]


@dataclass(frozen=True)
class RunEntry:
    """The simulation: s; without h by rtol; without an integrator the scene's own choice."""

    t_end: float
    rtol: float
    h: float | None
    integrator: str | None


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


@dataclass(frozen=True)
class SceneFile:
    """A whole scene file."""

    path: Path
    gravity: Vector
    bodies: tuple[RigidEntry | RecordEntry, ...]
    joints: tuple[JointEntry, ...]
    forces: tuple[Element, ...]
    couplings: tuple[Element, ...]
    run: RunEntry
    output: OutputEntry
