"""The strain of a beam that is free to expand, for `ExactBeam.strain`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number, numbers
from flexmbd.multibody.functions.spline_table import Table, is_polynomial
from flexmbd.multibody.functions.time_function import Sine, TimeFunction


@checked("alpha", "gradient")
def thermal_strain(
    alpha: float, rise: TimeFunction = 0.0, *, gradient: tuple[TimeFunction, TimeFunction] = (0.0, 0.0)
) -> tuple[TimeFunction, ...]:
    """Stretch and curvatures at which a beam with a temperature is slack: an entry of an `ExactBeam`'s ``strain``.

    Args:
        alpha: coefficient of thermal expansion, 1/K.
        rise: K, of the section's centroid: a number, or as a function of time ``fm.Sine``, ``fm.Table`` or a PPoly.
        gradient: K/m, of the temperature along the section's y and z, each as ``rise``.

    Returns:
        (6,) stretch, shears, twist, and curvatures about y and z, rad/m.

    Raises:
        SceneError: alpha is no finite number, the gradient has not two parts, or one is another function of time.
    """
    along_y, along_z = gradient
    # the fibre at (y, z) is stretched by strain[0] - strain[5] y + strain[4] z
    parts = _times(alpha, rise, "rise"), _times(alpha, along_z, "gradient"), _times(-alpha, along_y, "gradient")
    return parts[0], 0.0, 0.0, 0.0, parts[1], parts[2]


def _times(factor: float, function: TimeFunction, what: str) -> TimeFunction:
    """A function of time times a number."""
    if is_number(function) and np.isfinite(numbers(function)):
        return factor * float(numbers(function))
    if isinstance(function, Sine):
        return replace(function, amplitude=factor * function.amplitude, offset=factor * function.offset)
    if isinstance(function, Table):
        return replace(function, y=factor * np.asarray(function.y, dtype=float))
    if is_polynomial(function):
        return type(function)(factor * function.c, function.x, extrapolate=function.extrapolate)
    raise SceneError(
        f"{what} is a finite number, an fm.Sine, an fm.Table or a PPoly, got {function!r:.80}; another function of "
        "time goes into strain= itself, times alpha"
    )
