"""One integration in progress: a method's stepper, the state it moves, and the rows it leaves."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import RecordError, memory_told
from flexmbd.integrate import state as st
from flexmbd.integrate.controller import SAFETY, arrays_of
from flexmbd.integrate.protocol import Integrator
from flexmbd.multibody.functions.breaks import find_breaks
from flexmbd.multibody.interiors.scene_interiors import InteriorRecord
from flexmbd.multibody.kernels.base.array_struct import ArrayStruct
from flexmbd.multibody.kernels.base.arrays import new_work, open_horizon
from flexmbd.multibody.kernels.forward_dynamics.articulated import forward_dynamics
from flexmbd.multibody.kernels.forward_dynamics.articulated_layout import new_articulated_work
from flexmbd.multibody.kernels.inverse_dynamics.memories import remember
from flexmbd.multibody.kernels.reading.constraint_tables import is_driven
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.start.consistent_start import Start, accelerations, match_motion
from flexmbd.multibody.start.impulse import rates_after_jump, refuse_position_jumps
from flexmbd.multibody.start.independent_rows import better_rows
from flexmbd.multibody.team import Team, on_every_rank
from flexmbd.run.after_break import beside, closed_state, refuse_impulse_on_history, resumed_accelerations
from flexmbd.run.controller import Controller
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.limits import MOST_ROWS
from flexmbd.run.method_memory import recall, refuse_other_memory
from flexmbd.run.row_store import RowStore, new_record
from flexmbd.run.sampling import NO_SAMPLING, NO_SIGNALS, ControllerSamples, Sampling, with_own_signals
from flexmbd.run.series.departure import Departure
from flexmbd.run.snapshot import Snapshot, bound_by_span, copied_groups, copied_state, first_step, kept_interiors

FloatArray = NDArray[np.float64]

# How much more firmly others must hold to be kept instead of rows that still do, and after a step that failed.
_WORTH, _WORTH_AFTER_FAILURE = 4.0, 1.5
# Failures of a step that may come of kept rows losing their rank.
_POSSIBLY_DEPENDENT_ROWS = (
    st.NOT_CONVERGED, st.RANK_LOST, st.LOOPS_OPEN, st.NOT_FINITE, st.INACCURATE, st.NOT_ENFORCED,
)  # fmt: skip


class Integration:
    """A scene being integrated.

    Attributes:
        start: the consistent start.
        scene: what moves, with the rows that are kept.
        method: the integrator.
        state, groups: where it stands.
        stored: the rows (t, x, v, a, multipliers) taken from the buffer so far; multipliers of all constraint rows.
        beside: what bodies with history leave beside each of these rows.
        departures: with what it goes on from breaks among these rows.
        room: the most rows that one call of ``advance`` leaves.
    """

    def __init__(
        self,
        start: Start,
        method: Integrator,
        team: Team,
        at: Snapshot,
        *,
        one_by_one: bool,
        controllers: Sequence[Controller] = (),
        begun: float = 0.0,
        outside: Mapping[int, Callable[[float], float]] = NO_SIGNALS,
    ) -> None:
        start = with_own_signals(start) if controllers else start
        scene = start.scene if np.array_equal(at.rows, start.choice.rows) else start.unreduced.keep_rows(at.rows)
        self.start = start
        self.scene = scene
        self._rows = at.rows
        self.method = method
        self.state, self.groups = copied_state(at.state), copied_groups(at.groups)
        self.work = new_work(scene.plan)
        self._team = team
        self._first_step = at.first_step
        self._sampling: Sampling | None = None
        if controllers:
            self._sampling = Sampling(controllers, scene, begun=begun, team=team, outside=outside)
        if self._sampling is not None and at.sampling.code:
            self._sampling.resume(at.sampling, scene)
        self._interiors = scene.interiors
        # of a tree that often goes on from breaks: what finds its accelerations there quickly
        is_tree = not len(scene.plan.rows) and not is_driven(scene.plan) and self._interiors is None
        self._is_outside = len(outside) > 0  # who steps has no trajectory
        self._articulated = new_articulated_work(scene.plan) if is_tree and (outside or controllers) else None
        if self._interiors is not None:
            try:
                self._interiors.restore(scene.plan, at.interiors)
            except (KeyError, ValueError, IndexError, TypeError) as reason:
                raise RecordError(f"the checkpoint is damaged: a body's history cannot be read: {reason}") from reason
        with memory_told(f"{method.name} for a machine of {scene.nv} velocities"):
            self._bind_method()
        refuse_other_memory(self._own, at.memory, method=method.name)
        recall(self._own, at.memory)
        self._stepper.drop_factors()
        self._set_out()
        declared = scene.declared_breaks()
        number = self.state.numbers
        h = float(number[st.STEP]) if self.state.counts[st.FIXED_STEP] == 1 else None
        self._breaks = find_breaks(scene.time_rows, declared, rtol=float(number[st.TOLERANCE]), h=h)
        passed = int(np.searchsorted(self._breaks.knots, self.t, side="right"))
        self.state.counts[st.KNOT] = min(int(self.state.counts[st.KNOT]), passed)
        self.state.counts[st.WATCH_ROWS] = not start.choice.for_good
        if self.state.counts[st.STEPS] == 0:
            self.state.counts[st.AT_BREAK] = self.t in declared
        self.room = 1 if one_by_one else MOST_ROWS
        with memory_told(f"the rows of a run of {scene.nv} velocities"):
            self.record = new_record(scene, self.work, self.room)
        self.stored = RowStore()
        self.interior_rows: list[InteriorRecord] = []
        self.departures: list[Departure] = []
        self._departed: list[Departure] = []
        self.keep_state()

    def _set_out(self) -> None:
        """Let the method begin, or go on: then what was about to touch at the start bounds no step."""
        if self.state.counts[st.STEPS] > 0:
            self.scene.plan.horizon[:] = open_horizon()
            return
        evaluate_inputs(self.scene, self.work, self.t)
        self._begin()
        on_every_rank(self._team, self._stepper.refuse_step)

    @property
    def t(self) -> float:
        """Time (s) reached."""
        return float(self.state.numbers[st.TIME])

    @property
    def memory(self) -> ArrayStruct:
        """The method's memory beside the state."""
        return self._stepper.memory

    @property
    def steps_a_radian(self) -> float:
        """About how many steps the tolerance asks for in a radian of smooth motion; see ``controller.Stepper``."""
        return self._stepper.steps_a_radian

    @property
    def fixed_errors(self) -> FloatArray | None:
        """The method's estimates of the errors of given steps; see ``controller.Stepper``."""
        return self._stepper.fixed_errors

    @property
    def rows(self) -> int:
        """How many are taken."""
        return self.stored.count

    def bound_by_span(self, begun: float, t_end: float) -> None:
        """Let the steps be those of a simulation from ``begun`` to ``t_end`` (s)."""
        number, count = self.state.numbers, self.state.counts
        h = float(number[st.STEP]) if count[st.FIXED_STEP] == 1 else None
        bound_by_span(number, t_start=begun, t_end=t_end, h=h)

    def begin_by_span(self, begun: float, t_end: float) -> None:
        """The same before the first step, whose length under error control follows from it."""
        self.bound_by_span(begun, t_end)
        s = self.state
        if s.counts[st.FIXED_STEP] == 0:
            self._first_step = first_step(self.scene, s.numbers, s.v, s.a, self.method.order)
            s.numbers[st.STEP] = self._first_step

    def bound_steps(self, longest: float) -> None:
        """Let no step of error control be longer (s)."""
        ceiling = self.state.numbers[st.STEP_CEILING]
        self.state.numbers[st.STEP_CEILING] = min(ceiling, longest)

    def bound_step(self, longest: float) -> None:
        """Let the next step of error control be no longer (s); the shortest there is, at least."""
        number = self.state.numbers
        if self.state.counts[st.FIXED_STEP] == 0:
            number[st.STEP] = min(number[st.STEP], max(longest, number[st.STEP_FLOOR_SIZE]))

    def begin_anew(self) -> None:
        """Forget what the method remembers of earlier steps, for the state was changed by hand."""
        if self.state.counts[st.FIXED_STEP] == 0:
            self.state.numbers[st.STEP] = min(self.state.numbers[st.STEP], self._first_step)
        self.state.numbers[[st.STEP_REMAINDER, st.STEP_PART]] = 0.0
        evaluate_inputs(self.scene, self.work, self.t)
        self._forget()

    def take_sides(self, places: Sequence[int], sides: FloatArray) -> None:
        """Let laws go on by other sides, which stand at these places of x, in a row of their own."""
        scene, s = self.scene, self.state
        s.x[list(places)] = sides
        s.counts[st.SWITCHES] += len(places)
        evaluate_inputs(scene, self.work, self.t)
        s.a[:], s.multipliers[:] = resumed_accelerations(scene, self.work, s.x, s.v)
        self.begin_anew()
        self.keep_state()

    def advance(self, t_end: float) -> int:
        """Step until ``t_end`` (s), a full buffer, rows to be chosen anew or a failure; rank 0's outcome on every rank.

        Returns the stepper's code; the buffer holds the rows of the new steps.
        """
        self.empty_buffer()
        return self.step_on(t_end)

    def empty_buffer(self) -> None:
        """Let go of the rows in the buffer."""
        self.state.counts[st.STORED] = 0
        self._departed.clear()
        if self._interiors is not None:
            self._interiors.buffer.clear()

    def step_on(self, t_end: float) -> int:
        """As ``advance``, the new rows behind those that are in the buffer."""
        number, count = self.state.numbers, self.state.counts
        count[st.MOST_STORED] = self.room
        failed = int(count[st.RESELECT_ROWS])
        if failed and not self._choose_rows() and failed != st.PIVOT_FELL:
            return failed
        code = st.DONE
        while code == st.DONE and self.t < t_end:
            if self._take_samples() or count[st.AT_BREAK] == 1:
                self._leave_break()
            ahead = self._next_jump(t_end)
            number[st.TIME_END] = min(t_end, ahead)
            number[st.LATEST] = ahead - beside(ahead, self.state.numbers) if ahead <= t_end else np.inf
            code = self._stepper.advance(self.record, self._breaks.knots)
            if self._team.size > 1:
                agreed = self._team.agree(np.array([code, count[st.RESELECT_ROWS]], float))
                code, count[st.RESELECT_ROWS] = (int(one) for one in agreed)
            if code == st.DONE and self.t == ahead:
                count[st.AT_BREAK] = 1
        if count[st.WATCH_ROWS] == 1 and code in _POSSIBLY_DEPENDENT_ROWS:
            count[st.RESELECT_ROWS] = code
            return st.OUTPUT
        return code

    def _take_samples(self) -> bool:
        """Let the controllers whose time has come set their signals; whether any did.  Collective."""
        if self._sampling is None:
            return False
        s = self.state
        return self._sampling.take(self.t, self.scene, Instant(self.scene, self.t, s.x, s.v, s.a, s.multipliers))

    def _next_jump(self, t_end: float) -> float:
        """When (s) a function of time jumps next, or a controller samples."""
        ahead = self._breaks.next_jump(self.t)
        if self._sampling is None:
            return ahead
        return min(ahead, self._sampling.following(t_end, ahead))

    def _choose_rows(self) -> bool:
        """Keep other rows where they hold more firmly, and begin anew with them; whether there are any.  Collective."""
        full, s = self.start.unreduced, self.state
        failed = s.counts[st.RESELECT_ROWS] != st.PIVOT_FELL
        s.counts[st.RESELECT_ROWS] = 0
        s.numbers[st.LARGEST_PIVOT] = 0.0
        evaluate_inputs(self.scene, self.work, self.t)
        worth = _WORTH_AFTER_FAILURE if failed else _WORTH
        rows = better_rows(full, self.work, s.x, list(self._rows), worth=worth) or self._rows
        rows = self._team.agree(np.array(rows, float)).astype(np.int64)
        if np.array_equal(rows, self._rows):
            return False
        scene = full.keep_rows(rows)
        closed = closed_state(scene, self.work, s.x, s.v)
        if closed is None:
            return False
        x, v, a, multipliers = closed
        s.x[:], s.v[:], s.a[:], s.multipliers[:] = x, v, a, multipliers
        self.scene, self._rows = scene, rows
        t, *last = self.stored.last
        if t.size and t[-1] == self.t:  # what rows that lost their hold left there is worth less
            for part, now in zip(last, (x, v, a, self.of_all_rows(multipliers[None])[0]), strict=True):
                part[-1] = now
        self._bind_method()
        if failed and s.counts[st.FIXED_STEP] == 0:
            s.numbers[st.STEP] = max(s.numbers[st.STEP], self._first_step)
        self._forget()
        return True

    def _leave_break(self) -> None:
        """Go on from a break with the values just after it; the method's history is dropped."""
        scene, s = self.scene, self.state
        evaluate_inputs(scene, self.work, self.t + beside(self.t, self.state.numbers))
        if self._is_driven:
            refuse_position_jumps(scene, self.work, s.x, rtol=float(s.numbers[st.TOLERANCE]))
            v = rates_after_jump(scene, self.work, s.x, s.v)
            if self._interiors is not None:
                refuse_impulse_on_history(scene, v - s.v, s.numbers)
            s.v[:], s.a[:], s.multipliers[:] = match_motion(scene, self.work, s.x, v, held=np.zeros(scene.nv, bool))
        if self._interiors is not None:
            s.a[:], s.multipliers[:] = resumed_accelerations(scene, self.work, s.x, s.v)
        elif not self._is_driven:
            self._accelerate()
        if not self._is_outside:
            self._departed.append(Departure(int(s.counts[st.STORED]) - 1, s.v.copy(), s.a.copy()))
        if s.counts[st.JUMPED] == 1:
            s.numbers[st.STEP] = min(s.numbers[st.STEP], first_step(scene, s.numbers, s.v, s.a, self.method.order))
        self._forget()

    def _accelerate(self) -> None:
        """Find the accelerations and reactions; ``work.time`` is up to date."""
        scene, work, s = self.scene, self.work, self.state
        if self._articulated is not None:
            forward_dynamics(scene.plan, work, self._articulated, s.x, s.v, s.a, s.multipliers)
            if scene.plan.flag[0] == 0 and math.isfinite(s.a.dot(s.a)):
                return
            scene.refuse_failed(work)
        s.a[:], s.multipliers[:] = accelerations(scene, work, s.x, s.v)

    def _forget(self) -> None:
        """Let the method begin where the state stands; ``work.time`` is up to date."""
        count, number = self.state.counts, self.state.numbers
        count[st.AT_BREAK] = count[st.JUMPED] = 0
        count[st.NO_GROWTH :] = 0
        number[st.RATIO_BEFORE :] = 0.0
        number[st.STABLE_STEP] = np.inf
        number[st.STEP_BEFORE] = 0.0
        for part in self._own.values():
            part[...] = 0
        if self.work.trial.size:  # rates may have jumped
            remember(self.scene.plan, self.work, self.state.x, self.state.v, self.t)
        self._begin()

    def _bind_method(self) -> None:
        """Bind the method to the scene; ``_own``: the arrays that it remembers, by their names."""
        self._stepper = self.method.stepper(self.scene, self.state, self.groups, self.work)
        self._own = arrays_of(self._stepper.memory)
        self._is_driven = is_driven(self.scene.plan)

    def _begin(self) -> None:
        self.state.numbers[st.SAFETY] = SAFETY
        self._stepper.begin()

    def keep_rows(self) -> None:
        """Take the buffer's rows into ``stored``."""
        stored, before = int(self.state.counts[st.STORED]), self.rows
        self.departures.extend(replace(one, row=before + one.row) for one in self._departed)
        self._departed.clear()
        r = self.record
        *motion, multipliers = (part[:stored].copy() for part in (r.t, r.x, r.v, r.a, r.multipliers))
        self.stored.append((*motion, self.of_all_rows(multipliers)))
        if self._interiors is not None:
            self.interior_rows.extend(self._interiors.buffer[:stored])
        self.state.counts[st.STORED] = 0

    def keep_state(self) -> None:
        """Take the state as it stands into ``stored``, as a row of its own."""
        s = self.state
        motion = (part[None].copy() for part in (s.x, s.v, s.a))
        self.stored.append((np.array([self.t]), *motion, self.of_all_rows(s.multipliers[None])))
        if self._interiors is not None:
            self.interior_rows.append(self._interiors.row(self.scene.plan))

    def of_all_rows(self, multipliers: FloatArray) -> FloatArray:
        """Multipliers (n, m) of the kept rows among those of all, zero where a row is not kept."""
        found = np.zeros((len(multipliers), len(self.start.unreduced.plan.rows)))
        found[:, self._rows] = multipliers
        return found

    def series(self) -> tuple[FloatArray, ...]:
        """t (nt,), x (nt, nx), v, a (nt, nv), multipliers (nt, m) over all rows taken.  Collective."""
        if self.state.counts[st.RESELECT_ROWS] == st.PIVOT_FELL:
            self._choose_rows()
        return self.stored.series()

    def samples(self, *, since: float = -np.inf) -> tuple[ControllerSamples, ...]:
        """The samples of controllers, or those from a time (s) on."""
        return () if self._sampling is None else self._sampling.samples(since=since)

    def snapshot(self) -> Snapshot:
        """Copy the state and the method's memory."""
        memory = {name: part.copy() for name, part in self._own.items()}
        parts = copied_state(self.state), copied_groups(self.groups), memory, self._first_step, self._rows.copy()
        sampling = NO_SAMPLING if self._sampling is None else self._sampling.snapshot()
        return Snapshot(*parts, kept_interiors(self.scene), sampling)

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a snapshot of this integration."""
        if not np.array_equal(snapshot.rows, self._rows):
            self._rows = snapshot.rows
            self.scene = self.start.unreduced.keep_rows(snapshot.rows)
            self._bind_method()
        for here, there in ((self.state, snapshot.state), (self.groups, snapshot.groups)):
            for part, kept in zip(here.fields().values(), there.fields().values(), strict=True):
                part[...] = kept
        recall(self._own, snapshot.memory)
        if self._sampling is not None:
            self._sampling.restore(snapshot.sampling, self.scene)
        if self._interiors is not None:
            self._interiors.restore(self.scene.plan, snapshot.interiors)

    @property
    def kept_rows(self) -> NDArray[np.int64]:
        """(m,) which of all constraint rows are kept."""
        return np.array(self._rows, np.int64)

    def forget_rows(self) -> None:
        """Drop all rows but the last ones, and all samples of controllers but the last."""
        last, self.stored = self.stored.last, RowStore()
        self.stored.append(tuple(part[-1:] for part in last))
        self.departures.clear()
        if self._sampling is not None:
            self._sampling.forget()

    def checkpoint(self) -> Snapshot:
        """A snapshot from which a restart gives the same numbers to the bit as going on from here."""
        self._stepper.drop_factors()
        snapshot = self.snapshot()
        if self._interiors is not None:  # which forget their factors by it
            self._interiors.restore(self.scene.plan, snapshot.interiors)
        return snapshot
