"""Connection: a joint between two frames of a scene, with its initial and prescribed motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexmbd.errors import SceneError
from flexmbd.given import numbers, refuse_other
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.bodies.point_mass import is_point
from flexmbd.multibody.functions.time_function import TimeFunction, as_row
from flexmbd.multibody.joint.enforcement import Enforcement, Way
from flexmbd.multibody.joint.joint_layout import JointLayout
from flexmbd.multibody.joint.point_ends import refuse_turned_point
from flexmbd.multibody.joint.protocol import Joint, Row, step_slices
from flexmbd.round_off import TEN_DIGITS

FloatArray = NDArray[np.float64]


@dataclass(eq=False)
class Connection:
    """A joint in a scene; made by ``System.connect``.

    Attributes:
        joint: the kind of joint.
        parent: the frame F that the coordinates are measured from.
        child: the frame G that moves against it.
        name: unique in the scene.
        way: by coordinates or by constraints; None: as the scene's topology has it.
        enforce: how its constraints are enforced; None: by multipliers, if the joint needs any.

    Raises:
        SceneError: the joint cannot go that way, now or where it is changed later.
    """

    joint: Joint
    parent: Frame
    child: Frame
    name: str
    way: Way | None = None
    enforce: Enforcement | None = None

    def __repr__(self) -> str:
        """Its name and joint."""
        return f"Connection({self.name!r}, {self.joint!r})"

    def __post_init__(self) -> None:
        self._position: FloatArray | None = None
        self._velocity: FloatArray | None = None
        self._motion: TimeFunction | None = None
        refuse_turned_point(self.joint, self.parent.body, self.child.body, self.name)
        self._check(self.way, self.enforce)

    def __setattr__(self, name: str, value: object) -> None:
        """Set an attribute; how the joint is carried is checked whenever it changes."""
        if name in ("way", "enforce") and "_motion" in self.__dict__:
            self._check(**{"way": self.way, "enforce": self.enforce, name: value})
        object.__setattr__(self, name, value)

    def copied(self) -> Connection:
        """As `copy.copy`, in a fifth of its time: each machine that is compiled keeps its joints so."""
        copied = object.__new__(type(self))
        vars(copied).update(vars(self))
        return copied

    def _check(self, way: object, enforce: object) -> None:
        if way is not None:
            refuse_other(way, Way, f"joint {self.name!r}: its way", wanted="fm.Way.COORDINATES or CONSTRAINTS")
        if enforce is not None:
            what = f"joint {self.name!r}: what enforces it"
            refuse_other(
                enforce, get_args(Enforcement), what, wanted="fm.Multipliers(), fm.Penalty(...) or AugmentedLagrangian"
            )
        if way is Way.COORDINATES and is_point(self.child.body) and any(self.joint.angular):
            raise SceneError(
                f"joint {self.name!r}: the coordinates of a {type(self.joint).__name__} turn point mass "
                f"{self.child.body.name!r}, which has no orientation; let constraints hold it"
            )
        if way is Way.COORDINATES and not self.joint.steps:
            raise SceneError(
                f"joint {self.name!r}: a {type(self.joint).__name__} has no coordinates, only constraints"
            )
        if way is Way.COORDINATES and enforce is not None:
            raise SceneError(
                f"joint {self.name!r} goes by coordinates, which leave nothing to enforce; leave out "
                "`enforce`, or ask for Way.CONSTRAINTS"
            )

    @property
    def rows(self) -> tuple[Row, ...]:
        """The constraints that stand for the joint: of a point mass those on its place alone."""
        return JointLayout(self.joint).rows(at_point=is_point(self.child.body))

    @property
    def reversible(self) -> bool:
        """Whether the tree may run from the child to the parent: a point mass has no axes to carry its rail."""
        return self.joint.reversible and not is_point(self.child.body)

    @property
    def must_be_constraints(self) -> bool:
        """Whether constraints are asked for."""
        return self.way is Way.CONSTRAINTS or self.enforce is not None

    @property
    def may_be_coordinates(self) -> bool:
        """Whether the tree may carry this joint."""
        at_point = is_point(self.child.body)
        return JointLayout(self.joint).has_coordinates(at_point=at_point) and not self.must_be_constraints

    @property
    def position(self) -> FloatArray | None:
        """Initial joint coordinates (rad or m; a quaternion where the joint has one).

        None: not set, so the start's projection may move them, and so is what None is assigned to.  Setting them takes
        a number for a joint of one coordinate.
        """
        return self._position

    @position.setter
    def position(self, value: ArrayLike | None) -> None:
        if value is None:
            self._position = None
            return
        x = self._vector(value, len(self.joint.start), "position")
        for o in _quaternions(self.joint):
            length = float(np.linalg.norm(x[o : o + 4]))
            if abs(length - 1.0) > TEN_DIGITS:
                raise SceneError(f"joint {self.name!r}: quaternion of length {length:g}, not 1")
        self._position = x if len(x) else None  # of a joint without coordinates nothing is set

    @property
    def velocity(self) -> FloatArray | None:
        """Initial joint velocities (rad/s or m/s); None: not set, as for ``position``."""
        return self._velocity

    @velocity.setter
    def velocity(self, value: ArrayLike | None) -> None:
        size = len(self.joint.velocity_names)
        v = None if value is None else self._vector(value, size, "velocity")
        self._velocity = v if size else None

    @property
    def motion(self) -> TimeFunction | None:
        """The prescribed motion, or None."""
        return self._motion

    def prescribe(self, motion: TimeFunction) -> None:
        """Prescribe the joint's coordinate (rad or m) as a function of time (s).

        Args:
            motion: a number, ``Table``, ``Sine``, a scipy ``PPoly``, ``Motion`` of three compiled
                functions, or a callable that returns (value, rate, acceleration).

        Raises:
            SceneError: the joint has not exactly one coordinate, or no such function.
        """
        if len(self.joint.velocity_names) != 1:
            raise SceneError(
                f"joint {self.name!r}: a {type(self.joint).__name__} has "
                f"{len(self.joint.velocity_names)} coordinates; only a joint with one can be "
                "prescribed"
            )
        as_row(motion, motion_name(self), motion=True)
        self._motion = motion

    def _vector(self, value: ArrayLike, size: int, what: str) -> FloatArray:
        vector = np.atleast_1d(numbers(value))
        if vector.shape != (size,) or not np.isfinite(vector).all():
            raise SceneError(
                f"joint {self.name!r}: {what} of a {type(self.joint).__name__} takes {size} "
                f"finite number(s), got {value!r}"
            )
        return vector.copy()


def motion_name(connection: Connection) -> str:
    """The name of a joint's prescribed motion, in messages."""
    return f"motion of joint {connection.name!r}"


def _quaternions(joint: Joint) -> tuple[int, ...]:
    """Where quaternions begin among the joint's coordinates."""
    places = zip(joint.steps, step_slices(joint.steps), strict=True)
    return tuple(x.stop - 4 for step, (x, _) in places if step.pair.ball)
