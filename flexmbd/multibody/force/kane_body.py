"""A user's own body, by its inertia and active forces in Kane's form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.multibody.bodies.body import Frame
from flexmbd.multibody.force.protocol import ElementTable, OffJoints
from flexmbd.multibody.kane.equations import Kinematics
from flexmbd.multibody.kane.inertia import InertiaAndForces, UserBody


@checked("at", "name")
@dataclass(frozen=True, eq=False)
class KaneBody(OffJoints):
    """A body of one's own at k frames of the machine, given by its inertia and active forces.

    The function gets the ``Kinematics`` of the moment (no accelerations) and gives ``inertia`` (6 k, 6 k) and
    ``active`` (6 k,), in inertial axes, force (N) and torque (N m) frame by frame.  With the frames' accelerations
    acc = (a, alpha, ...) the body exerts active - inertia acc at the frames' origins, so that it enters the equations
    as F_r + F*_r = v_r . R + w_r . T does (Kane & Levinson 1985).  What depends on velocities, w x I w and the like,
    and the body's weight, belong to ``active``.  Each frame must lie on a body with a mass of its own.

    ``run.energy()`` knows nothing of it, ``run.reaction()`` does.  Python, once each evaluation of the equations.

    Attributes:
        at: the frames.
        function: of the ``Kinematics``.
        name: in messages.
    """

    at: Sequence[Frame]
    function: Callable[[Kinematics], InertiaAndForces]
    name: str = ""

    @property
    def frames(self) -> tuple[Frame, ...]:
        """Where it is."""
        return tuple(self.at)

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"KaneBody {self.name or getattr(self.function, '__name__', '')!r}"

    def check(self) -> None:
        """Raise SceneError without frames, or unless it is a function."""
        if not self.frames:
            raise SceneError(f"{self.what}: give one frame of the machine at least")
        if not callable(self.function):
            raise SceneError(f"{self.what}: {type(self.function).__name__} is not a function of the machine's motion")

    def assemble(self, table: ElementTable) -> None:
        """One of the bodies that are solved together."""
        table.add_user_body(UserBody(self.frames, self.function, self.what))
