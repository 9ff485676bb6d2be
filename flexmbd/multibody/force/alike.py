"""Elements of which a scene may have a hundred thousand: how those of one class enter the plan together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.force.protocol import BetweenFrames
from flexmbd.multibody.kernels.elements.element import ElementKind

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True)
class AlikeElements:
    """A class of elements between two frames whose rows follow from their numbers alone.

    Attributes:
        element: how kernels compute them.
        names: their attributes that are the numbers of a row, in order; two or more.
        acting: (n,) of numbers (n, k), whether elements with these ever exert anything.
    """

    element: ElementKind
    names: tuple[str, ...]
    acting: Callable[[FloatArray], BoolArray]

    def numbers(self, forces: Sequence[BetweenFrames]) -> FloatArray:
        """(n, k) the numbers of elements."""
        found = np.array(list(map(attrgetter(*self.names), forces)), dtype=np.float64)
        return found.reshape(len(forces), len(self.names))
