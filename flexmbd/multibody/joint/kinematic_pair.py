"""Kinematic pairs: the joints that the kernels know, as numbers.  A new one is one more entry, here or anywhere."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers
from flexmbd.multibody.kernels.base import kinds
from flexmbd.round_off import EQUAL

FloatArray = NDArray[np.float64]



@dataclass(frozen=True)
class KinematicPair:
    """A joint whose motion subspace is constant: translations in F's axes, rotations in G's.

    A joint of that kind is all of kinematics, dynamics, tangent, momenta and output at once
    (``kernels.physics.joints``); what is no pair is made of several, one after the other (``Step``).

    Attributes:
        columns: one of each coordinate that adds, in order: (turn, x, y, z), by how much a unit of it turns G about the
            z axis of F (rad) and slides G along the axes of F (m).  A coordinate that only slides is a length: its
            slide is a unit vector.  One may turn, and may slide along z as it does.
        ball: whether G turns about any axis; the quaternion of R_FG, scalar first, then follows those coordinates, and
            its angular velocity w_FG_G (rad/s) their rates.

    Raises:
        SceneError: the columns are not so, two slide along one line or at an oblique angle, or a sole coordinate does
            not lie along z, where the frames of its joint must lay it.
    """

    columns: tuple[tuple[float, float, float, float], ...] = ()
    ball: bool = False
    _numbers: FloatArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        table = numbers(self.columns).copy()
        if table.size == 0:
            table = np.zeros((0, 4))
        if table.ndim != 2 or table.shape[1] != 4 or not np.isfinite(table).all():
            raise SceneError(f"a column of a kinematic pair is four numbers (turn, x, y, z), got {self.columns!r}")
        object.__setattr__(self, "columns", tuple((float(t), float(x), float(y), float(z)) for t, x, y, z in table))
        turning = table[:, 0] != 0.0
        slides = table[~turning, 1:]
        if np.abs(slides @ slides.T - np.eye(len(slides))).max(initial=0.0) > EQUAL:
            raise SceneError(
                "the coordinates of a kinematic pair that only slide do so along unit vectors at right angles, got "
                f"columns (turn, x, y, z) {self.columns!r}"
            )
        if turning.sum() > (0 if self.ball else 1) or table[turning, 1:3].any():
            raise SceneError(
                "one coordinate of a kinematic pair may turn, about z and sliding along z alone, none of a ball; got "
                f"columns (turn, x, y, z) {self.columns!r}"
            )
        if len(table) == 1 and not self.ball and table[0, 1:3].any():
            raise SceneError(f"the sole coordinate of a kinematic pair slides along z, got {self.columns!r}")
        table.flags.writeable = False
        object.__setattr__(self, "_numbers", table)

    @property
    def numbers(self) -> FloatArray:
        """(k, 4) the columns."""
        return self._numbers

    @cached_property
    def turning(self) -> int:
        """``kinds.TURN_NONE``, ``TURN_ABOUT_Z`` or ``TURN_BALL``."""
        if self.ball:
            return kinds.TURN_BALL
        return kinds.TURN_ABOUT_Z if self._numbers[:, 0].any() else kinds.TURN_NONE

    @cached_property
    def reversible(self) -> bool:
        """Whether G seen from F and F seen from G have the same coordinates: all lie along z."""
        return not self.ball and not self._numbers[:, 1:3].any()

    @cached_property
    def start(self) -> tuple[float, ...]:
        """Coordinates with G on F."""
        return (0.0,) * len(self.columns) + ((1.0, 0.0, 0.0, 0.0) if self.ball else ())

    @cached_property
    def angular(self) -> tuple[bool, ...]:
        """Whether each velocity is an angular one (rad/s), else it is a linear one (m/s)."""
        return (*(column[0] != 0.0 for column in self.columns), *((True, True, True) if self.ball else ()))


def screw(pitch: float) -> KinematicPair:
    """A turn about z that advances along z by ``pitch`` (m/rad)."""
    return KinematicPair(((1.0, 0.0, 0.0, pitch),))


FIXED = KinematicPair()
REVOLUTE = KinematicPair(((1.0, 0.0, 0.0, 0.0),))
PRISMATIC = KinematicPair(((0.0, 0.0, 0.0, 1.0),))
SPHERICAL = KinematicPair(ball=True)
FREE = KinematicPair(((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)), ball=True)
