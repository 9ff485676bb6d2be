"""Groups of shapes that touch each other without entering: each pair by the points that are found in each step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.bodies.body import Body, Frame
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.contact.hard_contact import Hard
from flexmbd.multibody.contact.shapes import ConvexPolytope, TouchShape, Vertex
from flexmbd.multibody.contact.table_shape import refuse_table
from flexmbd.multibody.force.protocol import BetweenFrames, ElementTable


@dataclass(frozen=True, eq=False)
class HardGroup(BetweenFrames):
    """Shapes of a list each of which touches those of another; ``System.touch`` makes it.

    Attributes:
        one, other: the lists; they may be the same.
        law: of impacts and friction.
        joined: pairs of bodies that do not touch each other.
    """

    one: tuple[TouchShape, ...]
    other: tuple[TouchShape, ...]
    law: Hard
    joined: tuple[tuple[Body, Body], ...] = ()
    frame_F: Frame = field(init=False)
    frame_G: Frame = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "frame_F", self.one[0].frame)
        object.__setattr__(self, "frame_G", self.other[-1].frame)

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Of all its shapes."""
        return tuple(shape.frame for shape in self.shapes)

    @property
    def shapes(self) -> tuple[TouchShape, ...]:
        """All of both lists, each once."""
        return tuple({id(shape): shape for shape in (*self.one, *self.other)}.values())

    @property
    def what(self) -> str:
        """Its name in messages."""
        sizes = f"{len(self.one)} and {len(self.other)}" if self.one != self.other else f"{len(self.one)}"
        first, last = self.one[0], self.other[-1]
        ends = f"{type(first).__name__} {first.frame.label} to {type(last).__name__} {last.frame.label}"
        return f"hard contact of {sizes} shapes, {ends}"

    def check(self) -> None:
        """Raise SceneError for a law that is none, shapes that spheres alone touch, on a point mass, or on one body."""
        self.law.check(self.what)
        for shape in self.shapes:
            refuse_table(shape)
            if is_point(shape.frame.body):
                raise SceneError(f"{self.what}: {shape.frame.label} is a point mass, which has no contacts")
        if len({id(shape.frame.body) for shape in self.shapes}) < 2:
            raise SceneError(f"{self.what}: all are on one body, and never touch")

    def assemble(self, table: ElementTable) -> None:
        """One row."""
        numbers = [_numbers(shape) for shape in self.shapes]
        table.hard_group(self.what, self.frames, law=self.law.numbers, numbers=np.concatenate(numbers))


def _numbers(shape: TouchShape) -> np.ndarray:
    if isinstance(shape, ConvexPolytope):
        return np.asarray(shape.polytope.vertices, float).ravel()
    return np.zeros(0) if isinstance(shape, Vertex) else shape.numbers()
