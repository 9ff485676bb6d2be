"""Functions of time that a scene may hold, as data the kernels read or functions they call."""

from __future__ import annotations

import inspect
import pickle
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Union, overload

import numpy as np
from numba import carray, cfunc, njit, types
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

from flexmbd.errors import SceneError, TableWarning
from flexmbd.given import is_truth, numbers, refuse_no_truth
from flexmbd.multibody.functions.fingerprint import fingerprint
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.compiling import pickled_function

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Sine:
    """offset + amplitude sin(omega t + phase); omega in rad/s, phase in rad."""

    amplitude: float
    omega: float
    phase: float = 0.0
    offset: float = 0.0


class Beyond(Enum):
    """How a table goes on before its first point and after its last.

    Attributes:
        HOLD: it keeps the first and the last value.
        LINEAR: it goes on straight, with the slopes that it has there.
        EXTRAPOLATE: its first and last cubics go on, as far from the points as they may lead.
    """

    HOLD = "hold"
    LINEAR = "linear"
    EXTRAPOLATE = "extrapolate"


@dataclass(frozen=True, eq=False)
class Table:
    """A cubic spline through the points (t, y); t in s, ascending.

    A spline's second derivative is continuous, as a motion's should be, but beside a jump or a pulse it swings over; a
    ``TableWarning`` tells where it does so by more than the points' whole range.

    Attributes:
        t: (n,) s.
        y: (n,) values.
        monotone: stay between neighbouring points, and level between equal ones (Fritsch and Butland 1984,
            doi:10.1137/0905021); then only the first derivative is continuous, and a smooth function is met less well.
        beyond: what it is before the first point and after the last. Held, its slope there is zero: a motion whose
            points do not end at rest stops dead at the last of them, and the machine takes the impulse.
    """

    t: ArrayLike
    y: ArrayLike
    monotone: bool = field(default=False, kw_only=True)
    beyond: Beyond = field(default=Beyond.HOLD, kw_only=True)


class Signature(Enum):
    """Signatures of compiled functions, by the number of their arguments."""

    TIME = 1
    LAW = 3
    STATE = 4


@dataclass(frozen=True, eq=False)
class Compiled:
    """A compiled function; made by ``flexmbd.compiled``.  It is smooth in time between its ``breaks`` (s)."""

    address: int
    keep: Any
    name: str
    signature: Signature = Signature.TIME
    code: str = ""  # tells it from others where addresses change from process to process
    breaks: FloatArray = field(default_factory=lambda: np.zeros(0))
    source: Any = None

    def __deepcopy__(self, memo: object) -> Compiled:
        """Itself: it never changes."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """The Python function, by value, to be compiled where it is unpickled."""
        return _compiled_again, (pickled_function(self.source), self.breaks)


def _compiled_again(function: bytes, breaks: FloatArray) -> Compiled:
    return compiled(pickle.loads(function), breaks=breaks)


@dataclass(frozen=True, eq=False)
class Motion:
    """A prescribed motion by three functions made by ``flexmbd.compiled``."""

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
TimeFunction = Union[  # noqa: UP007  (a plain | fails at run time: scipy types are unknown to it)
    float, Sine, Table, PPoly, Compiled, Motion, Piecewise, Callable[[float], Any]
]


def checked_breaks(breaks: ArrayLike, what: str) -> FloatArray:
    """Declared breaks (k,), ascending; SceneError unless they are finite instants."""
    try:
        values = np.asarray(breaks, dtype=np.float64)
    except (TypeError, ValueError) as reason:
        raise SceneError(f"{what}: breaks must be instants (s), got {breaks!r}") from reason
    if values.ndim != 1 or not np.isfinite(values).all():
        raise SceneError(f"{what}: breaks must be a list of finite instants (s), got {breaks!r}")
    return np.unique(values)


@overload
def compiled(function: Callable[..., Any], *, breaks: ArrayLike = ()) -> Compiled: ...


@overload
def compiled(function: None = None, *, breaks: ArrayLike = ()) -> Callable[[Callable[..., Any]], Compiled]: ...


def compiled(
    function: Callable[..., Any] | None = None, *, breaks: ArrayLike = ()
) -> Compiled | Callable[[Callable[..., Any]], Compiled]:
    """Compile a function with numba, to be called inside the step without Python.

    ``f(t) -> float`` is a function of time; ``f(t, beta, rate) -> float`` a law on a joint coordinate;
    ``f(t, x, v, out)`` writes the generalised forces (nv,) of the whole state into ``out``, which comes as zeros.
    Divisions by zero give infinities, as in numpy: an exception could not leave the step, and
    numba would hand back a number in its place.

    Args:
        function: what to compile; where it is left out, as in ``@fm.compiled(breaks=[0.5])``, what follows.
        breaks: instants (s) at which its value or slope jumps, as of ``flexmbd.Piecewise``.

    Raises:
        SceneError: it takes another number of arguments, or breaks are not instants.
    """
    if function is None:
        return lambda following: compiled(following, breaks=breaks)
    known = checked_breaks(breaks, function.__name__)
    count = len(inspect.signature(function).parameters)
    if count not in {s.value for s in Signature}:
        raise SceneError(
            f"{function.__name__} takes {count} arguments; a compiled function is f(t), f(t, beta, rate) or "
            "f(t, x, v, out)"
        )
    signature = Signature(count)
    if signature is Signature.STATE:
        pointer = _state_pointer(njit(error_model="numpy")(function))
    else:
        pointer = cfunc(types.float64(*[types.float64] * count), error_model="numpy")(function)
    return Compiled(int(pointer.address), pointer, function.__name__, signature, fingerprint(function), known, function)


def _state_pointer(inner: Any) -> Any:
    """The function of arrays behind a C function of their sizes and addresses."""
    double = types.CPointer(types.float64)
    kind = types.void(types.float64, types.int64, types.int64, double, double, double)

    def outer(t, nx, nv, x, v, out):  # type: ignore[no-untyped-def]
        force = carray(out, (nv,))
        for k in range(nv):
            force[k] = 0.0
        inner(t, carray(x, (nx,)), carray(v, (nv,)), force)

    return cfunc(kind, error_model="numpy")(outer)


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


def as_row(function: TimeFunction, what: str, *, motion: bool) -> TimeRow:
    """Translate what a user gave into a ``TimeRow``.

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
    parts = (function.value, function.rate, function.acceleration) if isinstance(function, Motion) else (function,)
    declared += [part.breaks for part in parts if isinstance(part, Compiled)]
    breaks = np.unique(np.concatenate([np.zeros(0), *declared]))
    return replace(_as_row(function, what, motion=motion), motion=motion, breaks=breaks)


def _as_row(function: TimeFunction, what: str, *, motion: bool) -> TimeRow:
    none = (0, 0, 0)
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
    if isinstance(function, PPoly):
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


def spline(table: Table, what: str) -> PPoly:
    """A table as a piecewise cubic whose end pieces go on as the table is to.

    Warns with a TableWarning where the cubics leave the range of the points by more than that range.

    Raises:
        SceneError: the table is none.
    """
    t, y = numbers(table.t), numbers(table.y)
    if t.ndim != 1 or t.shape != y.shape or len(t) < 2:
        raise SceneError(f"{what}: a table needs numbers t and y, of one length, at least 2")
    if not (np.isfinite(t).all() and np.isfinite(y).all() and (np.diff(t) > 0.0).all()):
        raise SceneError(f"{what}: a table needs finite values and strictly ascending t")
    if not isinstance(table.beyond, Beyond):
        raise SceneError(
            f"{what}: a table's beyond must be fm.Beyond.HOLD, LINEAR or EXTRAPOLATE, got {table.beyond!r}"
        )
    refuse_no_truth(monotone=table.monotone)
    inner = PchipInterpolator(t, y) if table.monotone else CubicSpline(t, y)
    _warn_of_swings(inner, t, y, what)
    if table.beyond is Beyond.EXTRAPOLATE:
        return inner
    # straight pieces at both ends, as wide as the table; the first begins where the line from its end is there
    width = t[-1] - t[0]
    ends = np.zeros((len(inner.c), 2))
    if table.beyond is Beyond.LINEAR:
        ends[-2] = inner(t[[0, -1]], 1)
    ends[-1] = y[[0, -1]] - ends[-2] * [width, 0.0]
    x = np.concatenate([[t[0] - width], t, [t[-1] + width]])
    return PPoly(np.column_stack([ends[:, 0], inner.c, ends[:, 1]]), x)


def _warn_of_swings(inner: PPoly, t: FloatArray, y: FloatArray, what: str) -> None:
    turns = inner.derivative().roots(discontinuity=False, extrapolate=False)
    turns = turns[np.isfinite(turns)]  # a piece that is constant has them everywhere
    if len(turns) == 0:
        return
    values = inner(turns)
    low, high = y.min(), y.max()
    beyond = np.maximum(values - high, low - values)
    worst = int(np.argmax(beyond))
    # by less than the points' own range a smooth function's true extremes may lie outside of them; by more, the cubics
    # make more of the curve than the points do
    if beyond[worst] > high - low:
        warnings.warn(
            f"{what}: the cubic spline through its points, which lie between {low:.6g} and {high:.6g}, swings to "
            f"{values[worst]:.6g} at {turns[worst]:.6g}; fm.Table(t, y, monotone=True) stays between neighbours",
            TableWarning,
            stacklevel=2,
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


def checked(answer: Any, shape: tuple[int, ...]) -> FloatArray:
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
    values = checked(row.call(t), (3,) if motion else ())
    if motion:
        return float(values[0]), float(values[1]), float(values[2])
    return float(values), 0.0, 0.0
