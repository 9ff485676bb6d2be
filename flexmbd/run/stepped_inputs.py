"""Inputs of a machine that is stepped from outside: signals, held over a step or linear in it.

For the stepped machine alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers, refuse_no_name, refuse_other, shown
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.kernels.reading.force_tables import constant_place, straight_places
from flexmbd.multibody.plan.compiled_scene import CompiledScene, with_signals
from flexmbd.multibody.start.consistent_start import Start
from flexmbd.run.controller import Controller
from flexmbd.run.sampling import rows_of, with_own_signals

FloatArray = NDArray[np.float64]
#: Values of inputs: all in their order, one number of a single one, or some by their names.
InputValues: TypeAlias = Mapping[str, float] | ArrayLike


@dataclass(frozen=True)
class InputMemory:
    """The memory of inputs: their values at the end of the last step, and of linear ones the straight lines.

    Attributes:
        values: at the end of the last step.
        begin: when (s) the lines begin.
        first: their values there.
        slopes: 1/s.
    """

    values: tuple[float, ...]
    begin: float
    first: tuple[float, ...]
    slopes: tuple[float, ...]


def named_inputs(given: Sequence[Signal] | Mapping[str, Signal]) -> dict[str, Signal]:
    """The signals by the names that they are set by.

    Raises:
        SceneError: something else is given, a signal twice, or two of one name in a list.
    """
    refuse_other(given, (Sequence, Mapping), "inputs", wanted='a list of signals, or a mapping, {"push": signal}')
    for signal in given.values() if isinstance(given, Mapping) else given:
        wanted = 'a signal, fm.Signal("push"), that stands as the value of a load'
        refuse_other(signal, Signal, "an input", wanted=wanted)
    pairs = list(given.items() if isinstance(given, Mapping) else ((signal.name, signal) for signal in given))
    for name, _ in pairs:
        refuse_no_name(name, "an input's name")
    named = dict(pairs)
    if len({id(signal) for signal in named.values()}) < len(pairs):
        raise SceneError(
            "inputs must be different signals of different names; two of one name go into a mapping, "
            '{"left": one, "right": other}'
        )
    return named


def refuse_no_inputs(scene: CompiledScene, named: Mapping[str, Signal], controllers: Sequence[Controller]) -> None:
    """Raise SceneError where a signal is in no load of the scene, or is set by something in it."""
    ruled = [(signal, one.what) for one in controllers for signal in one.inputs]
    ruled += [(signal, states.what) for states in scene.index.states.values() for signal in states.inputs]
    measured = [one for controller in controllers for one in controller.measured]
    for name, signal in named.items():
        for other, what in ruled:
            if other is signal:
                raise SceneError(f"input {name!r}: its signal is set by {what} already")
        if not rows_of(scene, signal) and not any(one is signal for one in measured):
            raise SceneError(
                f"input {name!r}: no load of the scene has the signal {signal.name!r}, and no controller measures it; "
                "give it one, as scene.add_force(fm.force.JointTorque(joint, signal))"
            )


def with_inputs(start: Start, named: Mapping[str, Signal], *, linear: bool) -> Start:
    """The start of a machine with functions of time of its own, of which linear inputs are straight lines."""
    if not linear or not named:
        return with_own_signals(start)
    lines = {
        row: np.array([2.0, 0.0, 1.0, 0.0, float(signal.initial)])
        for signal in named.values()
        for row in rows_of(start.unreduced, signal)
    }
    unreduced = with_signals(start.unreduced, lines)
    scene = with_signals(start.scene, lines)
    shared = replace(scene, plan=scene.plan.replace(time_data=unreduced.plan.time_data))
    return replace(start, scene=shared, unreduced=unreduced)


class SteppedInputs:
    """The inputs of one stepped machine, and where kernels read them.

    Attributes:
        names: of the inputs, in order.
        values: at the end of the last step.
    """

    def __init__(self, named: Mapping[str, Signal], *, linear: bool) -> None:
        self._signals = tuple(named.values())
        self.names = tuple(named)
        self.values = tuple(float(signal.initial) for signal in named.values())
        self._linear = linear
        self._slopes, self._begin, self._first = (0.0,) * len(self.names), 0.0, self.values
        self._data: FloatArray = np.zeros(0)
        self._held: list[tuple[int, int]] = []
        self._lines: list[tuple[int, tuple[int, int, int]]] = []

    def bind(self, scene: CompiledScene) -> None:
        """Find where kernels read the inputs in a scene with functions of time of its own."""
        self._data = scene.plan.time_data
        rows = [(k, row) for k, signal in enumerate(self._signals) for row in rows_of(scene, signal)]
        if self._linear:
            self._lines = [(k, straight_places(scene.plan, row)) for k, row in rows]
        else:
            self._held = [(k, constant_place(scene.plan, row)) for k, row in rows]

    @property
    def readers(self) -> dict[int, Callable[[float], float]]:
        """By the ids of the signals their values at a time (s) within the step at hand, for controllers."""
        return {id(signal): partial(self._value, k) for k, signal in enumerate(self._signals)}

    def _value(self, k: int, t: float) -> float:
        return self._first[k] + self._slopes[k] * (t - self._begin) if self._linear else self.values[k]

    def set(self, t: float, t_end: float, given: InputValues | None) -> bool:
        """Set the inputs of a step (s); whether loads jump, or their slopes, where it begins.

        Raises:
            SceneError: an unknown input, or no finite numbers.
        """
        if given is None:
            values = self.values
        elif isinstance(given, float) and len(self.names) == 1 and math.isfinite(given):
            values = (float(given),)  # numpy's are floats, too
        else:
            values = self.taken(given)
        before, self.values = self.values, values
        if not self._linear:
            changes = values != before
        else:
            span = t_end - t
            slopes = tuple([(new - old) / span for new, old in zip(values, before, strict=True)])
            changes = slopes != self._slopes
            if changes:
                self._begin, self._first, self._slopes = t, before, slopes
        if changes:
            self._write()
        return changes

    def _write(self) -> None:
        """Write what kernels read."""
        for k, place in self._held:
            self._data[place] = self.values[k]
        for k, (begin, slope, first) in self._lines:
            self._data[begin], self._data[slope], self._data[first] = self._begin, self._slopes[k], self._first[k]

    def taken(self, given: InputValues | None) -> tuple[float, ...]:
        """Values as a user gives them, in order; None: as they are.

        Raises:
            SceneError: an unknown input, or no finite numbers.
        """
        if given is None:
            return self.values
        if isinstance(given, Mapping):
            values = dict(zip(self.names, self.values, strict=True))
            for name, value in given.items():
                if name not in values:
                    there = ", ".join(map(repr, self.names)) or "none: scene.stepper(inputs=[...]) names them"
                    raise SceneError(f"the stepper has no input {name!r:.60}; it has {there}")
                found = numbers(value)
                if found.shape != () or not math.isfinite(found):
                    raise SceneError(f"input {name!r} must be one finite number, got {shown(value)}")
                values[name] = float(found)
            return tuple(values.values())
        if type(given) is np.ndarray and given.dtype == np.float64:
            found = given
        else:
            found = numbers(given)
        if found.ndim == 0 and len(self.names) == 1:
            found = found.reshape(1)
        if found.shape != (len(self.names),) or not np.isfinite(found).all():
            raise SceneError(
                f"the inputs of a step must be {len(self.names)} finite numbers, of "
                f"{', '.join(map(repr, self.names)) or 'no input'}, or some by their names, got {shown(given)}"
            )
        return tuple(map(float, found))

    def memory(self) -> InputMemory:
        """The memory of the inputs."""
        return InputMemory(self.values, self._begin, self._first, self._slopes)

    def restore(self, memory: InputMemory) -> None:
        """Go back to an earlier memory."""
        self.values, self._begin, self._first, self._slopes = (
            memory.values, memory.begin, memory.first, memory.slopes
        )  # fmt: skip
        self._write()
