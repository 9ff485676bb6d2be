"""What is found of a path of equilibria, of whatever has equilibria."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.crossing import CriticalKind
from flexmbd.continuation.follow import PathEnd

FloatArray = NDArray[np.float64]


class FoundEquilibrium(Protocol):
    """An equilibrium on a path."""

    @property
    def t(self) -> float:
        """Its load factor."""

    @property
    def unstable(self) -> int | None:
        """How many independent motions grow from it."""


class FoundCriticalPoint(Protocol):
    """An equilibrium at which something gives way."""

    @property
    def t(self) -> float:
        """Its load factor."""

    @property
    def kind(self) -> CriticalKind:
        """What happens there."""


AnyEquilibrium = TypeVar("AnyEquilibrium", bound=FoundEquilibrium)
AnyCriticalPoint = TypeVar("AnyCriticalPoint", bound=FoundCriticalPoint)


@dataclass(frozen=True, eq=False, repr=False)
class FoundPath(Generic[AnyEquilibrium, AnyCriticalPoint]):
    """Equilibria one after the other, as loads grow and fall.

    Attributes:
        points: the equilibria, with their load factors ``t``.
        critical: the critical points among them, in their order; located to 1e-7 of the step in which they lie.
        end: why the path ends.
    """

    points: tuple[AnyEquilibrium, ...]
    critical: tuple[AnyCriticalPoint, ...]
    end: PathEnd

    def __repr__(self) -> str:
        """How far it goes and what lies on it."""
        met = ", ".join(f"{one.kind.value} at {one.t:.6g}" for one in self.critical) or "no critical point"
        return (
            f"<{type(self).__name__}: {len(self.points)} points, factors {self.factors[0]:.6g} to "
            f"{self.factors[-1]:.6g} ({self.end.value}); {met}>"
        )

    @property
    def factors(self) -> FloatArray:
        """(k,) load factors."""
        return np.array([one.t for one in self.points])

    @property
    def unstable(self) -> NDArray[np.int64]:
        """(k,) how many independent motions grow from each; 0 where it is stable."""
        return np.array([one.unstable for one in self.points])


def told(point: FoundCriticalPoint) -> str:
    """A critical point's text: its kind and factor."""
    return f"<{type(point).__name__}: {point.kind.value} at the factor {point.t:.9g}>"
