"""What users give: numbers, of which what is none becomes NaN, which each quantity's checks refuse; and objects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import FlexmbdError, SceneError

FloatArray = NDArray[np.float64]


def numbers(value: object) -> FloatArray:
    """An array of numbers; NaN, without dimensions, for what holds anything else, as a text or rows of two lengths."""
    try:
        array = np.asarray(value)
        if array.dtype.kind in "biufO":  # a text of digits is no number
            return np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError):
        pass
    return np.array(np.nan)


def is_number(value: object) -> bool:
    """Whether it is one finite number."""
    found = numbers(value)
    return found.shape == () and bool(np.isfinite(found))


def refuse_no_truth(error: type[FlexmbdError] = SceneError, **given: object) -> None:
    """Check arguments that are True or False, by their names: any text, ``"no"`` as well, would pass for True.

    Raises:
        FlexmbdError: of the kind given, naming the first that is neither.
    """
    for name, value in given.items():
        if not isinstance(value, bool | np.bool_):
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
    if isinstance(value, type):
        raise SceneError(f"{what} must be {wanted}, got the class {value.__name__} itself; call it, with its arguments")
    if not isinstance(value, kinds):
        raise SceneError(f"{what} must be {wanted}, got {value!r:.100}")
