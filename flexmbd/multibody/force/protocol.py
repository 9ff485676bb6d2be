"""The interfaces of a force element, and of the table that it adds its rows to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, numbers
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.continuum_body import PlacedInterior
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.force.shared_numbers import SharedNumbers
from flexmbd.multibody.functions.callback import Law, StateFunction, StateRates
from flexmbd.multibody.functions.compiled_function import Compiled
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.functions.switched import Switched
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kane.bearing import Bearing
from flexmbd.multibody.kane.inertia import UserBody
from flexmbd.multibody.kernels.elements.element import ElementKind, PairsElement
from flexmbd.multibody.motion.machine import Machine, WrenchSource

FloatArray = NDArray[np.float64]
#: The number of a switch by its side, t (s), x (nx,), v (nv,).
SwitchValue: TypeAlias = Callable[[float, float, FloatArray, FloatArray], Any]


class StateEquations(Protocol):
    """A user's state equations, as far as the table is concerned."""

    @property
    def what(self) -> str:
        """Their name in messages."""

    @property
    def code(self) -> str:
        """Tells them from others (see ``kernels.base.fingerprint``)."""
        ...

    @property
    def state_names(self) -> tuple[str, ...]:
        """Of each state."""
        ...

    @property
    def scales(self) -> FloatArray:
        """(n,) sizes of the states."""

    @property
    def first(self) -> FloatArray:
        """(n,) the states at the start."""

    @property
    def inputs(self) -> Sequence[Signal]:
        """The signals that their outputs set."""


class ElementTable(Protocol):
    """The table that force elements add their rows to (``plan.forces.ForceTable``)."""

    def coordinate(self, connection: Connection, index: int) -> tuple[int, int]:
        """Places in x and v of a joint's coordinate.

        Raises:
            SceneError: the joint has no coordinate in the tree.
        """

    def inertia(self, connection: Connection, index: int, value: float, what: str) -> None:
        """Add a one-dimensional inertia to a joint's coordinate, kg m^2 or kg per unit of it.

        Raises:
            SceneError: the joint has no coordinate in the tree, or moves by a pair of several coordinates.
        """

    def modes(self, body: Body) -> tuple[int, int]:
        """Places in x and v of a flexible body's first mode."""

    def frame(self, frame: Frame) -> int:
        """Row of ``Plan.frames``."""

    def ground(self) -> int:
        """Row of ``Plan.frames`` of the inertial frame."""

    def numbers(self, values: ArrayLike) -> int:
        """Offset in ``Plan.data`` of the values, appended."""

    def shared(self, numbers: SharedNumbers) -> int:
        """Offset in ``Plan.data`` of numbers that forces share; of a force that is ``WithSharedNumbers``.

        Raises:
            SceneError: a force that varies would read others than the scene was compiled with.
        """

    def joined(self) -> tuple[int, int, int]:
        """Where in ``Plan.data`` the group of the force at hand begins, which acts together with others, -1 of none.

        Then which of them it is, and how many numbers of ``Work.generalized`` the group needs.
        """

    def time(self, function: TimeFunction, what: str, *, rate: bool = False) -> int:
        """Row of ``Plan.times``; ``what`` is its name in messages, ``rate`` says whether its rate is needed too."""

    def effort(self, port: Port, time: int) -> None:
        """Note in which row of ``Plan.times`` the effort of a port stands; the first to do so gives it."""

    def follow(self, times: Sequence[int]) -> None:
        """Note that states follow functions of time, by their rows, which no states may then set."""

    def law(self, law: Compiled | Law, what: str) -> int:
        """Address of f(t, beta, rate of beta) -> N or N m."""

    def state_function(self, function: Compiled | StateFunction, what: str) -> int:
        """Address of a force of the whole state."""

    def frame_law(
        self, wrench: Compiled, what: str, frame_F: Frame, frame_G: Frame, *, numbers: ArrayLike = (),
        derivative: Compiled | None = None,
    ) -> None:
        """Let a law of one's own act between two frames.

        ``numbers`` are its ``data``.  The derivative is by central differences where none is given.

        Raises:
            SceneError: the functions are not compiled ones of six and of ten arguments (`flexmbd.compiled`).
        """

    def frame_states(
        self, law: Compiled, what: str, frame_F: Frame, frame_G: Frame, *, states: Mapping[str, float],
        scale: ArrayLike = 1.0, numbers: ArrayLike = (), inputs: Sequence[TimeFunction] = (),
    ) -> None:
        """Let a law of one's own with states act between two frames; for a force that is ``WithStates``.

        ``states`` names them, with the values at the start; ``scale``: their sizes in their own units, (n,) or one for
        all, to which rtol is relative.  ``numbers`` are its ``data``, ``inputs`` its ``u``: numbers, functions of time,
        signals that controllers set.  Without states it is a law of the motion and of its inputs alone.

        Raises:
            SceneError: the law is no compiled function of nine arguments (`flexmbd.compiled`), or states are none.
        """

    def contact(
        self, what: str, frame_F: Frame, frame_G: Frame, *, numbers: ArrayLike, bristle: float | None,
        turn: float | None = None, remembers: bool = False,
    ) -> None:
        """Let a shape on F and a sphere that G carries touch.

        ``numbers``: of the shape, the law and the sphere (``kernels.contact.contact_law``).  ``bristle``: the size (m)
        to which rtol is relative for the stretch of friction's bristle, or None where there is no friction; ``turn``
        likewise of the bristles that resist rolling and spinning; for a force that is ``WithStates``.  ``remembers``:
        also without friction, the speed at which the surfaces met.
        """

    def hard_contact(self, what: str, frame_F: Frame, frame_G: Frame, *, numbers: ArrayLike) -> None:
        """Let a shape on F and a sphere that G carries touch without entering each other.

        ``numbers``: of the shape, the law and the sphere (``kernels.elements.hard_element``).
        """

    def hard_group(self, what: str, frames: Sequence[Frame], *, law: ArrayLike, numbers: ArrayLike) -> None:
        """Let shapes on many frames touch without entering each other.

        ``law``: its numbers (``kernels.elements.hard_element``).  ``numbers``: what tells the shapes from others.
        """

    def pairs(
        self, law: Compiled | PairsElement, what: str, group: Sequence[Frame], *, own: ArrayLike = ((),),
        numbers: ArrayLike = (),
    ) -> None:
        """Let a law of one's own act along the lines between all pairs of a group of frames.

        ``own`` (n, k) are numbers of each frame, ``numbers`` those that all share.
        """

    def memory_law(
        self, law: Compiled, what: str, connection: Connection, index: int, *, memory: Mapping[str, float],
        numbers: ArrayLike = (), rest: float = 0.0,
    ) -> None:
        """Let a law with memory of one's own act on a joint's coordinate less ``rest`` (m or rad).

        ``numbers`` are its ``data``; ``memory`` names what it remembers, with the values it begins with;
        ``remembered`` tells those whose name begins with no underscore.

        Raises:
            SceneError: the law is no compiled function of five arguments (`flexmbd.compiled`), or has no memory.
        """

    def memory_line(
        self, law: Compiled, what: str, frame_F: Frame, frame_G: Frame, *, memory: Mapping[str, float],
        numbers: ArrayLike = (), length: float = 0.0,
    ) -> None:
        """Let a law with memory of one's own act on the distance of two frames less ``length`` (m); a pull is positive.

        As ``memory_law``.
        """

    def compiled_states(self, rates: Compiled, outputs: Compiled | None, n: int, k: int) -> int:
        """Address of compiled state equations of n states and k outputs."""

    def python_states(self, equations: StateRates, what: str, size: int) -> int:
        """Address of state equations in Python, which give rates and outputs (size,) in one."""

    def states(
        self, states: StateEquations, addresses: tuple[int, int], quantities: Sequence[tuple[int, int, int]], *,
        whole: bool, switch: tuple[Switched, SwitchValue] | None = None,
    ) -> slice:
        """Add a link for each state, and the row of their equations; the states' places in v.

        ``addresses``: of the equations, and of those on the negative side of their ``switch``, 0 where they have none.
        ``quantities``: of each number that they follow its kind (``kernels.elements.state_rates``), its place and the
        velocity that goes with it; ``whole``: whether the equations take x and v of the machine in their place.
        """

    def memory(self, names: Mapping[str, float]) -> int:
        """Place in x of a memory that begins with these values, behind those that every element with memory has."""

    def side(self, switched: Switched, value: SwitchValue, what: str) -> int:
        """Place in x of the side of a switch, whose number is ``value``."""

    def when_built(self, hook: Callable[[Machine], None]) -> None:
        """Call ``hook`` with the compiled scene once it is there."""

    def drive(self, connection: Connection, function: TimeFunction, what: str) -> None:
        """Let a function of time act on a joint's only coordinate."""

    def add_wrench_source(self, source: WrenchSource) -> None:
        """Add a source of wrenches on frames that the plan has as generalised forces alone, for reactions."""

    def add_bearing(self, bearing: Bearing) -> None:
        """Add a joint whose friction follows its reaction."""

    def add_user_body(self, body: UserBody) -> None:
        """Add a body that the user gives in Kane's form."""

    def add_interior(self, placed: PlacedInterior) -> int:
        """Add a body with history; return the row of ``Plan.wrenches`` of its first frame, the others follow."""

    def element(
        self, element: ElementKind, what: str, *, f: int = -1, g: int = -1, x: int = -1, v: int = -1, time: int = -1,
        data: int = 0, count: int = 0, address: int = 0, derivative: int = 0, memory: int = -1, side: int = -1,
        scratch: int = 0, acts: bool = True,
    ) -> None:
        """Append a row of ``Plan.elements``; ``what`` is its name in messages.

        Where its numbers are such that it never exerts anything, ``acts`` is False, and there is no row unless these
        numbers are to vary.  Where it has a ``side``, ``address`` is of the function on the positive side, and
        ``derivative`` of that on the negative one.
        """


@runtime_checkable
class Force(Protocol):
    """A force element."""

    @property
    def connections(self) -> tuple[Connection, ...]:
        """The joints that it acts on."""

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The frames that it acts on."""

    def check(self) -> None:
        """Raise SceneError if the joints or frames cannot take this force."""

    def assemble(self, table: ElementTable) -> None:
        """Add its rows to the table."""


class OnJoint:
    """Base of forces on a joint, for frozen dataclasses.

    Attributes:
        connection: the joint.
    """

    connection: Connection

    @property
    def connections(self) -> tuple[Connection, ...]:
        """The joint."""
        return (self.connection,)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """None: it acts on a coordinate."""
        return ()

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"{type(self).__name__} on joint {self.connection.name!r}"


class OnCoordinate(OnJoint):
    """Base of forces on one coordinate of a joint, for frozen dataclasses.

    Attributes:
        coordinate: which of its coordinates, from 0.
    """

    coordinate: int

    @property
    def what(self) -> str:
        """Its name in messages."""
        which = f"coordinate {self.coordinate} of " if isinstance(self.coordinate, int) and self.coordinate else ""
        return f"{type(self).__name__} on {which}joint {self.connection.name!r}"

    def check(self) -> None:
        """Raise SceneError unless the joint has this coordinate, as a single number."""
        joint = self.connection.joint
        count = len(joint.velocity_names)
        if len(joint.start) != count or count == 0:
            raise SceneError(
                f"{self.what}: a {type(joint).__name__} has no coordinate that is one number; act on frames instead"
            )
        if not is_number(self.coordinate) or self.coordinate not in range(count):
            there = f"a {type(joint).__name__} has coordinates 0 to {count - 1}"
            raise SceneError(f"{self.what}: {there}, not {self.coordinate!r:.100}")


class DrivesJoint(OnJoint):
    """Base of given forces on a joint's only coordinate, for frozen dataclasses.

    Attributes:
        value: N or N m, a function of time.
        turns: whether the coordinate must be an angle, or else a displacement.
    """

    value: TimeFunction
    turns: ClassVar[bool]

    def check(self) -> None:
        """Raise SceneError if the joint's only coordinate is of the other kind."""
        if self.connection.joint.angular != (self.turns,):
            what, motion = ("torque", "rotation") if self.turns else ("force", "translation")
            raise SceneError(
                f"a joint {what} acts on a joint whose only coordinate is a {motion}; "
                f"{self.connection.name!r} is a {type(self.connection.joint).__name__}"
            )

    def assemble(self, table: ElementTable) -> None:
        """Let the function of time act on the joint's coordinate."""
        table.drive(self.connection, self.value, self.what)


class OffJoints:
    """Base of forces that act on no joint's coordinate, for frozen dataclasses."""

    @property
    def connections(self) -> tuple[Connection, ...]:
        """None."""
        return ()


class OnState(OffJoints):
    """Base of forces on the state, or on a body's modes, for frozen dataclasses."""

    @property
    def frames(self) -> tuple[Frame, ...]:
        """None in particular."""
        return ()


class BetweenFrames(OffJoints):
    """Base of elements between two frames, for frozen dataclasses.

    Attributes:
        frame_F, frame_G: its ends.
    """

    frame_F: Frame
    frame_G: Frame

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Its ends."""
        return self.frame_F, self.frame_G

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"{type(self).__name__} {self.frame_F.label} to {self.frame_G.label}"


class WithStates:
    """Base, beside another, of forces that have states of their own, solved with the machine: a mark for the table.

    ``run.states(force)`` tells them.
    """


def check_numbers(
    what: str, *, positive: dict[str, float] | None = None, least: dict[str, float] | None = None
) -> None:
    """Check named numbers; those of ``least`` may be 0.

    Raises:
        SceneError: one is not finite or negative, or one of ``positive`` is 0.
    """
    above = positive or {}
    for name, value in {**above, **(least or {})}.items():
        if not is_number(value):
            raise SceneError(f"{what}: {name} = {value} is not a finite number")
        if value < 0.0 or (name in above and value == 0.0):
            raise SceneError(f"{what}: {name} = {value} must {'be positive' if name in above else 'not be negative'}")


def vector(value: ArrayLike, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
    """Finite numbers of a shape.

    Raises:
        SceneError: they are not; ``what`` names them.
    """
    array = numbers(value)
    if array.shape != shape or not np.isfinite(array).all():
        raise SceneError(f"{what} must be finite numbers of shape {shape}, got {value!r}")
    return array
