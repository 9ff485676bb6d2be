"""A force that drives a prismatic joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from flexmbd.multibody.force.protocol import DrivesJoint
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.joint.connection import Connection


@dataclass(frozen=True, eq=False)
class JointForce(DrivesJoint):
    """A force (N) along a joint's axis: +value on the child, -value on the parent.

    Attributes:
        connection: a joint whose only coordinate is a translation.
        value: N: a number, a table, a compiled function or any callable of time (s).
    """

    connection: Connection
    value: TimeFunction

    turns: ClassVar[bool] = False
