"""An elasto-plastic spring from point to point."""

from __future__ import annotations

from dataclasses import dataclass

from numpy.typing import ArrayLike

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable, check_numbers
from flexmbd.multibody.force.yield_curve import yield_curve
from flexmbd.multibody.kernels.elements.memory_law import ELASTOPLASTIC_LINE


@dataclass(frozen=True, eq=False)
class PlasticSpring(BetweenFrames):
    """Resists the elongation L - length of the line between two frames along a measured curve, as PlasticJointSpring.

    Attributes:
        frame_F, frame_G: its ends.
        deformation: (n,) m, growing; the first piece, from 0, is elastic, and the last goes on.
        force: (n,) N, never falling.
        length: m, at which it is slack before it yields.
        kinematic: share of kinematic hardening, 0 to 1.
    """

    frame_F: Frame
    frame_G: Frame
    deformation: ArrayLike
    force: ArrayLike
    length: float
    kinematic: float = 1.0

    def check(self) -> None:
        """Raise SceneError for points that are no yield curve, or a wrong rest length."""
        check_numbers(self.what, positive={"length": self.length})
        yield_curve(self.deformation, self.force, self.kinematic, self.what)

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        f, g = table.frame(self.frame_F), table.frame(self.frame_G)
        curve = yield_curve(self.deformation, self.force, self.kinematic, self.what)
        law, memory = curve.law_numbers(self.kinematic), curve.memory()
        data = table.numbers([self.length, law.size, *law])
        place = table.memory(memory)
        table.element(ELASTOPLASTIC_LINE, self.what, f=f, g=g, data=data, count=len(memory), memory=place)
