"""A body without rotation: a mass at a point."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number
from flexmbd.multibody.bodies.body import Frame, RigidBody, marker
from flexmbd.multibody.bodies.shape import Shape
from flexmbd.multibody.bodies.solid import Solid

FloatArray = NDArray[np.float64]

_FIXED = ("inertia", "com", "as_measured")


@dataclass(eq=False)
class PointMass(RigidBody):
    """A mass at a point: no inertia, no orientation, three translations at most.

    ``fm.joint.Translation`` lets it fly, ``PlanarPoint`` and ``Prismatic`` lead it on a plane and on a line, ``Fixed``
    and ``Spherical`` carry it on another body; of a joint's constraints those on its place alone hold it.  What would
    turn it is refused by name.

    Attributes:
        mass: kg, positive.  It may be changed later: a scene takes its value when it is compiled.
        name: given by ``System.add``.
        shape: what pictures show of it; it does not turn, unless what carries it does.

    Raises:
        SceneError: a mass that is none.
    """

    inertia: ArrayLike = field(default=(0.0, 0.0, 0.0), init=False, repr=False)
    com: tuple[float, ...] = field(default=(0.0, 0.0, 0.0), init=False, repr=False)
    as_measured: bool = field(default=False, init=False, repr=False)

    def __setattr__(self, name: str, value: object) -> None:
        if name in _FIXED:
            raise SceneError(f"point mass {self.name!r} has a mass alone, its {name} cannot be set; use a RigidBody")
        super().__setattr__(name, value)

    @classmethod
    @checked()
    def from_solid(cls, solid: Solid) -> PointMass:
        """The mass of a solid at a point, its centre; pictures show its outline there."""
        shape = None if solid.outline is None else Shape.of_solid(solid).moved(-solid.com)
        return cls(solid.mass, shape=shape)

    @classmethod
    def from_shape(cls, shape: Shape, *, density: float) -> PointMass:
        """The mass of a homogeneous shape, density kg/m^3, at a point, its centre, where pictures show it.

        Raises:
            SceneError: as ``RigidBody.from_shape``.
        """
        solid = RigidBody.from_shape(shape, density=density)
        return cls(solid.mass, shape=shape.moved(-np.asarray(solid.com)))

    def frame(self, p: ArrayLike = (0.0, 0.0, 0.0), *, R: ArrayLike | None = None) -> Frame:
        """Return a marker at the point with axes ``R`` (3, 3), by default those of what carries it, else the ground's.

        Raises:
            SceneError: ``p`` is not zero, for a point has no other place; or no rotation.
        """
        found = marker(self, p, R, self.name or "point mass")
        if found.p_BF_B.any():
            raise SceneError(f"frame {found.label}: a point mass has no place but its own; use a RigidBody")
        return found

    def inertias(self) -> tuple[FloatArray, FloatArray]:
        """Centre of mass (3,) and inertia (3, 3) about it: zeros.

        Raises:
            SceneError: as for the body.
        """
        if not (is_number(self.mass) and self.mass > 0.0):
            label = f"point mass {self.name!r}" if self.name else "point mass"
            raise SceneError(f"{label}: mass must be positive, got {self.mass!r}")
        return np.zeros(3), np.zeros((3, 3))

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Zeros (3,) and (3, 3): all its mass is at its frame's origin."""
        return self.inertias()


def is_point(body: object) -> bool:
    """Whether a body has a place and no orientation."""
    return isinstance(body, PointMass)


def refuse_turn(frame: Frame, what: str) -> None:
    """Raise SceneError where a frame is on a point mass; ``what`` asks for its orientation or would turn it."""
    if isinstance(frame, Frame) and is_point(frame.body):  # what is no frame others refuse
        raise SceneError(f"{what}: point mass {frame.body.name!r} has no orientation; use a RigidBody with an inertia")
