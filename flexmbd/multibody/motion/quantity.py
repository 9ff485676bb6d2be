"""What can be observed of a machine: places, velocities and accelerations of frames, joints and flexible bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.bodies.port import StrainFlow
from flexmbd.multibody.bodies.pseudo_rigid_body import PseudoRigidBody
from flexmbd.multibody.joint.connection import Connection

#: Objects of outputs: a frame's origin (m, inertial axes), a joint's coordinates, a body's modal coordinates.
Observed: TypeAlias = Frame | Connection | FlexibleBody | PseudoRigidBody


@dataclass(frozen=True, eq=False)
class Position:
    """The change of a frame's place (3), of a joint's coordinates or of a body's modal coordinates."""

    of: Observed


@dataclass(frozen=True, eq=False)
class Velocity:
    """The change of the velocity of the same."""

    of: Observed


@dataclass(frozen=True, eq=False)
class Acceleration:
    """The acceleration of the same."""

    of: Observed


@dataclass(frozen=True, eq=False)
class Rotation:
    """The small rotation (3) of a frame from where it stands (rad), about its own axes there."""

    of: Frame


Output: TypeAlias = Position | Velocity | Acceleration | Rotation

#: What a linearised machine is observed by.
LinearOutput: TypeAlias = Output | StrainFlow

#: Orders of differentiation.
ORDERS = {Position: 0, Rotation: 0, Velocity: 1, Acceleration: 2}
