"""Points of a path at which something gives way."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Generic

import numpy as np
from numpy.typing import NDArray

from flexmbd.continuation.space import AnyPoint, PathDirection

FloatArray = NDArray[np.float64]


class CriticalKind(Enum):
    """What happens at a critical point.

    Attributes:
        LIMIT: the load factor turns.
        BIFURCATION: another path of equilibria crosses.
        FLUTTER: vibrations begin to grow, of a machine or a body under forces that have no potential.
    """

    LIMIT = "limit point"
    BIFURCATION = "bifurcation"
    FLUTTER = "flutter"


@dataclass(frozen=True, eq=False)
class PathCrossing(Generic[AnyPoint]):
    """A critical point between two points of a path.

    Attributes:
        kind: of it.
        share: of the step at which it lies.
        point: it.
        mode: (n,) the direction of giving way; its largest part is 1 rad or the extent.
        tangent: of the path.
        unstable: how many motions are unstable behind it.
    """

    kind: CriticalKind
    share: float
    point: AnyPoint
    mode: FloatArray
    tangent: PathDirection
    unstable: int
