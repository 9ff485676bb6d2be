"""Interiors of bodies with history at rest: in balance with frames that stand, and their linear equations there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_truth, numbers
from flexmbd.multibody.bodies.continuum_body import ContinuumBody, FrameMotion, Interior

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LinearInterior:
    """An interior's linear equations about the state it stands in: of its k frames' motions and n own coordinates.

        mass s'' + damping s' + stiffness s + lacking = (-w, 0),    s = (xi, y)

    xi (6 k,) are small displacements (m) of the frames' origins and small rotations (rad) of the frames, as of
    ``ImplicitInterior.trial``, in inertial axes; w (6 k,) the wrenches on the frames.  The mass of the frames is the
    machine's.

    Attributes:
        mass, damping, stiffness: (6 k + n, 6 k + n).
        lacking: (6 k + n,) with the frames at rest: minus the wrenches, and the forces that are not balanced.
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    lacking: FloatArray


@dataclass(frozen=True)
class InteriorModes:
    """How many coordinates of its own an interior gets where a machine is linearised.

    They are vibrations with the frames held, the slowest first, beside its static answer to the frames' motion.

    Attributes:
        count: the most of them; all where there are fewer.
        below_hz: leaves out those above.
    """

    count: int = 20
    below_hz: float = np.inf

    def __post_init__(self) -> None:
        """Raise SceneError unless count is a whole number from 0, and below_hz a positive frequency."""
        if is_truth(self.count) or not isinstance(self.count, int | np.integer) or self.count < 0:
            raise SceneError(f"InteriorModes: count must be a whole number, 0 or more, got {self.count!r:.100}")
        if not (numbers(self.below_hz).shape == () and numbers(self.below_hz) > 0.0):
            raise SceneError(f"InteriorModes: below_hz must be a frequency above 0 Hz, got {self.below_hz!r:.100}")


@runtime_checkable
class SteadyInterior(Interior, Protocol):
    """An interior that finds its balance with frames that do not accelerate nor turn."""

    def equilibrate(self, t: float, motion: FrameMotion) -> tuple[FloatArray, FloatArray]:
        """A trial: in balance where the frames are, from the last state committed, no mass accelerating.

        Its history goes on from the last state in one increment.

        Args:
            t: s, of the last state committed.
            motion: of the frames, whose velocities are all the same and whose angular velocities and accelerations are
                zero.

        Returns:
            As ``ImplicitInterior.trial``; of the derivative the frames' displacements alone.

        Raises:
            ConvergenceError: no balance.
        """

    def resume(self, t: float, motion: FrameMotion) -> FloatArray:
        """Go on from the state at hand at time t (s), with other accelerations of the frames.

        As ``Interior.begin``, but with positions, velocities and history as they are.

        Returns:
            (k, 6) wrenches on the frames.
        """

    def linear(self, motion: FrameMotion, modes: InteriorModes) -> LinearInterior:
        """Linear equations about the last state committed, in which the frames stand as ``motion`` says.

        Where something yields they are those of unloading, which is elastic.

        Raises:
            ConvergenceError: they cannot be had.
        """

    def commit(self) -> None:
        """Make the last trial the state."""

    def revert(self) -> None:
        """Forget all trials since the last state committed."""


def steady(body: ContinuumBody) -> SteadyInterior:
    """The body's interior.

    Raises:
        SceneError: it can only be stepped.
    """
    if not isinstance(body.interior, SteadyInterior):
        raise SceneError(
            f"body {body.name!r}: its interior, {type(body.interior).__name__}, only steps forward in time and has no "
            "tangent, so that there is neither an equilibrium nor a linear equation of it; take ImplicitContinuum on "
            "the same body, or where it stays elastic reduce it (craig_bampton)"
        )
    return body.interior
