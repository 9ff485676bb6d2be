"""Beams with two interfaces as records of reduced bodies, by the discrete element method."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import flexmbd as fm
from flexmbd.beams import DiscreteFrame, discrete_body


@dataclass(frozen=True)
class _Section:
    """What a beam of the discrete element method asks of a section; a rectangle, b along y and h along z."""

    E: float
    nu: float
    rho: float
    b: float
    h: float
    orientation: tuple[float, float, float] = (0.0, 1.0, 0.0)
    Iyz: float = 0.0
    ky: float = 5.0 / 6.0
    kz: float = 5.0 / 6.0

    @property
    def A(self):
        return self.b * self.h

    @property
    def Iy(self):
        return self.b * self.h**3 / 12.0

    @property
    def Iz(self):
        return self.h * self.b**3 / 12.0

    @property
    def J(self):
        return 0.8 * (self.Iy + self.Iz)


@dataclass(frozen=True)
class Beam:
    """A bent beam from "a" over a corner to "b", its body frame on "a", on "b" or on the mean axis (None)."""

    length: float
    width: float
    height: float
    E: float
    rho: float
    modes: int
    damping: float
    frame: str | None

    def build(self):
        return fm.FlexibleBody(self.record())

    def record(self):
        return _record(self)

    def interface(self, name):
        """p, R of an interface in the body frame."""
        found = self.record().interface(name)
        return np.array(found.p_BI_B), np.array(found.R_BI)

    def in_units(self, u):
        return replace(
            self,
            length=self.length * u.length,
            width=self.width * u.length,
            height=self.height * u.length,
            E=self.E * u.force / u.length**2,
            rho=self.rho * u.mass / u.length**3,
        )


@cache
def _record(beam):
    points = {"a": (0.0, 0.0, 0.0), "corner": (0.75 * beam.length, 0.0, 0.0)}
    points["b"] = (beam.length, 0.125 * beam.length, 0.25 * beam.length)
    section = _Section(beam.E, 0.25, beam.rho, beam.width, beam.height)
    lumped = DiscreteFrame(
        points, {"beam": [("a", "corner"), ("corner", "b")]}, {"beam": section}, divisions=2
    )
    return discrete_body(
        lumped, interfaces=["a", "b"], frame=beam.frame, modes=beam.modes, damping_ratio=beam.damping
    )
