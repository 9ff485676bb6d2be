"""What the machine asks of a force element so far: a function of time on one joint velocity."""

from __future__ import annotations

from typing import Protocol

from flexmbd.multibody.connection import Connection
from flexmbd.multibody.time_function import TimeFunction


class Force(Protocol):
    """A generalised force on a joint's only coordinate."""

    @property
    def connection(self) -> Connection:
        """The joint that it drives."""

    @property
    def value(self) -> TimeFunction:
        """N m or N as a function of time."""

    def check(self) -> None:
        """Raise SceneError if the joint cannot take this force."""
