"""Values from users: numbers, where anything else becomes NaN, which each quantity's checks refuse; and objects.

True and False are not numbers: ``joint.position = True`` would turn a joint by 1 rad.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, SceneError

FloatArray = NDArray[np.float64]

_NUMBERS = frozenset({float, int})
_FITTING: set[tuple[type, type | tuple[type, ...]]] = set()  # classes all of whose objects are of these kinds


def numbers(value: object) -> FloatArray:
    """An array of numbers; NaN, without dimensions, for what holds anything else, as a text or rows of two lengths."""
    kind = type(value)
    if kind is np.ndarray and value.dtype == np.float64:  # type: ignore[attr-defined]
        return value  # type: ignore[return-value]
    if kind is float or ((kind is tuple or kind is list) and _NUMBERS.issuperset(map(type, value))):  # type: ignore[call-overload]
        return np.array(value, dtype=np.float64)
    if np.ma.isMaskedArray(value):  # beneath a mask stands a number that is none
        return np.array(np.nan)
    try:
        # among numbers numpy takes True for one, and a text of digits is not a number
        if isinstance(value, list | tuple) and _holds_no_number(value):
            return np.array(np.nan)
        array = np.asarray(value)
        if array.dtype.kind in "iufO" and not is_truth(value):
            return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        pass
    return np.array(np.nan)


def shaped_numbers(value: object, shape: tuple[int, ...], what: str) -> FloatArray:
    """Finite numbers of a shape; an axis of -1 is as long as it is.

    Raises:
        SceneError: it is something else.
    """
    found = numbers(value)
    fits = found.ndim == len(shape) and all(want in (-1, have) for want, have in zip(shape, found.shape, strict=False))
    if not fits or not np.isfinite(found).all():
        axes = ", ".join("n" if n == -1 else str(n) for n in shape)
        raise SceneError(f"{what} must be ({axes}{',' * (len(shape) == 1)}) finite numbers, got {shown(value)}")
    return found


def _holds_no_number(value: object) -> bool:
    """Whether anything in it is True, False or beneath a mask."""
    if isinstance(value, list | tuple):
        return any(map(_holds_no_number, value))
    return is_truth(value) or isinstance(value, np.ma.MaskedArray)


def is_truth(value: object) -> bool:
    """Whether it is True or False, of Python or of numpy, or an array of such."""
    return isinstance(value, bool | np.bool_) or (isinstance(value, np.ndarray) and value.dtype.kind == "b")


def is_number(value: object) -> bool:
    """Whether it is one finite number."""
    if type(value) is float:
        return math.isfinite(value)
    found = numbers(value)
    return found.shape == () and bool(np.isfinite(found))


def refuse_no_truth(error: type[FlexmbdError] = SceneError, **given: object) -> None:
    """Check arguments that are True or False, by their names: any text, ``"no"`` as well, would pass for True.

    Raises:
        FlexmbdError: of the kind given, naming the first that is neither.
    """
    for name, value in given.items():
        if isinstance(value, np.ndarray) or not is_truth(value):
            raise error(f"{name} must be True or False, got {value!r:.100}")


def refuse_other(value: object, kinds: type | tuple[type, ...], what: str, *, wanted: str) -> None:
    """Check what an argument is; a class is none of its objects.

    Args:
        value: the argument.
        kinds: classes, or protocols of which all names are looked for.
        what: it is, in the message.
        wanted: how the user gets one.

    Raises:
        SceneError: it is of none of these kinds.
    """
    if (type(value), kinds) in _FITTING:
        return
    if isinstance(value, type):
        raise SceneError(f"{what} must be {wanted}, got the class {value.__name__} itself; call it, with its arguments")
    if not isinstance(value, kinds):
        raise SceneError(f"{what} must be {wanted}, got {shown(value)}")
    with suppress(Exception):  # of what has no such object, or asks for more than is there
        if isinstance(object.__new__(type(value)), kinds):  # whatever it holds: its class tells, and need not again
            _FITTING.add((type(value), kinds))


def shown(value: object) -> str:
    """A value as messages have it, without the addresses of objects."""
    return f"{re.sub(r' at 0x[0-9a-f]+', '', repr(value)):.100}"


def refuse_no_function(value: object, what: str, *, wanted: str) -> None:
    """Check an argument that is to be called.

    Raises:
        SceneError: it cannot be called, or is a class.
    """
    if isinstance(value, type) or not callable(value):
        raise SceneError(f"{what} must be a function, {wanted}, got {value!r:.100}")


def refuse_no_name(value: object, what: str) -> None:
    """Check a name.

    Raises:
        SceneError: it is no text, or an empty one.
    """
    if not isinstance(value, str) or not value:
        raise SceneError(f"{what} must be a text that is not empty, got {value!r:.100}")


def is_list(value: Any) -> bool:
    """Whether it holds things in a row: no text, no mapping, no array without dimensions."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Collection) and not isinstance(value, str | bytes | Mapping)
