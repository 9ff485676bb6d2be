"""An integration that goes on when it is asked to, to a time of the caller's: steps, inputs, outputs, watches.

For the stepped machine alone, which stands before it for users and for several processes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, shown
from flexmbd.integrate import state as st
from flexmbd.integrate.automatic import check_method
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.kernels.base.compiling import announce_compilation, mark_compiled
from flexmbd.multibody.linear.working_point import WorkingPoint
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.results.range_watch import RangeWatch
from flexmbd.multibody.results.stretch_watch import StretchWatch
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.team import Team, on_every_rank
from flexmbd.run.controller import Controller
from flexmbd.run.event_search import EventSearch
from flexmbd.run.failures import refuse_stopped
from flexmbd.run.fixed_step_watch import FixedStepWatch
from flexmbd.run.settings import RunSettings
from flexmbd.run.snapshot import Snapshot, new_snapshot
from flexmbd.run.stats import spent
from flexmbd.run.stepped_inputs import (
    InputMemory,
    InputValues,
    SteppedInputs,
    named_inputs,
    refuse_no_inputs,
    with_inputs,
)
from flexmbd.run.stepped_outputs import OutputValues, SteppedOutput, SteppedOutputs, refuse_no_outputs
from flexmbd.run.stepping import Integration
from flexmbd.run.stopped import SimulationError
from flexmbd.run.torn_loops import largest_gaps, refuse_torn_loops
from flexmbd.run.trajectory import Trajectory

FloatArray = NDArray[np.float64]

_MOST_UNSEEN = 256  # rows that are looked at together, for a look costs as much as many steps


@dataclass(frozen=True, eq=False)
class SteppedScene:
    """The parts of a machine that its steppers share.

    Attributes:
        start: the consistent start.
        method: the integrator.
        settings: of the steps; the end is about how far they will go.
        open_end: whether it is not known how far, so that steps are those of a simulation up to where they go.
        inputs: signals by name.
        linear: whether these go on straight within a step.
        outputs: what is told after each step.
        bodies: by name.
        controllers: sampled ones.
        team: the processes that step.
    """

    start: Start
    method: Integrator
    settings: RunSettings
    open_end: bool
    inputs: Mapping[str, Signal]
    linear: bool
    outputs: Sequence[SteppedOutput] | Mapping[str, SteppedOutput]
    bodies: Mapping[str, Body]
    controllers: tuple[Controller, ...]
    team: Team

    def first(self) -> Snapshot:
        """Where steps begin."""
        one = self.settings
        return new_snapshot(
            self.start, self.method, t_start=one.t_start, t_end=one.t_end, rtol=one.rtol, h=one.h
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class SteppedMemory:
    """All that is remembered from step to step."""

    snapshot: Snapshot
    inputs: InputMemory


_SOME_STEPS = 1e4  # of a machine with a fixed step, whose end the caller alone knows


def settings_of(
    *,
    h: float | None,
    rtol: float,
    horizon: float | None,
    t_start: float,
    about: WorkingPoint | None,
    integrator: Integrator | Literal["auto"],
    max_step: float | None,
) -> RunSettings:
    """The settings of a run as long as steps are about to go.

    Raises:
        SceneError: one is none; the message names it.
    """
    if horizon is not None and not (is_number(horizon) and horizon > 0.0):
        raise SceneError(f"horizon = {shown(horizon)} s must be positive and finite")
    fixed = _SOME_STEPS * h if h is not None and is_number(h) and h > 0.0 else 1.0
    span = fixed if horizon is None else horizon
    t_end = t_start + span if is_number(t_start) else span
    return RunSettings(t_end, rtol=rtol, h=h, t_start=t_start, about=about, integrator=integrator, max_step=max_step)


def stepped_scene(
    start: Start,
    settings: RunSettings,
    bodies: Mapping[str, Body],
    controllers: tuple[Controller, ...],
    team: Team,
    *,
    inputs: Sequence[Signal] | Mapping[str, Signal],
    outputs: Sequence[SteppedOutput] | Mapping[str, SteppedOutput],
    interpolation: str,
    open_end: bool,
) -> SteppedScene:
    """The shared parts of a machine's steppers, from a user's arguments.

    Raises:
        SceneError: an input, an output or the interpolation is none; or the scene holds bodies with history.
    """
    if not (isinstance(interpolation, str) and interpolation in ("held", "linear")):
        raise SceneError(f'interpolation must be "held" or "linear", got {shown(interpolation)}')
    if start.scene.interiors is not None:
        names = ", ".join(repr(body.name) for body in start.scene.interiors.bodies)
        raise SceneError(
            f"bodies with history cannot be stepped from outside ({names}), for each keeps its history itself, once: "
            "simulate() them, with controllers and checkpoints, or reduce those that stay elastic"
        )
    named = named_inputs(inputs)
    refuse_no_inputs(start.scene, named, controllers)
    refuse_no_outputs(outputs)
    method = settings.method(start)
    check_method(method, start.scene)
    without = replace(settings, about=None, integrator=method)
    return SteppedScene(
        start, method, without, open_end, named, interpolation == "linear", outputs, bodies, controllers, team
    )


def _time(given: object, what: str) -> float:
    """A time (s) as users give it.

    Raises:
        SceneError: it is no finite number.
    """
    if not is_number(given):
        raise SceneError(f"{what} must be one finite number (s), got {shown(given)}")
    return float(given)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class _LatestRows:
    """Rows t, x, v of a run, of which those before ``first`` are gone; as ``StoredRows``."""

    count: int
    first: int
    rows: tuple[FloatArray, ...]

    def since(self, row: int) -> tuple[FloatArray, ...]:
        """The rows from ``row`` on."""
        return tuple(part[max(row - self.first, 0) :] for part in self.rows)


class SteppedIntegration:
    """One machine under way.

    Attributes:
        t: time (s) reached.
    """

    def __init__(self, scene: SteppedScene, at: SteppedMemory | None = None) -> None:
        """Begin at the start, or go on from an earlier memory."""
        self._scene = scene
        scene.start.scene.callbacks.reset()
        purpose = type(scene.method).__name__
        if scene.team.is_root:
            announce_compilation(purpose)
        start = with_inputs(scene.start, scene.inputs, linear=scene.linear)
        snapshot = scene.first() if at is None else at.snapshot
        switched = len(start.scene.switches) > 0
        self._inputs = SteppedInputs(scene.inputs, linear=scene.linear)
        self._integration = Integration(
            start, scene.method, scene.team, snapshot, one_by_one=switched, controllers=scene.controllers,
            begun=scene.settings.t_start, outside=self._inputs.readers,
        )  # fmt: skip
        self._inputs.bind(self._integration.scene)
        mark_compiled(purpose)
        self._integration.room = 1
        self._state, self._flag = self._integration.state, start.scene.plan.flag
        self.t = self._integration.t
        self._bound(scene.settings.t_end)
        self._outputs = SteppedOutputs(scene.outputs, self._integration.scene, self.now())
        on_root = scene.team.is_root
        self._stretches = StretchWatch(start.scene, scene.bodies.values())
        self._ranges = RangeWatch(start.scene, scene.bodies.values() if on_root else ())
        self._fixed = FixedStepWatch(start.scene.velocity_names, self._state, scene.method)
        self._seen, self._unseen = 0, 0
        self._search = self._searching(snapshot) if switched else None
        if at is not None:
            self._inputs.restore(at.inputs)

    def _searching(self, snapshot: Snapshot) -> EventSearch:
        return EventSearch(self._integration, (), self._scene.bodies, self._scene.team, snapshot.events)

    def _bound(self, t_end: float) -> None:
        """Let steps be those of a simulation up to ``t_end`` (s)."""
        settings, integration = self._scene.settings, self._integration
        if self._state.counts[st.STEPS] == 0:
            integration.begin_by_span(settings.t_start, t_end)
        else:
            integration.bound_by_span(settings.t_start, t_end)
        if settings.max_step is not None:
            integration.bound_steps(settings.max_step)

    def step(self, dt: float, given: InputValues | None) -> OutputValues:
        """Go on by dt (s); as ``step_to``."""
        if type(dt) is not float:
            dt = float(dt) if isinstance(dt, float) else _time(dt, "the step dt")
        return self.step_to(self.t + dt, given)

    def step_to(self, t_end: float, given: InputValues | None) -> OutputValues:
        """Go on to exactly ``t_end`` (s), with inputs held or linear up to there; the outputs.

        Raises:
            SceneError: the time does not lie ahead; of the inputs; or a function of the user's failed.
            SimulationError: a step failed; the machine stands where that began.
        """
        if self._scene.team.size > 1:
            t_end, given = self._agreed(t_end, given)
        elif not (type(t_end) is float and self.t < t_end < math.inf):
            t_end = self._ahead(t_end)
        if self._inputs.set(self.t, t_end, given):
            self._state.counts[st.AT_BREAK] = 1
        if self._flag[0] != 0:  # of a run of the same machine that failed
            self._scene.start.scene.callbacks.reset()
        if self._scene.open_end:
            self._bound(t_end)
        try:
            code = self._advance(t_end) if self._search is None else self._follow_switches(self._search, t_end)
        finally:
            self.t = self._integration.t
        if code != st.DONE:
            self._fail(code)
        return self._outputs.take(self._state, self.now)

    def _ahead(self, t: object) -> float:
        """A time (s) that lies ahead, as users give it.

        Raises:
            SceneError: it does not.
        """
        found = _time(t, "the time t")
        if not found > self.t:
            raise SceneError(
                f"the stepper stands at t = {self.t:.9g} s and goes forward alone, not to t = {found:.9g} s: restore a "
                "snapshot() to go back, and give steps larger than the round-off of the time"
            )
        return found

    def _agreed(self, t_end: object, given: InputValues | None) -> tuple[float, FloatArray]:
        """Rank 0's time (s) and inputs, where all ranks step.  Collective."""
        values = on_every_rank(self._scene.team, lambda: (self._ahead(t_end), *self._inputs.taken(given)))
        agreed = self._scene.team.agree(np.array(values))
        return float(agreed[0]), agreed[1:]

    def _advance(self, t_end: float) -> int:
        code = self._integration.step_on(t_end)
        while code == st.OUTPUT:
            self._look()
            code = self._integration.step_on(t_end)
        if not self._stretches.is_idle:
            self._look()
        return code

    def _follow_switches(self, search: EventSearch, t_end: float) -> int:
        code = st.OUTPUT
        while code in (st.OUTPUT, st.DONE) and self._integration.t < t_end:
            code = search.advance(t_end)
            self._look_at(self._integration.stored.since(0))
            self._integration.forget_rows()
        return st.DONE if code == st.OUTPUT else code

    def _look(self) -> None:
        """Look at the rows in the buffer, and empty it."""
        s, r = int(self._state.counts[st.STORED]), self._integration.record
        try:
            if s:
                self._look_at((r.t[:s], r.x[:s], r.v[:s], r.a[:s], self._integration.of_all_rows(r.multipliers[:s])))
        finally:
            self._integration.empty_buffer()
            self._integration.forget_rows()
            self._integration.room = min(2 * self._integration.room, _MOST_UNSEEN, len(r.t))
            self._unseen = 0

    def _look_at(self, rows: tuple[FloatArray, ...]) -> None:
        """Look at rows t, x, v, a, multipliers.

        Raises:
            SimulationError: something was pressed flat, or loops were torn open.

        Warns:
            RangeWarning, StepsWarning: as of any run.
        """
        first, self._seen = self._seen, self._seen + len(rows[0])
        latest = _LatestRows(self._seen, first, rows)
        if not self._stretches.sees_nothing(latest) and self._stretches.fault is not None:
            what, bodies = self._stretches.fault[1], self._scene.bodies.values()
            self._stretches, self._seen = StretchWatch(self._scene.start.scene, bodies), 0
            raise SimulationError(what, self._trajectory(rows))
        self._ranges.look(latest, last=True)
        if self._scene.team.is_root:
            self._fixed.look(self._integration.fixed_errors)
        if self._scene.start.scene.redundant:
            start, run = self._integration.start, self._trajectory(rows)
            open_by = float(largest_gaps(start.unreduced, run.t, run.x).max(initial=0.0))
            refuse_torn_loops(start, replace(run, stats=replace(run.stats, constraint_residual=open_by)))

    def _trajectory(self, rows: tuple[FloatArray, ...]) -> Trajectory:
        """Rows t, x, v, a, multipliers as a trajectory."""
        start, scene = self._integration.start, self._scene
        stats = spent(scene.method.name, self._state.counts, seconds=0.0, compile_seconds=0.0)
        kept = tuple(start.choice.rows) if start.scene.redundant else None
        t, x, v, a, multipliers = (part.copy() for part in rows)
        return Trajectory(
            scene.start.unreduced, t, x, v, a, multipliers, stats, scene.bodies, scene.team, kept_rows=kept
        )

    def _fail(self, code: int) -> None:
        """Raise what a step failed by, with the state that it failed in."""
        s = self._state
        rows = (np.array([self.t]), s.x[None], s.v[None], s.a[None], self._integration.of_all_rows(s.multipliers[None]))
        scene = self._scene.start.scene
        refuse_stopped(scene, self._integration, code, self._trajectory(rows))

    def state(self) -> tuple[FloatArray, ...]:
        """Copies of x, v, a and the multipliers."""
        s = self._state
        return s.x.copy(), s.v.copy(), s.a.copy(), s.multipliers.copy()

    @property
    def rows(self) -> NDArray[np.int64]:
        """Which of all constraint rows are kept."""
        return self._integration.kept_rows

    def now(self) -> Instant:
        """The machine where it stands."""
        return Instant(self._integration.scene, self._integration.t, *self.state())

    def outputs(self) -> OutputValues:
        """The outputs where it stands."""
        return self._outputs.take(self._state, self.now)

    @property
    def values(self) -> tuple[float, ...]:
        """Of the inputs, at the end of the last step."""
        return self._inputs.values

    def memory(self) -> SteppedMemory:
        """A copy of the memory; factors are dropped, so that further steps are those that start from the copy."""
        snapshot = self._integration.checkpoint()
        if self._search is not None:
            snapshot = replace(snapshot, events=self._search.memory())
        return SteppedMemory(snapshot, self._inputs.memory())

    def restore(self, memory: SteppedMemory) -> None:
        """Go on from an earlier memory."""
        self._unseen += int(self._state.counts[st.STORED])
        if self._unseen >= self._integration.room:  # of short stretches one is looked at now and then
            self._look()
        self._ranges.begin_anew()
        self._integration.restore(memory.snapshot)
        self._integration.empty_buffer()
        self._inputs.restore(memory.inputs)
        if self._search is not None:
            self._search = self._searching(memory.snapshot)
        self.t = self._integration.t
