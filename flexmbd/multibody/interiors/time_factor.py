"""Functions of time that an interior evaluates by itself, as those of its loads."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np

from flexmbd.errors import SceneError, described
from flexmbd.given import checked
from flexmbd.multibody.bodies.continuum_body import Interior
from flexmbd.multibody.functions.compiled_function import Compiled
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.functions.spline_table import Table, is_polynomial, spline
from flexmbd.multibody.functions.time_function import Motion, Piecewise, Sine, TimeFunction, answered, as_row


class TimeFactor:
    """A function of time by its value: a number, data, a compiled function or a Python callable.

    Attributes:
        function: as it was given.
        what: its purpose, for messages.
    """

    def __init__(self, function: TimeFunction, what: str) -> None:
        """Check it.

        Raises:
            SceneError: it is no function of time, or not finite.
        """
        if isinstance(function, Signal):
            raise SceneError(
                f"{what}: a signal, as of controllers, states and circuits, reaches no load inside a body with "
                "history; give a number or a function of time, or reduce the body (craig_bampton)"
            )
        as_row(function, what, motion=False)
        self.function, self.what = function, what
        self._call = _callable(function, what)

    @checked()
    def at(self, t: float) -> float:
        """Its value at t (s).

        Raises:
            SceneError: t is no time, or it failed, or gives no finite number; the message names it and the time.
        """
        try:
            return float(answered(self._call(t), ()))
        except Exception as reason:
            raise SceneError(f"{self.what}: at t = {t:g} s: {described(reason)}") from reason


def _callable(function: Any, what: str) -> Callable[[float], Any]:
    while isinstance(function, Piecewise):
        function = function.function
    if isinstance(function, Table):
        function = spline(function, what)
    if isinstance(function, Sine):
        sine = function
        return lambda t: sine.offset + sine.amplitude * np.sin(sine.omega * t + sine.phase)
    if isinstance(function, Motion):
        function = function.value
    if isinstance(function, Compiled):
        call: Callable[[float], Any] = function.source
        return call
    if is_polynomial(function):
        return lambda t: function(t).item()
    if callable(function):
        given: Callable[[float], Any] = function
        return given
    value = float(function)
    return lambda t: value


@runtime_checkable
class LoadedInterior(Interior, Protocol):
    """An interior with loads of its own, whose functions of time the machine is to know: steps end on their breaks."""

    @property
    def load_factors(self) -> tuple[TimeFactor, ...]:
        """One of each load."""
