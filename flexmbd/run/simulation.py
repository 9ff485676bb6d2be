"""Runs a machine from start to end: checkpoints, events, progress, failures."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, RecordError, SceneError
from flexmbd.integrate import state as st
from flexmbd.integrate.automatic import check_method, locates_impacts
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.base.compiling import announce_compilation, mark_compiled
from flexmbd.multibody.plan.compiled_scene import CompiledScene
from flexmbd.multibody.results.range_watch import RangeWatch
from flexmbd.multibody.results.stretch_watch import StretchWatch
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.team import Team
from flexmbd.run.checkpoint import Checkpoint
from flexmbd.run.controller import Controller
from flexmbd.run.creep_watch import CreepWatch
from flexmbd.run.event import NO_EVENTS, Occurrence
from flexmbd.run.event_search import EventSearch
from flexmbd.run.failures import interrupted, refuse_broken_off, refuse_stopped
from flexmbd.run.fixed_step_watch import FixedStepWatch
from flexmbd.run.impacts import impact_events
from flexmbd.run.interrupts import interrupt_ends, interrupts_wait
from flexmbd.run.limits import Limits
from flexmbd.run.prepared import PreparedRuns, SteppedRows
from flexmbd.run.pulse_watch import tell_missed_pulses
from flexmbd.run.recording_file import Recorder, open_recorder
from flexmbd.run.row_store import is_affordable
from flexmbd.run.run_stream import RunStream, open_stream
from flexmbd.run.sampling import with_samples
from flexmbd.run.settings import RunSettings, limits_of, saves_of
from flexmbd.run.snapshot import Snapshot
from flexmbd.run.stats import Stats, spent
from flexmbd.run.stepping import Integration
from flexmbd.run.stopped import SimulationError, rows_before
from flexmbd.run.torn_loops import largest_gaps, refuse_torn_loops
from flexmbd.run.trajectory import Trajectory
from flexmbd.run.update_watch import UpdateWatch

FloatArray = NDArray[np.float64]


def run(
    start: Start,
    bodies: Mapping[str, Body],
    *,
    settings: RunSettings,
    method: Integrator,
    snapshot: Snapshot,
    team: Team,
    controllers: Sequence[Controller] = (),
    explicit_steps: float = math.inf,
) -> Trajectory:
    """Integrate from a snapshot by settings, of which those of the start have been heeded; see ``System.simulate``.

    ``explicit_steps``: (1/s), as of ``IntegratorChoice``.
    """
    check_method(method, start.scene, locates=snapshot.state.counts[st.FIXED_STEP] == 0)
    start.scene.callbacks.reset()
    purpose = type(method).__name__
    if team.is_root:
        announce_compilation(purpose)
    set_out = time.perf_counter()
    begin, events = snapshot.state, [*settings.events]
    if locates_impacts(method, start.scene):
        events += impact_events(start.scene, float(begin.numbers[st.TIME]), begin.x, begin.v)
    searches = len(events) > 0 or len(start.scene.switches) > 0
    integration = Integration(
        start, method, team, snapshot,
        one_by_one=searches, controllers=controllers, begun=settings.begun,
    )  # fmt: skip
    integration.bound_by_span(settings.begun, settings.t_end)
    if settings.max_step is not None:
        integration.bound_steps(settings.max_step)
    with open_stream(start, settings, integration, team) as stream:
        search = EventSearch(integration, events, bodies, team, snapshot.events) if searches else None
        creep = CreepWatch(integration, settings.t_end, explicit_steps=explicit_steps)
        trajectory = _run(
            start, integration, bodies, settings, team, search=search, stream=stream, creep=creep, set_out=set_out
        )
        if stream is not None:
            stream.end(trajectory)
    return trajectory


def _run(
    start: Start,
    integration: Integration,
    bodies: Mapping[str, Body],
    settings: RunSettings,
    team: Team,
    *,
    search: EventSearch | None,
    stream: RunStream | None,
    creep: CreepWatch,
    set_out: float,
) -> Trajectory:
    """Step to the end; ``set_out``: s, when the run began."""
    method, purpose = integration.method, type(integration.method).__name__
    begun, t_end, saves = settings.begun, settings.t_end, saves_of(settings)
    budget = _Budget(limits_of(settings), integration, team, set_out)
    saved = saves.times(begun, integration.t, t_end) if saves is not None else []
    stops = sorted({*settings.checkpoints, *saved, t_end})
    kept: list[Checkpoint] = []
    began = compiled = time.perf_counter()
    code = st.DONE
    error: FlexmbdError | KeyboardInterrupt | None = None
    watch, ranges, updates, fixed = (
        StretchWatch(start.scene, bodies.values()),
        RangeWatch(start.scene, bodies.values() if team.is_root else ()),
        UpdateWatch(integration, start.scene.interiors),
        FixedStepWatch(start.scene.velocity_names, integration.state, method),
    )
    with (
        open_recorder(settings, integration, team) as recorder,
        interrupt_ends() as early,
        _progress_bar(settings.progress and team.is_root, t_end - integration.t) as bar,
    ):
        while stops and code in (st.OUTPUT, st.DONE) and watch.sees_nothing(integration.stored) and budget.lasts():
            before = integration.t
            try:
                _make_room(integration, search, stream, team)
                code = _advance(integration, search, stops[0], recorder, ranges)
                if stream is not None:
                    stream.take(_occurred(search))
            except (FlexmbdError, KeyboardInterrupt) as reason:  # of an event's function or action, or Ctrl-C
                error = reason
                break
            if search is not None and search.stopped:
                stops = []
            compiled = time.perf_counter() if compiled == began else compiled
            if team.is_root:
                creep.look()
                fixed.look(integration.fixed_errors)
            bar.update(integration.t - before)
            stop = stops.pop(0) if code == st.DONE and stops else np.inf
            if integration.t >= stop and (stops or stop in settings.checkpoints):
                checkpoint = _checkpoint(start, integration, begun, search)
                if stop in settings.checkpoints:
                    kept.append(checkpoint)
                if stream is not None:  # which then holds all up to where a restart begins
                    stream.write(_occurred(search), lasting=True)
                if saves is not None and stop in saved:
                    saves.write(checkpoint, team)
    times = time.perf_counter() - began, compiled - set_out
    updates.tell(team)
    with interrupts_wait() as late:  # what was computed is kept
        mark_compiled(purpose)
        trajectory = replace(
            _finish(start, bodies, team, integration, times=times),
            events=tuple(_occurred(search)),
            checkpoints=tuple(kept),
            recordings=() if recorder is None else recorder.recordings,
        )
    if error is None and team.size == 1:
        tell_missed_pulses(start.scene, trajectory.t, rtol=settings.rtol)
    error = error or (KeyboardInterrupt() if early.seen or late.seen else None)
    ranges.look(integration.stored, last=True)
    refuse_torn_loops(start, trajectory)
    _refuse_early_end(start, integration, trajectory, code=code, error=error, watch=watch, budget=budget)
    return trajectory


def _checkpoint(start: Start, integration: Integration, begun: float, search: EventSearch | None) -> Checkpoint:
    """Of a simulation that began at ``begun`` (s), where it is; of the scene before controllers set its signals."""
    snapshot = replace(integration.checkpoint(), events=NO_EVENTS if search is None else search.memory())
    return Checkpoint(integration.method.name, start.scene.digest(), begun, snapshot)


def _refuse_early_end(
    start: Start,
    integration: Integration,
    trajectory: Trajectory,
    *,
    code: int,
    error: FlexmbdError | KeyboardInterrupt | None,
    watch: StretchWatch,
    budget: _Budget,
) -> None:
    """Raise what a run did not reach its end for."""
    _refuse_flat(watch, integration, trajectory)
    refuse_broken_off(error, trajectory)
    budget.refuse_spent(trajectory)
    refuse_stopped(start.scene, integration, code, trajectory)


class _Budget:
    """The remaining budget of a run; the rows to compute before it is checked again."""

    def __init__(self, limits: Limits, integration: Integration, team: Team, set_out: float) -> None:
        self._limits, self._integration, self._team = limits, integration, team
        self._steps = int(integration.state.counts[st.STEPS])
        self._set_out, self._spent, self._over, self._room = set_out, 0.0, "", 1

    def lasts(self) -> bool:
        """Whether the run may go on; rank 0's clock on every rank.  Collective over the team."""
        spent = time.perf_counter() - self._set_out
        if self._limits.max_seconds is not None:
            spent = float(self._team.agree(np.array([spent]))[0])
        took, self._spent = spent - self._spent, spent
        integration = self._integration
        cost = {"steps": int(integration.state.counts[st.STEPS]) - self._steps, "rows": integration.rows}
        self._over = self._limits.reached(**cost, seconds=spent)
        self._room = integration.room = self._limits.room(self._room, took, **cost)
        return not self._over

    def refuse_spent(self, trajectory: Trajectory) -> None:
        """Raise SimulationError where the run may not go on."""
        if self._over:
            raise SimulationError(
                f"the simulation was broken off at t = {trajectory.t[-1]:.6g} s: {self._over}; what was computed up to "
                "then is in the error's trajectory",
                trajectory,
            )


def _occurred(search: EventSearch | None) -> Sequence[Occurrence]:
    return () if search is None else search.occurred


def _make_room(integration: Integration, search: EventSearch | None, stream: RunStream | None, team: Team) -> None:
    """Let rows that have no room in memory go to the disk.  Collective.

    Raises:
        RecordError: on all ranks: there is none on a disk either.
    """
    if is_affordable(integration.stored.bytes, team):
        return
    if stream is not None:
        stream.write(_occurred(search))
    error: FlexmbdError | None = None
    try:
        integration.stored.spill()
    except RecordError as reason:
        error = reason
    team.fail(error)


def _advance(
    integration: Integration,
    search: EventSearch | None,
    stop: float,
    recorder: Recorder | None,
    ranges: RangeWatch,
) -> int:
    """Step towards ``stop`` (s) and keep the rows; the stepper's code."""
    try:
        if search is not None:
            return search.advance(stop)
        try:
            return integration.advance(stop)
        finally:  # what comes before a break that cannot be left is kept
            integration.keep_rows()
    finally:
        ranges.look(integration.stored)
        if recorder is not None:
            recorder.write()


def _refuse_flat(watch: StretchWatch, integration: Integration, trajectory: Trajectory) -> None:
    """Raise where a pseudo-rigid body was pressed flat, with the rows before."""
    if not watch.sees_nothing(integration.stored) and watch.fault is not None:
        row, what = watch.fault
        raise SimulationError(what, rows_before(trajectory, row))


def _finish(
    start: Start,
    bodies: Mapping[str, Body],
    team: Team,
    integration: Integration,
    *,
    times: tuple[float, float],
) -> Trajectory:
    """The trajectory of an integration; ``times``: s of its stepping, and until its first steps."""
    t, x, v, a, multipliers = integration.series()
    stats = spent(integration.method.name, integration.state.counts, seconds=times[0], compile_seconds=times[1])
    stats = _with_start(stats, start, t, x)
    scene, kept = start.unreduced, _kept_rows(start)
    beside = tuple(integration.interior_rows)
    departures = tuple(integration.departures)
    samples = integration.samples()
    return Trajectory(
        with_samples(scene, samples), t, x, v, a, multipliers, stats, bodies, team,
        interior_rows=beside, departures=departures, kept_rows=kept, samples=samples,
    )  # fmt: skip


def _with_start(stats: Stats, start: Start, t: FloatArray, x: FloatArray) -> Stats:
    """With what a run's start (and rows t (nt,), x (nt, nx)) tell of its loops."""
    return replace(
        stats,
        start_moved=start.moved,
        start_residual=start.residual,
        constraint_residual=float(largest_gaps(start.unreduced, t, x).max(initial=0.0)),
        start_elastic=start.strain.energy,
    )


def _kept_rows(start: Start) -> tuple[int, ...] | None:
    return tuple(start.choice.rows) if start.scene.redundant else None


def prepared_trajectory(
    scene: CompiledScene,
    rows: SteppedRows,
    workspace: PreparedRuns,
    bodies: Mapping[str, Body],
    team: Team,
    *,
    start: Start | None,
) -> Trajectory:
    """The trajectory of a prepared run of this variant, of a machine with loops from its ``start``.

    Raises:
        SimulationError: as ``run``.
        SimulationInterrupted: Ctrl-C ended it early.
    """
    stats = spent(workspace.method.name, workspace.counts, seconds=rows.seconds, compile_seconds=0.0)
    t, x, v, a = (part.copy() for part in (rows.t, rows.x, rows.v, rows.a))
    multipliers = np.zeros((len(t), len(scene.plan.rows)))
    if start is None:
        trajectory = Trajectory(scene, t, x, v, a, multipliers, stats, bodies, team)
    else:
        multipliers[:, workspace.rows] = rows.multipliers
        stats = _with_start(stats, start, t, x)
        trajectory = Trajectory(
            start.unreduced, t, x, v, a, multipliers, stats, bodies, team, kept_rows=_kept_rows(start)
        )
        refuse_torn_loops(start, trajectory)
    if rows.interrupt is not None:
        raise interrupted(trajectory) from rows.interrupt
    return trajectory


def _progress_bar(shown: bool, total: float) -> AbstractContextManager[Any]:
    if not shown:
        return nullcontext(_Silent())
    try:
        from tqdm import tqdm  # only where a bar is asked for
    except ImportError as reason:
        raise SceneError("a progress bar needs tqdm: pip install 'flexmbd[pictures]'") from reason
    form = "{l_bar}{bar}| {n:.4g}/{total:.4g} s [{elapsed}<{remaining}]"
    return tqdm(total=total, bar_format=form)


class _Silent:
    """A progress bar that shows nothing."""

    def update(self, amount: float) -> None:
        """Take the time (s) that passed."""
