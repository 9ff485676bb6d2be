"""Users' functions compiled to C functions, which kernels call by their addresses (``native``)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import carray, cfunc, njit, types

# A division by zero gives infinity, as in numpy: an exception could not leave the step.
_MODEL = "numpy"


def scalar_function(function: Callable[..., float], count: int) -> Any:
    """A C function of ``count`` doubles that gives one; its ``address`` is good as long as it lives."""
    return cfunc(types.float64(*[types.float64] * count), error_model=_MODEL)(function)


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
