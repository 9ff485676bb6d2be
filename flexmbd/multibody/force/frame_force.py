"""A given force and torque on a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import is_list, is_number
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.point_mass import refuse_turn
from flexmbd.multibody.force.protocol import ElementTable, OffJoints
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.kernels.elements.element import ElementKind
from flexmbd.multibody.kernels.elements.given_wrench import GIVEN_IN_F, GIVEN_IN_G


class Axes(Enum):
    """Whose axes a given force keeps to."""

    WORLD = 0
    FRAME = 1

    @property
    def element(self) -> ElementKind:
        """The kernels' element of this force."""
        return GIVEN_IN_F if self is Axes.WORLD else GIVEN_IN_G


@dataclass(frozen=True, eq=False)
class FrameForce(OffJoints):
    """A force at a frame's origin and a torque, each component a number or a function of time (s).

    Attributes:
        frame: where they act.
        force: (3,) N.
        torque: (3,) N m.
        axes: whose axes the components are in: inertial ones, or those of the moving frame.
    """

    frame: Frame
    force: Sequence[TimeFunction] = (0.0, 0.0, 0.0)
    torque: Sequence[TimeFunction] = (0.0, 0.0, 0.0)
    axes: Axes = Axes.WORLD

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The frame."""
        return (self.frame,)

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"FrameForce on {self.frame.label}"

    def check(self) -> None:
        """Raise SceneError unless there are three components of each, numbers finite, along axes that there are."""
        if not isinstance(self.axes, Axes):
            raise SceneError(
                f"{self.what}: axes must be fm.force.Axes.WORLD or fm.force.Axes.FRAME, got {type(self.axes).__name__}"
            )
        for name in ("force", "torque"):
            given = getattr(self, name)
            if not isinstance(given, Sequence | np.ndarray) or not is_list(given) or len(given) != 3:
                raise SceneError(f"{self.what}: {name} takes three components, got {given!r:.100}")
        if not all(map(is_number, [c for c in (*self.force, *self.torque) if isinstance(c, (int, float))])):
            raise SceneError(f"{self.what}: a component is not a finite number")
        if not all(isinstance(c, (int, float)) and c == 0.0 for c in self.torque):
            refuse_turn(self.frame, f"{self.what}: a torque")

    def assemble(self, table: ElementTable) -> None:
        """One row for all numbers, and one for each function of time."""
        g, ground = table.frame(self.frame), table.ground()
        components = [*self.force, *self.torque]
        fixed = np.array([c if isinstance(c, (int, float)) else 0.0 for c in components])
        acts = bool(fixed.any())
        if acts or all(isinstance(c, (int, float)) for c in components):
            table.element(self.axes.element, self.what, f=ground, g=g, data=table.numbers(fixed), acts=acts)
        for unit, component, name in zip(np.eye(6), components, _NAMES, strict=True):
            if not isinstance(component, (int, float)):
                time = table.time(component, f"{name} of {self.what}")
                table.element(self.axes.element, self.what, f=ground, g=g, data=table.numbers(unit), time=time)


_NAMES = [f"{kind} {axis}" for kind in ("force", "torque") for axis in "xyz"]
