"""An equilibrium of a body on a path, and what its tangent stiffness tells there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.flutter import count_growing, flutters, grows, parted
from flexmbd.continuum.history.nonlinear_model import HistorySnapshot
from flexmbd.continuum.slow_loading.stiffness_spectrum import NearZero
from flexmbd.errors import ConvergenceError

FloatArray = NDArray[np.float64]

_FEW = 4  # eigenvalues next to zero that are looked at first
_MOST_NEAR = 64  # eigenvalues next to zero among which one is looked for


@dataclass(frozen=True, eq=False)
class BodyPoint:
    """An equilibrium of a body on a path.

    Attributes:
        before: what the body remembered before the step that led there.
        increment: (local dofs including ghosts,) m, of that step.
        factor: of the load.
        iterations: of Newton's method.
        response: (owned dofs,) change of the configuration by one of the factor.
        reactions: (prescribed dofs of this rank,) N.
        negative: how many negative eigenvalues the stiffness has; None of one that is not symmetric.
        sign: of its determinant.
        after: what the body remembers there, once it is accepted.
    """

    before: HistorySnapshot
    increment: FloatArray
    factor: float
    iterations: int
    response: FloatArray
    reactions: FloatArray
    negative: int | None
    sign: float
    after: HistorySnapshot | None = None

    @property
    def state(self) -> HistorySnapshot:
        """What the body remembers there; until it is accepted, what it did before."""
        return self.before if self.after is None else self.after

    @property
    def displacement(self) -> FloatArray:
        """(local dofs including ghosts,) m, from the undeformed body."""
        return self.before.displacement + self.increment if self.after is None else self.after.displacement


class BodySpectrum:
    """The stiffness' eigenvalues at a point, computed when they are asked for, and kept. All of it is collective."""

    def __init__(self, point: BodyPoint, near_zero: Callable[[int], NearZero]) -> None:
        """Nothing is computed yet; ``near_zero`` computes some of them."""
        self._point, self._compute = point, near_zero
        self._kept: NearZero | None = None

    @cached_property
    def unstable(self) -> int:
        """How many motions grow, beyond round-off; where the stiffness is not symmetric, of those next to zero."""
        if self._point.negative == 0:
            return 0
        count = _FEW
        while True:
            near = self._near(count)
            values = near.values
            growing = grows(values, near.round_off)
            if self._point.negative is not None:
                idle = int(np.count_nonzero((values.real < 0.0) & ~growing))
                return self._point.negative - idle
            if not growing[len(values) // 2 :].any() or len(values) < count or count >= _MOST_NEAR:
                return count_growing(values, near.round_off)
            count *= 2

    @property
    def gives_way(self) -> bool:
        """Whether nothing resists some motion, up to round-off, as where a body yields without hardening."""
        return self.smallest() <= self.round_off

    @property
    def round_off(self) -> float:
        """What the factor leaves of an eigenvalue that is zero."""
        return self._near(1).round_off

    @property
    def has_potential(self) -> bool:
        """Whether the stiffness is symmetric."""
        return self._point.negative is not None

    @property
    def sign(self) -> float:
        """Of the product of all."""
        return self._point.sign

    def smallest(self) -> float:
        """The size of the one next to zero."""
        return float(abs(self._near(1).values[0]))

    def nearest(self) -> int:
        """Which of them is the smallest in size."""
        first = self._point.negative or 0
        return first - 1 if self._near(1).values[0].real < 0.0 else first

    def eigenvalue(self, k: int) -> float:
        """Of number k, ascending."""
        return self._pair(k)[0]

    def mode(self, k: int) -> FloatArray:
        """(owned dofs,) of number k."""
        return self._pair(k)[1]

    def flutter_mode(self) -> FloatArray | None:
        """(owned dofs,) of the pair of eigenvalues that became complex last, real part; None of none next to zero."""
        count = 2 * _FEW
        while True:
            near = self._near(count)
            pairs = np.flatnonzero(flutters(near.values))
            if len(pairs):
                return near.modes[:, pairs[np.argmin(parted(near.values)[pairs])]]
            if count >= _MOST_NEAR or len(near.values) < count:
                return None
            count *= 2

    def _pair(self, k: int) -> tuple[float, FloatArray]:
        first = self._point.negative or 0
        side, place = (-1.0, first - 1 - k) if k < first else (1.0, k - first)
        count = place + 1
        while True:
            near = self._near(count)
            own = np.flatnonzero(np.sign(near.values.real) == side)
            if len(own) > place:
                return float(near.values[own[place]].real), near.modes[:, own[place]]
            if count >= _MOST_NEAR:
                raise ConvergenceError(f"eigenvalue {k} of the tangent stiffness was not found next to zero")
            count = min(2 * count, _MOST_NEAR)

    def _near(self, count: int) -> NearZero:
        if self._kept is None or len(self._kept.values) < count:
            self._kept = self._compute(count)
        return self._kept
