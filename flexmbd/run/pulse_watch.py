"""Warns of pulses of a user's Python function of time within a long step, between the stages of the method.

Compiled functions and declared breaks are as they are told; narrower pulses than a five hundredth of the run are not
looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import PulseWarning, warn
from flexmbd.multibody.functions.time_function import TimeRow, call_python
from flexmbd.multibody.plan.compiled_scene import CompiledScene

FloatArray = NDArray[np.float64]

_SAMPLES, _WITHIN = 500, 3  # of a run, and of each step that is longer than what these are apart
_INSIDE = 1e-6  # of a step: beside its ends, where a declared break may be
_SMOOTH = 0.25  # of what a polynomial misses of a smooth function, at most, is left when samples are twice as dense
_TRIED = 8  # places of a function where that is asked


def tell_missed_pulses(scene: CompiledScene, t: FloatArray, *, rtol: float) -> None:
    """Look at the functions between the instants t (n,) of a run.

    Warns:
        PulseWarning: between two of them a function leaves the polynomial through its neighbours, and the impulse so
            missed is more than rtol of what its largest value gives in the run; once a function.
    """
    for name, row in zip(scene.time_names, scene.time_rows, strict=False):  # names of rows that stand alone are more
        if row.call is None or len(t) < 2:
            continue
        try:
            found = _missed(_function(row), t, rtol)
        except Exception:  # noqa: BLE001  (the run did not ask at that instant, so nothing of it has failed)
            continue
        if found is None:
            continue
        when, change, scale, h = found
        warn(
            f"{name}: at about t = {when:.6g} s it changes by {change:.3g} (its largest value is {scale:.3g}) within a "
            f"step of {h:.3g} s that did not see it, so that this is missing in the motion. Declare where it jumps, "
            "fm.Piecewise(function, breaks=[...]), or let no step be longer than what it does, simulate(max_step=...)",
            PulseWarning,
            subject=f"pulse of {name}",
        )


def _function(row: TimeRow) -> Callable[[float], float]:
    """What a load is worth, or the acceleration of a prescribed motion."""
    return lambda t: call_python(row, t, motion=row.motion)[2 if row.motion else 0]


def _missed(function: Callable[[float], float], t: FloatArray, rtol: float) -> tuple[float, float, float, float] | None:
    """When (s) a pulse was missed, its size, the function's largest value and the step (s); None without."""
    span = float(t[-1] - t[0])
    stretches = [(times, np.array([function(one) for one in times])) for times in _sampled(t, span)]
    scale = max((float(np.abs(values).max()) for _, values in stretches), default=0.0)
    places: list[tuple[float, int, int]] = []
    for k, (times, values) in enumerate(stretches):
        missed = np.abs(np.convolve(values, [1.0, -4.0, 6.0, -4.0, 1.0], mode="valid")) / 6.0
        felt = missed * (times[1] - times[0])
        places += [(-float(felt[i]), k, int(i)) for i in np.flatnonzero(felt > rtol * scale * span)]
    for _, k, i in sorted(places)[:_TRIED]:
        times, values = stretches[k][0][i : i + 5], stretches[k][1][i : i + 5]
        if not _is_smooth(function, times, values):
            straight = np.interp(times, times[[0, -1]], values[[0, -1]])
            worst = int(np.argmax(np.abs(values - straight)))
            h = float(stretches[k][0][-1] - stretches[k][0][0])
            return float(times[worst]), float(abs(values - straight)[worst]), scale, h
    return None


def _sampled(t: FloatArray, span: float) -> Iterator[FloatArray]:
    """Instants (s) at equal distances in each long step, from its begin to its end."""
    steps = np.diff(t)
    for k in np.flatnonzero(steps > span / _SAMPLES):
        count = max(_WITHIN, int(np.ceil(_SAMPLES * steps[k] / span)))
        yield np.linspace(t[k] + _INSIDE * steps[k], t[k + 1] - _INSIDE * steps[k], count + 2)


def _is_smooth(function: Callable[[float], float], times: FloatArray, values: FloatArray) -> bool:
    """Whether a polynomial through five samples (5,) tells those between them far better than one of four the fifth."""
    between = 0.5 * (times[1:] + times[:-1])
    places = np.arange(-2.0, 3.0)
    polynomial = np.linalg.solve(np.vander(places), values)
    told = np.polyval(polynomial, places[1:] - 0.5)
    found = np.array([function(one) for one in between])
    missed = abs(np.convolve(values, [1.0, -4.0, 6.0, -4.0, 1.0], mode="valid")[0]) / 6.0
    return bool(np.abs(found - told).max() <= _SMOOTH * missed)
