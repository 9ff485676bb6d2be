"""Functions of users that are compiled, to be called inside a step without Python, and their breaks."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.brief import brief
from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.multibody.kernels.base.compiling import pickled_function
from flexmbd.multibody.kernels.base.fingerprint import called_fingerprint, fingerprint

FloatArray = NDArray[np.float64]


class Signature(Enum):
    """Signatures of compiled functions, by the number of their arguments; negative ones take ``side`` as one more.

    Of two with seven arguments the last one's name tells which it is: a ``RELATION`` writes into its ``memory``.
    """

    TIME = 1
    LAW = 3
    STATE = 4
    MEMORY = 5
    WRENCH = 6
    PAIR = 7
    RELATION = 7.5
    FRAME_STATES = 9
    WRENCH_VARIATION = 10
    SIDED_LAW = -3
    SIDED_STATE = -4


@dataclass(frozen=True, eq=False)
class Compiled:
    """A compiled function; made by ``flexmbd.compiled``.  It is smooth in time between its ``breaks`` (s).

    ``returns_number``: of a wrench, whether it returns the energy that it stores.  ``sides``: of a law that takes
    ``side``, what it is at 1.0 and at -1.0; it has no address of its own.
    """

    address: int
    keep: Any
    name: str
    signature: Signature = Signature.TIME
    code: str = ""  # tells it from others where addresses change from process to process
    breaks: FloatArray = field(default_factory=lambda: np.zeros(0))
    source: Any = None
    returns_number: bool = True
    sides: tuple[Compiled, ...] = ()
    reads: str = ""  # digest of the function and what it reads outside; of a side "", for its law is compared
    helpers: str = ""  # digest of the functions, compiled before it, that it calls
    _later: dict[str, Compiled] = field(default_factory=dict, repr=False)  # the same function of other values, by code

    __repr__ = brief

    def as_it_is_now(self) -> Compiled:
        """This function with the values that it reads from outside as they are now: compiled anew where they changed.

        numba makes constants of all numbers and arrays that a function names, so that a compiled function keeps those
        of its compilation.

        Raises:
            SceneError: a function that numba compiled before, and that this one calls, reads other values now.
        """
        code = fingerprint(self.source) if self.reads else ""
        if code == self.reads:
            return self
        if called_fingerprint(self.source) != self.helpers:
            raise SceneError(
                f"{self.name} calls a function compiled by numba that was changed, or that names values which were "
                "changed since: decorate both again (numba.njit and fm.compiled), or give the values as arguments"
            )
        if code not in self._later:
            self._later[code] = compiled(self.source, breaks=self.breaks)
        return self._later[code]

    def __deepcopy__(self, memo: object) -> Compiled:
        """Itself: it never changes."""
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """The Python function, by value, to be compiled where it is unpickled."""
        return _compiled_again, (pickled_function(self.source), self.breaks)


def _compiled_again(function: bytes, breaks: FloatArray) -> Compiled:
    return compiled(pickle.loads(function), breaks=breaks)


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


@checked("breaks")
def compiled(
    function: Callable[..., Any] | None = None, *, breaks: ArrayLike = ()
) -> Compiled | Callable[[Callable[..., Any]], Compiled]:
    """Compile a function with numba, to be called inside the step without Python.

    ``f(t) -> float`` is a function of time; ``f(t, beta, rate) -> float`` a law on a joint coordinate;
    ``f(t, x, v, out)`` writes the generalised forces (nv,) of the whole state into ``out``, which comes as zeros.
    ``f(data, d, R, rate, spin, out)`` writes the force and torque (6,) N, N m on frame G at its origin, in the axes of
    frame F, into ``out``; of G against F in F's axes it gets the place d (3,) m, the rotation R (3, 3), the rate of d
    and the angular velocity (3,).  Where it returns a number this is the energy (J) that it stores, whose derivative
    the wrench must be at rest.  ``f(data, d, R, rate, spin, dd, dtheta, drate, dspin, out)`` writes the change of that
    wrench for d + dd, exp(dtheta) R and so on.  Both are for ``flexmbd.force.ElementTable.frame_law``.
    ``f(t, data, a, b, r, rate, out)`` is a force along the line between two frames of a group: it writes what pushes
    them apart (N) into ``out`` (1,), by the time t (s), numbers ``data`` that all pairs share, those of the one frame
    ``a`` and of the other ``b``, their distance r (m) and its rate (m/s).  Where it returns a number this is the energy
    (J) that the pair stores.  For ``flexmbd.force.BetweenPairs``.
    ``f(t, data, z, u, d, R, rate, spin, out)`` is such a law with states z of its own, by which, by signals and
    functions of time u, and by the time t (s) it writes force, torque and the states' rates into ``out`` (6 + n,),
    which comes as zeros; for ``frame_states`` there.
    ``f(data, memory, begin, end, out)`` leads a law with memory from the deformation ``begin`` to ``end`` (m or rad),
    between which it does not turn: it changes ``memory`` in place, writes the force against the deformation, its slope
    and the number of the piece of the law that it is on into ``out`` (3,), and returns the energy (J) that it stores;
    for ``memory_law`` and ``memory_line`` of ``ElementTable``.
    ``f(data, h, h_before, nodes, u, v, memory)`` writes the weights of a step of a method, for
    ``flexmbd.integrate.ImplicitMethod``.
    ``f(t, beta, rate, side)`` and ``f(t, x, v, out, side)``, whose last argument has that very name, are laws of two
    sides, for ``flexmbd.Switched``.
    Divisions by zero give infinities, as in numpy: an exception could not leave the step, and
    numba would hand back a number in its place.
    Numbers and arrays that the function names outside itself are constants of its machine code.  Each ``compile()``
    of a scene, and each run of a ``System``, compares them and compiles the function anew where they changed.

    Args:
        function: to compile; left out in a decorator with arguments, as ``@fm.compiled(breaks=[0.5])``.
        breaks: instants (s) at which its value or slope jumps, as of ``flexmbd.Piecewise``.

    Raises:
        SceneError: it takes another number of arguments, or breaks are not instants.
    """
    if function is None:
        return lambda following: compiled(following, breaks=breaks)
    known = checked_breaks(breaks, function.__name__)
    names = list(inspect.signature(function).parameters)
    count = len(names)
    if names[-1:] == ["side"]:
        return _compiled_sides(function, count - 1, known)
    value = Signature.RELATION.value if count == 7 and names[-1] == "memory" else count
    if value not in {s.value for s in Signature}:
        raise SceneError(
            f"{function.__name__} takes {count} arguments; a compiled function is f(t), f(t, beta, rate), "
            "f(t, x, v, out), f(data, memory, begin, end, out), f(data, d, R, rate, spin, out), its derivative of ten "
            "arguments, f(t, data, a, b, r, rate, out), f(t, data, z, u, d, R, rate, spin, out), or "
            "f(data, h, h_before, nodes, u, v, memory)"
        )
    code = fingerprint(function)
    return _compiled(function, Signature(value), known, code, reads=code)


def _compiled(
    function: Callable[..., Any], signature: Signature, breaks: FloatArray, code: str, *, reads: str = ""
) -> Compiled:
    """The function compiled for a signature; ``code`` tells it from others, ``reads`` as in `Compiled`."""
    from flexmbd.multibody.kernels.base.user_functions import (  # and numba, with the first function to compile
        frame_function,
        frame_states_function,
        memory_function,
        pair_function,
        relation_function,
        scalar_function,
        state_function,
    )

    returns_number = True
    if signature is Signature.STATE:
        pointer = state_function(function)
    elif signature is Signature.MEMORY:
        pointer = memory_function(function)
    elif signature is Signature.PAIR:
        pointer, returns_number = pair_function(function)
    elif signature is Signature.RELATION:
        pointer = relation_function(function)
    elif signature is Signature.FRAME_STATES:
        pointer = frame_states_function(function)
    elif signature in (Signature.WRENCH, Signature.WRENCH_VARIATION):
        pointer, returns_number = frame_function(function, varied=signature is Signature.WRENCH_VARIATION)
    else:
        pointer = scalar_function(function, signature.value)
    return Compiled(
        int(pointer.address), pointer, function.__name__, signature, code, breaks, function, returns_number,
        reads=reads, helpers=called_fingerprint(function) if reads else "",
    )  # fmt: skip


def _compiled_sides(function: Callable[..., Any], count: int, breaks: FloatArray) -> Compiled:
    """A law of ``count`` arguments and its side, compiled for both.

    Raises:
        SceneError: there are no such laws.
    """
    if count not in (Signature.LAW.value, Signature.STATE.value):
        raise SceneError(
            f"{function.__name__} takes {count} arguments and a side; a compiled law of two sides is "
            "f(t, beta, rate, side) or f(t, x, v, out, side)"
        )
    from flexmbd.multibody.kernels.base.user_functions import at_side

    code = fingerprint(function)
    sides = tuple(
        _compiled(at_side(function, count, side), Signature(count), breaks, f"{code} {side:g}") for side in (1.0, -1.0)
    )
    return Compiled(
        0, None, function.__name__, Signature(-count), code, breaks, function, sides=sides, reads=code,
        helpers=called_fingerprint(function),
    )  # fmt: skip
