"""Efforts and flows of a port over a trajectory, and the work that comes in by it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from flexmbd.brief import brief
from flexmbd.errors import RangeWarning, warn
from flexmbd.multibody.bodies.body import FlexibleBody
from flexmbd.multibody.bodies.port import Port
from flexmbd.multibody.motion.machine import Machine
from flexmbd.multibody.motion.port_efforts import port_efforts
from flexmbd.record.groups import Ports

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PortSeries:
    """A port over time.

    Attributes:
        t: (nt,) s.
        effort: (nt,) of an electrode the voltage, V.
        flow: (nt,) of an electrode the charge, C.
    """

    t: FloatArray
    effort: FloatArray
    flow: FloatArray

    __repr__ = brief

    @cached_property
    def work(self) -> FloatArray:
        """(nt,) J that came in by the port since the first instant: effort over flow, by trapezoids."""
        steps = 0.5 * (self.effort[1:] + self.effort[:-1]) * np.diff(self.flow)
        return np.concatenate([np.zeros(1), np.cumsum(steps)])


def port_series(scene: Machine, port: Port, t: FloatArray, x: FloatArray, v: FloatArray) -> PortSeries:
    """Of a port at times t (nt,), configurations x (nt, nx), velocities v (nt, nv).

    Raises:
        SceneError: the port is of another scene, or a user's function failed.
    """
    efforts = port_efforts(scene, port.body, t, x, v)
    q = x[:, scene.index.modal(port.body).x]
    ports: Ports = port.body.record.ports
    flow = port.flow_of_strain(q) + efforts @ ports.capacity[port.number]
    return PortSeries(t.copy(), efforts[:, port.number].copy(), flow)


def energy_of_ports(scene: Machine, t: FloatArray, x: FloatArray, v: FloatArray) -> FloatArray:
    """(nt,) J that bodies store by the efforts of their ports beside their strain: efforts . capacity efforts / 2."""
    total = np.zeros(len(t))
    for port in scene.index.efforts:
        if port.number == 0:
            efforts = port_efforts(scene, port.body, t, x, v)
            total += 0.5 * np.einsum("ti,ij,tj->t", efforts, port.body.record.ports.capacity, efforts)
    return total


def tell_stress_of_modes(scene: Machine, body: FlexibleBody, t: FloatArray, x: FloatArray, v: FloatArray) -> None:
    """Warn with a RangeWarning where a body's stress is asked for at an effort, whose own stress the modes have not."""
    if body.record.ports is None:
        return
    efforts = port_efforts(scene, body, t, x, v)[0]
    if efforts.any():
        told = ", ".join(
            f"{name} {value:.4g} {unit}"
            for name, value, unit in zip(body.record.ports.names, efforts, body.record.ports.effort_units, strict=True)
        )
        warn(
            f"flexible body {body.name!r}: its stress is that of its modes, in short circuit, and lacks what the "
            f"efforts of its ports make by themselves ({told}); take it where they are zero",
            RangeWarning,
        )
