"""Sampled controllers: their laws, measurements and inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number, numbers, refuse_other
from flexmbd.multibody.functions.linear_system import LinearSystem
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.kernels.base.fingerprint import fingerprint
from flexmbd.multibody.motion.instant import Instant
from flexmbd.multibody.motion.quantity import ORDERS, Output, Rotation

FloatArray = NDArray[np.float64]

#: What is measured: of fm.output a Position, Velocity or Acceleration; a signal; a function of the machine's Instant.
Measurement: TypeAlias = Output | Signal | Callable[[Instant], ArrayLike]


@dataclass(frozen=True, eq=False)
class Controller:
    """A control law that is called at equal times and whose outputs are held between them (zero-order hold).

    Made by ``System.add_controller``, which tells how each attribute is given.

    Attributes:
        step: the law.
        period: s between two samples.
        measurements: quantities that its law gets; of a mapping by its names.
        inputs: the signals that it sets.
        offset: s from the start of the simulation to the first sample.
        state: its first state, an array of any shape; None: it has none.
        name: in messages and results.

    Raises:
        SceneError: the period is not a positive time, the offset negative, or an argument not of its kind.
    """

    step: Callable[..., Any]
    period: float
    measurements: Sequence[Measurement] | Mapping[str, Measurement]
    inputs: Sequence[Signal]
    offset: float = 0.0
    state: ArrayLike | None = None
    name: str = "controller"

    def __post_init__(self) -> None:
        if not (is_number(self.period) and self.period > 0.0):
            raise SceneError(f"{self.what}: the period {self.period!r:.60} s must be positive and finite")
        if not (is_number(self.offset) and self.offset >= 0.0):
            raise SceneError(f"{self.what}: the offset {self.offset!r:.60} s must be finite and not negative")
        if not callable(self.step):
            raise SceneError(f"{self.what}: its step must be a function step(t, y), got {self.step!r:.60}")
        refuse_other(self.inputs, Sequence, f"{self.what}: inputs", wanted="a list of signals, [fm.Signal(...)]")
        for signal in self.inputs:
            refuse_other(signal, Signal, f"{self.what}: an input", wanted='a signal, fm.Signal("motor torque")')
        if not self.inputs or len({id(signal) for signal in self.inputs}) < len(self.inputs):
            raise SceneError(f"{self.what}: its inputs must be one signal or more, each once")
        wanted = "a list of quantities, or a mapping of names to them"
        refuse_other(self.measurements, (Sequence, Mapping), f"{self.what}: measurements", wanted=wanted)
        for measurement in self.measured:
            refuse_no_measurement(measurement, self.what)
        if self.state is not None and not np.isfinite(numbers(self.state)).all():
            raise SceneError(f"{self.what}: its state at first must be finite numbers, got {self.state!r:.60}")

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"controller {self.name!r}"

    @property
    def explained(self) -> str:
        """Its inputs and its period, in a line."""
        late = f", {self.offset:g} s late" if self.offset else ""
        sets = ", ".join(repr(signal.name) for signal in self.inputs)
        remembers = f", remembers {self.first_state.size} numbers" if self.state is not None else ""
        return f"{self.what}: sets {sets} every {self.period:g} s{late}{remembers}; steps end there, Python"

    @property
    def measured(self) -> tuple[Measurement, ...]:
        """Its measurements, without names."""
        given = self.measurements
        return tuple(given.values() if isinstance(given, Mapping) else given)

    @property
    def first_state(self) -> FloatArray:
        """Its first state; without entries where it has none."""
        return np.zeros(0) if self.state is None else numbers(self.state)

    @property
    def code(self) -> str:
        """Tells it from controllers of other laws, times or states."""
        told = f"{self.period!r} {self.offset!r} {self.first_state.shape} {[s.name for s in self.inputs]}"
        return f"{self.name} {told} {fingerprint(self.step)}"

    def answer(self, t: float, y: Sequence[FloatArray], state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The inputs (nu,) and the next state that the law gives for measurements at a time (s).

        Raises:
            SceneError: they have other shapes, or are not finite.
            Exception: whatever the law raises.
        """
        told: FloatArray | dict[str, Any] = np.concatenate([np.zeros(0), *y])
        if isinstance(self.measurements, Mapping):
            told = {name: one[0] if one.size == 1 else one for name, one in zip(self.measurements, y, strict=True)}
        if self.state is None:
            return _checked(self.step(t, told), (len(self.inputs),), "inputs"), state
        answer = self.step(t, told, state.copy())
        if not (isinstance(answer, tuple) and len(answer) == 2):
            raise SceneError("a controller with a state must return (inputs, next state)")
        return _checked(answer[0], (len(self.inputs),), "inputs"), _checked(answer[1], state.shape, "a state")


def _checked(answer: Any, shape: tuple[int, ...], what: str) -> FloatArray:
    """Finite numbers of a shape; one number counts as an array of one."""
    values = numbers(answer)
    if values.shape == () and shape == (1,) and np.ndim(answer) == 0:
        values = values.reshape(1)
    if values.shape != shape:
        raise SceneError(f"it gave {what} of shape {np.shape(answer)}, not {shape}")
    if not np.isfinite(values).all():
        raise SceneError(f"it gave {what} that are not finite: {values}")
    return values.copy()


def refuse_no_measurement(given: object, what: str) -> None:
    """Raise SceneError unless it can be measured."""
    if isinstance(given, Rotation):
        raise SceneError(
            f"{what}: fm.output.Rotation is of small rotations about a working point; measure with a function, "
            "lambda now: now.rotation(frame)"
        )
    if not (isinstance(given, Signal) or type(given) in ORDERS or (callable(given) and not isinstance(given, type))):
        raise SceneError(
            f"{what}: {given!r:.60} cannot be measured; give fm.output.Position, Velocity or Acceleration of a joint, "
            "a frame or a flexible body, a signal, or a function of the machine's fm.Instant"
        )


def linear_law(system: LinearSystem, period: float | None, what: str) -> tuple[Callable[..., Any], float]:
    """The law of a sampled linear system, and its period (s).

    Raises:
        SceneError: it is continuous, or has another period than is given, or none.
    """
    if system.period is None:
        raise SceneError(
            f"{what}: the linear system is continuous; sample it (scipy.signal.cont2discrete, control.sample_system), "
            "or solve it with the machine (scene.add_states)"
        )
    own = system.period or period
    if own is None or (period is not None and period != own):
        raise SceneError(f"{what}: the linear system is sampled every {system.period:g} s, and period is {period} s")
    return partial(_linear_step, system.A, system.B, system.C, system.D), own


def _linear_step(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, t: float, y: Any, state: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """One sample of a linear system."""
    told = np.concatenate([np.atleast_1d(one) for one in y.values()]) if isinstance(y, dict) else y
    if len(told) != B.shape[1]:
        raise SceneError(f"the linear system takes {B.shape[1]} measurements, got {len(told)}")
    return C @ state + D @ told, A @ state + B @ told
