"""What a smooth and a hard contact share: a sphere, or a point, on one frame and the shape that it touches."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.point_mass import refuse_turn
from flexmbd.multibody.contact.given_contact import refuse_wrong_arguments
from flexmbd.multibody.contact.shapes import HollowSphere, Sphere, TouchedShape
from flexmbd.multibody.contact.table_shape import tables_of
from flexmbd.multibody.force.protocol import BetweenFrames
from flexmbd.multibody.force.shared_numbers import SharedNumbers, WithSharedNumbers


@dataclass(frozen=True, eq=False)
class SphereContact(BetweenFrames, WithSharedNumbers):
    """A sphere, or a point, and the shape that it touches.

    Attributes:
        shape: on frame F.
        frame_G: the frame that carries the sphere.
        radius: m; 0 of a point.
        centre: (3,) m of the sphere, in frame G's axes.
    """

    shape: TouchedShape
    frame_G: Frame
    radius: float
    centre: tuple[float, float, float]
    frame_F: Frame = field(init=False)
    kind: ClassVar[str]

    def __post_init__(self) -> None:
        refuse_wrong_arguments(self.shape, self.radius, self.centre)
        object.__setattr__(self, "frame_F", self.shape.frame)

    @property
    def what(self) -> str:
        """Its name in messages."""
        shape = type(self.shape).__name__
        place = f"({', '.join(f'{x:.6g}' for x in self.centre)}) of " if any(self.centre) else ""
        return f"{self.kind} of {self.touching} {place}{self.frame_G.label} with {shape} {self.frame_F.label}"

    @property
    def touching(self) -> str:
        """What touches, in messages."""
        return "sphere" if self.radius > 0.0 else "point"

    def refuse_turns(self) -> None:
        """Raise SceneError where what turns with its frame is on a point mass."""
        if not isinstance(self.shape, (Sphere, HollowSphere)):
            refuse_turn(self.frame_F, f"{self.what}: a {type(self.shape).__name__} turns with its frame")
        if any(self.centre):
            refuse_turn(self.frame_G, f"{self.what}: it turns with its frame")

    @property
    def shared_numbers(self) -> tuple[SharedNumbers, ...]:
        """The shape's table, if it has one."""
        return tables_of(self.shape)
