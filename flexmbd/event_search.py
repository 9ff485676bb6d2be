"""Stepping from event to event: each located by steps of the method itself, to its own accuracy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import brentq

from flexmbd.event import Event, Moment, Occurrence
from flexmbd.integrate import state as st
from flexmbd.multibody.body import Body
from flexmbd.multibody.initial import match_motion
from flexmbd.multibody.team import Team
from flexmbd.stepping import Integration, Snapshot, evaluate_inputs


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

    def advance(self, t_end: float) -> int:
        """One step towards ``t_end`` (s), cut short at the first event in it; the stepper's code."""
        integration = self._integration
        before = integration.snapshot()
        code = integration.advance(t_end)
        if code not in (st.OUTPUT, st.DONE) or integration.t == before.state.numbers[st.TIME]:
            return code
        signs = self._signs_now()
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
        return st.DONE if self.stopped or integration.t >= t_end else st.OUTPUT

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
        moment = self._moment()
        return np.sign([event.value(moment, self._team) for event in self._events])
