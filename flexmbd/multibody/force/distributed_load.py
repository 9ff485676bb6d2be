"""A named load of a reduced body's record: a pressure or traction over part of its surface, or a temperature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.given import refuse_no_name, refuse_other
from flexmbd.multibody.bodies.body import FlexibleBody, Frame
from flexmbd.multibody.force.protocol import ElementTable, OffJoints
from flexmbd.multibody.functions.time_function import TimeFunction
from flexmbd.multibody.kernels.elements.given_wrench import GIVEN_IN_G
from flexmbd.multibody.kernels.elements.held_expansion import HELD_EXPANSION
from flexmbd.multibody.kernels.elements.modal_force import MODAL_FORCE
from flexmbd.record.reduced_body import ReducedBody

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DistributedLoad(OffJoints):
    """A named load of the record times a factor: work on the modes, and its resultants on the body frame.

    It keeps to the body's axes, and its resultants are those on the undeformed body (`DistributedLoads`).  A
    temperature has none; where its expansion is held the membrane forces change the stiffness, up to buckling.

    Attributes:
        body: a body whose record has the load.
        name: the load's.
        factor: a number or a function of time (s).
    """

    body: FlexibleBody
    name: str
    factor: TimeFunction = 1.0

    def __post_init__(self) -> None:
        """Raise SceneError for a body without a record, or a load's name that is no text."""
        refuse_other(self.body, FlexibleBody, "what a DistributedLoad acts on", wanted="a FlexibleBody")
        refuse_no_name(self.name, "the name of a load")

    @property
    def frames(self) -> tuple[Frame, ...]:
        """The body frame."""
        return (self.body.frame(),)

    @property
    def what(self) -> str:
        """Its name in messages."""
        return f"DistributedLoad {self.name!r} on {self.body.name or 'flexible body'}"

    def check(self) -> None:
        """Raise SceneError if the record has no load of that name."""
        loads = self.body.record.loads
        names = () if loads is None else loads.names
        if self.name not in names:
            there = ", ".join(map(repr, names)) or "none; name loads in the reduction"
            raise SceneError(f"{self.what}: the record has no such load; it has: {there}")

    def assemble(self, table: ElementTable) -> None:
        """A wrench on the body frame, and forces on the modes."""
        loads = self.body.record.loads
        if loads is None:
            raise SceneError(f"{self.what}: the record has no loads")
        k = loads.names.index(self.name)
        time = table.time(self.factor, f"factor of {self.what}")
        wrench = table.numbers(np.concatenate([loads.force[k], loads.moment[k]]))
        g = table.frame(self.body.frame())
        table.element(GIVEN_IN_G, self.what, f=table.ground(), g=g, data=wrench, time=time)
        modal = loads.modal[k]
        if modal.size:
            x, v = table.modes(self.body)
            table.element(
                MODAL_FORCE, self.what, v=v, data=table.numbers(modal), count=modal.size, time=time
            )
            held = _held_expansion(self.body.record, self.name, modal)
            if held.any():
                data = table.numbers(held.ravel())
                table.element(HELD_EXPANSION, self.what, x=x, v=v, data=data, count=modal.size, time=time)


def _held_expansion(record: ReducedBody, name: str, modal: FloatArray) -> FloatArray:
    """(n, n) force on the modes per unit of each, by the membrane forces of a temperature that is held; else zero."""
    n = record.n_modes
    if record.heat is None or name not in record.heat.names or record.stretch is None:
        return np.zeros((n, n))
    free = record.stretch.strain @ (modal / record.stiffness)
    return np.asarray(np.tensordot(free, record.stretch.P, 1))
