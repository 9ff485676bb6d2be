"""Where a value passes zero, by as few evaluations as can be."""

from __future__ import annotations

from collections.abc import Callable

from flexmbd.errors import ConvergenceError

_MOST = 60  # evaluations; halvings alone end sooner


def zero(value: Callable[[float], float], low: float, high: float, *, within: float, round_off: float = 0.0) -> float:
    """Where a value passes zero, by inverse interpolation of three values, halvings where that leads astray.

    After Chandrupatla (1997), doi:10.1016/S0965-9978(96)00051-8, but for the first, a secant, and for the end: at a
    place from which by the slopes at hand the zero is no further than wanted, and which was evaluated last.

    Args:
        value: of a place.
        low: one place.
        high: another one, where the value has another sign.
        within: how near it is to be found.
        round_off: of the value: one below this that falls no further is taken for zero.

    Raises:
        ConvergenceError: the values there have one sign.
    """
    (x, f), (other, f_other) = (high, value(high)), (low, value(low))
    if not f * f_other <= 0.0:
        raise ConvergenceError(f"what passes zero between them is {f_other:.3g} and {f:.3g} at their ends")
    for end, there in ((x, f), (other, f_other)):
        if there == 0.0:
            return end
    part, best = f / (f - f_other), min((abs(f), x), (abs(f_other), other))
    for _ in range(_MOST):
        trial = x + part * (other - x)
        f_trial = value(trial)
        if f_trial * f > 0.0:
            third, f_third = x, f
        else:
            third, f_third, other, f_other = other, f_other, x, f
        x, f = trial, f_trial
        slope = min(abs((f - there) / (x - place)) for place, there in ((other, f_other), (third, f_third)))
        if abs(f) <= within * slope or abs(other - x) <= within:
            return x
        stays, best = 2.0 * abs(f) > best[0], min(best, (abs(f), x))
        if stays and abs(f) <= round_off:
            return best[1]
        part = _part((x, f), (other, f_other), (third, f_third))
        least = 0.5 * within / abs(other - x)
        part = min(max(part, least), 1.0 - least)
    raise ConvergenceError("what passes zero between them does so by a jump")


def _part(one: tuple[float, float], other: tuple[float, float], third: tuple[float, float]) -> float:
    """Of the way from one place to the other, where the inverse parabola through all is zero, if it is monotonic."""
    (x, f), (x_other, f_other), (x_third, f_third) = one, other, third
    place, height = (x - x_other) / (x_third - x_other), (f - f_other) / (f_third - f_other)
    if not (height**2 < place and (1.0 - height) ** 2 < 1.0 - place):
        return 0.5
    by_other = f / (f_other - f) * f_third / (f_other - f_third)
    by_third = (x_third - x) / (x_other - x) * f / (f_third - f) * f_other / (f_third - f_other)
    return by_other + by_third
