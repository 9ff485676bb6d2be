"""A spring and damper from point to point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.alike import AlikeBetweenFrames
from flexmbd.multibody.force.protocol import check_numbers
from flexmbd.multibody.kernels.elements.distance_spring import DISTANCE_SPRING
from flexmbd.multibody.kernels.elements.element import ElementKind


@dataclass(frozen=True, eq=False)
class SpringDamper(AlikeBetweenFrames):
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

    element: ClassVar[ElementKind] = DISTANCE_SPRING
    number_names: ClassVar[tuple[str, ...]] = ("stiffness", "length", "damping")

    def check(self) -> None:
        """Raise SceneError for numbers that no spring has."""
        check_numbers(
            self.what, least={"stiffness": self.stiffness, "length": self.length, "damping": self.damping}
        )

    @classmethod
    def acting(cls, numbers: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) those (n, 3) with a stiffness or a damping."""
        return np.asarray((numbers[:, [0, 2]] > 0.0).any(axis=1))
