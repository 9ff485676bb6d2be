"""Limit points, bifurcations and the onset of flutter: found between two points of a path, and located.

At a limit point or a bifurcation an eigenvalue of the stiffness passes zero; its eigenvector is the direction in which
the machine, or the body, gives way.  At a limit point the load does work along it, and the factor turns; at a
bifurcation another path crosses in its direction (Seydel 2010, Practical Bifurcation and Stability Analysis, chapter
5).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Generic

import numpy as np

from flexmbd.continuation.crossing import CriticalKind, PathCrossing
from flexmbd.continuation.space import AnyPoint, FloatArray, PathDirection, PathSpace, PathSpectrum, unit
from flexmbd.continuation.station import Station, Stretch, station
from flexmbd.continuation.zero import zero
from flexmbd.errors import ConvergenceError

_WITHIN = 1e-7  # of a step: how exactly they are located
_ASIDE = 1e-2  # of a step: how far before and behind a factor is compared that turns where paths cross
_MOST_MODES = 2  # that may give way at once
_BESIDE = 1e-3  # of a step: how far before and behind tangents are compared
_TURNED = 2e-3  # of a step: how far from where paths cross round-off turns tangents
_NEAR = (3e-3, 1e-2, 3e-2, 0.1)  # of a step: how far from where paths cross a point is tried that is determined


def crossings(space: PathSpace[AnyPoint], stretch: Stretch[AnyPoint]) -> list[PathCrossing[AnyPoint]]:
    """The critical points of a stretch, in their order.

    Raises:
        ConvergenceError: Newton's method does not converge between points between which it did.
    """
    try:
        return _crossings(space, stretch)
    except ConvergenceError as reason:
        raise ConvergenceError(
            f"a critical point of the path between the factors {stretch.before.point.factor:.6g} and "
            f"{stretch.after.point.factor:.6g} could not be located: {reason}; take a smaller longest_step"
        ) from reason


def _crossings(space: PathSpace[AnyPoint], stretch: Stretch[AnyPoint]) -> list[PathCrossing[AnyPoint]]:
    search = _StretchPoints(space, stretch)
    before, after = stretch.before.spectrum, stretch.after.spectrum
    if before.has_potential and after.has_potential:
        low, high = sorted((before.unstable, after.unstable))
        found = [search.crossing(partial(_eigenvalue, k), k) for k in range(low, high)]
    else:
        found = search.without_potential()
    turns = stretch.before.tangent.factor * stretch.after.tangent.factor < 0.0
    if turns and not any(one.kind is CriticalKind.LIMIT for one in found):
        # at a limit load that stays round-off chooses the factor's side
        if not (after.gives_way or before.gives_way):
            found.append(search.turning())
    return sorted(found, key=lambda one: one.share)


def _eigenvalue(k: int, spectrum: PathSpectrum) -> float:
    return spectrum.eigenvalue(k)


def _determinant(spectrum: PathSpectrum) -> float:
    """The smallest eigenvalue's size with the sign of the product of all."""
    return spectrum.sign * spectrum.smallest()


class _StretchPoints(Generic[AnyPoint]):
    """Points of a stretch, which are found from those that are known already."""

    def __init__(self, space: PathSpace[AnyPoint], stretch: Stretch[AnyPoint]) -> None:
        self._space, self._stretch = space, stretch
        self._known = {0.0: stretch.before, 1.0: stretch.after}

    def crossing(
        self,
        value: Callable[[PathSpectrum], float],
        k: int | None = None,
        *,
        between: tuple[float, float] = (0.0, 1.0),
    ) -> PathCrossing[AnyPoint]:
        """Where a value of the spectrum passes zero, which is eigenvalue k or the smallest one."""
        round_off = self._stretch.after.spectrum.round_off
        share = zero(lambda share: value(self._at(share).spectrum), *between, within=_WITHIN, round_off=round_off)
        kind, tangent = self._kind_around(share)
        spectrum = self._at(share).spectrum
        mode = spectrum.mode(spectrum.nearest() if k is None else k)
        return self._crossing(kind, share, tangent, mode)

    def without_potential(self, low: float = 0.0, high: float = 1.0) -> list[PathCrossing[AnyPoint]]:
        """Where the number of unstable motions changes, one by one or, in flutter, two at once, by halving."""
        before, after = (self._at(share).spectrum for share in (low, high))
        if before.unstable == after.unstable:
            return []
        if abs(before.unstable - after.unstable) == 1 and before.sign * after.sign < 0.0:
            return [self.crossing(_determinant, between=(low, high))]
        if high - low <= _WITHIN:
            return [self._several_at_once(low, high)]
        middle = 0.5 * (low + high)
        return [*self.without_potential(low, middle), *self.without_potential(middle, high)]

    def _several_at_once(self, low: float, high: float) -> PathCrossing[AnyPoint]:
        """Between two places next to each other: flutter that begins or ends, else eigenvalues that pass zero together.

        The mode of flutter is that of the side on which more motions grow, for on the other it may be none.
        """
        stations = [self._at(share) for share in (high, low)]
        for one in sorted(stations, key=lambda one: one.spectrum.unstable, reverse=True):
            mode = one.spectrum.flutter_mode()
            if mode is not None:
                return self._crossing(CriticalKind.FLUTTER, high, stations[0].tangent, mode)
        spectrum = min((one.spectrum for one in stations), key=lambda one: one.smallest())
        kind, tangent = self._kind_around(high)
        return self._crossing(kind, high, tangent, spectrum.mode(spectrum.nearest()))

    def _kind_around(self, share: float) -> tuple[CriticalKind, PathDirection]:
        """Whether the factor turns where eigenvalues pass zero, or another path crosses; and the unit tangent."""
        before, after = (self._at(min(max(share + side, 0.0), 1.0)).tangent for side in (-_BESIDE, _BESIDE))
        kind = CriticalKind.LIMIT if before.factor * after.factor < 0.0 else CriticalKind.BIFURCATION
        return kind, unit(self._space, before.plus(after))

    def turning(self) -> PathCrossing[AnyPoint]:
        """Where the factor turns though no eigenvalue has changed its sign: another path crosses there.

        Round-off turns tangents next to there, so it is found from points aside, by the cubic of their factors.
        """
        near = zero(lambda share: self._at(share).tangent.factor, 0.0, 1.0, within=_ASIDE)
        low, high = max(near - _ASIDE, 0.0), min(near + _ASIDE, 1.0)
        length = high - low
        rise = (self._at(high).point.factor - self._at(low).point.factor) / length
        first, last = (self._slope(self._at(share)).factor for share in (low, high))
        # the slope of the cubic: first + linear x + square x^2
        square, linear = 3.0 * (first + last - 2.0 * rise), 6.0 * rise - 4.0 * first - 2.0 * last
        root = np.sqrt(max(linear**2 - 4.0 * square * first, 0.0))
        share = low + length * -2.0 * first / (linear + np.copysign(root, linear))
        along = self._at(low).tangent.times(high - share).plus(self._at(high).tangent.times(share - low))
        spectrum = self._at(share).spectrum
        return self._crossing(CriticalKind.LIMIT, share, unit(self._space, along), spectrum.mode(spectrum.nearest()))

    def _at(self, share: float) -> Station[AnyPoint]:
        if share not in self._known:
            try:
                point = self._determined(share)
            except ConvergenceError:
                point = self._undetermined(share)
            self._known[share] = station(self._space, point, self._stretch.before.tangent)
        return self._known[share]

    def _determined(self, share: float) -> AnyPoint:
        begin, change = self._predicted(share)
        return self._space.correct(begin, change, self._stretch.across)

    def _predicted(self, share: float) -> tuple[AnyPoint, PathDirection]:
        """A known point and the change from there to a share, by the cubic through it and another one.

        They are the nearest ones but for those so near that, next to where paths cross, round-off turns their tangents;
        paths do not cross at the ends of a stretch.
        """
        usable = [known for known in self._known if abs(known - share) > _TURNED or known in (0.0, 1.0)]
        usable.sort(key=lambda known: abs(known - share))
        begin = next(known for known in usable if known != 1.0)  # what has a memory does not go back from the end
        other = next(known for known in usable if known != begin)
        one, two = self._known[begin], self._known[other]
        length, x = other - begin, (share - begin) / (other - begin)
        across = self._space.difference(one.point, two.point).times(x * x * (3.0 - 2.0 * x))
        here, there = (self._slope(station) for station in (one, two))
        slopes = here.times(length * x * (1.0 - x) ** 2).plus(there.times(length * x * x * (x - 1.0)))
        return one.point, across.plus(slopes)

    def _slope(self, there: Station[AnyPoint]) -> PathDirection:
        """The change by one of the share."""
        across = self._stretch.across
        length = self._space.product(across, self._stretch.step) / self._space.product(across, there.tangent)
        return there.tangent.times(length)

    def _undetermined(self, share: float) -> AnyPoint:
        """So near to where paths cross that the other one's direction stays as near points' tangents leave it."""
        failure = ConvergenceError()
        for aside in _NEAR:
            try:
                self._at_near(share, aside)
            except ConvergenceError as reason:
                failure = reason
                continue
            begin, change = self._predicted(share)
            for undetermined in range(1, _MOST_MODES + 1):
                try:
                    return self._space.correct(begin, change, self._stretch.across, undetermined=undetermined)
                except ConvergenceError as reason:
                    failure = reason
        raise failure

    def _at_near(self, share: float, aside: float) -> None:
        """Know a point that lies aside, if there is none so near."""
        if any(_TURNED < abs(known - share) <= aside for known in self._known):
            return
        place = share + (-aside if share > aside else aside)
        self._known[place] = station(self._space, self._determined(place), self._stretch.before.tangent)

    def _crossing(
        self, kind: CriticalKind, share: float, tangent: PathDirection, mode: FloatArray
    ) -> PathCrossing[AnyPoint]:
        unstable = self._stretch.after.spectrum.unstable
        return PathCrossing(kind, share, self._at(share).point, self._space.sized(mode), tangent, unstable)
