"""A joint of chosen free axes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.joint.kinematic_pair import FIXED, PRISMATIC, REVOLUTE
from flexmbd.multibody.joint.protocol import UNTURNED, CarriedBySteps, FloatArray, Row, Step
from flexmbd.multibody.kernels.base import kinds

_AXES = "xyz"


@dataclass(frozen=True)
class Generic(CarriedBySteps):
    """Translations along chosen axes of F, then rotations one after the other.

    Coordinates, in the order of the letters: displacements (m) of G from F along axes of F; then angles (rad), the
    first about an axis of F, each further one about an axis of what those before have turned, the last about an axis
    of G.  ``Generic("z", "z")`` is a cylindrical joint along z, ``Generic("", "xy")`` a universal joint,
    ``Generic("xyz", "zyx")`` leaves all six free, by yaw, pitch and roll.  With three angles the first and the last
    axis fall together where the middle one is at a right angle, where integrators fail: take ``Free`` or
    ``Spherical`` where it comes near.

    Attributes:
        translations: letters of "xyz", each at most once.
        rotations: letters of "xyz", each at most once, in the order in which they turn.

    Raises:
        SceneError: other letters, or one twice.
    """

    translations: str = ""
    rotations: str = ""

    turn: ClassVar[FloatArray] = np.eye(3)

    def __post_init__(self) -> None:
        for name, given in (("translations", self.translations), ("rotations", self.rotations)):
            if not isinstance(given, str) or len({*given} & {*_AXES}) != len(given):
                raise SceneError(
                    f"the {name} of a Generic joint are letters of 'xyz', each at most once, as 'xz'; got {given!r:.60}"
                )

    @property
    def steps(self) -> tuple[Step, ...]:
        """A slide along each free axis, then a hinge about each."""
        slides = [Step(PRISMATIC, axis) for axis in self.translations]
        hinges = [Step(REVOLUTE, axis) for axis in self.rotations]
        return (*slides, *hinges) or (Step(FIXED),)

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """Of displacements, then angles."""
        slides = [f"displacement {axis}" for axis in self.translations]
        return (*slides, *(f"angle {axis}" for axis in self.rotations))

    @property
    def rows(self) -> tuple[Row, ...]:
        """No displacement along the other axes; the axes of G keep the directions that the free turns leave them."""
        held = [k for k, axis in enumerate(_AXES) if axis not in self.translations]
        places = [Row(kinds.ROW_TRANSLATION, k, f"translation {_AXES[k]}") for k in held]
        return (*places, *_unturned(self.rotations))


def _unturned(rotations: str) -> tuple[Row, ...]:
    """The rows that leave these turns free."""
    turning = [_AXES.index(axis) for axis in rotations]
    if not turning:
        return UNTURNED
    if len(turning) == 1:  # the axis of G along that of F
        own = turning[0]
        across = [k for k in range(3) if k != own]
        return tuple(_right_angle(k, own) for k in across)
    return (_right_angle(*turning),) if len(turning) == 2 else ()


def _right_angle(of_F: int, of_G: int) -> Row:
    """Axis ``of_F`` of F at right angles to axis ``of_G`` of G."""
    return Row(kinds.ROW_DIRECTION, 3 * of_F + of_G, f"right angle of {_AXES[of_F]} to {_AXES[of_G]}")
