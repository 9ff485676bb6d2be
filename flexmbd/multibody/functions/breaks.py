"""Where functions of time are not smooth: the instants that steps end on, and stretches that no step may leap over.

Data are cut into stretches: each as long as one polynomial of degree `DEGREE` follows it to within rtol of all that
the data span.  So a dense table of a smooth function has few, a noisy one as many as it has points, and a pulse its
own, however short.  Where neighbouring stretches meet with another value or slope (of a motion: another rate,
acceleration or slope of that) there is a break, at which steps end and methods begin anew; elsewhere a step may cross
from one stretch into the next, but it contains none.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from flexmbd.multibody.functions.time_function import TimeRow

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

DEGREE = 5
_PER_PIECE = 6  # points of a piece at which a polynomial is compared with it
_ROUND_OFF = 1e-11  # of a polynomial's terms: more than what is left where splines change from one form to another


@dataclass(frozen=True, eq=False)
class Breaks:
    """Instants (s), ascending.

    Attributes:
        jumps: where steps end and methods begin anew.
        knots: ends of stretches of data, jumps among them.
    """

    jumps: FloatArray
    knots: FloatArray

    def next_jump(self, t: float) -> float:
        """The first jump after t (s); infinite where there is none."""
        k = bisect_right(self.jumps, t)  # of few, for which numpy's search takes as long as many steps
        return float(self.jumps[k]) if k < len(self.jumps) else np.inf


def find_breaks(rows: Sequence[TimeRow], declared: ArrayLike, *, rtol: float, h: float | None = None) -> Breaks:
    """The breaks of all functions of time, and those declared, for a simulation with rtol or with fixed steps h (s).

    The user who fixes the step says how finely data are to be resolved: only stretches too short to be sampled by such
    steps, less than half of one, divide it.
    """
    jumps, knots = [np.asarray(declared, dtype=np.float64)], []
    for row in rows:
        if row.has_pieces:
            poly = _polynomial(row)
            if row.motion:
                # what acts is its acceleration, and where its rate jumps, an impulse
                smooth, rate = poly.derivative(2), poly.derivative()
                parts = [(stretches(smooth, rtol), 4), (stretches(rate, rtol), 2), (stretches(poly, rtol), 1)]
            else:
                parts = [(stretches(poly, rtol), 2)]
            for found, derivatives in parts:
                jumps.append(found[_discontinuities(poly, found, derivatives)])
                knots.append(found if h is None else _of_short_stretches(poly, found, 0.5 * h))
    if not any(map(len, jumps)) and not any(map(len, knots)):
        return Breaks(np.zeros(0), np.zeros(0))
    sharp = _distinct(np.unique(np.concatenate(jumps)))
    return Breaks(sharp, _distinct(np.unique(np.concatenate([sharp, *knots]))))


def jumps_of_rate(row: TimeRow) -> FloatArray:
    """Instants (s) at which data of a prescribed motion jump in value or rate."""
    return _jumps(row, 2) if row.motion else np.zeros(0)


def jumps_of_value(row: TimeRow) -> FloatArray:
    """Instants (s) at which data jump."""
    return _jumps(row, 1)


def _jumps(row: TimeRow, derivatives: int) -> FloatArray:
    if not row.has_pieces:
        return np.zeros(0)
    poly = _polynomial(row)
    inside: FloatArray = poly.x[1:-1]
    return inside[_discontinuities(poly, inside, derivatives)]


def _distinct(instants: FloatArray) -> FloatArray:
    """Ascending instants without those that differ from the one before by rounding alone."""
    return instants[np.diff(instants, prepend=-np.inf) > 32.0 * np.spacing(np.abs(instants))]


def stretches(poly: PPoly, share: float) -> FloatArray:
    """The breakpoints at which one polynomial no longer follows, to within ``share`` of all that the pieces span."""
    bounds = np.arange(len(poly.x))
    samples, within = _samples(poly)
    size = float(np.abs(samples).max())
    limit = share * float(samples.max() - samples.min()) + _ROUND_OFF * size
    settled = np.zeros(len(bounds), bool)
    settled[[0, -1]] = True
    while not settled.all():
        soft = np.flatnonzero(~settled)
        # no two neighbours at once: each is tried with what lies beside it
        begins = np.concatenate([[True], np.diff(soft) > 1])
        tried = soft[(soft - soft[begins][np.cumsum(begins) - 1]) % 2 == 0]
        joined = _is_followed(samples, within, poly.x, bounds[tried - 1], bounds[tried + 1], limit)
        settled[tried[~joined]] = True
        keep = np.ones(len(bounds), bool)
        keep[tried[joined]] = False
        bounds, settled = bounds[keep], settled[keep]
    found: FloatArray = poly.x[bounds[1:-1]]
    return found


def _of_short_stretches(poly: PPoly, knots: FloatArray, length: float) -> FloatArray:
    """Those of the knots between stretches beside which one is shorter than a length (s)."""
    short = np.diff(np.concatenate([poly.x[:1], knots, poly.x[-1:]])) < length
    return knots[short[1:] | short[:-1]]


def _polynomial(row: TimeRow) -> PPoly:
    """The piecewise polynomial of a row's data."""
    from scipy.interpolate import PPoly  # on need: it takes as long to load as a pendulum to compute

    order, pieces = int(row.data[0]), row.count
    x = row.data[1 : pieces + 2]
    return PPoly(row.data[pieces + 2 :].reshape(pieces, order).T, x)


def _samples(poly: PPoly) -> tuple[FloatArray, FloatArray]:
    """(pieces, k) values of each piece, and where they are in it: 0 to 1; its ends and Chebyshev's points between."""
    inner = 0.5 - 0.5 * np.cos(np.pi * np.arange(_PER_PIECE) / (_PER_PIECE - 1))
    s = np.diff(poly.x)[:, None] * inner
    values = np.zeros_like(s)
    for c in poly.c:
        values = values * s + c[:, None]
    return values, inner


def _is_followed(
    samples: FloatArray, within: FloatArray, x: FloatArray, first: NDArray[np.int64], last: NDArray[np.int64],
    limit: float,
) -> BoolArray:  # fmt: skip
    """Whether one polynomial is within ``limit`` of the pieces from ``first`` to before ``last``, for each pair."""
    joined = np.zeros(len(first), bool)
    for length in np.unique(last - first):
        mine = np.flatnonzero(last - first == length)
        pieces = first[mine, None] + np.arange(length)
        begin, width = x[first[mine]], x[last[mine]] - x[first[mine]]
        at_t = (x[pieces][:, :, None] - begin[:, None, None] + np.diff(x)[pieces][:, :, None] * within)
        place = (2.0 * at_t / width[:, None, None] - 1.0).reshape(len(mine), -1)
        values = samples[pieces].reshape(len(mine), -1)
        basis = np.moveaxis(chebyshev.chebvander(place, DEGREE), -1, 1)
        normal = basis @ np.swapaxes(basis, 1, 2)
        coefficients = np.linalg.solve(normal, (basis @ values[:, :, None]))
        gap = np.abs(values - (np.swapaxes(coefficients, 1, 2) @ basis)[:, 0])
        joined[mine] = gap.max(axis=1) <= limit
    return joined


def _discontinuities(poly: PPoly, instants: FloatArray, derivatives: int) -> BoolArray:
    """Where a derivative of an order below ``derivatives`` jumps, by more than the round-off of its terms."""
    inside = np.searchsorted(poly.x, instants)
    torn = np.zeros(len(instants), bool)
    width = np.diff(poly.x)[inside - 1]
    for _ in range(derivatives):
        left, terms = np.zeros(len(inside)), np.zeros(len(inside))
        for c in poly.c:
            left = left * width + c[inside - 1]
            terms = terms * width + np.abs(c[inside - 1])
        right = poly.c[-1, inside]
        torn |= np.abs(right - left) > _ROUND_OFF * np.maximum(terms, np.abs(right))
        if len(poly.c) == 1:
            break
        poly = poly.derivative()
    return torn
