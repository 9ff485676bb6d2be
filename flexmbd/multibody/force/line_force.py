"""A given force along the line between two frames."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import is_number
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.kernels.elements.given_on_line import GIVEN_ON_LINE


@dataclass(frozen=True, eq=False)
class LineForce(BetweenFrames):
    """A force that pushes the origins of two frames apart along their line, as an actuator between two eyes does.

    Attributes:
        frame_F, frame_G: its ends, which must not meet, for there the line has no direction.
        value: N, positive where it lengthens the line: a number, a function of time (s), or a signal.
    """

    frame_F: Frame
    frame_G: Frame
    value: TimeFunction

    def check(self) -> None:
        """Raise SceneError for a number that is not finite."""
        if isinstance(self.value, (int, float)) and not is_number(self.value):
            raise SceneError(f"{self.what}: its value {self.value} is not a finite number")

    def assemble(self, table: ElementTable) -> None:
        """One row, with a function of time."""
        f, g, time = table.frame(self.frame_F), table.frame(self.frame_G), table.time(self.value, self.what)
        table.element(GIVEN_ON_LINE, self.what, f=f, g=g, time=time)
