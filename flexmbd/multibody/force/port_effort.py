"""What the effort of a port does to its body: forces on the modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexmbd.errors import SceneError
from flexmbd.given import is_number, refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.force.protocol import ElementTable, OffJoints
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.kernels.elements.modal_force import MODAL_FORCE


@dataclass(frozen=True, eq=False)
class PortEffort(OffJoints):
    """The effort of a port, as an electrode's voltage: forces (load + second q) times effort on the modes.

    A scene has one for each port of its bodies, with the effort that the port is given (``port.effort``). As an input
    of a linearised machine it is made anew, with a value.

    Attributes:
        port: of a body.
        value: a number or a function of time; None: that of the port.
    """

    port: Port
    value: TimeFunction | None = None

    def __post_init__(self) -> None:
        refuse_other(self.port, Port, "what has an effort", wanted='a port, as body.port("top")')

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The body frame."""
        body: FlexibleBody = self.port.body
        return (body.frame(),)

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"{self.port.effort_name} of port {self.port.label}"

    def check(self) -> None:
        """Nothing beyond what the port has checked."""

    def assemble(self, table: ElementTable) -> None:
        """Forces on the modes, where the effort is no zero."""
        value = self.port.effort_now if self.value is None else self.value
        if isinstance(value, bool):
            raise SceneError(f"{self.what}: {value} is not a number")
        time, load, second = table.time(value, self.what), self.port.load, self.port.second
        table.effort(self.port, time)
        if load.size:
            x, v = table.modes(self.port.body)
            acts = self.value is not None or not (is_number(value) and value == 0.0)
            data = table.numbers(load if second is None else np.concatenate([load, second.ravel()]))
            place = -1 if second is None else x
            table.element(MODAL_FORCE, self.what, x=place, v=v, data=data, count=load.size, time=time, acts=acts)
