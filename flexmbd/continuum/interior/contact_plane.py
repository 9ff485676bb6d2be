"""Contact of nodes with a rigid plane at rest, for central differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.continuum.interior.nodal_push import penalty_stiffness, push
from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.record.groups import frozen
from flexmbd.round_off import SAME_PLACE

FloatArray = NDArray[np.float64]



@checked()
@dataclass(frozen=True, eq=False)
class RigidPlane:
    """A plane that nodes may leave and not pass, with Coulomb friction.

    With a penalty a node at the depth d is pushed back by m penalty d / h_0^2, which keeps its energy; h_0 is the
    stable step of the undeformed body in contact, so that the push is the same function of d whatever the steps.
    It is sqrt(1 - penalty / 4) of the stable step without contact.  With none the push is the
    one that ends the step on the plane: no depth, no change of the stable step, and the energy with which the
    single node arrived is lost (that of half a cell's layer, which falls as the mesh is refined).

    Attributes:
        point: (3,) m, on the plane, in inertial axes.
        normal: (3,) towards the side where the body is; of any length.
        friction: Coulomb's coefficient, at least 0.
        penalty: between 0 and 3, dimensionless; None for none.
        name: in messages.

    Raises:
        SceneError: a value is not a finite number of that shape or outside its range; the normal is zero.
    """

    point: ArrayLike
    normal: ArrayLike
    friction: float = 0.0
    penalty: float | None = 0.5
    name: str = "plane"

    def __post_init__(self) -> None:
        for item in ("point", "normal"):
            value = np.asarray(getattr(self, item), dtype=float)
            if value.shape != (3,) or not np.isfinite(value).all():
                raise SceneError(f"{self.name}: {item} must be three finite numbers, got {getattr(self, item)!r}")
            object.__setattr__(self, item, frozen(value))
        normal = np.asarray(self.normal)
        if not normal.any():
            raise SceneError(f"{self.name}: its normal is zero; give the direction towards the body")
        object.__setattr__(self, "normal", frozen(normal / np.linalg.norm(normal)))
        if not 0.0 <= self.friction < float("inf"):
            raise SceneError(f"{self.name}: friction must be finite and at least 0, got {self.friction!r}")
        if self.penalty is not None and not 0.0 < self.penalty < 3.0:
            raise SceneError(f"{self.name}: penalty must be None or between 0 and 3, got {self.penalty!r}")

    def stiffness(self, h: float) -> float:
        """The penalty stiffness per mass of a node, 1/s^2; zero without penalty.

        Args:
            h: stable step of the undeformed body without contact, s.
        """
        return penalty_stiffness(self.penalty, h)

    def depth(self, x: FloatArray) -> FloatArray:
        """(n,) m, by which nodes at x (n, 3) are behind the plane; negative in front of it."""
        depth: FloatArray = (np.asarray(self.point) - x) @ np.asarray(self.normal)
        return depth

    def check_start(self, deepest: float, size: float) -> None:
        """Refuse a body that is behind the plane.

        Raises:
            SceneError: names the plane and the depth.
        """
        if deepest > SAME_PLACE * size:
            raise SceneError(
                f"{self.name}: the body begins {deepest:.4g} m behind it; move one of them, or turn the normal"
            )

    def push(
        self, x: FloatArray, v: FloatArray, a: FloatArray, *, h: float, reach: float, stiffness: float
    ) -> tuple[FloatArray, FloatArray]:
        """Accelerations (n, 3) m/s^2 of nodes at x (n, 3) m, normal to the plane and along it; see `nodal_push`."""
        depth, normal, friction = self.depth(x), np.asarray(self.normal), self.friction
        return push(depth, normal, v, a, h=h, reach=reach, stiffness=stiffness, friction=friction)
