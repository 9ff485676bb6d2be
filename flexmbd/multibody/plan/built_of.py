"""What a scene is built of, as values to compare: whether it is unchanged since it was built before.

A value counts where it is known what may change in it: numbers, texts, arrays (which may be changed in place, so that
their numbers are compared), and the package's own bodies, joints and forces of such values.  What holds anything else
is never said to be unchanged: functions read what they like, a force of the user's own adds rows as it likes, and a
table of points tells again that its spline swings.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from itertools import chain, groupby
from types import NoneType
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

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


class GivenParts(NamedTuple):
    """The parts of a scene, as its user put them together."""

    ground: Ground
    bodies: Sequence[Body]
    connections: Sequence[Connection]
    forces: Sequence[Force]
    couplings: Sequence[CoordinateCoupling]
    gravity: object
    team: Team


class KeptWhile(Generic[T]):
    """What was made of a scene's parts, for as long as these are unchanged; threads may share it."""

    def __init__(self) -> None:
        self._kept: tuple[BuiltOf, T] | None = None

    def __reduce__(self) -> tuple[type[KeptWhile[T]], tuple[()]]:
        """Copies and pickles have none."""
        return KeptWhile, ()

    def of(self, parts: GivenParts, make: Callable[[], T]) -> T:
        """What was made of these parts where none of them has changed since; else what ``make`` makes now."""
        kept = self._kept
        if kept is not None and kept[0].is_untouched(parts):
            return kept[1]
        read = built_of(parts)
        made = make() if kept is None or read is None or kept[0].values != read.values else kept[1]
        self._kept = None if read is None else (read, made)
        return made


class _UnknownError(Exception):
    """A value of which it is not known what may change in it."""


@dataclass(frozen=True, eq=False)
class BuiltOf:
    """All that ``System.compile`` reads of a scene's parts, as it was when it was read.

    Attributes:
        values: of all parts, equal to those of another time where nothing changed.  They hold the parts themselves, so
            that no other ones come to stand in their places.
        objects: the parts, and what the attributes are that may be given anew, in the order of ``_objects``.
        arrays: whose numbers may be changed in place.
        numbers: what these were.
        lists: that may be changed in place, each with its values.
    """

    values: tuple[Any, ...]
    objects: list[object]
    arrays: list[NDArray[Any]]
    numbers: tuple[Any, ...]
    lists: list[tuple[list[Any], Any]]

    def is_untouched(self, parts: GivenParts) -> bool:
        """Whether the parts are these very ones, and nothing in them was given anew or changed in place.

        What is frozen holds what it held, so that its values need not be read again: a scene of a hundred thousand
        springs is compared by the springs themselves.
        """
        try:
            objects = _objects(parts)
            return (
                len(objects) == len(self.objects)
                and all(map(operator.is_, objects, self.objects))
                and _numbers(self.arrays) == self.numbers
                and all(_Reader().value(one) == known for one, known in self.lists)
            )
        except _UnknownError:
            return False


def built_of(parts: GivenParts) -> BuiltOf | None:
    """What a scene is built of; None where it holds anything of which it is not known what may change in it."""
    read = _Reader()
    try:
        objects = _objects(parts)
        values = (
            parts.team,
            read.value(parts.gravity),
            parts.ground,
            parts.ground.name,
            read.bodies(parts.bodies),
            read.joints(parts.connections),
            read.forces(parts.forces),
            tuple(map(read.value, parts.couplings)),
        )
    except _UnknownError:
        return None
    arrays = list(read.arrays.values())
    return BuiltOf(values, objects, arrays, _numbers(arrays), list(read.lists.values()))


def _objects(parts: GivenParts) -> list[object]:
    """The parts of a scene, and the attributes of those that are not frozen."""
    known = [parts.team, parts.gravity, parts.ground, parts.ground.name]
    attributes = [chain.from_iterable(map(_attributes_of(kind), own)) for kind, own in _by_kind(parts.bodies)]
    of_joints = chain.from_iterable(map(_OF_JOINT, parts.connections))
    return [*known, *chain(*parts[1:5]), *chain(*attributes), *of_joints]


def _by_kind(bodies: Sequence[Body]) -> list[tuple[type, list[Body]]]:
    """The bodies of each class."""
    found: dict[type, list[Body]] = {}
    for body in bodies:
        found.setdefault(type(body), []).append(body)
    return list(found.items())


def _attributes_of(kind: type) -> Callable[[Any], tuple[Any, ...]]:
    """Reads the attributes of a body of this class that a scene is compiled of."""
    how = _OF_BODIES.get(kind)
    if how is None:
        raise _UnknownError
    return how


def _numbers(arrays: Sequence[NDArray[Any]]) -> tuple[Any, ...]:
    """The numbers of arrays, and how these are laid out."""
    content = b"".join([one if one.flags.c_contiguous else one.tobytes() for one in arrays])
    return content, [one.dtype for one in arrays], [one.shape for one in arrays]


class _Reader:
    """Reads values; notes the arrays and lists among them, which may be changed in place.

    Attributes:
        arrays: by their ids.
        lists: likewise, with their values.
    """

    def __init__(self) -> None:
        self.arrays: dict[int, NDArray[Any]] = {}
        self.lists: dict[int, tuple[list[Any], Any]] = {}
        self._frames: dict[int, Any] = {}  # each is read once, however many parts it is an end of

    def bodies(self, bodies: Sequence[Body]) -> tuple[Any, ...]:
        """Bodies with their values, those of each class attribute by attribute."""
        found: list[Any] = [tuple(bodies)]
        for kind, own in _by_kind(bodies):
            given = list(zip(*map(_attributes_of(kind), own), strict=True))
            if kind is FlexibleBody:
                if any(type(record) is not ReducedBody for record in given[0]):
                    raise _UnknownError
                found.append(given.pop(0))
            found += map(self._attribute, given)
        return tuple(found)

    def joints(self, joints: Sequence[Connection]) -> tuple[Any, ...]:
        """Joints with their values."""
        if any(type(joint) is not Connection for joint in joints):
            raise _UnknownError
        given = zip(*map(_OF_JOINT, joints), strict=True)
        return tuple(joints), *map(self._attribute, given)

    def forces(self, forces: Sequence[Force]) -> tuple[Any, ...]:
        """Forces with their values, those next to each other of one class field by field."""
        found: list[Any] = [tuple(forces)]
        for kind, run in groupby(forces, key=type):
            names, alone = _FIELDS.get(kind) or _learnt(kind)
            own = list(run)
            found += self._columns(own, names) if alone else map(self.value, own)
        return tuple(found)

    def _columns(self, several: Sequence[Any], names: Sequence[str]) -> Iterator[Any]:
        """The values of objects of a frozen class, field by field."""
        known = [vars(one) for one in several]
        if set(map(len, known)) != {len(names)}:  # something was hung on one
            raise _UnknownError
        return map(self._attribute, zip(*map(operator.itemgetter(*names), known), strict=True))

    def _attribute(self, values: tuple[Any, ...]) -> Any:
        """The values of one attribute of several objects."""
        kinds = set(map(type, values))
        if kinds <= _ATOMS or kinds <= _THEMSELVES:
            return values
        if len(kinds) > 1:
            return tuple(map(self.value, values))
        if kinds == {Frame}:
            new = {id(frame): frame for frame in values if id(frame) not in self._frames}
            self._frames.update(new)
            return values, *(self._columns(list(new.values()), _FRAME) if new else ())
        if kinds == {np.ndarray}:
            return self._arrays(values)
        kind = type(values[0])
        if not (kind in _WITH_KIND or kind is list or kind is tuple or issubclass(kind, Enum)):
            names, alone = _FIELDS.get(kind) or _learnt(kind)
            if len(names) > 1 and not alone:
                return kind, *self._columns(values, names)
        return tuple(map(self.value, values))

    def _arrays(self, arrays: tuple[NDArray[Any], ...]) -> tuple[Any, ...]:
        if any(kind not in "iufb" for kind in {array.dtype.kind for array in arrays}):
            raise _UnknownError
        self.arrays.update(zip(map(id, arrays), arrays, strict=True))
        return _numbers(arrays)

    def value(self, one: object) -> Any:
        """A value of any class that is known."""
        kind = type(one)
        if kind in _ATOMS:
            return one
        if kind is Frame:
            known = self._frames.get(id(one))
            if known is None:
                known = self._frames[id(one)] = self._fields(one, _FRAME, alone=True)
            return known
        if kind in _THEMSELVES or isinstance(one, Enum):  # their own values are read once
            return one
        if kind in _WITH_KIND:
            return kind, one
        if isinstance(one, np.ndarray):
            return self._array(one)
        if kind is list or kind is tuple:
            return self._several(one)  # type: ignore[arg-type]
        names, alone = _FIELDS.get(kind) or _learnt(kind)
        return self._fields(one, names, alone=alone)

    def _array(self, array: NDArray[Any]) -> tuple[Any, ...]:
        if type(array) is not np.ndarray or array.dtype.kind not in "iufb":
            raise _UnknownError
        self.arrays[id(array)] = array
        return array.dtype.str, array.shape, array.tobytes()

    def _several(self, several: list[Any] | tuple[Any, ...]) -> tuple[Any, ...]:
        values = tuple(map(self.value, several))
        if isinstance(several, list):
            self.lists[id(several)] = several, values
        return values

    def _fields(self, one: object, names: Sequence[str], *, alone: bool) -> tuple[Any, ...]:
        known = vars(one)
        if len(known) != len(names):  # something was hung on it
            raise _UnknownError
        return one if alone else type(one), *[self.value(known[name]) for name in names]


def _learnt(kind: type) -> tuple[Sequence[str], bool]:
    """The fields of a frozen class that is named above, and whether one is not another of the same values."""
    _, own, name = f"{kind.__module__}.{kind.__qualname__}".partition("flexmbd.multibody.")
    alone = name in OF_FIELDS_ALONE
    if not own or not (alone or name in OF_FIELDS):
        raise _UnknownError
    found = _FIELDS[kind] = [field.name for field in fields(kind)], alone
    return found


_ATOMS = frozenset({float, int, str, NoneType})
_WITH_KIND = frozenset({bool, np.float64, np.int64})  # which are not the numbers that they equal
_THEMSELVES = frozenset({PointMass, RigidBody, FlexibleBody, Ground, Connection})
_FRAME = [field.name for field in fields(Frame)]
_FIELDS: dict[type, tuple[Sequence[str], bool]] = {}
_OF_BODIES: dict[type, Callable[[Any], tuple[Any, ...]]] = {
    PointMass: operator.attrgetter("mass", "name"),
    RigidBody: operator.attrgetter("mass", "inertia", "com", "as_measured", "name"),
    FlexibleBody: operator.attrgetter("record", "q", "q_rate", "name"),
}
_OF_JOINT = operator.attrgetter(
    "joint", "parent", "child", "way", "enforce", "position", "velocity", "motion", "name"
)
