"""A universal joint: two shafts joined by a cross."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.multibody.joint.kinematic_pair import REVOLUTE
from flexmbd.multibody.joint.protocol import TOGETHER, CarriedBySteps, FloatArray, Row, Step
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis, z_onto
from flexmbd.round_off import TEN_DIGITS


@dataclass(frozen=True)
class Universal(CarriedBySteps):
    """A rotation about ``first``, fixed in F, then one about ``second``, fixed in G.

    Coordinates: the angle (rad) of the cross against F about the first axis, and that of G against
    the cross about the second.  With the defaults both shafts run along z.

    Attributes:
        first: the axis of the cross held by F: "x", "y", "z" or a vector (3,).
        second: the axis of the cross held by G, at right angles to the first where G lies on F.

    Raises:
        SceneError: an axis without direction, or axes not at right angles.
    """

    first: Axis = "x"
    second: Axis = "y"

    def __post_init__(self) -> None:
        cosine = float(z_onto(self.first)[:, 2] @ z_onto(self.second)[:, 2])
        if abs(cosine) > TEN_DIGITS:
            raise SceneError(
                f"the axes {self.first!r} and {self.second!r} of a universal joint must be at right "
                f"angles; the cosine between them is {cosine:.3g}"
            )

    steps: ClassVar[tuple[Step, ...]] = (Step(REVOLUTE), Step(REVOLUTE, "x"))
    velocity_names: ClassVar[tuple[str, ...]] = ("angle 1", "angle 2")
    rows: ClassVar[tuple[Row, ...]] = (*TOGETHER, Row(kinds.ROW_DIRECTION, 6, "right angle of the cross"))

    @property
    def turn(self) -> FloatArray:
        """The first axis as z, the second as x."""
        z, x = z_onto(self.first)[:, 2], z_onto(self.second)[:, 2]
        return np.column_stack([x, np.cross(z, x), z])
