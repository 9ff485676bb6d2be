"""A user's forces on frames as a function of the machine's motion, by Kane's generalised active forces."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.multibody.force.protocol import ElementTable, OnState
from flexmbd.multibody.functions.callback import FloatArray
from flexmbd.multibody.functions.time_function import Piecewise
from flexmbd.multibody.kane.equations import Kinematics
from flexmbd.multibody.kernels.elements.user_state_force import STATE_FORCE
from flexmbd.multibody.motion.machine import Contribution, Machine


@checked("name")
@dataclass(frozen=True, eq=False)
class KaneForce(OnState):
    """Forces and torques on frames that follow from the motion: F_r = v_r . F + w_r . T.

    The function gets the ``Kinematics`` of the moment (t, positions, rotations, velocities of any frame, joint
    coordinates, modal coordinates; no accelerations) and gives (frame, force (3,) N, torque (3,) N m) for each frame
    that it acts on, in inertial axes.  A body of one's own is a ``RigidBody`` with the constant part of its mass, and
    a ``KaneForce`` with what else its inertia does, with the opposite sign of what it asks: a rotor spun inside it
    at a given speed, a store that loses mass.  Python, once each evaluation of the equations.

    Attributes:
        function: of the ``Kinematics``.
        name: in messages.
    """

    function: Callable[[Kinematics], Iterable[Contribution]]
    name: str = ""

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"KaneForce {self.name or getattr(self.function, '__name__', '')!r}"

    def check(self) -> None:
        """Raise SceneError unless it is a function."""
        if not callable(self.function):
            raise SceneError(f"{self.what}: {type(self.function).__name__} is not a function of the machine's motion")

    def assemble(self, table: ElementTable) -> None:
        """Add a function of the state that calls the user's with the motion of that state."""
        forces = _Forces(self.function)
        table.when_built(forces.build)
        breaks = self.function.breaks if isinstance(self.function, Piecewise) else ()
        address = table.state_function(Piecewise(forces, breaks), self.what)
        table.element(STATE_FORCE, self.what, address=address)
        table.add_wrench_source(forces)


class _Forces:
    """The user's forces as a function of the machine's state; ``build`` comes first."""

    def __init__(self, function: Callable[[Kinematics], Iterable[Contribution]]) -> None:
        self._function = function

    def build(self, scene: Machine) -> None:
        """Take the compiled scene."""
        self._kinematics = Kinematics(scene)

    def __call__(self, t: float, x: FloatArray, v: FloatArray) -> FloatArray:
        """Generalised forces (nv,)."""
        return self._kinematics.generalised_forces(self.wrenches(t, x, v))

    def wrenches(self, t: float, x: FloatArray, v: FloatArray) -> list[Contribution]:
        """The wrenches of the user's function."""
        return list(self._function(self._kinematics.move(t, x, v)))
