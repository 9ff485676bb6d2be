"""What the machine asks of a joint."""

from __future__ import annotations

from typing import Protocol

from flexmbd.rotation import Axis

#: A scalar loop constraint: kind (layout.ROW_*), index, and its name in messages.
Row = tuple[int, int, str]


class Joint(Protocol):
    """A joint between a frame F on the parent and a frame G on the child.

    Its coordinates describe G against F; positive along or about the axis, right-handed.
    """

    @property
    def kind(self) -> int:
        """Kernel code (layout.FIXED, ...)."""

    @property
    def axis(self) -> Axis:
        """The axis in both frames; "z" where the joint has none."""

    @property
    def start(self) -> tuple[float, ...]:
        """Coordinates with G on F: zeros, and (1, 0, 0, 0) for a quaternion."""

    @property
    def velocity_names(self) -> tuple[str, ...]:
        """Names of the joint velocities, in order."""

    @property
    def angular(self) -> tuple[bool, ...]:
        """Whether each joint velocity is an angular one (rad/s) or a linear one (m/s)."""

    @property
    def rows(self) -> tuple[Row, ...]:
        """The constraints that close a loop with this joint; the axis laid along z."""

    @property
    def reversible(self) -> bool:
        """Whether the tree may run from child to parent with the same coordinates."""
