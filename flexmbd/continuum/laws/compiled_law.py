"""A user's law of a point, compiled with numba behind a C function that looks at what it returns."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import carray, cfunc, njit, types
from numba.core.errors import NumbaError
from numba.np.unsafe.ndarray import to_fixed_tuple

from flexmbd.continuum.laws.logarithmic_strain import logarithmic_strain, pulled_back
from flexmbd.errors import FormulationError

# A division by zero gives infinity, as in numpy, which is told; an exception would only say that there was one.
_MODEL = "numpy"
_KIND = types.void(*[types.voidptr] * 7)


class PointStep(NamedTuple):
    """What a law is given of a step at a quadrature point.

    Strains are xx, yy, zz, yz, xz, xy with twice the tensor's shears; stresses are in the same order.

    Attributes:
        strain: (6,) at the step's begin.
        increment: (6,) of the strain in the step.
        stress: (6,) Pa, at the step's begin.
        state: (n,) at the step's begin.
        dt: s, length of the step; 0: no time passes.
    """

    strain: Any
    increment: Any
    stress: Any
    state: Any
    dt: Any


@njit(error_model=_MODEL)
def _is_finite(values):  # type: ignore[no-untyped-def]
    for value in values.flat:
        if not np.isfinite(value):
            return False
    return True


@njit(error_model=_MODEL)
def _fault(stress, tangent, state, n):  # type: ignore[no-untyped-def]
    """Place, from 1 on, in `point_law.FAULTS` of what is wrong with what a law returns; 0: nothing."""
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


@njit(error_model=_MODEL)
def _same_strain(strain):  # type: ignore[no-untyped-def]
    """In place of `logarithmic_strain`."""
    return strain, np.ones(3), np.eye(3)


@njit(error_model=_MODEL)
def _same_stress(stress, tangent, squares, vectors):  # type: ignore[no-untyped-def]
    """In place of `pulled_back`."""
    return stress, tangent


def compiled_law(law: Callable[..., Any], *, names: Sequence[str], n: int, logarithmic: bool) -> Any:
    """The C function of `point_law.PointLaw`; its ``address`` is good as long as it lives.

    Args:
        law: (step, p) -> stress, tangent, state, of a `PointStep` and a named tuple of parameters.
        names: of the parameters.
        n: components of the state.
        logarithmic: whether the law is one in logarithmic strain.

    Raises:
        FormulationError: numba cannot compile it, or it does not return three arrays.
    """
    kind = namedtuple("Parameters", names)  # type: ignore[misc]
    count = len(names)
    inner = _compiled(law, types.NamedUniTuple(types.float64, count, kind), n)
    measure, pull_back = (logarithmic_strain, pulled_back) if logarithmic else (_same_strain, _same_stress)

    @njit(error_model=_MODEL)
    def at_point(made, given, constants):  # type: ignore[no-untyped-def]
        total, begin = given[:6], given[6:]
        if not _is_finite(total):
            return 5
        own, squares, vectors = measure(total)
        if not _is_finite(own):
            return 5
        p = kind(*to_fixed_tuple(constants[1:], count))
        # copies: a law may write in what it is given, and return it
        step = PointStep(begin[:6].copy(), own - begin[:6], begin[6:12].copy(), begin[12:].copy(), constants[0])
        stress, tangent, state = inner(step, p)
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


def _compiled(law: Callable[..., Any], parameters: types.NamedUniTuple, n: int) -> Any:
    """A law compiled for what it is given.

    Raises:
        FormulationError: numba cannot compile it, or it does not return three arrays.
    """
    inner = njit(error_model=_MODEL)(law)
    vector = types.Array(types.float64, 1, "C")
    asked = f"law(step, p) -> stress (6,), tangent (6, 6), state ({n},), arrays of floats"
    try:
        inner.compile((types.NamedTuple([vector] * 4 + [types.float64], PointStep), parameters))
    except NumbaError as error:
        raise FormulationError(f"{law.__name__}: numba cannot compile it as {asked}: {str(error).strip()}") from error
    (signature,) = inner.nopython_signatures
    made = signature.return_type
    parts = list(made) if isinstance(made, types.BaseTuple) else []
    kinds = [(part.dtype, part.ndim) if isinstance(part, types.Array) else None for part in parts]
    if kinds != [(types.float64, ndim) for ndim in (1, 2, 1)]:
        raise FormulationError(f"{law.__name__}: it must be {asked}, and returns {made}")
    return inner
