"""A spring and damper from point to point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.alike import AlikeElements, BoolArray, FloatArray
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable, check_numbers
from flexmbd.multibody.kernels.elements.distance_spring import DISTANCE_SPRING


@dataclass(frozen=True, eq=False)
class SpringDamper(BetweenFrames):
    """A pull stiffness (L - length) + damping dL/dt along the line of length L between two frames' origins.

    Attributes:
        frame_F, frame_G: its ends.
        stiffness: N/m.
        length: m, unstretched.  With 0 the ends may meet; with more, the line has no direction where they do.
        damping: N s/m.
    """

    frame_F: Frame
    frame_G: Frame
    stiffness: float
    length: float
    damping: float = 0.0

    def check(self) -> None:
        """Raise SceneError for numbers that no spring has."""
        check_numbers(
            self.what, least={"stiffness": self.stiffness, "length": self.length, "damping": self.damping}
        )

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = SPRINGS.numbers([self])
        data = table.numbers(numbers[0])
        f, g = table.frame(self.frame_F), table.frame(self.frame_G)
        acts = bool(SPRINGS.acting(numbers)[0])
        table.element(SPRINGS.element, self.what, f=f, g=g, data=data, acts=acts)


def _acting(numbers: FloatArray) -> BoolArray:
    """Those with a stiffness or a damping."""
    return np.asarray((numbers[:, [0, 2]] > 0.0).any(axis=1))


#: Of springs a scene may have many.
SPRINGS = AlikeElements(DISTANCE_SPRING, ("stiffness", "length", "damping"), _acting)
