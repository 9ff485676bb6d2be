"""A user's law of a point, compiled with numba behind a C function that looks at what it returns."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, cast

import numpy as np
from numba import carray, cfunc, njit, types
from numba.core.errors import NumbaError
from numba.np.unsafe.ndarray import to_fixed_tuple

from flexmbd.errors import FormulationError

# A division by zero gives infinity, as in numpy, which is told; an exception would only say that there was one.
_MODEL = "numpy"

F = TypeVar("F", bound=Callable[..., Any])

_KIND = types.void(*[types.voidptr] * 7)


def law_part(function: F) -> F:
    """Compile what laws call: it may make arrays, as kernels may not."""
    return cast(F, njit(error_model=_MODEL)(function))


@law_part
def _is_finite(values):  # type: ignore[no-untyped-def]
    for value in values.flat:
        if not np.isfinite(value):
            return False
    return True


@law_part
def _fault(stress, tangent, state, n):  # type: ignore[no-untyped-def]
    """Place, from 1 on, in the contract's `point_law.FAULTS` of what is wrong with what a law returns; 0: nothing."""
    if stress.shape != (6,):
        return 2
    if tangent.shape != (6, 6):
        return 3
    if state.shape != (n,):
        return 4
    if not _is_finite(stress):
        return 6
    if not _is_finite(tangent):
        return 7
    return 0 if _is_finite(state) else 8


def law_function(
    law: Callable[..., Any], *, step: type, names: Sequence[str], n: int, measure: Any, pull_back: Any
) -> Any:
    """``void f(double *made, double *given, double *constants, ...)``; its ``address`` is good as long as it lives.

    Args:
        law: (step, p) -> stress, tangent, state.
        step: named tuple of strain, increment, stress, state, dt that the law is given.
        names: of the parameters, of which it is given a named tuple.
        n: components of the state.
        measure: kernel, of the strain (6,) to the law's, squares of stretches (3,) and eigenvectors (3, 3).
        pull_back: kernel, of the law's stress and tangent, squares and eigenvectors to those of the strain.

    Raises:
        FormulationError: numba cannot compile it, or it does not return three arrays.
    """
    kind = namedtuple("Parameters", names)  # type: ignore[misc]
    count = len(names)
    inner = _compiled(law, step, types.NamedUniTuple(types.float64, count, kind), n)

    @law_part
    def at_point(made, given, constants):  # type: ignore[no-untyped-def]
        total, begin = given[:6], given[6:]
        if not _is_finite(total):
            return 5
        own, squares, vectors = measure(total)
        if not _is_finite(own):
            return 5
        p = kind(*to_fixed_tuple(constants[1:], count))
        # copies: a law may write in what it is given, and return it
        now = step(begin[:6].copy(), own - begin[:6], begin[6:12].copy(), begin[12:].copy(), constants[0])
        stress, tangent, state = inner(now, p)
        fault = _fault(stress, tangent, state, n)
        if fault:
            return fault
        made[:6], made[6:12], made[12 : 12 + n] = own, stress, state
        working, slopes = pull_back(stress, tangent, squares, vectors)
        made[12 + n : 18 + n], made[18 + n : 24 + n] = working, total
        made[24 + n : -1] = slopes.ravel()
        return 0

    def outer(made, given, constants, coordinates, entity, permutation, custom):  # type: ignore[no-untyped-def]
        result = carray(made, (24 + n + 37,), np.float64)
        from_step = carray(given, (18 + n,), np.float64)
        numbers = carray(constants, (1 + count,), np.float64)
        try:
            fault = at_point(result, from_step, numbers)
        except Exception:
            fault = 1
        result[24 + n + 36] = fault

    return cfunc(_KIND, error_model=_MODEL)(outer)


def _compiled(law: Callable[..., Any], step: type, parameters: types.NamedUniTuple, n: int) -> Any:
    """A law compiled for what it is given.

    Raises:
        FormulationError: numba cannot compile it, or it does not return three arrays.
    """
    inner = njit(error_model=_MODEL)(law)
    vector = types.Array(types.float64, 1, "C")
    asked = f"law(step, p) -> stress (6,), tangent (6, 6), state ({n},), arrays of floats"
    try:
        inner.compile((types.NamedTuple([vector] * 4 + [types.float64], step), parameters))
    except NumbaError as error:
        raise FormulationError(f"{law.__name__}: numba cannot compile it as {asked}: {str(error).strip()}") from error
    (signature,) = inner.nopython_signatures
    made = signature.return_type
    parts = list(made) if isinstance(made, types.BaseTuple) else []
    kinds = [(part.dtype, part.ndim) if isinstance(part, types.Array) else None for part in parts]
    if kinds != [(types.float64, ndim) for ndim in (1, 2, 1)]:
        raise FormulationError(f"{law.__name__}: it must be {asked}, and returns {made}")
    return inner
