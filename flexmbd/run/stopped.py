"""Errors that end a simulation early, with the trajectory up to then."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexmbd.errors import FlexmbdError

if TYPE_CHECKING:
    from flexmbd.run.trajectory import Trajectory


class SimulationInterrupted(KeyboardInterrupt):
    """A simulation was interrupted, as by Ctrl-C; ``trajectory`` holds the motion up to then.

    No FlexmbdError: what catches errors lets an interrupt pass.
    """

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[type[SimulationInterrupted], tuple[str, Trajectory]]:
        """For pickle, which does not know of the trajectory."""
        return type(self), (str(self), self.trajectory)


class SimulationError(FlexmbdError):
    """A simulation stopped early; ``trajectory`` holds the motion up to then.

    Remedy: the message says when and where it stopped and what to look for; plot the last rows of the trajectory.
    """

    def __init__(self, message: str, trajectory: Trajectory) -> None:
        super().__init__(message)
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[type[SimulationError], tuple[str, Trajectory]]:
        """For pickle, which does not know of the trajectory."""
        return type(self), (str(self), self.trajectory)


def rows_before(trajectory: Trajectory, row: int) -> Trajectory:
    """The trajectory's rows before ``row``."""
    t = trajectory.t[:row]
    parts = {name: getattr(trajectory, name)[:row] for name in ("x", "v", "a", "row_multipliers", "interior_rows")}
    kept = tuple(c for c in trajectory.checkpoints if c.t <= t[-1])
    events = tuple(e for e in trajectory.events if e.row < row)
    departures = tuple(d for d in trajectory.departures if d.row < row)
    return replace(trajectory, t=t, events=events, checkpoints=kept, departures=departures, **parts)
