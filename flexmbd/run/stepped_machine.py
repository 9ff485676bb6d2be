"""A machine that is stepped from outside, by a controller, an optimiser or another program.

Made by the system and by compiled machines.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.given import refuse_other
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.team import Team
from flexmbd.run.sampling import code_of
from flexmbd.run.stepped_inputs import InputValues
from flexmbd.run.stepped_integration import SteppedIntegration, SteppedMemory, SteppedScene
from flexmbd.run.stepped_outputs import OutputValues
from flexmbd.run.stopped import SimulationError, SimulationInterrupted
from flexmbd.run.trajectory import Trajectory

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class SteppedState:
    """All that a stepper remembers at one instant; made by ``SteppedMachine.snapshot``.  It can be pickled.

    Attributes:
        t: time (s).
        machine: a key of the machine, its method and its steps.
        memory: copies of the state and of the memories of method, controllers and inputs.
    """

    t: float
    machine: str
    memory: SteppedMemory

    __repr__ = brief


class SteppedMachine:
    """A machine that goes on when it is told to, up to a time of the caller's; made by ``System.stepper``.

    It can be pickled, and goes on to the bit in the process that loads it.  On several processes all calls are
    collective, and rank 0's arguments count.
    """

    def __init__(self, scene: SteppedScene, team: Team, at: SteppedState | None = None) -> None:
        """Begin at the start, or where another stepper of the same machine stood.

        Args:
            scene: the machine.
            team: the processes that call; where they are more than step, rank 0 steps for all.
            at: where to go on.
        """
        self._scene, self._team = scene, team
        self._is_told = team.size > scene.team.size
        self._stepping: SteppedIntegration | None = None
        memory = None if at is None else at.memory
        if not self._is_told:
            self._stepping = SteppedIntegration(scene, memory)
        else:
            team.on_root(lambda: self._set_up(memory))
        self._t = scene.settings.t_start if at is None else at.t
        self._machine = "" if at is None else at.machine
        self._first = self.snapshot() if at is None else at

    def _set_up(self, memory: SteppedMemory | None) -> None:
        with self._scene.start.scene.callbacks.alone():
            self._stepping = SteppedIntegration(self._scene, memory)

    def __repr__(self) -> str:
        """Where it stands, by which method, and its inputs."""
        names = ", ".join(self._scene.inputs) or "none"
        return f"<SteppedMachine at t = {self.t:.6g} s by {self._scene.method.name}; inputs: {names}>"

    @property
    def t(self) -> float:
        """Time (s) reached."""
        return self._t if self._stepping is None else self._stepping.t

    @property
    def inputs(self) -> dict[str, float]:
        """The inputs by their names, at the end of the last step.  Collective."""
        return dict(zip(self._scene.inputs, self._ask(lambda one: one.values), strict=True))

    @property
    def now(self) -> Instant:
        """The machine where it stands, a copy: positions, velocities, reactions.  Collective."""
        x, v, a, multipliers = self._ask(lambda one: one.state())
        rows = self._ask(lambda one: one.rows)
        return Instant(self._scene.start.unreduced.keep_rows(rows), self.t, x, v, a, multipliers)

    def outputs(self) -> OutputValues:
        """The outputs where it stands, as ``step`` returns them.  Collective."""
        return self._ask(lambda one: one.outputs())

    def step(self, dt: float, inputs: InputValues | None = None) -> OutputValues:
        """Go on to exactly t + dt, in as many steps of the method as that takes, and tell the outputs.  Collective.

        Args:
            dt: s.
            inputs: their values in order, a number of a single one, or some by name: held over the step; of linear
                inputs those at its end, to which they go straight from where they were.  None: they stay.

        Returns:
            (ny,) all outputs in their order; where they were given by names a dict.

        Raises:
            SceneError: dt leads back in time, or an input is unknown or no finite number; nothing has moved.  Or a
                function of the user's failed.
            SimulationError: a step failed; the machine stands where that began, and ``restore`` takes it back.
        """
        if self._is_told:
            return self._ask(lambda one: one.step(dt, inputs))
        stepping: Any = self._stepping
        return stepping.step(dt, inputs)

    def step_to(self, t: float, inputs: InputValues | None = None) -> OutputValues:
        """As ``step``, to exactly the time t (s).  Collective."""
        return self._ask(lambda one: one.step_to(t, inputs))

    def snapshot(self) -> SteppedState:
        """Keep all that is remembered here, for ``restore``.  Collective.

        An implicit method factors anew in the next step, here as after a restore, so that both are the same to the bit.
        """
        memory = self._ask(lambda one: one.memory())
        return SteppedState(self.t, self._key(), memory)

    def restore(self, state: SteppedState | None = None) -> None:
        """Go back, or forth, to a state that this stepper, a copy or another one of the same machine has kept.

        Collective.

        Args:
            state: of ``snapshot``; None: where this stepper began.

        Raises:
            SceneError: it is of another machine, method or step.
        """
        kept = self._first if state is None else state
        self._ask(lambda one: one.restore(self._own(kept)))
        self._t = kept.t

    def _own(self, state: SteppedState) -> SteppedMemory:
        """What a state of this machine remembers."""
        refuse_other(state, SteppedState, "what is restored", wanted="what stepper.snapshot() gave")
        if state.machine != self._key():
            raise SceneError(
                "the snapshot is of another machine: bodies, joints, forces, inputs, the method or its steps differ"
            )
        return state.memory

    def _key(self) -> str:
        """Tells machine, method and steps from others."""
        if not self._machine:
            one, scene = self._scene.settings, self._scene
            told = one.t_start, one.t_end, one.rtol, one.h, one.max_step, scene.open_end, scene.linear, [*scene.inputs]
            self._machine = f"{scene.start.scene.digest()} {scene.method.name} {told} {code_of(scene.controllers)}"
        return self._machine

    def copy(self) -> SteppedMachine:
        """Another stepper in the same state, independent of this one.  Collective."""
        other = SteppedMachine(self._scene, self._team, self.snapshot())
        other._first = self._first
        return other

    def __copy__(self) -> SteppedMachine:
        """As ``copy``."""
        return self.copy()

    def __reduce__(self) -> tuple[Callable[..., SteppedMachine], tuple[Any, ...]]:
        """The machine, where it stands and where it began.

        Raises:
            SceneError: it is shared by several processes.
        """
        if self._team.size > 1:
            raise SceneError("a stepper that several processes share cannot be pickled; pickle its snapshot()")
        return _revived, (self._scene, self.snapshot(), self._first)

    def _ask(self, question: Callable[[SteppedIntegration], T]) -> T:
        """What the one that steps answers, on every rank."""
        stepping: Any = self._stepping
        if not self._is_told:
            found: T = question(stepping)
            return found
        answer, self._t, failure = self._team.on_root(lambda: self._told(question))
        if failure is None:
            told: T = answer
            return told
        kind, message, stats, (t, x, v, a, multipliers) = failure
        scene = self._scene
        run = Trajectory(scene.start.unreduced, t, x, v, a, multipliers, stats, scene.bodies, self._team)
        raise kind(message, run)

    def _told(self, question: Callable[[SteppedIntegration], T]) -> tuple[Any, float, tuple[Any, ...] | None]:
        """On rank 0: the answer, the time (s) reached, and what a failed step is told by."""
        stepping: Any = self._stepping
        with self._scene.start.scene.callbacks.alone():
            try:
                return question(stepping), stepping.t, None
            except (SimulationError, SimulationInterrupted) as error:
                run = error.trajectory
                rows = run.t, run.x, run.v, run.a, run.row_multipliers
                return None, stepping.t, (type(error), str(error), run.stats, rows)


def _revived(scene: SteppedScene, state: SteppedState, first: SteppedState) -> SteppedMachine:
    """A stepper of another process."""
    start = scene.start
    own = replace(start, scene=start.unreduced.keep_rows(start.choice.rows))  # one set of users' functions
    stepper = SteppedMachine(replace(scene, start=own), scene.team, state)
    stepper._first = first
    return stepper
