"""Beams given by their stiffnesses."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

import flexmbd as fm
from flexmbd.multibody.linear.working_point import WorkingPoint

Place = tuple[float, float, float]


@dataclass(frozen=True)
class Bar:
    """Stiffnesses of a section, z being the axis that `axis` of `beam` is normal to.

    Attributes:
        EA, GAy, GAz: N; infinite GAy, GAz for Kirchhoff's beam.
        GJ, EIy, EIz: N m^2.
        rho_A: kg/m.
        rho_Iy, rho_Iz: kg m.
    """

    EA: float
    GAy: float
    GAz: float
    GJ: float
    EIy: float
    EIz: float
    rho_A: float = 1.0
    rho_Iy: float = 1e-3
    rho_Iz: float = 1e-3

    def beam(
        self, points: dict[str, Place], beams: list[tuple[Any, ...]], n: int, *, y: Place = (0.0, 1.0, 0.0)
    ) -> fm.ExactBeam:
        """Beams of this bar, each of n elements, with y of the section along `y`: a section of 1 m^2 with nu = 0."""
        shear = 0.5 * self.EA
        section = SimpleNamespace(
            E=self.EA, nu=0.0, rho=self.rho_A, A=1.0, Iy=self.EIy / self.EA, Iz=self.EIz / self.EA, Iyz=0.0,
            J=self.GJ / shear, ky=self.GAy / shear, kz=self.GAz / shear, orientation=y,
        )  # fmt: skip
        rotary = {"bar": (self.rho_Iy, self.rho_Iz)}
        return fm.ExactBeam(points, {"bar": beams}, {"bar": section}, n, rotary_inertia=rotary)


def straight(bar: Bar, length: float, n: int) -> tuple[fm.System, fm.ExactBeam]:
    """A beam along x of n elements, clamped at the origin, in a scene."""
    scene = fm.System()
    ends = {"clamp": (0.0, 0.0, 0.0), "tip": (length, 0.0, 0.0)}
    beam = scene.add(bar.beam(ends, [("clamp", "tip")], n), name="beam")
    scene.connect(fm.joint.Fixed(), scene.ground.frame(), beam.frame("clamp"))
    return scene, beam


def at_rest(scene: fm.System, *, steps: int = 1) -> WorkingPoint:
    """The equilibrium under loads that are functions of time, at 1, brought up in equal steps."""
    about = scene.equilibrium(t=1.0 / steps)
    for share in np.arange(2, steps + 1) / steps:
        about = scene.equilibrium(t=float(share), about=about)
    return about


def limit_load(scene: fm.System, *, to: float) -> float:
    """The factor of the loads at the first limit point of a path that would go on to `to`, and never comes there."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fm.PathWarning)
        path = scene.equilibrium(path=fm.Continuation(to=to, back_to=-1e-3 * to))
    return float(next(one.t for one in path.critical if one.kind is fm.CriticalKind.LIMIT))
