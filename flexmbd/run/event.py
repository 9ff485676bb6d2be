"""Events: moments at which a function of the machine's state passes through zero."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError, described
from flexmbd.given import numbers, refuse_no_function, refuse_no_name, refuse_no_truth, refuse_other
from flexmbd.multibody.functions.switched import Switch
from flexmbd.multibody.joint.connection import Connection
from flexmbd.multibody.kernels.base.fingerprint import fingerprint
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.team import Team

FloatArray = NDArray[np.float64]


class Direction(enum.Enum):
    """Which passages through zero count."""

    EITHER = 0
    RISING = 1
    FALLING = -1


class Moment(Instant):
    """The machine at one instant of a simulation; an event's action may change joint velocities, with ``set_rate``."""

    scene: CompiledScene

    def __init__(
        self,
        scene: CompiledScene,
        t: float,
        x: FloatArray,
        v: FloatArray,
        a: FloatArray,
        multipliers: FloatArray | None = None,
    ) -> None:
        super().__init__(scene, t, x, v, a, multipliers)
        self.changed: NDArray[np.bool_] = np.zeros(scene.nv, bool)
        self.new_rates = self.v.copy()

    def set_rate(self, connection: Connection, rate: ArrayLike) -> None:
        """Give a joint of the tree other velocities (rad/s or m/s) from this moment on.

        Velocities of loops are made consistent with them, others as near as can be to what they were.

        Raises:
            SceneError: the joint has no coordinate, or takes another number of velocities.
        """
        slots = self.scene.index.coordinates(connection)
        values = np.atleast_1d(numbers(rate))
        if values.shape != (slots.v.stop - slots.v.start,) or not np.isfinite(values).all():
            raise SceneError(
                f"joint {connection.name!r} takes {slots.v.stop - slots.v.start} finite velocities, "
                f"got {rate!r}"
            )
        self.new_rates[slots.v] = values
        self.changed[slots.v] = True


@dataclass(frozen=True, eq=False)
class Event:
    """Something to look for while a machine moves.

    Attributes:
        function: of a ``Moment``, one number; the event is where it passes through zero.  It must be continuous.
            What passes and comes back within a step is found by looking at the motion between its ends, once at least,
            thrice in the time between its last two passages, and the closer the more it bends between looks; of
            passages that are much nearer than a 32nd of a step some may be missed.  An ``EventWarning`` tells where
            that may be; ``max_step`` bounds the steps.
        direction: which passages count.  A function that is zero at the start of the simulation, and then goes to the
            side of a given direction, passes there; with ``EITHER`` it does not.
        stop: end the simulation there.
        action: called at the event; may set joint velocities, as an impact does.
        name: for messages and ``run.events``.

    Raises:
        SceneError: ``function`` or ``action`` is no function, ``direction`` no ``Direction``, ``stop`` neither True
            nor False, or ``name`` no text.
    """

    function: Callable[[Moment], float | FloatArray]
    direction: Direction = Direction.EITHER
    stop: bool = False
    action: Callable[[Moment], None] | None = None
    name: str = "event"

    def __post_init__(self) -> None:
        refuse_no_name(self.name, "an event's name")
        refuse_no_function(self.function, f"event {self.name!r}: function", wanted="f(moment) -> number")
        if self.action is not None:
            refuse_no_function(self.action, f"event {self.name!r}: action", wanted="f(moment)")
        wanted = " or ".join(str(one) for one in Direction)
        refuse_other(self.direction, Direction, f"event {self.name!r}: direction", wanted=wanted)
        refuse_no_truth(stop=self.stop)

    def value(self, moment: Moment, team: Team) -> float:
        """The function's value, rank 0's on every rank.  Collective over the team.

        Raises:
            SceneError: the function failed on some rank, or gave no finite number.
        """
        error: Exception | None = None
        value: FloatArray = np.zeros(1)
        try:
            answer = np.asarray(self.function(moment), dtype=np.float64)
            if answer.shape != () or not np.isfinite(answer):
                raise SceneError(f"it gave {answer!r}, not one finite number")
            value = np.array([float(answer)])
        except Exception as reason:  # noqa: BLE001  (a user's function: any error, told below)
            error = SceneError(f"event {self.name!r} at t = {moment.t:g} s: {described(reason)}")
            error.__cause__ = reason
        team.fail(error)
        return float(team.agree(value)[0])

    def act(self, moment: Moment, team: Team) -> None:
        """Run the action; rank 0's velocities on every rank.  Collective over the team.

        Raises:
            SceneError: the action failed on some rank.
        """
        if self.action is None:
            return
        error: Exception | None = None
        try:
            self.action(moment)
        except Exception as reason:  # noqa: BLE001  (a user's function: any error, told below)
            error = SceneError(f"action of event {self.name!r} at t = {moment.t:g} s: {described(reason)}")
            error.__cause__ = reason
        team.fail(error)
        agreed: FloatArray = team.agree(np.concatenate([moment.new_rates, moment.changed]))
        moment.new_rates = agreed[: len(moment.new_rates)]
        moment.changed = np.array(agreed[len(moment.new_rates) :] > 0.5)

    @property
    def remedy(self) -> str:
        """What to do where the machine passes the zero again at once, after the action."""
        return (
            "end the run there (stop=True where the impact is slow enough), or let a JointStop or a contact force "
            "carry it"
        )

    @property
    def may_go_on(self) -> bool:
        """Whether the function may go on through zero at a rate of its own, after the action."""
        return True

    def passes(self, before: float, after: float, *, begins: bool = False) -> bool:
        """Whether a function that went from one sign (-1, 0, 1) to another has passed.

        One that ``begins`` the simulation on zero passes where it goes the way that the event looks for.
        """
        if before == 0.0:
            return begins and self.direction is not Direction.EITHER and after == self.direction.value
        if after in (before, 0.0):
            return False
        return self.direction is Direction.EITHER or after == self.direction.value


@dataclass(frozen=True, eq=False)
class EventMemory:
    """The state of the search for events from step to step.

    Attributes:
        codes: (n,) digests of the events, by which a restart knows them again.
        followed: (5, n) of each event's function: its side of zero (-1, 0, 1), from which side (-1, 1) an action has
            thrown it back, when (s) it passed last, how long (s) that was after the time before, its last value.
        new_pace: whether a function may pass at another pace than before.
    """

    codes: tuple[str, ...]
    followed: FloatArray
    new_pace: bool

    @property
    def is_damaged(self) -> bool:
        """Whether no search could have left this."""
        if self.followed.shape != (5, len(self.codes)):
            return True
        sides, last, spacing = self.followed[:2], self.followed[2], self.followed[3]
        return not (np.isin(sides, (-1.0, 0.0, 1.0)).all() and (last < np.inf).all() and (spacing > 0.0).all())


NO_EVENTS = EventMemory((), np.zeros((5, 0)), True)


def codes_of(events: Sequence[Event], switches: Sequence[Switch] = ()) -> tuple[str, ...]:
    """Digests of events by name, direction and function, then of switches, no two alike."""
    codes = [f"{event.name} {event.direction.name} {fingerprint(event.function)}" for event in events]
    codes += [switch.code for switch in switches]
    return tuple(f"{code} {codes[:k].count(code)}" for k, code in enumerate(codes))


@dataclass(frozen=True, eq=False)
class Occurrence:
    """An event that took place.

    Attributes:
        event: which.
        t: when (s).
        row: row of the trajectory at the event, before its action.
    """

    event: Event
    t: float
    row: int

    __repr__ = brief

    @property
    def name(self) -> str:
        """The event's name."""
        return self.event.name
