"""Functions of time that a scene may hold, as data the kernels read or functions they call."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_truth, numbers
from flexmbd.multibody.functions.compiled_function import Compiled, Signature, checked_breaks
from flexmbd.multibody.functions.signal import Signal
from flexmbd.multibody.functions.spline_table import Table, is_polynomial, spline
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.fingerprint import fingerprint

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Sine:
    """offset + amplitude sin(omega t + phase); omega in rad/s, phase in rad."""

    amplitude: float
    omega: float
    phase: float = 0.0
    offset: float = 0.0


@checked()
@dataclass(frozen=True, eq=False)
class Motion:
    """A prescribed motion by three functions made by ``flexmbd.compiled``.

    Raises:
        SceneError: one is no such function.
    """

    value: Compiled
    rate: Compiled
    acceleration: Compiled


@dataclass(frozen=True, eq=False)
class Piecewise:
    """A function that is smooth in time but for its breaks, at which its value or slope may jump.

    Steps end on each break exactly.  What a step needs there is asked for just before it, what the next one begins
    with just after, each by a few units of round-off of the times simulated.

    Attributes:
        function: of time, or a Python law or force of the state wherever one may stand.
        breaks: instants (s).

    Raises:
        SceneError: the breaks are not finite instants.
    """

    function: Any
    breaks: ArrayLike

    def __post_init__(self) -> None:
        checked_breaks(self.breaks, "Piecewise")

    def __call__(self, *arguments: Any) -> Any:
        """The function's own answer."""
        return self.function(*arguments)


#: Types that serve as a function of time.
TimeFunction = Union[
    float, Sine, Table, "PPoly", Compiled, Motion, Piecewise, Signal, Callable[[float], Any]
]


@dataclass(frozen=True, eq=False)
class TimeRow:
    """One function of time as the plan holds it.

    Attributes:
        kind: TIME_* code.
        data: numbers for the kernel.
        count: number of pieces of a piecewise polynomial.
        addresses: value, rate, acceleration of compiled functions, 0 where absent.
        call: the Python callable of TIME_PYTHON, else None.
        text: how ``explain`` calls it.
        code: digest of a user's function (see ``fingerprint``).
        motion: whether it prescribes a motion.
        breaks: (k,) s, declared.
        signal: the signal of which the row holds the value; None of functions of time.
    """

    kind: int
    data: FloatArray
    count: int
    addresses: tuple[int, int, int]
    call: Callable[[float], Any] | None
    text: str
    code: str = ""
    motion: bool = False
    breaks: FloatArray = field(default_factory=lambda: np.zeros(0))
    signal: Signal | None = None

    @property
    def has_pieces(self) -> bool:
        """Whether it is a polynomial of several pieces, which may have breaks of their own."""
        return self.kind == kinds.TIME_PIECEWISE and self.count > 1

    @property
    def is_users(self) -> bool:
        """Whether it is a function that a user wrote."""
        return self.kind in (kinds.TIME_COMPILED, kinds.TIME_PYTHON)


def as_row(function: TimeFunction, what: str, *, motion: bool) -> TimeRow:
    """Translate a user's function of time into a ``TimeRow``.

    Args:
        function: the user's function of time.
        what: what it is for, in messages.
        motion: whether rate and acceleration are needed as well.

    Raises:
        SceneError: it is of no known kind, not finite, or lacks the derivatives.
    """
    declared: list[FloatArray] = []
    while isinstance(function, Piecewise):
        declared.append(checked_breaks(function.breaks, what))
        function = function.function
    if isinstance(function, Motion):
        parts = tuple(part.as_it_is_now() for part in (function.value, function.rate, function.acceleration))
        function = Motion(*parts)
    elif isinstance(function, Compiled):
        function = function.as_it_is_now()
        parts = (function,)
    else:
        parts = ()
    declared += [part.breaks for part in parts]
    breaks = np.unique(np.concatenate([np.zeros(0), *declared]))
    return replace(_as_row(function, what, motion=motion), motion=motion, breaks=breaks)


def load_row(function: TimeFunction, what: str, *, rate: bool) -> TimeRow:
    """`as_row` of a load, which moves no coordinate, with its derivatives where ``rate``."""
    return replace(as_row(function, what, motion=rate), motion=False)


def _as_row(function: TimeFunction, what: str, *, motion: bool) -> TimeRow:
    none = (0, 0, 0)
    if isinstance(function, Signal):
        if motion:
            raise SceneError(
                f"{what}: signal {function.name!r} jumps when it is set, and the motion would jump with it; let the "
                "signal be the value of a load, as fm.force.JointTorque(joint, signal)"
            )
        constant = np.array([1.0, 0.0, 1.0, float(function.initial)])
        text = f"signal {function.name!r}, {function.initial:g} until it is set"
        return TimeRow(kinds.TIME_PIECEWISE, constant, 1, none, None, text, signal=function)
    if isinstance(function, (int, float, np.integer, np.floating)) and not is_truth(function):
        value = float(function)
        if not np.isfinite(value):
            raise SceneError(f"{what}: {value} is not a finite number")
        return TimeRow(
            kinds.TIME_PIECEWISE, np.array([1.0, 0.0, 1.0, value]), 1, none, None, f"{value:g}"
        )
    if isinstance(function, Sine):
        values = numbers([function.offset, function.amplitude, function.omega, function.phase])
        if values.shape != (4,) or not np.isfinite(values).all():
            raise SceneError(f"{what}: a sine takes finite numbers, got {function!r}")
        return TimeRow(kinds.TIME_SINE, values, 0, none, None, "sine")
    if isinstance(function, Table):
        function = spline(function, what)
    if is_polynomial(function):
        return _piecewise(function, what)
    if isinstance(function, Motion):
        addresses = (
            function.value.address,
            function.rate.address,
            function.acceleration.address,
        )
        text = f"compiled {function.value.name}"
        code = function.value.code + function.rate.code + function.acceleration.code
        return TimeRow(kinds.TIME_COMPILED, np.zeros(0), 0, addresses, None, text, code)
    if isinstance(function, Compiled):
        if function.signature is not Signature.TIME:
            raise SceneError(f"{what}: {function.name} takes {function.signature.value} arguments, not the time alone")
        if motion:
            raise SceneError(
                f"{what}: a prescribed motion needs rate and acceleration as well; give "
                "flexmbd.Motion(value, rate, acceleration) of three compiled functions"
            )
        return TimeRow(
            kinds.TIME_COMPILED,
            np.zeros(0),
            0,
            (function.address, 0, 0),
            None,
            f"compiled {function.name}",
            function.code,
        )
    if callable(function):
        return TimeRow(kinds.TIME_PYTHON, np.zeros(0), 0, none, function, "Python callable", fingerprint(function))
    raise SceneError(
        f"{what}: {type(function).__name__} is not a function of time; give a number, "
        "flexmbd.Table, flexmbd.Sine, a scipy PPoly, a compiled function or a callable"
    )


def _piecewise(poly: PPoly, what: str) -> TimeRow:
    if poly.c.ndim != 2 or not (np.isfinite(poly.c).all() and np.isfinite(poly.x).all()):
        raise SceneError(f"{what}: a piecewise polynomial must be scalar and finite")
    if not (np.diff(poly.x) > 0.0).all():
        raise SceneError(f"{what}: a piecewise polynomial needs ascending breakpoints")
    if poly.extrapolate is not True:
        raise SceneError(
            f"{what}: a piecewise polynomial goes on with its end pieces, and this one has extrapolate="
            f"{poly.extrapolate!r}; make it with extrapolate=True, with all the pieces that are needed"
        )
    order, pieces = poly.c.shape
    data = np.concatenate([[float(order)], poly.x, poly.c.T.ravel()])
    return TimeRow(
        kinds.TIME_PIECEWISE, data, pieces, (0, 0, 0), None, f"piecewise polynomial ({pieces})"
    )


def answered(answer: Any, shape: tuple[int, ...]) -> FloatArray:
    """The result of a user's function, as an array.

    Raises:
        SceneError: another shape than ``shape``, or not finite.
    """
    values = np.asarray(answer, dtype=np.float64)
    if values.shape != shape:
        wanted = f"shape {shape}" if shape else "one number"
        raise SceneError(f"it gave shape {values.shape}, not {wanted}")
    if not np.isfinite(values).all():
        raise SceneError(f"it gave {values}, not finite")
    return values


def call_python(row: TimeRow, t: float, *, motion: bool) -> tuple[float, float, float]:
    """Value, rate and acceleration that a Python function of time gives; (value, 0, 0) unless it is a motion.

    Raises:
        SceneError: wrong shape or not finite.
    """
    if row.call is None:
        raise SceneError("it is not a Python callable")
    values = answered(row.call(t), (3,) if motion else ())
    if motion:
        return float(values[0]), float(values[1]), float(values[2])
    return float(values), 0.0, 0.0
