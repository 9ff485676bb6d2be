"""Points of a path with what is known there, and the steps between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic

import numpy as np

from flexmbd.continuation.crossing import PathCrossing
from flexmbd.continuation.space import AnyPoint, PathDirection, PathSpace, PathSpectrum


@dataclass(frozen=True, eq=False)
class Station(Generic[AnyPoint]):
    """A point of a path with its tangent and the spectrum of its stiffness."""

    point: AnyPoint
    tangent: PathDirection
    spectrum: PathSpectrum


@dataclass(frozen=True, eq=False)
class Stretch(Generic[AnyPoint]):
    """A step of a path, from one station to the next.

    Attributes:
        before, after: its ends.
        step: that led from one to the other.
        across: what corrections were normal to.
        met: the critical points on the way, in their order, where these are looked for.
        closes: whether the path has come back to where it began.
    """

    before: Station[AnyPoint]
    after: Station[AnyPoint]
    step: PathDirection
    across: PathDirection
    met: Sequence[PathCrossing[AnyPoint]] = ()
    closes: bool = False


def station(space: PathSpace[AnyPoint], point: AnyPoint, onwards: PathDirection) -> Station[AnyPoint]:
    """A point with its tangent on the side of a direction."""
    return Station(point, space.tangent(point, onwards), space.spectrum(point))


def angle(space: PathSpace[AnyPoint], a: Station[AnyPoint], b: Station[AnyPoint]) -> float:
    """Between tangents, rad."""
    return float(np.arccos(np.clip(space.product(a.tangent, b.tangent), -1.0, 1.0)))
