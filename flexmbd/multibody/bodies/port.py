"""Ports of a flexible body: pairs of effort and flow beside its frames, as an electrode's voltage and charge."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexmbd.errors import SceneError
from flexmbd.multibody.functions.signal import Signal
from flexmbd.record.groups import Ports

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StrainFlow:
    """The flow of a port at no effort: a measurement of states, controllers and linearised machines.

    Of a controller, or wherever a function of the machine's ``fm.Instant`` is asked for, it is called.

    Attributes:
        port: whose.
        order: 0 for the flow (C), 1 for its rate (A).
    """

    port: Port
    order: int

    @property
    def label(self) -> str:
        """Its name in messages and linearised machines."""
        return f"{'rate of ' if self.order else ''}{self.port.flow_name} of the strain at {self.port.label}"

    def __call__(self, now: Any) -> float:
        """At an instant."""
        q = now.q(self.port.body)
        if self.order == 0:
            return float(self.port.flow_of_strain(q[None])[0])
        return float(self.port.slope(q) @ now.q_rate(self.port.body))



@dataclass(frozen=True, eq=False)
class PortFlow:
    """The flow of a port, that of the strain and capacity . efforts, as a function of the machine's ``fm.Instant``.

    Attributes:
        port: whose.
    """

    port: Port

    def __call__(self, now: Any) -> float:
        """At an instant."""
        return float(now.port_flow(self.port))


@dataclass(frozen=True, eq=False)
class InducedFlow:
    """The flow that all but a port's own effort brings: the strain, and the efforts of other ports of its body.

    A circuit follows it as states: with the charge Q among them the voltage is (Q - induced) / capacity. Of a
    controller, or wherever a function of the machine's ``fm.Instant`` is asked for, it is called.

    Attributes:
        port: whose.
    """

    port: Port

    @property
    def others(self) -> list[tuple[Port, float]]:
        """The other ports with which it has a capacity, and that."""
        names, row = self.port.body.record.ports.names, self.port.body.record.ports.capacity[self.port.number]
        return [
            (self.port.body.port(name), float(row[k]))
            for k, name in enumerate(names)
            if k != self.port.number and row[k] != 0.0
        ]

    def __call__(self, now: Any) -> float:
        """At an instant."""
        return float(now.port_flow(self.port) - self.port.capacity * now.port_effort(self.port))


class Port:
    """A port of a body in a scene: its effort is given, its flow is asked for; ``body.port("top")``.

    The effort may be a number, a function of time, or a ``fm.Signal`` that a controller or states set. Where none is
    given, what is asked for is a signal of the port's own, for their inputs; where nobody sets it the effort is zero,
    which is a short circuit to the ground. The machine takes it when it is compiled.

    Attributes:
        body: whose.
        name: of the port.
        number: its place among the body's ports, from 0.
    """

    def __init__(self, body: Any, ports: Ports, name: str) -> None:
        """Not for users, who ask ``body.port(name)``.

        Raises:
            SceneError: the body has no such port.
        """
        if name not in ports.names:
            there = ", ".join(map(repr, ports.names))
            raise SceneError(f"body {body.name!r} has no port {name!r}; it has: {there}")
        self.body = body
        self.name, self.number, self._ports = name, ports.names.index(name), ports
        self._given: Any = None
        self._driving: Any = None
        self._signal: Signal | None = None

    def __repr__(self) -> str:
        """Its body and name, and the units of effort and flow."""
        units = f"{self._ports.effort_units[self.number]}, {self._ports.flow_units[self.number]}"
        return f"Port({self.label!r}: {self.effort_name}, {self.flow_name}; {units})"

    @property
    def label(self) -> str:
        """Body and port."""
        return f"{self.body.name or 'flexible body'}.{self.name}"

    @property
    def effort_name(self) -> str:
        """What the effort is called, as "voltage"."""
        return self._ports.efforts[self.number]

    @property
    def flow_name(self) -> str:
        """What the flow is called, as "charge"."""
        return self._ports.flows[self.number]

    @property
    def load(self) -> FloatArray:
        """(n,) force on each modal coordinate per unit effort, undeformed; flow per unit modal coordinate."""
        return self._ports.load[self.number]

    @cached_property
    def second(self) -> FloatArray | None:
        """(n, n) by which that grows with the modal coordinates, symmetric; None where it does not.

        An effort does its work on the strain, which has a part of second order in the modes' rotations
        (`ModalStretch`): a bent arm is not stretched, though its membrane modes move. So a voltage also stiffens or
        softens.
        """
        stretch = self.body.record.stretch
        if stretch is None or not len(stretch.strain):
            return None
        shares = stretch.strain @ (self.load / self.body.record.stiffness)
        found: FloatArray = np.tensordot(shares, stretch.P, 1)
        return 0.5 * (found + found.T)

    def slope(self, q: FloatArray) -> FloatArray:
        """(n,) derivative of the strain's flow by the modal coordinates q (n,)."""
        return self.load if self.second is None else self.load + self.second @ q

    def flow_of_strain(self, q: FloatArray) -> FloatArray:
        """(nt,) flow at no effort, at modal coordinates q (nt, n): load . q + q . second q / 2."""
        flow: FloatArray = q @ self.load
        return flow if self.second is None else flow + 0.5 * np.einsum("ti,ij,tj->t", q, self.second, q)

    @property
    def capacity(self) -> float:
        """Flow per own effort while the modes rest, as C/V = F."""
        return float(self._ports.capacity[self.number, self.number])

    @property
    def effort(self) -> Any:
        """The effort that is given, a number, a function of time or a signal; else a new signal, which then is it."""
        if self._given is None:
            self._signal = Signal(f"{self.effort_name} of {self.label}")
            self._given = self._signal
        return self._given

    @effort.setter
    def effort(self, value: Any) -> None:
        self._given = value

    def drive(self, function: Any) -> None:
        """Let a function of time be the effort for now, whatever is given; None: no longer."""
        self._driving = function

    @property
    def effort_now(self) -> Any:
        """The same, and zero where neither was an effort given nor a signal asked for."""
        if self._driving is not None:
            return self._driving
        return 0.0 if self._given is None else self._given

    @property
    def is_free(self) -> bool:
        """Whether no effort is given, and a signal of the port's own may be set."""
        return self._given is None or self._given is self._signal

    @property
    def flow(self) -> PortFlow:
        """The flow, as a measurement of controllers and wherever a function of ``fm.Instant`` may stand."""
        return PortFlow(self)

    @property
    def induced_flow(self) -> InducedFlow:
        """What the strain and the efforts of other ports make of the flow; what states follow that set the effort."""
        return InducedFlow(self)

    @property
    def strain_flow(self) -> StrainFlow:
        """The part of the flow that the deformation makes."""
        return StrainFlow(self, 0)

    @property
    def strain_flow_rate(self) -> StrainFlow:
        """Its rate: of a short-circuited electrode the current (A)."""
        return StrainFlow(self, 1)

    @property
    def voltage(self) -> Any:
        """The effort (V) of an electrode; ``inputs=[port.voltage]`` of states and controllers."""
        self._refuse_other("voltage")
        return self.effort

    @voltage.setter
    def voltage(self, value: Any) -> None:
        self._refuse_other("voltage")
        self.effort = value

    @property
    def charge(self) -> PortFlow:
        """The flow (C) of an electrode."""
        self._refuse_other("charge")
        return self.flow

    @property
    def induced_charge(self) -> InducedFlow:
        """The charge (C) that the strain and the voltages of other electrodes bring; what a circuit's states follow."""
        self._refuse_other("charge")
        return self.induced_flow

    @property
    def strain_charge(self) -> StrainFlow:
        """The part of the charge (C) that the deformation makes: all of it where no electrode has a voltage."""
        self._refuse_other("charge")
        return self.strain_flow

    @property
    def strain_current(self) -> StrainFlow:
        """The rate of that (A): the current of an electrode in short circuit."""
        self._refuse_other("charge")
        return self.strain_flow_rate

    def _refuse_other(self, asked: str) -> None:
        if asked not in (self.effort_name, self.flow_name):
            raise SceneError(
                f"port {self.label!r} has no {asked}: its effort is the {self.effort_name}, its flow the "
                f"{self.flow_name}; ask for effort, flow and strain_flow"
            )
