"""Controllers at work: exact instants, measurements, laws, and inputs that are held.

Instants are k periods after the start, k a whole number, so that none drifts; steps end on them as on breaks of
functions of time.  At instants that several controllers share all measure before any input is set.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.errors import RecordError, SceneError
from flexmbd.given import checked
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.kernels.reading.force_tables import constant_place
from flexmbd.multibody.motion.instant import Instant, measure
from flexmbd.multibody.plan.compiled_scene import CompiledScene, with_signals
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.multibody.team import Team
from flexmbd.run.controller import Controller, Measurement

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Arrays of `ControllerSamples` with a row for each.
_BY_SAMPLE = ("t", "measurements", "inputs", "states")
#: Of runs that nobody steps from outside.
NO_SIGNALS: Mapping[int, Callable[[float], float]] = {}
_SAME = 32.0  # units of round-off: instants that differ by no more are one


@dataclass(frozen=True, eq=False)
class ControllerSamples:
    """The samples of a controller.

    Attributes:
        name: the controller's.
        t: (k,) s, its samples.
        measurements: (k, ny) of each sample.
        inputs: (k, nu) set at each sample, held until the next.
        states: (k, ns) its state after each sample, in one row.
        before: (nu,) the inputs before the first of these samples.
        rows: of each input the rows of ``Plan.times`` that have it.
    """

    name: str
    t: FloatArray
    measurements: FloatArray
    inputs: FloatArray
    states: FloatArray
    before: FloatArray
    rows: tuple[tuple[int, ...], ...]

    __repr__ = brief

    @checked()
    def held(self, t: FloatArray) -> FloatArray:
        """(n, nu) the inputs at times (s); at a sample those that it gave."""
        values = np.vstack([self.before, self.inputs])
        return values[np.searchsorted(self.t, np.asarray(t, dtype=np.float64), side="right")]

    @checked()
    def since(self, t: float) -> ControllerSamples:
        """The samples from a time (s) on."""
        k = int(np.searchsorted(self.t, t))
        rest = {name: getattr(self, name)[k:] for name in _BY_SAMPLE}
        return replace(self, before=self.inputs[k - 1] if k else self.before, **rest)

    @checked()
    def followed_by(self, other: ControllerSamples, *, since: float) -> ControllerSamples:
        """These before a time (s), and then those of another."""
        k = int(np.searchsorted(self.t, since))
        kept = replace(self, **{name: getattr(self, name)[:k] for name in _BY_SAMPLE})
        if not len(other.t):
            return kept
        if not k:
            return replace(other, before=self.before)
        parts = {name: np.concatenate([getattr(kept, name), getattr(other, name)]) for name in _BY_SAMPLE}
        return replace(self, **parts)


@dataclass(frozen=True, eq=False)
class SamplingMemory:
    """The memory of controllers from step to step.

    Attributes:
        code: tells them from others.
        next: (nc,) the number of each one's next sample.
        values: (ns,) of the signals.
        states: of all controllers, one behind the other.
        taken: (nc,) how many samples of this run each has.
    """

    code: str
    next: IntArray
    values: FloatArray
    states: FloatArray
    taken: tuple[int, ...] = ()


NO_SAMPLING = SamplingMemory("", np.zeros(0, np.int64), np.zeros(0), np.zeros(0))


@dataclass(frozen=True, eq=False)
class _Sample:
    t: float
    measured: FloatArray
    inputs: FloatArray
    state: FloatArray


class Sampling:
    """The controllers of one run; all ranks of a team go the same way.

    Attributes:
        controllers: those of the machine.
    """

    def __init__(
        self,
        controllers: Sequence[Controller],
        scene: CompiledScene,
        *,
        begun: float,
        team: Team,
        outside: Mapping[int, Callable[[float], float]] = NO_SIGNALS,
    ) -> None:
        """Find the signals of a scene.

        Args:
            controllers: those of the machine.
            scene: with functions of time that nobody else writes to.
            begun: s, when the simulation began.
            team: the processes that run it.
            outside: by the ids of signals that are set from outside their values at a time (s).

        Raises:
            SceneError: nothing in the machine has a signal that is set, or one that is measured is set by nobody.
        """
        self.controllers = tuple(controllers)
        self._scene, self._begun, self._team, self._outside = scene, begun, team, outside
        self._signals = [signal for one in self.controllers for signal in one.inputs]
        self._place = {id(signal): k for k, signal in enumerate(self._signals)}
        self._rows = [rows_of(scene, signal) for signal in self._signals]
        self._refuse_lost()
        self._next = np.zeros(len(self.controllers), np.int64)
        self._values = np.array([float(signal.initial) for signal in self._signals])
        self._states = [one.first_state for one in self.controllers]
        self._log: list[list[_Sample]] = [[] for _ in self.controllers]
        self._before = self._values.copy()
        self._last: dict[int, tuple[tuple[object, ...], tuple[FloatArray, FloatArray]]] = {}

    def _refuse_lost(self) -> None:
        for states in self._scene.index.states.values():
            for signal in states.inputs:
                if id(signal) in self._place:
                    raise SceneError(f"the signal {signal.name!r} is set by {states.what} already, and by a controller")
        measured = [m for one in self.controllers for m in one.measured if isinstance(m, Signal)]
        for one in self.controllers:
            for signal in one.inputs:
                if not self._rows[self._place[id(signal)]] and not any(signal is m for m in measured):
                    raise SceneError(
                        f"{one.what}: no load of the scene has the signal {signal.name!r}; give it one, as "
                        "scene.add_force(fm.force.JointTorque(joint, signal))"
                    )
        for m in measured:
            if id(m) not in self._place and id(m) not in self._outside:
                raise SceneError(f"signal {m.name!r} is measured, and no controller sets it, nor a stepper's input")

    def instant(self, k: int) -> float:
        """When (s) the next sample of controller k is."""
        one = self.controllers[k]
        return self._begun + (float(one.offset) + int(self._next[k]) * float(one.period))

    def following(self, *others: float) -> float:
        """The next sample (s) of any controller; exactly one of ``others`` where these differ by round-off alone."""
        first = min(self.instant(k) for k in range(len(self.controllers)))
        return next((other for other in others if _is_same(other, first, self._begun)), first)

    def take(self, t: float, scene: CompiledScene, now: Instant) -> bool:
        """Take all samples that are due at t (s) and set their signals; whether there were any.  Collective.

        Raises:
            SceneError: a measurement or a law failed on some rank; the message names controller and time.
        """
        due = [k for k in range(len(self.controllers)) if self._is_due(k, t)]
        answers = [self._answer(k, now) for k in due]
        for k, sample in zip(due, answers, strict=True):
            first = self._first_input(k)
            self._values[first : first + len(sample.inputs)] = sample.inputs
            self._states[k] = sample.state
            self._next[k] += 1
            self._log[k].append(_Sample(t, sample.measured, sample.inputs, sample.state))
        if due:
            self.write(scene)
        return bool(due)

    def _is_due(self, k: int, t: float) -> bool:
        instant = self.instant(k)
        return instant <= t or _is_same(instant, t, self._begun)

    def _answer(self, k: int, now: Instant) -> _Sample:
        """What controller k does now; asked once of the same state, however often a step is taken again."""
        one, t = self.controllers[k], self.instant(k)
        state, error = self._states[k], None
        measured: FloatArray = np.zeros(0)
        inputs: FloatArray = np.full(len(one.inputs), np.nan)
        following = state
        try:
            y = [self._measured(m, now) for m in one.measured]
            measured = np.concatenate([np.zeros(0), *y])
            key = (t, measured.tobytes(), state.tobytes())
            known = self._last.get(k)
            inputs, following = known[1] if known is not None and known[0] == key else one.answer(t, y, state)
            self._last[k] = key, (inputs, following)
        except Exception as reason:  # noqa: BLE001  (a user's function: any error, told below)
            error = SceneError(f"{one.what} at t = {t:g} s: {_told(reason)}")
            error.__cause__ = reason
        self._team.fail(error)
        if self._team.size > 1:
            agreed = self._team.agree(np.concatenate([inputs, following.ravel()]))
            inputs, following = agreed[: len(inputs)], agreed[len(inputs) :].reshape(following.shape)
        return _Sample(t, measured, inputs, following)

    def _measured(self, measurement: Measurement, now: Instant) -> FloatArray:
        if isinstance(measurement, Signal):
            outside = self._outside.get(id(measurement))
            return self._values[[self._place[id(measurement)]]] if outside is None else np.array([outside(now.t)])
        return measure(measurement, now)

    def _first_input(self, k: int) -> int:
        return sum(len(one.inputs) for one in self.controllers[:k])

    def write(self, scene: CompiledScene) -> None:
        """Write the signals' values where kernels read them."""
        for rows, value in zip(self._rows, self._values, strict=True):
            for row in rows:
                scene.plan.time_data[constant_place(scene.plan, row)] = value

    def forget(self) -> None:
        """Let go of all samples but the last of each controller."""
        for log in self._log:
            del log[:-1]

    def snapshot(self) -> SamplingMemory:
        """A copy of the memory."""
        states = np.concatenate([np.zeros(0), *(state.ravel() for state in self._states)])
        taken = tuple(len(log) for log in self._log)
        return SamplingMemory(code_of(self.controllers), self._next.copy(), self._values.copy(), states, taken)

    def restore(self, memory: SamplingMemory, scene: CompiledScene) -> None:
        """Go back to a snapshot of this run."""
        self._next[:], self._values[:] = memory.next, memory.values
        first = 0
        for k, state in enumerate(self._states):
            self._states[k] = memory.states[first : first + state.size].reshape(state.shape).copy()
            first += state.size
        for log, count in zip(self._log, memory.taken, strict=True):
            del log[count:]
        self.write(scene)

    def resume(self, memory: SamplingMemory, scene: CompiledScene) -> None:
        """Go on from a checkpoint made with these controllers.

        Raises:
            RecordError: it is damaged.
        """
        sizes = len(self._next), len(self._values), sum(state.size for state in self._states)
        if tuple(len(part) for part in (memory.next, memory.values, memory.states)) != sizes:
            raise RecordError("the checkpoint is damaged: what controllers remember has another size")
        self.restore(replace(memory, taken=(0,) * len(self._log)), scene)
        self._before = self._values.copy()

    def samples(self, *, since: float = -np.inf) -> tuple[ControllerSamples, ...]:
        """The samples of each controller in this run, or from a time (s) on."""
        found = []
        for k, one in enumerate(self.controllers):
            begin, first = bisect_left(self._log[k], since, key=lambda sample: sample.t), self._first_input(k)
            log = self._log[k][begin:]
            inputs = slice(first, first + len(one.inputs))
            t = np.array([sample.t for sample in log])
            measured, given, states = (
                np.array([getattr(sample, part).ravel() for sample in log]).reshape(len(log), -1)
                if log
                else np.zeros((0, size))
                for part, size in (("measured", 0), ("inputs", len(one.inputs)), ("state", one.first_state.size))
            )
            before = self._log[k][begin - 1].inputs if begin else self._before[inputs].copy()
            rows = tuple(self._rows[inputs])
            found.append(ControllerSamples(one.name, t, measured, given, states, before, rows))
        return tuple(found)


def _told(reason: Exception) -> str:
    """An error in words; of the package's own the message alone."""
    return str(reason) if isinstance(reason, SceneError) else f"{type(reason).__name__}: {reason}"


def _is_same(a: float, b: float, begun: float) -> bool:
    """Whether instants (s) differ by round-off alone; that of what has not begun is infinite, and like no other."""
    return math.isfinite(a - b) and abs(a - b) <= _SAME * math.ulp(max(abs(a), abs(b), abs(begun)))


def rows_of(scene: CompiledScene, signal: Signal) -> tuple[int, ...]:
    """The rows of ``Plan.times`` that have a signal."""
    return tuple(k for k, row in enumerate(scene.time_rows) if row.signal is signal)


def code_of(controllers: Sequence[Controller]) -> str:
    """Tells controllers from others; of none empty."""
    return "; ".join(one.code for one in controllers)


def with_own_signals(start: Start) -> Start:
    """The start of a machine with functions of time of its own, which a run may write to."""
    own = start.unreduced.plan.time_data.copy()
    scene, unreduced = (replace(one, plan=one.plan.replace(time_data=own)) for one in (start.scene, start.unreduced))
    return replace(start, scene=scene, unreduced=unreduced)


def with_samples(scene: CompiledScene, samples: Sequence[ControllerSamples]) -> CompiledScene:
    """The scene with the inputs that were held, as steps just after each sample."""
    steps = {}
    for one in samples:
        for values, before, rows in zip(one.inputs.T, one.before, one.rows, strict=True):
            begins = np.nextafter(one.t, np.inf)
            first, last = (begins[0] - 1.0, begins[-1] + 1.0) if len(begins) else (0.0, 1.0)
            data = np.concatenate([[1.0], [first], begins, [last], [before], values])
            steps.update(dict.fromkeys(rows, data))
    return with_signals(scene, steps) if steps else scene
