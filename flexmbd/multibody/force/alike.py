"""Force elements of which a scene may have a hundred thousand: they enter the plan together."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from operator import attrgetter
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable
from flexmbd.multibody.kernels.elements.element import ElementKind

FloatArray = NDArray[np.float64]


class AlikeBetweenFrames(BetweenFrames):
    """Base of elements between two frames whose rows follow from their numbers alone, for frozen dataclasses.

    Attributes:
        element: how kernels compute it.
        number_names: its attributes that are the numbers of its row, in order; two or more.
    """

    element: ClassVar[ElementKind]
    number_names: ClassVar[tuple[str, ...]]

    @classmethod
    def numbers_of(cls, forces: Sequence[AlikeBetweenFrames]) -> FloatArray:
        """(n, k) the numbers of elements of this class."""
        found = np.array(list(map(attrgetter(*cls.number_names), forces)), dtype=np.float64)
        return found.reshape(len(forces), len(cls.number_names))

    @classmethod
    @abstractmethod
    def acting(cls, numbers: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether elements with these numbers (n, k) ever exert anything."""

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = self.numbers_of([self])
        data = table.numbers(numbers[0])
        f, g = table.frame(self.frame_F), table.frame(self.frame_G)
        table.element(self.element, self.what, f=f, g=g, data=data, acts=bool(self.acting(numbers)[0]))
