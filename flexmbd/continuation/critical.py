"""Limit points, bifurcations and the onset of flutter: found between two points of a path, and located.

At a limit point or a bifurcation an eigenvalue of the stiffness passes zero; its eigenvector is the direction in which
the machine, or the body, gives way.  At a limit point the load does work along it, and the factor turns; at a
bifurcation another path crosses in its direction (Seydel 2010, Practical Bifurcation and Stability Analysis, chapter
5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Generic

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from flexmbd.continuation.crossing import CriticalKind, PathCrossing
from flexmbd.continuation.follow import Stretch
from flexmbd.continuation.space import AnyPoint, PathDirection, PathSpace, PathSpectrum, unit
from flexmbd.errors import ConvergenceError

FloatArray = NDArray[np.float64]

_WITHIN = 1e-7  # of a step: how exactly they are located
_MOST_MODES = 2  # that may give way at once
_BESIDE = 1e-3  # of a step: how far before and behind tangents are compared
_NEAR = (1e-3, 3e-3, 1e-2, 3e-2, 0.1)  # of a step: how far from where paths cross a point is tried that is determined


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
    search = _Located(space, stretch)
    before, after = stretch.before.spectrum, stretch.after.spectrum
    if before.has_potential and after.has_potential:
        low, high = sorted((before.unstable, after.unstable))
        found = [search.crossing(partial(_eigenvalue, k), k) for k in range(low, high)]
    else:
        found = search.without_potential()
    turns = stretch.before.tangent.factor * stretch.after.tangent.factor < 0.0
    if before.gives_way or after.gives_way:  # as at a limit load that stays: round-off chooses the factor's side
        turns = False
    if turns and not any(one.kind is CriticalKind.LIMIT for one in found):
        found.append(search.turning())
    return sorted(found, key=lambda one: one.share)


def _eigenvalue(k: int, spectrum: PathSpectrum) -> float:
    return spectrum.eigenvalue(k)


def _determinant(spectrum: PathSpectrum) -> float:
    """The smallest eigenvalue's size with the sign of the product of all."""
    return spectrum.sign * spectrum.smallest()


def _zero(value: Callable[[float], float], low: float, high: float) -> float:
    """Where a value passes zero between two shares of a step."""
    ends = value(low), value(high)
    if not ends[0] * ends[1] <= 0.0:
        raise ConvergenceError(f"what passes zero between them is {ends[0]:.3g} and {ends[1]:.3g} at their ends")
    return float(brentq(value, low, high, xtol=_WITHIN))


@dataclass(frozen=True, eq=False)
class _Located(Generic[AnyPoint]):
    space: PathSpace[AnyPoint]
    stretch: Stretch[AnyPoint]

    def crossing(
        self,
        value: Callable[[PathSpectrum], float],
        k: int | None = None,
        *,
        between: tuple[float, float] = (0.0, 1.0),
    ) -> PathCrossing[AnyPoint]:
        """Where a value of the spectrum passes zero, which is eigenvalue k or the smallest one."""
        share = _zero(lambda share: value(self.space.spectrum(self._at(share))), *between)
        point = self._at(share)
        before, after = (self._tangent(share + side) for side in (-_BESIDE, _BESIDE))
        kind = CriticalKind.LIMIT if before.factor * after.factor < 0.0 else CriticalKind.BIFURCATION
        return self._crossing(kind, share, point, unit(self.space, before.plus(after)), k)

    def without_potential(self, low: float = 0.0, high: float = 1.0) -> list[PathCrossing[AnyPoint]]:
        """Where the number of unstable motions changes, one by one or, in flutter, two at once, by halving."""
        before, after = (self.space.spectrum(self._at(share)) for share in (low, high))
        if before.unstable == after.unstable:
            return []
        if abs(before.unstable - after.unstable) == 1 and before.sign * after.sign < 0.0:
            return [self.crossing(_determinant, between=(low, high))]
        if high - low <= _WITHIN:
            return [self._crossing(CriticalKind.FLUTTER, high, self._at(high), self._tangent(high))]
        middle = 0.5 * (low + high)
        return [*self.without_potential(low, middle), *self.without_potential(middle, high)]

    def turning(self) -> PathCrossing[AnyPoint]:
        """Where the factor turns though no eigenvalue has changed its sign."""
        share = _zero(lambda share: self._tangent(share).factor, 0.0, 1.0)
        return self._crossing(CriticalKind.LIMIT, share, self._at(share), self._tangent(share))

    def _at(self, share: float) -> AnyPoint:
        if share in (0.0, 1.0):
            return (self.stretch.before if share == 0.0 else self.stretch.after).point
        try:
            return self._determined(share)
        except ConvergenceError:
            return self._undetermined(share)

    def _determined(self, share: float) -> AnyPoint:
        return self.space.correct(self.stretch.before.point, self.stretch.step.times(share), self.stretch.across)

    def _undetermined(self, share: float) -> AnyPoint:
        """So near to where paths cross that the other one's direction stays as a near point's tangent leaves it."""
        space, across = self.space, self.stretch.across
        failure = ConvergenceError()
        for aside in _NEAR:
            apart = -aside if share > aside else aside
            try:
                near = self._determined(share + apart)
            except ConvergenceError as reason:
                failure = reason
                continue
            tangent = space.tangent(near, self.stretch.before.tangent)
            length = -apart * space.product(across, self.stretch.step) / space.product(across, tangent)
            for undetermined in range(1, _MOST_MODES + 1):
                try:
                    return space.correct(near, tangent.times(length), across, undetermined=undetermined)
                except ConvergenceError as reason:
                    failure = reason
        raise failure

    def _tangent(self, share: float) -> PathDirection:
        if share <= 0.0 or share >= 1.0:
            return (self.stretch.before if share <= 0.0 else self.stretch.after).tangent
        return self.space.tangent(self._at(share), self.stretch.before.tangent)

    def _crossing(
        self, kind: CriticalKind, share: float, point: AnyPoint, tangent: PathDirection, k: int | None = None
    ) -> PathCrossing[AnyPoint]:
        spectrum = self.space.spectrum(point)
        mode = self.space.sized(spectrum.mode(spectrum.nearest() if k is None else k))
        return PathCrossing(kind, share, point, mode, tangent, self.stretch.after.spectrum.unstable)
