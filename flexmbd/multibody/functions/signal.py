"""A signal: the value of a load that a controller sets while the machine runs."""

from __future__ import annotations

from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import is_number


@dataclass(frozen=True, eq=False)
class Signal:
    """A value that stands where a load takes a function of time, and that a controller or states set.

    Two signals of one name are different signals.

    Attributes:
        name: in messages, tables and plots.
        initial: its value before it is set for the first time, and in what runs no controllers: equilibria and
            linearised machines.  In the unit of the load that it stands in.

    Raises:
        SceneError: the name is empty, or the value not a finite number.
    """

    name: str
    initial: float = 0.0

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name):
            raise SceneError(f'a signal needs a name, fm.Signal("motor torque"); got {self.name!r:.60}')
        if not is_number(self.initial):
            raise SceneError(f"signal {self.name!r}: its initial value {self.initial!r:.60} is not a finite number")
