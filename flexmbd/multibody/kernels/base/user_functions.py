"""Users' functions compiled to C functions, which kernels call by their addresses (``native``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import carray, cfunc, njit, types

# A division by zero gives infinity, as in numpy: an exception could not leave the step.
_MODEL = "numpy"
_ARRAY = types.Array(types.float64, 1, "C")
_MATRIX = types.Array(types.float64, 2, "C")
_MOTION = (_ARRAY, _MATRIX, _ARRAY, _ARRAY)  # d, R, rate, spin
_CHANGES = (_ARRAY,) * 4  # dd, dtheta, drate, dspin


def scalar_function(function: Callable[..., float], count: int) -> Any:
    """A C function of ``count`` doubles that gives one; its ``address`` is good as long as it lives."""
    return cfunc(types.float64(*[types.float64] * count), error_model=_MODEL)(function)


def at_side(function: Callable[..., Any], count: int, side: float) -> Callable[..., Any]:
    """A law of ``count`` arguments, three or four, and a side as one of these arguments alone."""
    inner = njit(error_model=_MODEL)(function)

    def law(t, beta, rate):  # type: ignore[no-untyped-def]
        return inner(t, beta, rate, side)

    def forces(t, x, v, out):  # type: ignore[no-untyped-def]
        inner(t, x, v, out, side)

    chosen = law if count == 3 else forces
    chosen.__name__ = function.__name__
    return chosen


def state_function(function: Callable[..., None]) -> Any:
    """``f(t, x, v, out)`` of arrays (nx,), (nv,), (nv,) behind a C function of their sizes and addresses."""
    inner = njit(error_model=_MODEL)(function)
    double = types.CPointer(types.float64)
    kind = types.void(types.float64, types.int64, types.int64, double, double, double)

    def outer(t, nx, nv, x, v, out):  # type: ignore[no-untyped-def]
        force = carray(out, (nv,))
        for k in range(nv):
            force[k] = 0.0
        inner(t, carray(x, (nx,)), carray(v, (nv,)), force)

    return cfunc(kind, error_model=_MODEL)(outer)


def states_function(rates: Callable[..., None], outputs: Callable[..., None] | None, n: int, k: int) -> Any:
    """``f(t, z, u, out)`` of n rates and, alike, of k outputs behind one C function, which writes both (n + k,).

    Without ``outputs`` these are the states themselves.
    """
    inner = njit(error_model=_MODEL)(rates)
    double = types.CPointer(types.float64)
    kind = types.void(types.float64, types.int64, types.int64, double, double, double)

    def alone(t, nz, nu, z, u, out):  # type: ignore[no-untyped-def]
        found = carray(out, (n + k,))
        for i in range(n + k):
            found[i] = 0.0 if i < n else z[i - n]
        inner(t, carray(z, (nz,)), carray(u, (nu,)), found[:n])

    if outputs is None:
        return cfunc(kind, error_model=_MODEL)(alone)
    given = njit(error_model=_MODEL)(outputs)

    def both(t, nz, nu, z, u, out):  # type: ignore[no-untyped-def]
        found = carray(out, (n + k,))
        for i in range(n + k):
            found[i] = 0.0
        inner(t, carray(z, (nz,)), carray(u, (nu,)), found[:n])
        given(t, carray(z, (nz,)), carray(u, (nu,)), found[n:])

    return cfunc(kind, error_model=_MODEL)(both)


def frame_states_function(function: Callable[..., None]) -> Any:
    """``f(t, data, z, u, d, R, rate, spin, out)`` behind a C function.

    ``void f(double t, int64 k, int64 size, double *data, double *given, double *out)``.  ``data``: k numbers;
    ``given``, ``size`` of them: how many states, d, R row by row, rate, spin, the states z and the signals u;
    ``out``: force, torque, and the states' rates, which come as zeros.

    Raises:
        numba.TypingError: it does not compile for such arguments.
    """
    inner = njit(error_model=_MODEL)(function)
    inner.compile((types.float64, _ARRAY, _ARRAY, _ARRAY, *_MOTION, _ARRAY))
    double = types.CPointer(types.float64)
    kind = types.void(types.float64, types.int64, types.int64, double, double, double)

    def outer(t, k, size, data, given, out):  # type: ignore[no-untyped-def]
        m = carray(given, (size,))
        n = int(m[0])
        found = carray(out, (6 + n,))
        for i in range(6 + n):
            found[i] = 0.0
        u = m[19 + n :]
        inner(t, carray(data, (k,)), m[19 : 19 + n], u, m[1:4], m[4:13].reshape(3, 3), m[13:16], m[16:19], found)

    return cfunc(kind, error_model=_MODEL)(outer)


def memory_function(function: Callable[..., float]) -> Any:
    """``double f(int64 n, double *data, int64 m, double *memory, double begin, double end, double out[3])``.

    Raises:
        numba.TypingError: it does not compile for such arguments.
    """
    inner = njit(error_model=_MODEL)(function)
    inner.compile((_ARRAY, _ARRAY, types.float64, types.float64, _ARRAY))
    double = types.CPointer(types.float64)
    kind = types.float64(types.int64, double, types.int64, double, types.float64, types.float64, double)

    def outer(n, data, m, memory, begin, end, out):  # type: ignore[no-untyped-def]
        return inner(carray(data, (n,)), carray(memory, (m,)), begin, end, carray(out, (3,)))

    return cfunc(kind, error_model=_MODEL)(outer)


def frame_function(function: Callable[..., None], *, varied: bool) -> tuple[Any, bool]:
    """``double f(int64 n, double *data, double *motion, double out[6])``, and whether the user's returns a number.

    ``motion``: d, R row by row, rate, spin; where it is ``varied`` also dd, dtheta, drate, dspin.

    Raises:
        numba.TypingError: it does not compile for such arguments.
    """
    inner = njit(error_model=_MODEL)(function)
    inner.compile((_ARRAY, *_MOTION, *(_CHANGES if varied else ()), _ARRAY))
    returned = inner.nopython_signatures[0].return_type
    returns_number = isinstance(returned, types.Number)
    pointer = types.CPointer(types.float64)
    kind = types.float64(types.int64, pointer, pointer, pointer)

    def wrench(n, data, motion, out):  # type: ignore[no-untyped-def]
        m = carray(motion, (18,))
        inner(carray(data, (n,)), m[:3], m[3:12].reshape(3, 3), m[12:15], m[15:], carray(out, (6,)))
        return 0.0

    def storing(n, data, motion, out):  # type: ignore[no-untyped-def]
        m = carray(motion, (18,))
        return inner(carray(data, (n,)), m[:3], m[3:12].reshape(3, 3), m[12:15], m[15:], carray(out, (6,)))

    def variation(n, data, motion, out):  # type: ignore[no-untyped-def]
        m = carray(motion, (30,))
        inner(
            carray(data, (n,)), m[:3], m[3:12].reshape(3, 3), m[12:15], m[15:18], m[18:21], m[21:24], m[24:27],
            m[27:], carray(out, (6,)),
        )  # fmt: skip
        return 0.0

    outer = variation if varied else storing if returns_number else wrench
    return cfunc(kind, error_model=_MODEL)(outer), returns_number


def pair_function(function: Callable[..., float]) -> tuple[Any, bool]:
    """``f(t, data, a, b, r, rate, out)`` as a function of ``frame_function``'s kind, and whether it returns a number.

    ``motion``: t, r, rate, where in ``data`` the numbers a and b begin, and how many they are.

    Raises:
        numba.TypingError: it does not compile for such arguments.
    """
    inner = njit(error_model=_MODEL)(function)
    one = types.float64
    inner.compile((one, _ARRAY, _ARRAY, _ARRAY, one, one, _ARRAY))
    returns_number = isinstance(inner.nopython_signatures[0].return_type, types.Number)
    pointer = types.CPointer(types.float64)
    kind = types.float64(types.int64, pointer, pointer, pointer)

    def force(n, data, motion, out):  # type: ignore[no-untyped-def]
        m = carray(motion, (6,))
        i, j, k = int(m[3]), int(m[4]), int(m[5])
        whole = carray(data, (max(i, j) + k,))
        inner(m[0], whole[:n], whole[i : i + k], whole[j : j + k], m[1], m[2], carray(out, (1,)))
        return 0.0

    def storing(n, data, motion, out):  # type: ignore[no-untyped-def]
        m = carray(motion, (6,))
        i, j, k = int(m[3]), int(m[4]), int(m[5])
        whole = carray(data, (max(i, j) + k,))
        return inner(m[0], whole[:n], whole[i : i + k], whole[j : j + k], m[1], m[2], carray(out, (1,)))

    return cfunc(kind, error_model=_MODEL)(storing if returns_number else force), returns_number


def relation_function(function: Callable[..., None]) -> Any:
    """``f(data, h, h_before, nodes, u, v, memory)`` behind a C function of the sizes k, s, r, of lengths, of addresses.

    ``data`` (k,), ``nodes`` (s,), ``u`` and ``v`` (s, n), ``memory`` (r, n) with n = 3 (s + 1) + r.

    Raises:
        numba.TypingError: it does not compile for such arguments.
    """
    inner = njit(error_model=_MODEL)(function)
    inner.compile((_ARRAY, types.float64, types.float64, _ARRAY, *[_MATRIX] * 3))
    double = types.CPointer(types.float64)
    kind = types.void(*[types.int64] * 3, types.float64, types.float64, *[double] * 5)

    def outer(k, s, r, h, h_before, data, nodes, u, v, memory):  # type: ignore[no-untyped-def]
        n = 3 * (s + 1) + r
        weights = carray(u, (s, n)), carray(v, (s, n)), carray(memory, (r, n))
        inner(carray(data, (k,)), h, h_before, carray(nodes, (s,)), *weights)

    return cfunc(kind, error_model=_MODEL)(outer)
