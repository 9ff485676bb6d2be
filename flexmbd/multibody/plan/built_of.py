"""What a scene is built of, as values to compare: whether it is unchanged since it was built before.

A value counts where it is known what may change in it: numbers, texts, arrays (which may be changed in place, so that
their numbers are compared), and the package's own bodies, joints and forces of such values.  What holds anything else
is never said to be unchanged: functions read what they like, a force of the user's own adds rows as it likes, and a
table of points tells again that its spline swings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from enum import Enum
from types import NoneType
from typing import Any, Generic, TypeVar

import numpy as np

from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame, Ground, RigidBody
from flexmbd.multibody.bodies.point_mass import PointMass
from flexmbd.multibody.force.protocol import Force
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.joint.coordinate_coupling import CoordinateCoupling
from flexmbd.multibody.team import Team
from flexmbd.record.reduced_body import ReducedBody

T = TypeVar("T")

#: Of these, in flexmbd.multibody, each field is a value. They are named, so that a scene loads those that it has alone.
OF_FIELDS = (
    "functions.time_function.Sine joint.enforcement.Multipliers joint.enforcement.Penalty "
    "joint.enforcement.AugmentedLagrangian joint.constant_velocity.ConstantVelocity joint.cylindrical.Cylindrical "
    "joint.distance.Distance joint.fixed.Fixed joint.free.Free joint.planar.Planar joint.planar_point.PlanarPoint "
    "joint.point_on_line.PointOnLine "
    "joint.point_on_plane.PointOnPlane joint.prismatic.Prismatic joint.revolute.Revolute "
    "joint.rolling_disc.RollingDisc joint.screw.Screw joint.spherical.Spherical joint.translation_joint.Translation "
    "joint.universal.Universal"
).split()
#: As these, and one is not another that has the same values.
OF_FIELDS_ALONE = (
    "joint.gear.Gear joint.rack_and_pinion.RackAndPinion force.beam_element.BeamElement force.bushing.Bushing "
    "force.distributed_load.DistributedLoad force.frame_force.FrameForce force.joint_damper.JointDamper "
    "force.gravitation.Gravitation "
    "force.joint_force.JointForce force.joint_friction.JointFriction force.joint_spring.JointSpring "
    "force.joint_stop.JointStop force.joint_torque.JointTorque force.plastic_joint_spring.PlasticJointSpring "
    "force.plastic_spring.PlasticSpring force.spring_damper.SpringDamper"
).split()


class KeptWhile(Generic[T]):
    """What was made of parts, for as long as these are unchanged; threads may share it."""

    def __init__(self) -> None:
        self._kept: tuple[tuple[Any, ...], T] | None = None

    def __reduce__(self) -> tuple[type[KeptWhile[T]], tuple[()]]:
        """Copies and pickles have none."""
        return KeptWhile, ()

    def of(self, parts: tuple[Any, ...] | None) -> T | None:
        """What was made of these parts (``built_of``); None where it was made of others."""
        kept = self._kept
        return None if kept is None or parts is None or kept[0] != parts else kept[1]

    def keep(self, parts: tuple[Any, ...] | None, made: T) -> T:
        """Keep what was made of these parts, in place of what was kept before."""
        self._kept = None if parts is None else (parts, made)
        return made


class _UnknownError(Exception):
    """A value of which it is not known what may change in it."""


def built_of(
    ground: Ground,
    bodies: Sequence[Body],
    connections: Sequence[Connection],
    forces: Sequence[Force],
    couplings: Sequence[CoordinateCoupling],
    gravity: object,
    team: Team,
) -> tuple[Any, ...] | None:
    """All that ``System.compile`` reads of its parts now, equal to that of before where nothing changed; else None.

    It holds the parts themselves, so that no other ones come to stand in their places.
    """
    try:
        return (
            team,
            _value(gravity),
            ground,
            ground.name,
            tuple(map(_part_of_body, bodies)),
            tuple(map(_part_of_joint, connections)),
            tuple(map(_value, forces)),
            tuple(map(_value, couplings)),
        )
    except _UnknownError:
        return None


def _part_of_body(body: Body) -> tuple[Any, ...]:
    if type(body) is PointMass:
        return body, _value(body.mass), body.name
    if type(body) is RigidBody:
        given = body.mass, body.inertia, body.com, body.as_measured, body.name
        return body, *map(_value, given)
    if type(body) is FlexibleBody and type(body.record) is ReducedBody:
        return body, body.record, *map(_value, (body.q, body.q_rate, body.name))
    raise _UnknownError


def _part_of_joint(joint: Connection) -> tuple[Any, ...]:
    if type(joint) is not Connection:
        raise _UnknownError
    started = joint.position, joint.velocity, joint.motion
    given = joint.joint, joint.parent, joint.child, joint.way, joint.enforce, *started, joint.name
    return joint, *map(_value, given)


def _value(one: object) -> Any:
    kind = type(one)
    if kind in _ATOMS:
        return one
    how = _HOW.get(kind) or _learnt(kind)
    if how is not None:
        return how(one)
    if isinstance(one, Enum):
        return one
    raise _UnknownError


def _of_array(array: np.ndarray) -> tuple[Any, ...]:
    if array.dtype.kind not in "iufb":
        raise _UnknownError
    return array.dtype.str, array.shape, array.tobytes()


def _of_list(several: Sequence[object]) -> tuple[Any, ...]:
    return tuple(map(_value, several))


def _of_kind(one: object) -> tuple[Any, ...]:
    return type(one), one


def _itself(one: object) -> object:
    return one


def _reader(kind: type, *, alone: bool) -> Callable[[Any], tuple[Any, ...]]:
    names = [field.name for field in fields(kind)]

    def values(one: object) -> tuple[Any, ...]:
        known = vars(one)
        if len(known) != len(names):  # something was hung on it
            raise _UnknownError
        return one if alone else kind, *[_value(known[name]) for name in names]

    return values


_ATOMS = frozenset({float, int, str, NoneType})
_HOW: dict[type, Callable[[Any], Any]] = {
    bool: _of_kind,  # which are not the numbers that they equal
    np.float64: _of_kind,
    np.int64: _of_kind,
    np.ndarray: _of_array,
    list: _of_list,
    tuple: _of_list,
    PointMass: _itself,
    RigidBody: _itself,  # where others name them; their own values are entered once
    FlexibleBody: _itself,
    Ground: _itself,
    Connection: _itself,
    Frame: _reader(Frame, alone=True),
}


def _learnt(kind: type) -> Callable[[Any], Any] | None:
    """How a class that is named above is read; None where it is not."""
    _, own, name = f"{kind.__module__}.{kind.__qualname__}".partition("flexmbd.multibody.")
    alone = name in OF_FIELDS_ALONE
    if not own or not (alone or name in OF_FIELDS):
        return None
    how = _HOW[kind] = _reader(kind, alone=alone)
    return how
