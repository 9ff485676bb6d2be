"""The interface of a joint: its steps as coordinates, its rows as constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import is_number
from flexmbd.multibody.joint.kinematic_pair import KinematicPair
from flexmbd.multibody.kernels.base import kinds
from flexmbd.rotation import Axis, z_onto

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """A scalar constraint between the joint's frames.

    Attributes:
        kind: kinds.ROW_*.
        index: which component, as the kind counts them.
        name: in messages.
        data: parameters of the kind.
        level: whether it holds positions, or velocities alone.
    """

    kind: int
    index: int
    name: str
    data: tuple[float, ...] = ()
    level: int = kinds.LEVEL_POSITION

    def __post_init__(self) -> None:
        # a user's number may be an array without axes, which is no part of a set
        object.__setattr__(self, "data", tuple(map(float, self.data)))


@dataclass(frozen=True)
class Step:
    """One of the kernels' joints on the way from F to G.

    Attributes:
        pair: how it moves.
        axis: where the z axis of the pair's frames lies in the turned frames of the joint.

    Raises:
        SceneError: the pair is none, or the axis.
    """

    pair: KinematicPair
    axis: Axis = "z"

    def __post_init__(self) -> None:
        if not isinstance(self.pair, KinematicPair):
            raise SceneError(
                f"a step is a fm.joint.KinematicPair, as fm.joint.REVOLUTE or fm.joint.screw(pitch), got {self.pair!r}"
            )
        z_onto(self.axis)  # refuses what is not an axis


#: Swaps a joint's ends without changing its coordinate: turns both frames about x by pi.
_FLIP = np.diag([1.0, -1.0, -1.0])


def step_turn(step: Step, reverse: bool) -> FloatArray:
    """(3, 3) rotation that lays the z axis of a step's own frames in those of its joint."""
    turn = z_onto(step.axis)
    return turn @ _FLIP if reverse else turn


def step_slices(steps: Sequence[Step]) -> list[tuple[slice, slice]]:
    """Where the coordinates and the velocities of each step lie among those of its joint."""
    found, x, v = [], 0, 0
    for step in steps:
        x_end, v_end = x + len(step.pair.start), v + len(step.pair.angular)
        found.append((slice(x, x_end), slice(v, v_end)))
        x, v = x_end, v_end
    return found


@runtime_checkable
class Joint(Protocol):
    """A joint between a frame F on the parent and a frame G on the child.

    Its coordinates describe G against F; positive along or about the axis, right-handed.
    """

    @property
    def turn(self) -> FloatArray:
        """(3, 3) rotation that lays the joint's own axes in both frames; steps and rows mean those."""

    @property
    def steps(self) -> tuple[Step, ...]:
        """The joints that lead from F to G in a tree, with their coordinates in order.

        None: the joint exists as constraints alone.
        """

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
        """The constraints that stand for this joint."""

    @property
    def reversible(self) -> bool:
        """Whether the tree may run from child to parent with the same coordinates."""


class AlongAxis:
    """Base of joints along or about one axis, for frozen dataclasses.

    Attributes:
        axis: "x", "y", "z" or a vector (3,).
    """

    axis: Axis

    def __post_init__(self) -> None:
        z_onto(self.axis)  # refuses what is not an axis

    @property
    def turn(self) -> FloatArray:
        """The axis as z."""
        return z_onto(self.axis)


class CarriedBySteps:
    """Base of joints that a tree can carry: coordinates follow from their steps."""

    @property
    def start(self: Joint) -> tuple[float, ...]:
        """Zeros, and (1, 0, 0, 0) for a quaternion."""
        return tuple(value for step in self.steps for value in step.pair.start)

    @property
    def angular(self: Joint) -> tuple[bool, ...]:
        """Of the coordinates that turn."""
        return tuple(turns for step in self.steps for turns in step.pair.angular)

    @property
    def reversible(self: Joint) -> bool:
        """Whether all steps are."""
        return all(step.pair.reversible for step in self.steps)


class ConstraintsAlone:
    """Base of joints without coordinates."""

    steps: ClassVar[tuple[Step, ...]] = ()
    start: ClassVar[tuple[float, ...]] = ()
    velocity_names: ClassVar[tuple[str, ...]] = ()
    angular: ClassVar[tuple[bool, ...]] = ()
    reversible: ClassVar[bool] = False


def positive(value: float, what: str) -> None:
    """Raise SceneError unless ``value`` is a finite positive number; ``what`` names it."""
    if not (is_number(value) and value > 0.0):
        raise SceneError(f"{what} must be positive and finite, got {value!r}")


#: The origin of G on the axis z of F.
ON_AXIS = (
    Row(kinds.ROW_TRANSLATION, 0, "translation x"),
    Row(kinds.ROW_TRANSLATION, 1, "translation y"),
)

#: z of G along z of F.
ALIGNED = (
    Row(kinds.ROW_DIRECTION, 2, "rotation y"),
    Row(kinds.ROW_DIRECTION, 5, "rotation x"),
)

#: The origin of G on that of F.
TOGETHER = (*ON_AXIS, Row(kinds.ROW_TRANSLATION, 2, "translation z"))

#: No rotation of G against F.
UNTURNED = (
    Row(kinds.ROW_AXIS, 0, "rotation x"),
    Row(kinds.ROW_AXIS, 1, "rotation y"),
    Row(kinds.ROW_AXIS, 2, "rotation z"),
)
