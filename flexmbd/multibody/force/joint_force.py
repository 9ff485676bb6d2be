"""A force that drives a prismatic joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.errors import SceneError
from flexmbd.multibody.body import Frame
from flexmbd.multibody.connection import Connection
from flexmbd.multibody.force.protocol import Table
from flexmbd.multibody.time_function import TimeFunction


@dataclass(frozen=True, eq=False)
class JointForce:
    """A force (N) about or along a joint's axis: +value on the child, -value on the parent.

    Attributes:
        connection: a joint whose only coordinate is a translation.
        value: N: a number, a table, a compiled function or any callable of time (s).
    """

    connection: Connection
    value: TimeFunction

    frames: ClassVar[tuple[Frame, ...]] = ()

    @property
    def connections(self) -> tuple[Connection, ...]:
        """The joint."""
        return (self.connection,)

    def check(self) -> None:
        """Raise SceneError if the joint's only coordinate is no translation."""
        if self.connection.joint.angular != (False,):
            raise SceneError(
                f"a joint force acts on a joint whose only coordinate is a translation; "
                f"{self.connection.name!r} is a {type(self.connection.joint).__name__}"
            )

    def lay(self, table: Table) -> None:
        """Let the function of time act on the joint's coordinate."""
        table.drive(self.connection, self.value, f"{type(self).__name__} on joint {self.connection.name!r}")
