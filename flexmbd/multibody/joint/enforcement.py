"""Choices for a joint: coordinates or constraints, and how the constraints are enforced."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from flexmbd.errors import SceneError
from flexmbd.given import checked, is_number


class Way(Enum):
    """How a joint is carried.

    COORDINATES: by joint coordinates along the tree.
    CONSTRAINTS: by constraint rows, whether it closes a loop or not.
    """

    COORDINATES = auto()
    CONSTRAINTS = auto()


@dataclass(frozen=True)
class Multipliers:
    """Constraints hold exactly; each brings one unknown reaction."""


def _check(stiffness: float, damping: float) -> None:
    if not (is_number(stiffness) and stiffness > 0.0):
        raise SceneError(f"the stiffness of a penalty must be positive and finite, got {stiffness!r}")
    if not (is_number(damping) and damping >= 0.0):
        raise SceneError(f"the damping of a penalty must be finite and not negative, got {damping!r}")


@dataclass(frozen=True)
class Penalty:
    """Constraints yield: reaction = stiffness phi + damping d phi/dt, and no unknown.

    The gap is the reaction over the stiffness.  Rows measured in rad take both numbers times the
    square of the machine's extent.  A row that holds velocities alone takes ``damping`` alone.

    Attributes:
        stiffness: N/m, positive.
        damping: N s/m, not negative.

    Raises:
        SceneError: values outside.
    """

    stiffness: float
    damping: float = 0.0

    def __post_init__(self) -> None:
        _check(self.stiffness, self.damping)


@checked()
@dataclass(frozen=True)
class AugmentedLagrangian:
    """Constraints hold to a tolerance: reaction = nu* + stiffness phi + damping d phi/dt.

    nu* is found within each step of GeneralizedAlpha by repeated solutions, each adding what the
    stiffness makes of what the one before left open (Hestenes and Powell's iteration), until no
    row stays open by more than ``tol`` times the machine's extent (rad rows: by more than
    ``tol``).  A stiffness above mass / step^2 makes for few solutions; reactions are known to
    about tol times mass / step^2.  Other integrators solve for the reaction itself, as with
    Multipliers.

    Attributes:
        stiffness: N/m, positive; rad rows take it times the square of the machine's extent.
        damping: N s/m, not negative, alike.
        tol: the largest residual of the constraints, over the machine's extent.

    Raises:
        SceneError: values outside.
    """

    stiffness: float
    damping: float = 0.0
    tol: float = 1e-9

    def __post_init__(self) -> None:
        _check(self.stiffness, self.damping)
        if not 1e-15 < self.tol < 1.0:
            raise SceneError(f"tol of an augmented Lagrangian must lie between 1e-15 and 1, got {self.tol!r}")


Enforcement = Multipliers | Penalty | AugmentedLagrangian
