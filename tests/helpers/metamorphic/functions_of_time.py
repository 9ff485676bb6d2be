"""Functions of time as data: their values, shifted in time, and in other units."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

import flexmbd as fm


@dataclass(frozen=True, eq=False)
class Declared:
    """A polynomial in pieces that is given as a function of Python with its breaks declared."""

    poly: PPoly


def given(function, *, motion=False):
    """As it is given to flexmbd: a motion with its rate and acceleration."""
    if not isinstance(function, Declared):
        return function
    poly = function.poly
    if motion:
        return fm.Piecewise(lambda t: tuple(float(poly(t, k)) for k in range(3)), breaks=poly.x[1:-1])
    return fm.Piecewise(lambda t: float(poly(t)), breaks=poly.x[1:-1])


def value(function, t, order=0):
    """The function or a derivative of it at t."""
    if isinstance(function, fm.Sine):
        phase = function.omega * t + function.phase + 0.5 * np.pi * order
        return function.amplitude * function.omega**order * np.sin(phase) + (function.offset if order == 0 else 0.0)
    if isinstance(function, fm.Table):
        return (PchipInterpolator if function.monotone else CubicSpline)(function.t, function.y)(t, order)
    if isinstance(function, PPoly):
        return function(t, order)
    if isinstance(function, Declared):
        return function.poly(t, order)
    return float(function) if order == 0 else 0.0


def raised(function, offset):
    """With ``offset`` added to its values."""
    if isinstance(function, fm.Sine):
        return replace(function, offset=function.offset + offset)
    if isinstance(function, fm.Table):
        return fm.Table(function.t, np.asarray(function.y) + offset, monotone=function.monotone)
    if isinstance(function, PPoly):
        return PPoly(np.vstack([function.c[:-1], function.c[-1:] + offset]), function.x)
    if isinstance(function, Declared):
        return Declared(raised(function.poly, offset))
    return function + offset


def in_units(function, size, time):
    """With its values times ``size`` and its times times ``time``."""
    if isinstance(function, fm.Sine):
        return fm.Sine(function.amplitude * size, function.omega / time, function.phase, function.offset * size)
    if isinstance(function, fm.Table):
        return fm.Table(np.asarray(function.t) * time, np.asarray(function.y) * size, monotone=function.monotone)
    if isinstance(function, PPoly):
        powers = np.arange(len(function.c))[::-1, None]
        return PPoly(function.c * size / time**powers, function.x * time)
    if isinstance(function, Declared):
        return Declared(in_units(function.poly, size, time))
    return function * size


def later(function, shift):
    """Put off by ``shift`` (s)."""
    if isinstance(function, fm.Sine):
        phase = function.phase - function.omega * shift
        return fm.Sine(function.amplitude, function.omega, phase, function.offset)
    if isinstance(function, fm.Table):
        return fm.Table(np.asarray(function.t) + shift, function.y, monotone=function.monotone)
    if isinstance(function, PPoly):
        return PPoly(function.c, function.x + shift)
    if isinstance(function, Declared):
        return Declared(later(function.poly, shift))
    return function
