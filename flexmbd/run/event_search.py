"""Stepping from event to event: each located by steps of the method itself, to its own accuracy.

Switches of laws are located alike; what an event does besides is up to its action, what a switch does is change its
law's side.  They are counted behind the events here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import EventWarning, SceneError, warn
from flexmbd.integrate import state as st
from flexmbd.multibody.bodies.body import Body
from flexmbd.multibody.kernels.sampling.interpolation import interpolate_series, interpolated_coordinates
from flexmbd.multibody.start.consistent_start import match_motion
from flexmbd.multibody.team import Team
from flexmbd.round_off import EQUAL
from flexmbd.run.event import NO_EVENTS, Event, EventMemory, Moment, Occurrence, codes_of
from flexmbd.run.input_values import evaluate_inputs
from flexmbd.run.snapshot import Snapshot
from flexmbd.run.stepping import Integration
from flexmbd.run.switch_watch import SwitchWatch

FloatArray = NDArray[np.float64]

# Where what a function goes through falls below this share of what it went through in a whole step, an impact has no
# flight after it: flights go with the root.
_GONE = 1e-10
# Where a function is looked at within a step: once at least, so often in the time between its last two passages, and
# at most so often; what is found twice in a row by twice as many looks is all there is.
_LOOKS, _MOST_LOOKS = 3.0, 4096
# So often, if what is seen could hide passages: a function that lies on zero could from any number of looks.
_CLOSE_LOOKS = 32
_UNEVEN = 0.618  # no whole share of a step, for functions that repeat themselves
# Where a function's pace is not known yet, at the start and after a passage, it is also looked at in shorter and
# shorter parts of the step, each half the one before: the first of passages at equal times is then seen by itself.
_HALVES = 12


class _NotReached(Exception):
    """A step failed, with the stepper's code."""

    def __init__(self, code: int) -> None:
        self.code = code


class EventSearch:
    """Follows the signs of the events' functions along an integration that stops after every step.

    Attributes:
        occurred: what took place so far.
        stopped: whether an event has ended the simulation.
    """

    def __init__(
        self,
        integration: Integration,
        events: Sequence[Event],
        bodies: Mapping[str, Body],
        team: Team,
        at: EventMemory = NO_EVENTS,
    ) -> None:
        """Begin where an integration stands; after a checkpoint with the memory kept there."""
        self._integration = integration
        self._events = events
        self._bodies = bodies
        self._team = team
        self.occurred: list[Occurrence] = []
        self.stopped = False
        self._coordinates = interpolated_coordinates(integration.start.scene.plan)
        self._watch = SwitchWatch(integration)
        self._codes = codes_of(events, self._watch.switches)
        n = len(self._codes)
        # of each function: its side of zero; from which side (-1, 1) an action has thrown it back, until it is off
        # zero; when it passed through zero last, and how long that was after the time before; its value where the last
        # step ended, NaN where an event took place there
        followed = np.array([self._signs_now(), *np.outer([0.0, -np.inf, np.inf, np.nan], np.ones(n))])
        places = np.array([at.codes.index(code) if code in at.codes else -1 for code in self._codes], np.float64)
        known = team.agree(places).astype(np.int64)  # functions may differ between ranks: rank 0's count
        here = known >= 0
        self._new_pace = at.new_pace or not here.all()  # whether a function may pass at another pace than before
        followed[:, here] = at.followed[:, known[here]]
        self._signs, self._thrown_back, self._last_passage, self._spacing, self._values = followed
        self._signs[len(events) :] = self._watch.sides
        self._warned: set[int] = set()
        # functions that begin on zero, until they are off it
        self._begins_on_zero = (self._signs == 0.0) & ~here

    def memory(self) -> EventMemory:
        """A copy of the memory, for a checkpoint."""
        parts = self._signs, self._thrown_back, self._last_passage, self._spacing, self._values
        return EventMemory(self._codes, np.array(parts), self._new_pace)

    def advance(self, t_end: float) -> int:
        """One step towards ``t_end`` (s), cut short at the first event in it; the stepper's code."""
        integration = self._integration
        before = integration.snapshot()
        code = integration.advance(t_end)
        if code not in (st.OUTPUT, st.DONE) or integration.t == before.state.numbers[st.TIME]:
            return code
        code, values = self._off_throw(before, code)
        if (first := self._first_of_many(before, values)) is not None:
            code = self._step_to(before, first)
            code, values = self._off_throw(before, st.OUTPUT if code == st.DONE else code)
        signs = np.sign(values)
        self._thrown_back[signs != 0.0] = 0.0
        self._refuse_entered(signs, values)
        passed = [k for k in range(len(signs)) if self._passes(k, signs[k])]
        self._begins_on_zero &= signs == 0.0
        if not passed:
            self._note_passages(signs * self._signs < 0.0)
            # a function that touches zero keeps its side
            self._signs = np.where(signs == 0.0, self._signs, signs)
            self._new_pace = first is not None
            self._values = values
            integration.keep_rows()
            return code
        self._values = np.full(len(signs), np.nan)
        return self._take_place(passed, before, signs, t_end)

    def _off_throw(self, before: Snapshot, code: int) -> tuple[int, FloatArray]:
        """Follow functions that were thrown back and have come through again; the stepper's code, and all values."""
        values = self._values_now()
        signs = np.sign(values)
        fallen = (signs != 0.0) & (signs == self._thrown_back)
        if not fallen.any():
            return code, values
        code = self._follow_throw(before, np.flatnonzero(fallen))
        return code, self._values_now()

    def _refuse_entered(self, signs: FloatArray, values: FloatArray) -> None:
        """Raise SceneError where a function goes on, unseen, on the side that nothing is to go to."""
        for k, event in enumerate(self._events):
            if not event.may_go_on and signs[k] < 0.0 and self._signs[k] < 0.0 and values[k] < self._values[k]:
                t = self._integration.t
                raise SceneError(f"event {event.name!r} passed unseen before t = {t:.6g} s; {event.remedy}")

    def _passes(self, k: int, sign: float) -> bool:
        """Whether function k has passed to a sign."""
        if k < len(self._events):
            return self._events[k].passes(self._signs[k], sign, begins=self._begins_on_zero[k])
        return bool(sign * self._signs[k] < 0.0)

    def _note_passages(self, passed: NDArray[np.bool_]) -> None:
        """Take note of when functions passed, about now, and of the time since they did before."""
        self._new_pace = self._new_pace or bool(passed.any())
        self._spacing[passed] = (self._integration.t - self._last_passage)[passed]
        self._last_passage[passed] = self._integration.t

    def _first_of_many(self, before: Snapshot, values: FloatArray) -> float | None:
        """Where to end the step that a function passes more than once in: at a look with but its first passage before.

        A function that is zero at the step's beginning has none before it: it must be seen on a side to leave that.
        Looked for on the motion between the step's ends, which nothing but this is taken from; more and more closely as
        long as what is seen could hide a passage (``_hides_none``).

        Args:
            before: the step's beginning.
            values: of the functions at its end.
        """
        begin, end = float(before.state.numbers[st.TIME]), self._integration.t
        looks = int(min(1.0 + np.ceil(_LOOKS * (end - begin) / self._spacing.min()), _MOST_LOOKS))
        halves = 0.5 ** np.arange(1, _HALVES + 1) if self._new_pace else np.zeros(0)
        allowed = (self._signs != 0.0).astype(int)
        found, most = -1, max(_CLOSE_LOOKS, 2 * looks)
        while True:
            shares = np.concatenate([halves, (np.arange(looks) + _UNEVEN) / (looks + _UNEVEN)])
            instants = np.unique(begin + (end - begin) * shares)
            instants = instants[(instants > begin) & (instants < end)]  # none in a step of a few units of round-off
            rows = zip(instants, *self._motion_since(before, instants), strict=True)
            told = np.array([self._values, *(self._values_at(t, x, v, a) for t, x, v, a in rows), values])
            seen = np.vstack([self._signs, np.sign(told[1:])])
            changes = [_changes(np.array([row[k] for row in seen])) for k in range(told.shape[1])]
            resolved = _hides_none(np.array([begin, *instants, end]), told)
            none = all(len(one) <= most for one, most in zip(changes, allowed, strict=True))
            if none and (resolved.all() or looks >= _CLOSE_LOOKS):
                return None
            total = sum(len(one) for one in changes)
            if not none and ((total == found and (resolved.all() or looks >= most)) or looks >= _MOST_LOOKS):
                self._warn(begin, end, changes, resolved)
                # seen[k + 1] is what is seen at instants[k]
                last = min(one[0] - 2 + most for one, most in zip(changes, allowed, strict=True) if len(one))
                return float(instants[last]) if last < len(instants) else None
            found, looks = total, 2 * looks

    def _warn(
        self, begin: float, end: float, changes: Sequence[NDArray[np.int64]], resolved: NDArray[np.bool_]
    ) -> None:
        """Warn, once for each event, where a function changes its sign faster than it was looked at."""
        for k, event in enumerate(self._events):
            followed = event.may_go_on  # else it is thrown back at its first passage
            if followed and len(changes[k]) > 1 and not resolved[k] and k not in self._warned and self._team.is_root:
                self._warned.add(k)
                warn(
                    f"the function of event {event.name!r} passes through zero at least {len(changes[k])} times in a "
                    f"step of {end - begin:.3g} s at t = {begin:.6g} s; of passages so near to each other some may be "
                    "missed. "
                    "Bound the steps (max_step=), or let a controller sample at exact instants (scene.add_controller)",
                    EventWarning,
                )

    def _motion_since(self, before: Snapshot, instants: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x (k, nx), v, a (k, nv) at instants (s) of the step from ``before`` to where the integration stands."""
        old, new = before.state, self._integration.state
        pairs = (old.numbers[st.TIME], self._integration.t), (old.x, new.x), (old.v, new.v), (old.a, new.a)
        t, x, v, a = (np.array(pair) for pair in pairs)
        k = len(instants)
        found = np.zeros((k, x.shape[1])), np.zeros((k, v.shape[1])), np.zeros((k, v.shape[1]))
        interpolate_series(*self._coordinates, t, x, v, a, np.zeros(k, np.int64), instants, *found)
        return found

    def _take_place(
        self, passed: Sequence[int], before: Snapshot, signs: np.ndarray, t_end: float
    ) -> int:
        """Go back, step to the first of the events that passed, and let it act."""
        integration = self._integration
        begin, end = float(before.state.numbers[st.TIME]), integration.t
        try:
            instants = {k: self._locate(k, before, begin, end) for k in passed}
        except _NotReached as reason:
            return reason.code
        first = min(instants.values())
        if (code := self._step_to(before, first, keep=True)) != st.DONE:
            return code
        now = [k for k, t in instants.items() if t - first <= EQUAL * max(abs(end), end - begin)]
        self._note_passages(np.isin(np.arange(len(signs)), now))
        row = integration.rows - 1
        here, n = self._signs_now(), len(self._events)
        self._signs = np.where(here == 0.0, self._signs, here)
        self._signs[n:] = self._watch.sides
        switched, thrown = {k - n: float(signs[k]) for k in now if k >= n}, set()
        for k in now:
            if k >= n:
                continue
            event = self._events[k]
            self._signs[k] = signs[k]
            self.occurred.append(Occurrence(event, integration.t, row))
            self.stopped = self.stopped or event.stop
            moment = self._moment()
            event.act(moment, self._team)
            if moment.changed.any():
                self._change_rates(moment)
                self._signs[k] = 0.0  # an impact may throw the function back
                self._thrown_back[k] = signs[k]
                here = self._signs_now()[n:]  # the rates that are set may lead to other sides
                thrown = {int(j) for j in np.flatnonzero(self._signs[n:] * here < 0.0)} - switched.keys()
                switched |= {j: float(here[j]) for j in thrown}
        if switched and not self.stopped:
            self._watch.change([*switched], np.array([*switched.values()]), thrown=thrown)
            self._signs[n:] = self._watch.sides
        return st.DONE if self.stopped or integration.t >= t_end else st.OUTPUT

    def _follow_throw(self, before: Snapshot, fallen: NDArray[np.int64]) -> int:
        """Step again, so far only that functions which were thrown back and have come through once more are still back.

        Where a function goes on through at a rate of its own, for the action let it, the step stays.

        Raises:
            SceneError: no step is short enough: the machine rests there, or is hit ever faster.
        """
        integration = self._integration
        begin, end = float(before.state.numbers[st.TIME]), integration.t
        length, first = end - begin, self._values_now()[fallen]
        integration.restore(before)
        at_begin, far = self._values_now()[fallen], first
        while True:
            length *= 0.25
            self._step_to(before, begin + length)
            near = self._values_now()[fallen]
            if (np.sign(near) != self._thrown_back[fallen]).all():
                return st.OUTPUT
            gone, gone_before = near - at_begin, far - at_begin
            # of c1 t + c2 t^2 through both: c1 t of the longer one; at rest it is none
            linear = (16.0 * gone - gone_before) / 3.0
            goes_on = linear * gone_before >= 0.5 * gone_before**2
            if goes_on.any() and all(self._events[k].may_go_on for k in fallen[goes_on]):
                self._step_to(before, end)
                return st.OUTPUT
            if (np.abs(gone) <= _GONE * np.abs(first - at_begin)).any() or begin + length == begin:
                integration.restore(before)
                integration.state.counts[st.STORED] = 0
                names = ", ".join(repr(self._events[k].name) for k in fallen)
                remedies = dict.fromkeys(self._events[k].remedy for k in fallen)
                raise SceneError(
                    f"event {names} at t = {begin:.6g} s: after its action the machine passes the zero again at once: "
                    f"it rests there, or its impacts follow each other ever faster; {'; '.join(remedies)}"
                )
            far = near

    def _locate(self, k: int, before: Snapshot, begin: float, end: float) -> float:
        """The instant (s) in (begin, end] at which event k's function is zero.

        Raises:
            _NotReached: a step towards it failed.
        """
        events = self._events

        def value(t: float) -> float:
            if t <= begin:  # where it may have just passed, and what it leaves there is round-off of either sign
                return float(self._signs[k])
            if (code := self._step_to(before, t)) != st.DONE:
                raise _NotReached(code)
            if k < len(events):
                return events[k].value(self._moment(), self._team)
            return self._watch.number_now(k - len(events))

        from scipy.optimize import brentq  # on need: 0.1 s

        spacing = 4.0 * np.spacing(max(abs(begin), abs(end)))
        return max(float(brentq(value, begin, end, xtol=spacing)), begin + spacing)

    def _step_to(self, before: Snapshot, t: float, *, keep: bool = False) -> int:
        """Step from ``before`` to t (s), and keep the rows if it gets there; the stepper's code."""
        integration = self._integration
        integration.restore(before)
        code = st.OUTPUT
        while code == st.OUTPUT:  # the method may cut a step of its own
            code = integration.advance(t)
            if keep:
                integration.keep_rows()
        return code

    def _change_rates(self, moment: Moment) -> None:
        """Go on with other velocities, made consistent with the loops."""
        integration = self._integration
        state = integration.state
        evaluate_inputs(integration.scene, integration.work, integration.t)
        state.v[:], state.a[:], state.multipliers[:] = match_motion(
            integration.scene, integration.work, state.x, moment.new_rates, held=moment.changed
        )
        integration.begin_anew()
        integration.keep_state()

    def _moment(self) -> Moment:
        s = self._integration.state
        now = (part.copy() for part in (s.x, s.v, s.a, s.multipliers))
        return Moment(self._integration.scene, self._integration.t, *now)

    def _signs_now(self) -> np.ndarray:
        return np.sign(self._values_now())

    def _values_at(self, t: float, x: FloatArray, v: FloatArray, a: FloatArray) -> FloatArray:
        if not self._events:
            return self._watch.numbers(t, x, v)
        return self._values_of(Moment(self._integration.scene, t, x, v, a))

    def _values_now(self) -> NDArray[np.float64]:
        if self._events:  # which may keep the moment
            return self._values_of(self._moment())
        s = self._integration.state
        return self._values_at(self._integration.t, s.x, s.v, s.a)

    def _values_of(self, moment: Moment) -> NDArray[np.float64]:
        values = [event.value(moment, self._team) for event in self._events]
        return np.concatenate([values, self._watch.numbers(moment.t, moment.x, moment.v)])


def _hides_none(t: FloatArray, values: FloatArray) -> NDArray[np.bool_]:
    """Whether each function (k, events) is smooth enough between looks at t (k,) to hide no passage through zero.

    Three values in a row of one sign do not where they lie farther from zero than the middle one from the line through
    the others; of two signs where they ascend or descend by more than that.  What is not known (NaN) says nothing.
    """
    first, middle, last = values[:-2], values[1:-1], values[2:]
    share = ((t[1:-1] - t[:-2]) / (t[2:] - t[:-2]))[:, None]
    bend = np.abs(middle - first - share * (last - first))
    rise, further = middle - first, last - middle
    ascends = (rise * further > 0.0) & (np.minimum(np.abs(rise), np.abs(further)) >= bend)
    nearest = np.minimum(np.minimum(np.abs(first), np.abs(middle)), np.abs(last))
    one_sided = (np.sign(first) == np.sign(middle)) & (np.sign(middle) == np.sign(last))
    return np.asarray((np.where(one_sided, nearest >= bend, ascends) | np.isnan(bend)).all(axis=0))


def _changes(signs: FloatArray) -> NDArray[np.int64]:
    """Where among signs (-1, 0, 1) another one than the last that was not zero stands."""
    kept = np.flatnonzero(signs)
    return kept[1:][np.diff(signs[kept]) != 0.0]
