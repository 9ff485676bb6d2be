"""Limit points, bifurcations and the onset of flutter: found between two points of a path, and located.

At a limit point or a bifurcation an eigenvalue of the stiffness passes zero; its eigenvector is the direction in which
the machine gives way.  At a limit point the load does work along it, and the factor turns; at a bifurcation another
path crosses in its direction (Seydel 2010, Practical Bifurcation and Stability Analysis, chapter 5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from flexmbd.errors import ConvergenceError
from flexmbd.multibody.linear.path.corrector import PathDirection, PathPoint, PathSpace
from flexmbd.multibody.linear.path.follow import Stretch
from flexmbd.multibody.linear.stability import MotionSpectrum

FloatArray = NDArray[np.float64]

_WITHIN = 1e-7  # of a step: how exactly they are located
_MOST_MODES = 2  # in which the machine may give way at once
_BESIDE = 1e-3  # of a step: how far before and behind tangents are compared


class CriticalKind(Enum):
    """What happens at a critical point.

    Attributes:
        LIMIT: the load factor turns.
        BIFURCATION: another path of equilibria crosses.
        FLUTTER: vibrations begin to grow, of a machine under forces that have no potential.
    """

    LIMIT = "limit point"
    BIFURCATION = "bifurcation"
    FLUTTER = "flutter"


@dataclass(frozen=True, eq=False)
class PathCrossing:
    """A critical point between two points of a path.

    Attributes:
        kind: of it.
        share: of the step at which it lies.
        point: it.
        mode: (nv,) the direction in which the machine gives way; its largest part is 1 rad or the machine's extent.
        tangent: of the path.
        unstable: how many motions are unstable behind it.
    """

    kind: CriticalKind
    share: float
    point: PathPoint
    mode: FloatArray
    tangent: PathDirection
    unstable: int


def crossings(space: PathSpace, stretch: Stretch) -> list[PathCrossing]:
    """The critical points of a stretch, in their order.

    Raises:
        ConvergenceError: Newton's method does not converge between points between which it did.
    """
    search = _Located(space, stretch)
    before, after = stretch.before.spectrum, stretch.after.spectrum
    low, high = sorted((before.unstable, after.unstable))
    if before.has_potential and after.has_potential:
        found = [search.crossing(partial(_eigenvalue, k), k) for k in range(low, high)]
    elif low == high:
        found = []
    elif _determinant(before) * _determinant(after) < 0.0:
        found = [search.crossing(_determinant)]
    else:
        found = [search.flutter()]
    turns = stretch.before.tangent.factor * stretch.after.tangent.factor < 0.0
    if turns and not any(one.kind is CriticalKind.LIMIT for one in found):
        found.append(search.turning())
    return sorted(found, key=lambda one: one.share)


def _eigenvalue(k: int, spectrum: MotionSpectrum) -> float:
    return float(spectrum.values[k].real)


def _determinant(spectrum: MotionSpectrum) -> float:
    """The smallest eigenvalue's size with the sign of the product of all."""
    real = np.abs(spectrum.values.imag) == 0.0
    sign = -1.0 if int((spectrum.values.real[real] < 0.0).sum()) % 2 else 1.0
    return sign * float(np.abs(spectrum.values).min())


@dataclass(frozen=True, eq=False)
class _Located:
    space: PathSpace
    stretch: Stretch

    def crossing(self, value: Callable[[MotionSpectrum], float], k: int | None = None) -> PathCrossing:
        """Where a value of the spectrum passes zero, which is eigenvalue k or the smallest one."""
        share = float(brentq(lambda share: value(self.space.spectrum(self._at(share))), 0.0, 1.0, xtol=_WITHIN))
        point = self._at(share)
        before, after = (self._tangent(share + side) for side in (-_BESIDE, _BESIDE))
        kind = CriticalKind.LIMIT if before.factor * after.factor < 0.0 else CriticalKind.BIFURCATION
        return self._crossing(kind, share, point, self.space.unit(before.plus(after)), k)

    def flutter(self) -> PathCrossing:
        """Where the number of unstable motions changes, by halving."""
        low, high = 0.0, 1.0
        stable = self.stretch.before.spectrum.unstable
        while high - low > _WITHIN:
            middle = 0.5 * (low + high)
            if self.space.spectrum(self._at(middle)).unstable == stable:
                low = middle
            else:
                high = middle
        return self._crossing(CriticalKind.FLUTTER, high, self._at(high), self._tangent(high))

    def turning(self) -> PathCrossing:
        """Where the factor turns though no eigenvalue has changed its sign."""
        share = float(brentq(lambda share: self._tangent(share).factor, 0.0, 1.0, xtol=_WITHIN))
        return self._crossing(CriticalKind.LIMIT, share, self._at(share), self._tangent(share))

    def _at(self, share: float) -> PathPoint:
        if share in (0.0, 1.0):
            return (self.stretch.before if share == 0.0 else self.stretch.after).point
        start = self.stretch.before.point
        step = self.stretch.step.times(share)
        for undetermined in range(_MOST_MODES):
            try:
                return self.space.correct(start, step, self.stretch.across, undetermined=undetermined)
            except ConvergenceError:
                continue
        return self.space.correct(start, step, self.stretch.across, undetermined=_MOST_MODES)

    def _tangent(self, share: float) -> PathDirection:
        if share <= 0.0 or share >= 1.0:
            return (self.stretch.before if share <= 0.0 else self.stretch.after).tangent
        return self.space.tangent(self._at(share), self.stretch.before.tangent)

    def _crossing(
        self, kind: CriticalKind, share: float, point: PathPoint, tangent: PathDirection, k: int | None = None
    ) -> PathCrossing:
        spectrum = self.space.spectrum(point)
        mode = spectrum.mode(int(np.argmin(np.abs(spectrum.values))) if k is None else k)
        parts = mode / self.space.size
        mode = mode / parts[np.argmax(np.abs(parts))]
        return PathCrossing(kind, share, point, mode, tangent, self.stretch.after.spectrum.unstable)
