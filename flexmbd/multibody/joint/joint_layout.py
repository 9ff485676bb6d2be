"""What a plan asks of a joint: found once, and of joints that are alike once for all of them."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexmbd.multibody.joint.kinematic_pair import KinematicPair
from flexmbd.multibody.joint.point_ends import rows_at_point
from flexmbd.multibody.joint.protocol import Joint, Row, step_slices, step_turn
from flexmbd.rotation import z_onto

FloatArray = NDArray[np.float64]


class LaidStep(NamedTuple):
    """A step of a joint on the way outwards.

    Attributes:
        pair: how it moves.
        x, v: where its coordinates and velocities begin among the joint's.
        end: (3, 3) turn of the axes of the frame in which it ends: the joint's outer one, or the frame of a link.
        begin: (3, 3) likewise of the frame of that link in which the next step begins; None of the last step.
    """

    pair: KinematicPair
    x: int
    v: int
    end: FloatArray
    begin: FloatArray | None


class JointLayout:
    """A joint's attributes, each computed when it is first asked for."""

    def __init__(self, joint: Joint) -> None:
        self.joint = joint

    @cached_property
    def start(self) -> tuple[float, ...]:
        """Coordinates with G on F."""
        return self.joint.start

    @cached_property
    def velocity_names(self) -> tuple[str, ...]:
        """Of its velocities."""
        return self.joint.velocity_names

    @cached_property
    def turn(self) -> FloatArray:
        """(3, 3) that lays the joint's own axes in both frames."""
        return self.joint.turn

    @cached_property
    def slides(self) -> FloatArray:
        """(3, k) along the axes of F, by how much a unit of each coordinate slides G; of joints that do not turn."""
        steps = [self.turn @ z_onto(step.axis) @ step.pair.numbers[:, 1:].T for step in self.joint.steps]
        return np.hstack([np.zeros((3, 0)), *steps])

    @cached_property
    def groups(self) -> tuple[tuple[bool, ...], tuple[int, ...]]:
        """Lengths and angles, in the order in which they come, and to which of these each velocity belongs."""
        angular = self.joint.angular
        kinds = tuple(dict.fromkeys(angular))
        return kinds, tuple(kinds.index(one) for one in angular)

    @cached_property
    def _rows(self) -> tuple[tuple[Row, ...], tuple[Row, ...]]:
        return self.joint.rows, rows_at_point(self.joint.rows)

    def rows(self, *, at_point: bool) -> tuple[Row, ...]:
        """The constraints that stand for the joint: of a point mass those on its place alone."""
        return self._rows[at_point]

    @cached_property
    def _has_steps(self) -> tuple[bool, bool]:
        has = bool(self.joint.steps)
        return has, has and not any(self.joint.angular)

    def has_coordinates(self, *, at_point: bool) -> bool:
        """Whether a tree can carry it: a point mass is turned by none."""
        return self._has_steps[at_point]

    @cached_property
    def _outwards(self) -> tuple[FloatArray, tuple[LaidStep, ...]]:
        return self._way(reverse=False)

    @cached_property
    def _inwards(self) -> tuple[FloatArray, tuple[LaidStep, ...]]:
        return self._way(reverse=True)

    def way(self, *, reverse: bool) -> tuple[FloatArray, tuple[LaidStep, ...]]:
        """(3, 3) turn of the axes of the inner frame, and the steps from there; ``reverse``: from G to F."""
        return self._inwards if reverse else self._outwards

    def _way(self, *, reverse: bool) -> tuple[FloatArray, tuple[LaidStep, ...]]:
        steps = self.joint.steps
        order = list(range(len(steps)))[:: -1 if reverse else 1]
        turns, places = [step_turn(step, reverse) for step in steps], step_slices(steps)
        found = []
        for k, after in zip(order, [*order[1:], None], strict=True):
            x, v = places[k]
            ends = (self.turn @ turns[k], None) if after is None else (turns[k], turns[after])
            found.append(LaidStep(steps[k].pair, x.start, v.start, *ends))
        return self.turn @ turns[order[0]], tuple(found)


class AlikeJoints:
    """The layouts of joints, one for all that are equal; copies and pickles know none."""

    def __init__(self) -> None:
        self._known: dict[object, JointLayout] = {}
        self._met: dict[int, tuple[Joint, JointLayout]] = {}  # by ids of joints, which live as long

    def __reduce__(self) -> tuple[type[AlikeJoints], tuple[()]]:
        """Ids are of one process."""
        return AlikeJoints, ()

    def of(self, joint: Joint) -> JointLayout:
        """The layout of a joint."""
        met = self._met.get(id(joint))
        if met is None:
            met = self._met[id(joint)] = joint, self._like(joint)
        return met[1]

    def _like(self, joint: Joint) -> JointLayout:
        try:
            found = self._known.get(joint)
        except TypeError:  # it cannot be hashed, as by an axis in a list
            return JointLayout(joint)
        if found is None:
            found = self._known[joint] = JointLayout(joint)
        return found
