"""A user's generalised forces as a function of the whole state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from flexmbd.errors import SceneError
from flexmbd.given import checked
from flexmbd.multibody.force.protocol import ElementTable, OnState
from flexmbd.multibody.functions.callback import StateFunction
from flexmbd.multibody.functions.compiled_function import Compiled, Signature
from flexmbd.multibody.functions.switched import Switched, at_side, refuse_other_law, switch_number, switched_now
from flexmbd.multibody.kernels.elements.user_state_force import STATE_FORCE


@checked("name")
@dataclass(frozen=True, eq=False)
class StateForce(OnState):
    """Generalised forces on all velocities of the machine.

    Their work is force . v; ``CompiledScene.velocity_names``, ``index.joints`` and ``index.modes`` give the
    places of coordinates.  Called at every evaluation of the equations, several times a step: compile what is slow.

    Attributes:
        function: f(t, x (nx,), v (nv,)) -> (nv,) in Python, or ``flexmbd.compiled`` f(t, x, v, out); or
            ``flexmbd.Switched``, of forces that jump.
        name: in messages.
    """

    function: Compiled | StateFunction | Switched
    name: str = ""

    @property
    def what(self) -> str:
        """Its name in messages."""
        if isinstance(self.function, (Compiled, Switched)):
            own = self.function.name
        else:
            own = getattr(self.function, "__name__", "")
        return f"StateForce {self.name or own!r}"

    def check(self) -> None:
        """Raise SceneError unless it is a function of the state."""
        if isinstance(self.function, Switched):
            refuse_other_law(self.function, Signature.STATE, f"{self.what}: forces by t, x, v and their side")
        elif isinstance(self.function, Compiled):
            if self.function.signature is not Signature.STATE:
                raise SceneError(f"{self.what}: it must take four arguments, t, x, v and out")
        elif not callable(self.function):
            raise SceneError(f"{self.what}: {type(self.function).__name__} is not a function of t, x and v")

    def assemble(self, table: ElementTable) -> None:
        """One row with the function's address."""
        if isinstance(self.function, Switched):
            function = switched_now(self.function)
            up, down = (table.state_function(at_side(function, side), self.what) for side in (1.0, -1.0))
            side = table.side(function, partial(switch_number, function), self.what)
            table.element(STATE_FORCE, self.what, address=up, derivative=down, side=side)
            return
        table.element(STATE_FORCE, self.what, address=table.state_function(self.function, self.what))
