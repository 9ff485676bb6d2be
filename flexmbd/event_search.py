"""Stepping from event to event: each located by steps of the method itself, to its own accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from flexmbd.errors import SceneError
from flexmbd.event import Event, Moment, Occurrence
from flexmbd.integrate import state as st
from flexmbd.multibody.body import Body
from flexmbd.multibody.initial import match_motion
from flexmbd.multibody.team import Team
from flexmbd.stepping import Integration, Snapshot, evaluate_inputs

# Where what a function goes through falls below this share of what it went through in a whole step, an impact has no
# flight after it: flights go with the root.
_GONE = 1e-10


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
    ) -> None:
        self._integration = integration
        self._events = events
        self._bodies = bodies
        self._team = team
        self.occurred: list[Occurrence] = []
        self.stopped = False
        self._signs = self._signs_now()
        # from which side (-1, 1) an action has thrown each function back, until it is off zero
        self._thrown_back = np.zeros(len(events))

    def advance(self, t_end: float) -> int:
        """One step towards ``t_end`` (s), cut short at the first event in it; the stepper's code."""
        integration = self._integration
        before = integration.snapshot()
        code = integration.advance(t_end)
        if code not in (st.OUTPUT, st.DONE) or integration.t == before.state.numbers[st.TIME]:
            return code
        signs = self._signs_now()
        fallen = (signs != 0.0) & (signs == self._thrown_back)
        if fallen.any():
            code = self._follow_throw(before, np.flatnonzero(fallen))
            signs = self._signs_now()
        self._thrown_back[signs != 0.0] = 0.0
        passed = [
            k for k, event in enumerate(self._events) if event.passes(self._signs[k], signs[k])
        ]
        if not passed:
            # a function that touches zero keeps its side
            self._signs = np.where(signs == 0.0, self._signs, signs)
            integration.keep_rows()
            return code
        return self._take_place(passed, before, signs, t_end)

    def _take_place(
        self, passed: Sequence[int], before: Snapshot, signs: np.ndarray, t_end: float
    ) -> int:
        """Go back, step to the first of the events that passed, and let it act."""
        integration = self._integration
        begin, end = float(before.state.numbers[st.TIME]), integration.t
        instants = {k: self._locate(k, before, begin, end) for k in passed}
        first = min(instants.values())
        if (code := self._step_to(before, first, keep=True)) != st.DONE:
            return code
        now = [k for k, t in instants.items() if t - first <= 1e-12 * max(abs(end), end - begin)]
        row = sum(len(block[0]) for block in integration.stored) - 1
        self._signs = np.where(self._signs_now() == 0.0, self._signs, self._signs_now())
        for k in now:
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
            if (linear * gone_before >= 0.5 * gone_before**2).any():
                self._step_to(before, end)
                return st.OUTPUT
            if (np.abs(gone) <= _GONE * np.abs(first - at_begin)).any() or begin + length == begin:
                integration.restore(before)
                integration.state.counts[st.STORED] = 0
                names = ", ".join(repr(self._events[k].name) for k in fallen)
                raise SceneError(
                    f"event {names} at t = {begin:.6g} s: its action does not keep the machine from going on through, "
                    "for it rests there, or its impacts follow each other ever faster; end the run there (stop=True "
                    "where the impact is slow enough), or let a JointStop or a contact force bear it"
                )
            far = near

    def _locate(self, k: int, before: Snapshot, begin: float, end: float) -> float:
        """The instant (s) in (begin, end] at which event k's function is zero."""
        event = self._events[k]

        def value(t: float) -> float:
            if t <= begin:
                self._integration.restore(before)
            elif self._step_to(before, t) != st.DONE:
                return float("nan")
            return event.value(self._moment(), self._team)

        low, high = value(begin), value(end)
        if low * high > 0.0:  # it passed by a hair at the step's beginning
            return begin + 1e-3 * (end - begin)
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
        evaluate_inputs(integration.start.scene, integration.work, integration.t)
        state.v[:], state.a[:], state.multipliers[:] = match_motion(
            integration.start.scene, integration.work, state.x, moment.new_rates, held=moment.changed
        )
        integration.begin_anew()
        integration.keep_state()

    def _moment(self) -> Moment:
        s = self._integration.state
        time = np.array([self._integration.t])
        x, v, a, multipliers = (part[None].copy() for part in (s.x, s.v, s.a, s.multipliers))
        row = (time, x, v, a, multipliers)
        return Moment(self._integration.start.scene, row, self._bodies, self._team)

    def _signs_now(self) -> np.ndarray:
        return np.sign(self._values_now())

    def _values_now(self) -> NDArray[np.float64]:
        moment = self._moment()
        return np.array([event.value(moment, self._team) for event in self._events])
