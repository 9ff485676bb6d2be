"""Python callables called from inside a compiled step, through C function pointers.

The kernels know an address and call it, as they call compiled functions; ctypes takes the
interpreter's lock for the call.  An exception cannot leave the step: it is kept here, NaN is
handed back, and the flag tells the stepper to stop at once.

A signal's handler runs between any two of the interpreter's instructions and may raise, as that of Ctrl-C does, also
where the function that ctypes calls has not begun to look, or looks no longer.  ctypes then has nobody to pass the
exception on to and hands it to ``sys.unraisablehook``, where it is fetched back.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError, described
from flexmbd.multibody.functions.time_function import TimeRow, answered, call_python
from flexmbd.multibody.kernels.base import kinds
from flexmbd.multibody.kernels.base.fingerprint import fingerprint
from flexmbd.multibody.team import Alone, Team
from flexmbd.unraisable import taken_by

FloatArray = NDArray[np.float64]

_Double, _Whole = ctypes.c_double, ctypes.c_int64
_TimeThunk = ctypes.CFUNCTYPE(None, _Double, ctypes.POINTER(_Double))
_LawThunk = ctypes.CFUNCTYPE(_Double, _Double, _Double, _Double)
_StateThunk = ctypes.CFUNCTYPE(None, _Double, _Whole, _Whole, *[ctypes.c_void_p] * 3)

#: A law on a coordinate: f(t, beta, rate of beta) -> N or N m.
Law = Callable[[float, float, float], Any]
#: A force of the whole state: f(t, x (nx,), v (nv,)) -> generalised forces (nv,).
StateFunction = Callable[[float, FloatArray, FloatArray], Any]

#: State equations: f(t, z (n,), u (m,)) -> rates and outputs in one.
StateRates = Callable[[float, FloatArray, FloatArray], FloatArray]


class Callbacks:
    """The Python callables of one compiled scene, and the first error among them.

    Attributes:
        flag: (1,) int64, not zero once a user's function has failed; the plan holds it too.
        error: what a Python callable raised.
        codes: digests of users' laws and forces, compiled ones too (see ``fingerprint``).
        keep: compiled functions that were made for this scene alone, whose addresses live as long.
    """

    def __init__(self, team: Team) -> None:
        self.flag = np.zeros(1, np.int64)
        self.error: BaseException | None = None
        self.codes: list[str] = []
        self._where = ""
        self._team = team
        self._kept: list[Any] = []  # ctypes frees a thunk that nothing holds
        self.keep: list[Any] = []
        self._lost: BaseException | None = None

    def of_time(self, row: TimeRow, what: str, *, motion: bool) -> int:
        """Return the address of ``void f(double t, double out[3])`` for a function of time."""

        def thunk(t: float, out: Any) -> None:
            answer = self._agreed(
                lambda: np.array(call_python(row, t, motion=motion)), 3, lambda: f"{what} at t = {t:g} s"
            )
            for k in range(3):
                out[k] = answer[k]

        return self._keep(_TimeThunk, thunk)

    def of_law(self, law: Law, what: str) -> int:
        """Return the address of ``double f(double t, double beta, double rate)`` for a law on a coordinate."""
        self.codes.append(fingerprint(law))

        def thunk(t: float, beta: float, rate: float) -> float:
            answer = self._agreed(
                lambda: answered(law(t, beta, rate), ()).reshape(1), 1,
                lambda: f"{what} at t = {t:g} s, coordinate {beta:.9g}, rate {rate:.9g}",
            )
            return float(answer[0])

        return self._keep(_LawThunk, thunk)

    def of_state(self, function: StateFunction, what: str) -> int:
        """Return the address of ``void f(double t, int64 nx, int64 nv, double *x, double *v, double *out)``."""
        self.codes.append(fingerprint(function))

        def thunk(t: float, nx: int, nv: int, x: int, v: int, out: int) -> None:
            position, velocity = _view(x, nx).copy(), _view(v, nv).copy()

            def where() -> str:
                told = np.concatenate([_view(x, nx), _view(v, nv)])
                return f"{what} at t = {t:g} s, state (x, v) = {np.array2string(told, precision=6, threshold=12)}"

            _view(out, nv)[:] = self._agreed(lambda: answered(function(t, position, velocity), (nv,)), nv, where)

        return self._keep(_StateThunk, thunk)

    def of_states(self, equations: StateRates, what: str, size: int) -> int:
        """Return the address of ``void f(double t, int64 n, int64 m, double *z, double *u, double out[size])``."""

        def thunk(t: float, n: int, m: int, z: int, u: int, out: int) -> None:
            first, second = _view(z, n).copy(), _view(u, m).copy()
            answer = self._agreed(lambda: equations(t, first, second), size, lambda: f"{what} at t = {t:g} s")
            _view(out, size)[:] = answer

        return self._keep(_StateThunk, thunk)

    def beside(self) -> Callbacks:
        """For a scene of other numbers, which may run beside this one: with a flag of its own.

        This very object where Python callables take part, for they set its flag.
        """
        if self._kept:
            return self
        found = Callbacks(self._team)
        found.codes, found.keep = self.codes, self.keep
        return found

    @property
    def team(self) -> Team:
        """The ranks that are asked together."""
        return self._team

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Ask on this rank alone meanwhile: the others do not step."""
        team, self._team = self._team, Alone()
        try:
            yield
        finally:
            self._team = team

    @property
    def addresses(self) -> frozenset[int]:
        """Of all Python callables."""
        return frozenset(_address(thunk) for thunk in self._kept)

    def reset(self) -> None:
        """Drop the error kept, and install the hook for exceptions that ctypes cannot pass on."""
        self.flag[0] = 0
        self.error = None
        self._lost = None
        taken_by(_take_escaped)

    def keep_escaped(self, error: BaseException) -> None:
        """Take an exception that left a call outside of the user's function; other ranks learn it at the next call."""
        self._lost = error
        if self._team.size == 1:
            self.error, self._where = error, "a call of a user's function"
            self.flag[0] = kinds.FLAG_PYTHON

    def failure(
        self, t: float, elements: Sequence[str], times: Sequence[str], undefined: Mapping[int, str]
    ) -> tuple[str, BaseException] | None:
        """The failure in words and the user's own error where ``flag`` is set, else None.

        ``t`` is the time (s) of the evaluation; the rest names the rows of ``Plan.elements`` and ``Plan.times``, and
        says of elements that are no users' functions what it means where they give no number.
        """
        flag = int(self.flag[0])
        if flag == 0:
            return None
        if self.error is not None:
            return f"{self._where} failed: {described(self.error)}", self.error
        name = elements[flag - kinds.FLAG_ELEMENT] if flag >= kinds.FLAG_ELEMENT else times[kinds.FLAG_TIME - flag]
        why = undefined.get(flag - kinds.FLAG_ELEMENT, "the compiled function gave no finite number")
        error = SceneError(f"{name} at t = {t:g} s: {why}")
        return str(error), error

    def _agreed(self, ask: Callable[[], FloatArray], size: int, where: Callable[[], str]) -> FloatArray:
        """Rank 0's answer on every rank, or NaN on every rank where any rank's callable fails."""
        nothing: FloatArray = np.full(size, np.nan)
        if self.flag[0]:
            return nothing
        answer = nothing
        error: BaseException | None = None
        told: Exception | None = None
        try:
            if self._lost is not None:
                raise self._lost
            answer = ask()
        except BaseException as reason:  # noqa: BLE001  (whatever it is, it must not be lost inside the step)
            error = reason
            # an interrupt stops the other ranks as well
            told = reason if isinstance(reason, Exception) else RuntimeError(f"{type(reason).__name__} on one rank")
        try:
            self._team.fail(told)
            return self._team.agree(answer)
        except Exception as reason:  # noqa: BLE001  (this rank's or another's)
            self.flag[0] = kinds.FLAG_PYTHON
            self.error = reason if error is None or told is error else error
            self._where = where()
            return nothing

    def _keep(self, kind: Any, call: Callable[..., Any]) -> int:
        _calls.add(call.__code__)
        thunk = kind(call)
        self._kept.append(thunk)
        return _address(thunk)


_calls: set[Any] = set()  # code of the functions that ctypes calls


def _take_escaped(unraisable: Any) -> bool:
    """Give an exception that left one of our calls, which ctypes cannot pass on, to its ``Callbacks``."""
    trace = unraisable.exc_traceback
    if trace is None or trace.tb_frame.f_code not in _calls:
        return False
    trace.tb_frame.f_locals["self"].keep_escaped(unraisable.exc_value)
    return True


def _address(thunk: Any) -> int:
    return int(ctypes.cast(thunk, ctypes.c_void_p).value or 0)


def _view(address: int, size: int) -> FloatArray:
    """The kernel's own array at an address; empty arrays may have none."""
    if size == 0:
        return np.zeros(0)
    return np.frombuffer((_Double * size).from_address(address))
