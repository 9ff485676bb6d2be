"""Errors that end a simulation early, with the trajectory up to then."""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexmbd.errors import FlexmbdError

if TYPE_CHECKING:
    from flexmbd.run.trajectory import Trajectory


class SimulationInterrupted(KeyboardInterrupt):
    """A simulation was interrupted, as by Ctrl-C; ``trajectory`` holds what was computed up to then.

    No FlexmbdError: what catches errors lets an interrupt pass.
    """

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[type[SimulationInterrupted], tuple[str, Trajectory]]:
        """For pickle, which does not know of the trajectory."""
        return type(self), (str(self), self.trajectory)


class SimulationError(FlexmbdError):
    """A simulation stopped early; ``trajectory`` holds what was computed up to then.

    Remedy: the message says when and where it stopped and what to look for; plot the last rows of the trajectory.
    """

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[type[SimulationError], tuple[str, Trajectory]]:
        """For pickle, which does not know of the trajectory."""
        return type(self), (str(self), self.trajectory)
