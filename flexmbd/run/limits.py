"""Limits of a simulation: steps, rows that are kept, seconds."""

from __future__ import annotations

from dataclasses import dataclass, fields

from flexmbd.errors import SceneError
from flexmbd.given import is_number

#: Rows that compiled stepping leaves at most before it returns, and seconds between two looks at the clock.
MOST_ROWS = 1024
_LOOK = 0.05


@dataclass(frozen=True)
class Limits:
    """Where a simulation is broken off; None where it is not.

    Attributes:
        max_steps: accepted steps of this run.
        max_rows: rows of the trajectory, the start's and those of events included.
        max_seconds: s of the wall's clock, compiling included.

    Raises:
        SceneError: one is not positive, or counts are not whole numbers.
    """

    max_steps: int | None = None
    max_rows: int | None = None
    max_seconds: float | None = None

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            whole = one.name == "max_seconds" or isinstance(value, int)
            if value is not None and not (is_number(value) and whole and value > 0):
                kind = "positive time (s)" if one.name == "max_seconds" else "positive whole number"
                raise SceneError(f"{one.name} = {value!r} must be a {kind}")

    def reached(self, *, steps: int, rows: int, seconds: float) -> str:
        """Which limit is reached, for a message; empty where none is."""
        if self.max_steps is not None and steps >= self.max_steps:
            return f"max_steps = {self.max_steps} steps are taken"
        if self.max_rows is not None and rows >= self.max_rows:
            return f"max_rows = {self.max_rows} rows are kept"
        if self.max_seconds is not None and seconds >= self.max_seconds:
            return f"max_seconds = {self.max_seconds:g} s are over"
        return ""

    def room(self, before: int, took: float, *, steps: int, rows: int) -> int:
        """Rows that stepping may leave before the next look, after ``before`` of them ``took`` so long (s)."""
        room = MOST_ROWS
        if self.max_seconds is not None:
            room = min(MOST_ROWS, 2 * before if took < _LOOK else max(1, before // 2))
        if self.max_steps is not None:
            room = min(room, self.max_steps - steps)
        if self.max_rows is not None:
            room = min(room, self.max_rows - rows)
        return max(1, room)
