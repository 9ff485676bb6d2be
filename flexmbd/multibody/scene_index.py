"""Places of a scene's bodies, joints and forces in its arrays, by the objects themselves."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, MutableMapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.bodies.body import Body, FlexibleBody, Frame
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.arrays import Plan
from flexmbd.multibody.kernels.reading.tree import with_frame

FloatArray = NDArray[np.float64]
K = TypeVar("K")
V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)
T = TypeVar("T")


class IdentityMap(MutableMapping[K, V], Generic[K, V]):
    """A dictionary whose keys are these very objects, whatever they equal.

    It keeps them alive, and knows them again where it was pickled or deep-copied together with them.
    """

    def __init__(self, pairs: Iterable[tuple[K, V]] = ()) -> None:
        self._found: dict[int, tuple[K, V]] = {id(key): (key, value) for key, value in pairs}

    def __getitem__(self, key: K) -> V:
        """The value of an object; KeyError if it has none."""
        return self._found[id(key)][1]

    def __setitem__(self, key: K, value: V) -> None:
        """Enter an object."""
        self._found[id(key)] = key, value

    def __delitem__(self, key: K) -> None:
        """Take an object out."""
        del self._found[id(key)]

    def __contains__(self, key: object) -> bool:
        """Whether this very object is in."""
        return id(key) in self._found

    def get(self, key: K, default: Any = None) -> Any:
        """The value of an object, or what is to be in its place."""
        found = self._found.get(id(key))
        return default if found is None else found[1]

    def __iter__(self) -> Iterator[K]:
        """The objects, in the order in which they were entered."""
        return (key for key, _ in self._found.values())

    def __len__(self) -> int:
        """How many objects."""
        return len(self._found)

    def __getstate__(self) -> dict[str, list[tuple[K, V]]]:
        """The pairs: ids are of one process."""
        return {"pairs": list(self._found.values())}

    def __setstate__(self, state: dict[str, list[tuple[K, V]]]) -> None:
        """Enter the objects as they are now."""
        self._found = {id(key): (key, value) for key, value in state["pairs"]}


class ByNumber(Protocol[V_co]):
    """Values of a run of objects, by their numbers in it."""

    def __getitem__(self, number: int, /) -> V_co:
        """The value of one."""
        ...


class RunMap(IdentityMap[K, V], Generic[K, V]):
    """An `IdentityMap` whose values are no tuples, to which runs of objects are added with what tells their values."""

    def add_run(self, keys: Sequence[K], values: ByNumber[V]) -> None:
        """Enter objects, whose values are those of their numbers."""
        entries: Any = zip(keys, zip(repeat(values), range(len(keys)), strict=False), strict=True)
        self._found.update(zip(map(id, keys), entries, strict=True))

    def __getitem__(self, key: K) -> V:
        """The value of an object; KeyError if it has none."""
        found: Any = super().__getitem__(key)
        if type(found) is tuple:
            values, number = found
            found = values[number]
        return found  # type: ignore[no-any-return]

    def get(self, key: K, default: Any = None) -> Any:
        """The value of an object, or what is to be in its place."""
        return self[key] if key in self else default


@dataclass(frozen=True)
class Slots:
    """Where something lies in the configuration x and the velocity v."""

    x: slice
    v: slice


@dataclass(frozen=True, eq=False)
class StatePlaces:
    """Where the values of a user's state equations stand.

    Attributes:
        v: where in the velocity v.
        scale: (n,) what they are divided by there.
        initial: (n,) the values at the start.
        what: their name in messages.
        inputs: the signals that they set.
    """

    v: slice
    scale: FloatArray
    initial: FloatArray
    what: str
    inputs: tuple[Signal, ...]


@dataclass(frozen=True)
class ForceRows:
    """Rows of ``Plan.forces`` and of ``Plan.elements`` of one force element."""

    forces: range
    elements: range


class JoinedPlace(NamedTuple):
    """Where the numbers of a group of forces stand that act together, and which of them a force is.

    Attributes:
        place: where they begin in ``Plan.data``; -1: the force is in no group.
        number: of the force in its group.
        scratch: how many numbers of ``Work.generalized`` the group needs.
    """

    place: int = -1
    number: int = 0
    scratch: int = 0


@dataclass(frozen=True, eq=False)
class SceneIndex:
    """Where the objects of a scene stand in its compiled arrays.

    Attributes:
        bodies: row of ``Plan.tree``; -1 for the ground.
        joints: coordinates of the joints of the tree.
        links: of the same, the row of ``Plan.tree`` of each of their steps.
        closures: rows of F and G in ``Plan.frames`` of joints held by constraints.
        modes: modal coordinates of flexible bodies.
        forces: rows of force elements; not of those that are solved together.
        memories: of force elements with memory, the places in x of what they remember, by name.
        states: of users' state equations, where their values stand.
        efforts: of ports, the row of ``Plan.times`` of their effort.
        shared: of numbers that forces share, where they begin in ``Plan.data``.
        joined: of forces that act together with others, where their group stands.
        substitutes: of bodies, frames, joints and forces whose numbers differ from those of the scene that was
            compiled: objects that have the numbers of this variant.
    """

    bodies: IdentityMap[Body, int] = field(default_factory=IdentityMap)
    joints: IdentityMap[Connection, Slots] = field(default_factory=IdentityMap)
    links: IdentityMap[Connection, tuple[int, ...]] = field(default_factory=IdentityMap)
    closures: IdentityMap[Connection, tuple[int, int]] = field(default_factory=IdentityMap)
    modes: IdentityMap[Body, Slots] = field(default_factory=IdentityMap)
    forces: RunMap[object, ForceRows] = field(default_factory=RunMap)
    memories: IdentityMap[object, dict[str, int]] = field(default_factory=IdentityMap)
    states: IdentityMap[object, StatePlaces] = field(default_factory=IdentityMap)
    efforts: IdentityMap[Port, int] = field(default_factory=IdentityMap)
    shared: IdentityMap[object, int] = field(default_factory=IdentityMap)
    joined: IdentityMap[object, JoinedPlace] = field(default_factory=IdentityMap)
    substitutes: IdentityMap[object, Any] = field(default_factory=IdentityMap)

    def now(self, thing: T) -> T:
        """The body, joint, force or frame with the numbers that it has in this variant of the scene."""
        found: T = self.substitutes.get(thing, thing)
        return found

    def frame_now(self, frame: Frame) -> Frame:
        """As ``now`` of a frame: of another record's interface where its body has another record."""
        refuse_other(frame, Frame, "what is asked for", wanted="a frame, as body.frame()")
        body = self.substitutes.get(frame.body)
        if isinstance(body, FlexibleBody) and frame.interface is not None:
            found = body.frame(frame.interface)
            own: Frame = frame.body.frame(frame.interface)  # type: ignore[attr-defined]
            if np.array_equal(own.R_BF, frame.R_BF):
                return found
            return replace(found, R_BF=found.R_BF @ own.R_BF.T @ frame.R_BF)  # a joint's axes in the drawing
        return self.now(frame)

    def row_of(self, frame: Frame) -> int:
        """Row of ``Plan.tree`` of a frame's body; -1 for the ground.

        Raises:
            SceneError: the body is not in the scene.
        """
        refuse_other(frame, Frame, "what is asked for", wanted="a frame, as body.frame()")
        row = self.bodies.get(frame.body)
        if row is None:
            raise SceneError(f"frame {frame.label} belongs to no body of this scene")
        return row

    def with_probe(self, plan: Plan, frame: Frame) -> Plan:
        """``plan`` with one more frame, its last, for asking where ``frame`` is.

        Raises:
            SceneError: the frame's body is not in the scene.
        """
        now = self.frame_now(frame)
        return with_frame(plan, self.row_of(frame), now.p_BF_B, now.R_BF, now.modes)

    def coordinates(self, connection: Connection) -> Slots:
        """Where the coordinates of a joint lie.

        Raises:
            SceneError: it has none.
        """
        slots = self.joints.get(connection)
        if slots is None:
            refuse_other(connection, Connection, "what is asked for", wanted="a joint, as scene.connect(...) gives it")
            raise SceneError(
                f"joint {connection.name!r} has no joint coordinate here: it closes a loop, or belongs to another "
                "scene; ask for its frames' positions"
            )
        return slots

    def modal(self, body: Body) -> Slots:
        """Where the modal coordinates of a body lie.

        Raises:
            SceneError: it has none.
        """
        slots = self.modes.get(body)
        if slots is None:
            refuse_other(body, Body, "what is asked for", wanted="a body of the scene")
            raise SceneError(f"body {body.name!r} has no modal coordinates here: it is rigid, or of another scene")
        return slots

    def state_places(self, states: object) -> StatePlaces:
        """Where the values of a user's state equations stand.

        Raises:
            SceneError: they are not in the scene.
        """
        found = self.states.get(states)
        if found is None:
            what = getattr(states, "what", repr(states))
            if states in self.forces:
                raise SceneError(
                    f"{what} has no states: a contact has them with friction alone, friction=fm.contact.Friction(...)"
                )
            raise SceneError(f"{what} are not in this scene: scene.add_states(...)")
        return found

    def is_modal(self, k: int) -> bool:
        """Whether velocity k is the rate of a modal coordinate."""
        return any(slots.v.start <= k < slots.v.stop for slots in self.modes.values())
